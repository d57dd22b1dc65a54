//! Training of pose predictors and dynamics, from masks with known poses.
//!
//! [`Examples`] come from the [`TrainingFrames`] of a sequence ([`train_on_sequence`]) or are rendered from [`Recordings`] of
//! many people. [`fit_predictor`] makes a predictor of them.

mod examples;
mod fit;
mod frames;
mod kept;
pub mod noise;
mod recorded;
pub mod render;
mod sequence;
mod transition;
pub mod validate;

pub use examples::Examples;
pub use fit::{DescriptorKind, TrainConfig, fit_predictor};
pub use frames::{STATURE_SD_M, TrainingFrames, first_markers, sequence_masks};
pub use kept::{kept_latent, kept_predictor};
pub use recorded::Recordings;
pub use sequence::{examples_of_frames, notice_of, train_on_frames, train_on_sequence};
pub use transition::{Step, fit_transitions, train_transitions};
