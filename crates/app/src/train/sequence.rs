//! Examples from the frames of a sequence with true joints.

use std::ops::Range;

use anyhow::{Context as _, ensure};
use body::{BodyModel, RestJoints};
use silhouette::Mask;

use super::render::turned_views;
use super::{Examples, TrainConfig, fit_predictor};
use crate::input::MaskFolder;
use crate::predict::{PosePredictor, Training, ViewedPose};
use crate::stage::{FittedSequence, Sequence, fit_sequence, personal_joints};

/// Frames whose mean bone lengths are the subject's.
const LENGTH_FRAMES: usize = 100;

/// Our skeleton on the frames of `range`, with the bone lengths of its first valid frames, held to the true rotations.
///
/// # Errors
/// When no frame of `range` has valid joints.
pub fn fitted_motion(sequence: &Sequence, range: Range<usize>) -> anyhow::Result<FittedSequence> {
    let lengths: Vec<_> =
        sequence.markers[range.clone()].iter().flatten().take(LENGTH_FRAMES).copied().collect();
    ensure!(
        !lengths.is_empty(),
        "{}: no valid joints on frames {} to {}, expected some to train on",
        sequence.folder.join("joints.csv").display(),
        range.start,
        range.end
    );
    let template = BodyModel::builtin().shape_for_stature(sequence.stature_m, sequence.sex);
    let rest: RestJoints = personal_joints(template.rest_joints(), &lengths);
    Ok(fit_sequence(sequence, range, rest, true))
}

/// The masks of frames `range`, kind `observed` or `clean`.
///
/// # Errors
/// When there are fewer, or one cannot be read.
pub fn sequence_masks(
    sequence: &Sequence,
    camera: &str,
    kind: &str,
    range: &Range<usize>,
) -> anyhow::Result<Vec<Mask>> {
    let path = sequence.masks_path(camera, kind);
    let mut folder = MaskFolder::open(&path)?;
    let mut masks = Vec::with_capacity(range.len());
    for frame in 0..range.end {
        let mask = folder
            .next_mask()?
            .with_context(|| format!("{}: holds {frame} masks, expected {}", path.display(), range.end))?;
        if frame >= range.start {
            masks.push(mask);
        }
    }
    Ok(masks)
}

/// The frames named as `camera` saw them, and rendered views of their poses; `masks` and `motion` are those of the whole
/// training range.
pub(super) fn examples_of_frames(
    sequence: &Sequence,
    camera: &str,
    masks: &[Mask],
    frames: &[usize],
    motion: &FittedSequence,
    config: &TrainConfig,
) -> anyhow::Result<Examples> {
    let camera = sequence.camera(camera)?;
    let mut examples = Examples::default();
    let mut poses = Vec::new();
    for &frame in frames {
        let at = frame - sequence.train.start;
        if sequence.markers[frame].is_some() {
            examples.push(&masks[at], ViewedPose::of(&motion.motion.poses[at], camera.centre_world()));
            poses.push(&motion.motion.poses[at]);
        }
    }
    let shape = BodyModel::builtin().coefficients_for_stature(sequence.stature_m, sequence.sex);
    examples.append(turned_views(&poses, &shape, &camera, config.views_per_pose, config.seed));
    if config.mirror {
        examples.mirror();
    }
    ensure!(
        !examples.is_empty(),
        "{}: no frame with a person and valid joints, expected some to train on",
        sequence.folder.display()
    );
    Ok(examples)
}

/// What a predictor trained on `examples` of a sequence was trained for.
pub(super) fn training_of(
    sequence: &Sequence,
    camera: &str,
    examples: &Examples,
) -> anyhow::Result<Training> {
    let height_m = sequence.camera(camera)?.centre_world().z;
    let Range { start, end } = sequence.train;
    Ok(Training {
        notice: format!("frames {start} to {} of {}", end - 1, sequence.title()),
        activity: sequence.activity.to_lowercase(),
        camera_height_m: [height_m; 2],
        n_masks: examples.len() as u64,
    })
}

/// A predictor for one person, activity and camera, trained on the training frames of `sequence`; masks of `kind`
/// `observed` or `clean`.
///
/// # Errors
/// When the data cannot be read or there is too little of it.
pub fn train_on_sequence(
    sequence: &Sequence,
    camera: &str,
    kind: &str,
    config: &TrainConfig,
) -> anyhow::Result<PosePredictor> {
    let range = sequence.train.clone();
    let motion = fitted_motion(sequence, range.clone())?;
    let masks = sequence_masks(sequence, camera, kind, &range)?;
    let frames: Vec<usize> = range.collect();
    let examples = examples_of_frames(sequence, camera, &masks, &frames, &motion, config)?;
    fit_predictor(&examples, &motion.rest, training_of(sequence, camera, &examples)?, config)
}
