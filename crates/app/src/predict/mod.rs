//! Poses straight from a mask: what a mixture of experts, trained on masks with known poses, says of a new one.
//!
//! A [`PosePredictor`] describes the mask, and its experts answer with a density over heading and pose
//! ([`PoseDensity`]): to be sampled, to weigh a pose by, to take a few modes from. The answer is a [`ViewedPose`], which
//! becomes a pose in the world with the place of camera and pelvis. [`LatentPoses`] are few coordinates for poses, whose
//! [`LatentDynamics`] say how they go on; [`TransitionPredictor`] says how they do given the next mask.

mod descriptor;
mod dynamics;
mod file;
mod latent;
mod pose_space;
mod predictor;
mod shipped;
mod transition;
mod viewed;

pub use descriptor::{MaskDescriptor, person_in};
pub use dynamics::{DynamicsError, LatentDynamics};
pub use file::LoadPredictorError;
pub use latent::{LatentPoses, LoadLatentError};
pub use pose_space::PoseSpace;
pub use predictor::{NotTrainedFor, PoseDensity, PoseMode, PosePredictor, Training};
pub use shipped::Activity;
pub use transition::TransitionPredictor;
pub use viewed::{ROW_LEN as MAX_POSE_DIM, ViewedPose, wrapped};

#[cfg(test)]
mod tests;
