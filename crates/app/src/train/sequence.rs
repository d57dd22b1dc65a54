//! A predictor from the training frames of a sequence.

use std::ops::Range;

use anyhow::ensure;

use super::frames::TrainingFrames;
use super::render::turned_views;
use super::{Examples, TrainConfig, fit_predictor};
use crate::predict::{Activity, PosePredictor, Training, ViewedPose};
use crate::stage::Sequence;

/// The frames numbered `chosen` as their camera saw them, and rendered views of their poses.
///
/// # Errors
/// When none of them shows a person and has valid joints.
pub fn examples_of_frames(
    frames: &TrainingFrames<'_>,
    chosen: &[usize],
    config: &TrainConfig,
) -> anyhow::Result<Examples> {
    let sequence = frames.sequence;
    let camera = sequence.camera(&frames.camera)?;
    let mut examples = Examples::default();
    let mut poses = Vec::new();
    for &frame in chosen {
        let at = frame - sequence.train.start;
        if sequence.markers[frame].is_some() {
            let pose = &frames.motion.motion.poses[at];
            examples.push(&frames.masks[at], ViewedPose::of(pose, camera.centre_world()));
            poses.push(pose);
        }
    }
    ensure!(
        !examples.is_empty(),
        "{}: no training frame with a person and valid joints, expected some",
        sequence.folder.display()
    );
    examples.append(turned_views(&poses, &frames.shape, &camera, config.views_per_pose, config.seed));
    if config.mirror {
        examples.mirror();
    }
    Ok(examples)
}

/// What a predictor trained on `examples` of a sequence was trained for.
pub(super) fn training_of(frames: &TrainingFrames<'_>, examples: &Examples) -> anyhow::Result<Training> {
    let height_m = frames.sequence.camera(&frames.camera)?.centre_world().z;
    Ok(Training {
        notice: notice_of(frames),
        activity: activity_of(frames.sequence),
        camera_height_m: [height_m; 2],
        n_masks: examples.len() as u64,
    })
}

/// The activity that a sequence shows, by our name where there is one.
fn activity_of(sequence: &Sequence) -> String {
    match Activity::called(&sequence.activity) {
        Activity::Any => sequence.activity.to_lowercase(),
        known => known.name().to_owned(),
    }
}

/// Which frames a predictor of a sequence learned from, as [`Training::notice`] says it.
pub fn notice_of(frames: &TrainingFrames<'_>) -> String {
    let Range { start, end } = frames.range();
    let TrainingFrames { sequence, camera, kind, .. } = frames;
    format!("frames {start} to {} of {}, {kind} masks of camera {camera}", end - 1, sequence.title())
}

/// A predictor for one person, activity and camera.
///
/// # Errors
/// When there is too little to learn from.
pub fn train_on_sequence(frames: &TrainingFrames<'_>, config: &TrainConfig) -> anyhow::Result<PosePredictor> {
    train_on_frames(frames, &frames.range().collect::<Vec<_>>(), config)
}

/// The same of the training frames numbered `chosen` alone.
///
/// # Errors
/// When there is too little to learn from.
pub fn train_on_frames(
    frames: &TrainingFrames<'_>,
    chosen: &[usize],
    config: &TrainConfig,
) -> anyhow::Result<PosePredictor> {
    let examples = examples_of_frames(frames, chosen, config)?;
    fit_predictor(&examples, &frames.motion.rest, training_of(frames, &examples)?, config)
}
