//! Readers and writers of files: cameras, meshes, motion capture. Cameras and motions are metres once loaded; meshes stay in
//! the unit of their file.

pub mod bodies;
pub mod cameras;
mod fields;
pub mod landmarks;
pub mod meshes;
pub mod mocap;

pub use cameras::{CameraFile, LoadCameraError, load_camera};
pub use landmarks::{LoadLandmarksError, load_landmarks};
pub use meshes::{LengthUnit, LoadMeshError, MeshFile, WriteMeshError, load_mesh, write_obj};
