//! The human body as a model: skeleton, joint limits, pose, skinned template, shape space.
//!
//! It knows nothing of images, filters or GPUs.
//!
//! # Conventions
//! Metres and radians. World: right-handed, z up. Body frame (rest mesh): y up, faces +z, its left at +x.
//! At rest (the A-pose: arms about 45 degrees down) every joint frame is aligned with the body frame and all angles are 0.
//! `f64` for poses, `f32` for vertices.
//! # Map
//! [`skeleton`] joints, degrees of freedom, limits · [`pose`] angles and forward kinematics · [`model`] template and shape
//! space, bodies · [`skin`] posed vertices · [`camera`] · [`ik`] · [`mocap`] recorded motion · [`retarget`] its
//! poses on our skeleton · [`pose_prior`] what they say of poses and steps · [`io`] files · [`mesh`] nearest points,
//! crossings · [`register`] template onto scan · [`build`] makes model and prior from data, [`asset`] and [`container`] their files
//! # References
//! The keys in brackets, such as `[NorkinWhite2016]`, are listed in `docs/papers.md`.

pub mod asset;
pub mod build;
pub mod camera;
mod camera_lens;
pub mod container;
pub mod ik;
pub mod io;
pub mod mesh;
pub mod mocap;
pub mod model;
pub mod pose;
pub mod pose_prior;
pub mod register;
pub mod retarget;
pub mod skeleton;
pub mod skin;
#[cfg(test)]
mod test_data;

pub use camera::{Camera, Intrinsics};
pub use model::{Body, BodyModel, Sex};
pub use pose::{JointTransforms, Pose, RestJoints};
pub use skeleton::{Dof, Joint, JointId, N_DOF, N_JOINTS, Skeleton};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
