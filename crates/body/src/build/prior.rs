//! Makes the pose prior from a folder of motion capture clips.

use std::path::Path;

use crate::io::mocap::{LoadIndexError, LoadMocapError, load_index, load_indexed_clip};
use crate::pose::RestJoints;
use crate::pose_prior::{LearnPriorError, PosePrior, PosePriorConfig};
use crate::retarget::{Motion, RetargetClipError, RetargetConfig, RetargetError, retarget};

/// Source and terms of the recordings, as their database asks.
pub const CMU_NOTICE: &str = "\
The data used in this project was obtained from mocap.cs.cmu.edu. The database was created with funding from NSF EIA-0196217.

Terms of the database: \"This data is free for use in research projects. You may include this data in commercially-sold
products, but you may not resell this data directly, even in converted form.\" This file holds statistics of joint angles, no
recording. Some of the running clips were read from their conversion in the repository arpspoof/Jump (MIT licence).
";

/// Why no prior could be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BuildPriorError {
    /// The table of clips.
    #[error(transparent)]
    Index(#[from] LoadIndexError),
    /// A clip's file.
    #[error(transparent)]
    Clip(#[from] LoadMocapError),
    /// A clip's skeleton.
    #[error(transparent)]
    Retarget(#[from] RetargetClipError),
    /// The poses.
    #[error(transparent)]
    Learn(#[from] LearnPriorError),
}

/// A clip on our skeleton.
#[derive(Clone, Debug, PartialEq)]
pub struct RetargetedClip {
    /// What the person does.
    pub action: String,
    /// The poses.
    pub motion: Motion,
    /// How well they fit.
    pub error: RetargetError,
}

/// All clips of one split (`train` or `validate`) of the folder's `index.csv`, for a person with joints `rest`.
///
/// # Errors
/// [`BuildPriorError`] names the file at fault.
pub fn retargeted_clips(
    folder: &Path,
    split: &str,
    rest: &RestJoints,
    config: &RetargetConfig,
) -> Result<Vec<RetargetedClip>, BuildPriorError> {
    let index = load_index(folder)?;
    let clips = index.into_iter().filter(|entry| entry.split == split).map(|entry| {
        let (motion, error) = retarget(&load_indexed_clip(folder, &entry)?, rest, config)?;
        Ok(RetargetedClip { action: entry.action, motion, error })
    });
    clips.collect()
}

/// The prior learned from the training clips of `folder`, at the default rate and settings.
///
/// # Errors
/// [`BuildPriorError`] names the file at fault.
pub fn build_pose_prior(folder: &Path, rest: &RestJoints) -> Result<PosePrior, BuildPriorError> {
    let clips = retargeted_clips(folder, "train", rest, &RetargetConfig::default())?;
    let motions: Vec<Motion> = clips.into_iter().map(|clip| clip.motion).collect();
    Ok(PosePrior::learn(&motions, CMU_NOTICE, &PosePriorConfig::default())?)
}
