//! Readers and writers of files: cameras, meshes, motion capture. Everything is metres once loaded, unless said.

pub mod bodies;
pub mod cameras;
mod fields;

pub use cameras::{CameraFile, LoadCameraError, load_camera};
