//! How far a predictor is off on frames of its sequence that it has not seen.

use std::ops::Range;

use body::pose::forward_kinematics;
use body::{RestJoints, Skeleton};
use glam::DVec3;

use super::sequence::{examples_of_frames, training_of};
use super::{TrainConfig, TrainingFrames, fit_predictor};
use crate::predict::{PosePredictor, ViewedPose, wrapped};
use crate::stage::{Markers, markers_of};

/// Modes among which the best is looked for.
const N_MODES: usize = 5;
/// Frames left out between those trained on and those held out: neighbours are nearly equal.
const GAP: usize = 10;

/// Mean errors over frames; positions with the pelvis at the origin, millimetres, angles in degrees.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct PredictionErrors {
    /// Of the mean of the density.
    pub mean_mm: f64,
    /// Of its highest mode.
    pub mode_mm: f64,
    /// Of the best of the five highest modes.
    pub best_mode_mm: f64,
    /// Of the mean of the density with the true heading in place of its own.
    pub true_heading_mm: f64,
    /// Heading of the mean.
    pub heading_deg: f64,
    /// ln of the density of the true pose.
    pub log_density: f64,
}

/// Two parts of the training frames of a sequence, each held out once: the first fifth and the last.
pub fn folds(train: &Range<usize>) -> [Range<usize>; 2] {
    let fifth = train.len() / 5;
    [train.start..train.start + fifth, train.end - fifth..train.end]
}

/// Trains on the training frames but for one fold and measures on that; the mean over both [`folds`].
///
/// # Errors
/// When there is too little to learn from.
pub fn cross_validate(frames: &TrainingFrames<'_>, config: &TrainConfig) -> anyhow::Result<PredictionErrors> {
    let TrainingFrames { sequence, camera, masks, motion, .. } = frames;
    let train = frames.range();
    let camera_world = sequence.camera(camera)?.centre_world();
    let mut sum = PredictionErrors::default();
    let mut n = 0.0;
    for fold in folds(&train) {
        let is_near = |frame: usize| frame + GAP >= fold.start && frame < fold.end + GAP;
        let chosen: Vec<usize> = train.clone().filter(|&frame| !is_near(frame)).collect();
        let examples = examples_of_frames(frames, &chosen, config)?;
        let predictor = fit_predictor(&examples, &motion.rest, training_of(frames, &examples)?, config)?;
        for frame in fold {
            let Some(markers) = &sequence.markers[frame] else { continue };
            let pose = &motion.motion.poses[frame - train.start];
            let truth = ViewedPose::of(pose, camera_world);
            let seen = Seen { rest: &motion.rest, camera_world, root_world: pose.root_position, markers };
            if let Some(errors) = seen.errors(&predictor, &masks[frame - train.start], &truth) {
                sum = added(sum, errors);
                n += 1.0;
            }
        }
    }
    Ok(scaled(sum, 1.0 / n))
}

/// What a frame shows in truth.
struct Seen<'a> {
    rest: &'a RestJoints,
    camera_world: DVec3,
    root_world: DVec3,
    markers: &'a Markers,
}

impl Seen<'_> {
    fn errors(
        &self,
        predictor: &PosePredictor,
        mask: &silhouette::Mask,
        truth: &ViewedPose,
    ) -> Option<PredictionErrors> {
        let density = predictor.density(mask)?;
        let mean = density.mean();
        let modes: Vec<f64> =
            density.modes(N_MODES).iter().map(|mode| self.distance_mm(&mode.pose)).collect();
        let turned = ViewedPose { heading_rad: truth.heading_rad, ..mean.clone() };
        Some(PredictionErrors {
            mean_mm: self.distance_mm(&mean),
            mode_mm: modes[0],
            best_mode_mm: modes.iter().copied().fold(f64::INFINITY, f64::min),
            true_heading_mm: self.distance_mm(&turned),
            heading_deg: wrapped(mean.heading_rad - truth.heading_rad).abs().to_degrees(),
            log_density: density.log_density(truth),
        })
    }

    /// Mean distance of the markers of `pose` from the true ones, hips put on each other, millimetres.
    fn distance_mm(&self, pose: &ViewedPose) -> f64 {
        let pose = pose.pose(self.camera_world, self.root_world);
        let joints = forward_kinematics(Skeleton::human(), self.rest, &pose).map(|frame| frame.translation);
        let own = markers_of(&joints);
        let shift = self.markers[1] - own[1];
        let distances = own.iter().zip(self.markers).map(|(a, b)| (*a + shift).distance(*b));
        1000.0 * distances.sum::<f64>() / self.markers.len() as f64
    }
}

fn added(a: PredictionErrors, b: PredictionErrors) -> PredictionErrors {
    PredictionErrors {
        mean_mm: a.mean_mm + b.mean_mm,
        mode_mm: a.mode_mm + b.mode_mm,
        best_mode_mm: a.best_mode_mm + b.best_mode_mm,
        true_heading_mm: a.true_heading_mm + b.true_heading_mm,
        heading_deg: a.heading_deg + b.heading_deg,
        log_density: a.log_density + b.log_density,
    }
}

fn scaled(a: PredictionErrors, by: f64) -> PredictionErrors {
    PredictionErrors {
        mean_mm: by * a.mean_mm,
        mode_mm: by * a.mode_mm,
        best_mode_mm: by * a.best_mode_mm,
        true_heading_mm: by * a.true_heading_mm,
        heading_deg: by * a.heading_deg,
        log_density: by * a.log_density,
    }
}
