//! How well poses are predicted from single masks while the predictor learns from the tracker.

use std::sync::Arc;

use rayon::prelude::*;
use serde::Serialize;
use silhouette::Mask;

use super::rows::LOOK_AHEAD;
use super::{MAIN_CAMERA, Prepared, StageEval, TrainOn};
use crate::config::{Method, TrackConfig};
use crate::eval::joint_error::mean;
use crate::predict::{PosePredictor, ViewedPose, wrapped};
use crate::run_folder::Learned;
use crate::track::follower::Follower;
use crate::track::tracker::Scene;
use crate::train::{TrainingFrames, train_on_frames};

/// Particles of each frame that predictors learn from.
const PARTICLES: [u32; 4] = [0, 1, 4, 10];
/// Frames that the second predictor of a sequence is trained on, the first of its training frames: a second of motion.
const FEW_FRAMES: usize = 60;

/// How far predictions are off on the test frames, each asked for before the predictor learns from that frame. Means over
/// frames and seeds.
#[derive(Clone, Debug, Serialize)]
pub struct UpdatesRow {
    /// Subject.
    pub subject: String,
    /// Activity.
    pub activity: String,
    /// Kind of masks.
    pub masks: String,
    /// What the predictor was trained on before.
    pub trained_on: String,
    /// Whether that were a few frames of the sequence only.
    pub is_short_of_frames: bool,
    /// Particles of each frame that are learned from.
    pub particles: u32,
    /// Mean absolute difference of the joint angles that the true motion moves (Euler angles), degrees.
    pub joints_deg: f64,
    /// Mean difference of the heading, degrees.
    pub heading_deg: f64,
    /// Mean absolute difference of all the angles that are predicted: those of the joints above, and the heading as one more,
    /// degrees.
    pub angles_deg: f64,
    /// What was learned, sum over frames and seeds.
    pub learned: Learned,
    /// `joints_deg` of each frame.
    pub frames_deg: Vec<f64>,
}

/// Errors of the mean prediction of a frame, as in [`UpdatesRow`], degrees.
#[derive(Clone, Copy)]
struct PredictionError {
    joints: f64,
    heading: f64,
    angles: f64,
}

/// Lets the predictors of a sequence learn from the joint particle filter's particles, and asks them on the way: the one that
/// the trackers use, and where they learned from the sequence one that has seen few of its frames.
pub(super) fn study(prepared: &Prepared, eval: &StageEval) -> anyhow::Result<Vec<UpdatesRow>> {
    let (Some(kind), Some(own)) = (eval.masks.first(), &prepared.predictor) else { return Ok(Vec::new()) };
    let mut predictors = Vec::new();
    if eval.train == TrainOn::Sequence {
        let frames = TrainingFrames::read(&prepared.sequence, MAIN_CAMERA, "observed")?;
        let few: Vec<usize> = frames.range().take(FEW_FRAMES).collect();
        predictors.push((format!("{} frames", frames.range().len()), false, own.clone()));
        let trained = train_on_frames(&frames, &few, &eval.training())?;
        predictors.push((format!("{} frames", few.len()), true, Arc::new(trained)));
    } else {
        let trained_on = if eval.train == TrainOn::Others { "other people" } else { "as shipped" };
        predictors.push((trained_on.to_owned(), false, own.clone()));
    }
    let masks = prepared.masks(MAIN_CAMERA, kind)?;
    let mut rows = Vec::new();
    for (trained_on, is_short_of_frames, predictor) in predictors {
        let runs: Vec<(u32, u64)> =
            PARTICLES.iter().flat_map(|n| (1..=eval.seeds).map(|seed| (*n, seed))).collect();
        let runs: Vec<(Vec<PredictionError>, Learned)> = runs
            .par_iter()
            .map(|&(adapt, seed)| {
                let config =
                    TrackConfig { adapt, seed, smooth: 0, method: Method::Jpf, ..eval.config.clone() };
                follow(prepared, &predictor, &masks, config)
            })
            .collect::<anyhow::Result<_>>()?;
        for (&particles, runs) in PARTICLES.iter().zip(runs.chunks(eval.seeds as usize)) {
            let over = |part: fn(&PredictionError) -> f64| mean(runs.iter().flat_map(|run| &run.0).map(part));
            let mut learned = Learned::default();
            runs.iter().for_each(|run| learned += run.1);
            rows.push(UpdatesRow {
                subject: prepared.sequence.subject.clone(),
                activity: prepared.sequence.activity.clone(),
                masks: kind.clone(),
                trained_on: trained_on.clone(),
                is_short_of_frames,
                particles,
                joints_deg: over(|e| e.joints),
                heading_deg: over(|e| e.heading),
                angles_deg: over(|e| e.angles),
                learned,
                frames_deg: (0..runs[0].0.len())
                    .map(|frame| mean(runs.iter().map(|run| run.0[frame].joints)))
                    .collect(),
            });
        }
    }
    Ok(rows)
}

/// The errors on all frames with a known pose, and what was learned.
fn follow(
    prepared: &Prepared,
    predictor: &Arc<PosePredictor>,
    masks: &[Mask],
    config: TrackConfig,
) -> anyhow::Result<(Vec<PredictionError>, Learned)> {
    let learns = config.adapt > 0;
    let scene = prepared.scene(config, MAIN_CAMERA)?;
    let mut follower = Follower::new(Scene { predictor: Some(predictor.clone()), ..scene });
    let (mut errors, mut learned) = (Vec::with_capacity(masks.len()), Learned::default());
    for (frame, mask) in masks.iter().enumerate() {
        errors.extend(follower.predictor().and_then(|predictor| error_of(prepared, predictor, mask, frame)));
        // A predictor that does not learn needs no tracker.
        if learns {
            let window: Vec<&Mask> = masks[frame..].iter().take(LOOK_AHEAD).collect();
            let record = follower.step(frame as u64, &window)?;
            record.and_then(|record| record.learned).into_iter().for_each(|lesson| learned += lesson);
        }
    }
    Ok((errors, learned))
}

/// How far the mean prediction for test frame `frame` is off; none without a person in the mask, or where the true pose is not
/// known.
fn error_of(
    prepared: &Prepared,
    predictor: &PosePredictor,
    mask: &Mask,
    frame: usize,
) -> Option<PredictionError> {
    let Prepared { sequence, truth, moving_dofs, .. } = prepared;
    sequence.markers[sequence.test.start + frame]?;
    let camera_world = sequence.camera(MAIN_CAMERA).ok()?.centre_world();
    let true_pose = &truth.motion.poses[frame];
    let predicted = predictor.density(mask)?.mean();
    let true_heading_rad = ViewedPose::of(true_pose, camera_world).heading_rad;
    let heading = wrapped(predicted.heading_rad - true_heading_rad).abs().to_degrees();
    let off = |&dof: &usize| (predicted.angles[dof] - true_pose.angles[dof]).abs().to_degrees();
    let joints = || moving_dofs.iter().map(off);
    Some(PredictionError {
        joints: mean(joints()),
        heading,
        angles: mean(joints().chain(std::iter::once(heading))),
    })
}
