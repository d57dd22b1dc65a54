//! Readers and writers of files: cameras, meshes, motion capture. Everything is metres once loaded, unless said.

pub mod bodies;
pub mod cameras;
mod fields;
pub mod mocap;

pub use cameras::{CameraFile, LoadCameraError, load_camera};
