//! Examples rendered from recorded motion: many bodies, seen from all sides by cameras at several heights.

use std::f64::consts::TAU;
use std::path::Path;

use anyhow::ensure;
use body::build::prior::{CMU_NOTICE, RetargetedClip, retargeted_clips};
use body::retarget::RetargetConfig;
use body::{BodyModel, Camera, Intrinsics, Pose};
use glam::{DQuat, DVec3};
use pf_core::rng::{Draw, Purpose, particle_rng, standard_normal_quantile};
use rand::RngExt as _;
use rayon::prelude::*;
use silhouette::Mask;

use super::noise::segmentation_noise;
use super::render::render;
use super::{Examples, TrainConfig, fit_predictor};
use crate::predict::{Activity, PosePredictor, Training, ViewedPose};

/// Cameras stand so high above the floor, metres,
const CAMERA_HEIGHT_M: [f64; 2] = [0.8, 2.2];
/// so far from the person, metres,
const DISTANCE_M: [f64; 2] = [3.2, 6.5];
/// and look past the person by up to this much, metres.
const ASIDE_M: f64 = 1.0;
const IMAGE_PX: [u32; 2] = [640, 480];
const FOCAL_PX: f64 = 620.0;
/// Shape coefficients that are drawn; the others stay 0.
const SHAPE_COEFFICIENTS: usize = 20;
/// Masks of a model, mirror images not counted.
const N_MASKS: usize = 2_600;

/// A predictor for an activity from the training clips of a folder of recorded motion.
///
/// # Errors
/// When a clip cannot be read, or none shows the activity.
pub fn train_on_recordings(
    folder: &Path,
    activity: Activity,
    config: &TrainConfig,
) -> anyhow::Result<PosePredictor> {
    let model = BodyModel::builtin();
    let rest = *model.mean().rest_joints();
    let clips = retargeted_clips(folder, "train", &rest, &RetargetConfig::default())?;
    let mut examples = recorded_examples(&clips, activity, config.seed)?;
    examples.mirror();
    let training = Training {
        notice: CMU_NOTICE.to_owned(),
        activity: activity.name().to_owned(),
        camera_height_m: CAMERA_HEIGHT_M,
        n_masks: examples.len() as u64,
    };
    fit_predictor(&examples, &rest, training, config)
}

/// [`N_MASKS`] rendered masks: an action of the activity, a frame of it, a body, a camera and a side, all at random.
fn recorded_examples(clips: &[RetargetedClip], activity: Activity, seed: u64) -> anyhow::Result<Examples> {
    let mut actions: Vec<&str> =
        clips.iter().map(|clip| clip.action.as_str()).filter(|action| activity.includes(action)).collect();
    actions.sort_unstable();
    actions.dedup();
    ensure!(!actions.is_empty(), "no training clip shows `{}`", activity.name());
    let poses: Vec<Vec<&Pose>> = actions
        .iter()
        .map(|action| {
            let clips = clips.iter().filter(|clip| clip.action == *action);
            clips.flat_map(|clip| &clip.motion.poses).collect()
        })
        .collect();
    let model = BodyModel::builtin();
    let mean_stature_m = model.mean().stature_m();
    let seen: Vec<Option<(Mask, ViewedPose)>> = (0..N_MASKS)
        .into_par_iter()
        .map(|index| {
            let at = Draw { seed, frame: index as u64, layer: 1, purpose: Purpose::User };
            let mut rng = particle_rng(at, 0);
            let mut uniform = |[low, high]: [f64; 2]| low + (high - low) * rng.random::<f64>();
            let poses = &poses[index % poses.len()];
            let mut pose = poses[uniform([0.0, poses.len() as f64]) as usize].clone();
            let shape: Vec<f64> = (0..SHAPE_COEFFICIENTS)
                .map(|_| standard_normal_quantile(uniform([1e-3, 1.0 - 1e-3])))
                .collect();
            let body = model.shape(&shape);
            let side = DQuat::from_rotation_z(uniform([0.0, TAU]));
            pose.root_orientation = side * pose.root_orientation;
            let height_m = pose.root_position.z * body.stature_m() / mean_stature_m;
            pose.root_position = DVec3::new(uniform([-ASIDE_M, ASIDE_M]), uniform(DISTANCE_M), height_m);
            let eye = DVec3::new(0.0, 0.0, uniform(CAMERA_HEIGHT_M));
            let target = DVec3::new(0.0, pose.root_position.y, uniform([0.7, 1.1]));
            let intrinsics = Intrinsics::from_focal(IMAGE_PX[0], IMAGE_PX[1], FOCAL_PX).ok()?;
            let camera = Camera::look_at(intrinsics, eye, target).ok()?;
            let mask = render(&body, &pose, &camera)?;
            let person = mask.bounding_box()?;
            let is_whole =
                person.x0 > 0 && person.y0 > 0 && person.x1 < mask.width() && person.y1 < mask.height();
            is_whole.then(|| (segmentation_noise(&mask, &mut rng), ViewedPose::of(&pose, eye)))
        })
        .collect();
    let mut examples = Examples::default();
    for (mask, pose) in seen.into_iter().flatten() {
        examples.push(&mask, pose);
    }
    Ok(examples)
}
