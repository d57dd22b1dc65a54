//! A small predictor of walkers seen from all sides: what it predicts, and its file.

use std::f64::consts::TAU;
use std::sync::OnceLock;

use bme::{HierarchicalConfig, UpdateReport};
use body::{BodyModel, Camera, Intrinsics, JointId, Pose, Skeleton};
use glam::DVec3;
use pf_core::rng::{Draw, Purpose, particle_rng};
use silhouette::Mask;

use super::*;
use crate::train::render::render;
use crate::train::{Examples, Step, TrainConfig, fit_predictor, fit_transitions};

fn camera() -> Camera {
    let intrinsics = Intrinsics::from_focal(160, 160, 150.0).unwrap();
    Camera::look_at(intrinsics, DVec3::new(0.0, -3.5, 1.2), DVec3::new(0.0, 0.0, 0.9)).unwrap()
}

/// A stride: hips and knees swing with `phase`.
fn walker(heading: f64, phase: f64) -> (Mask, ViewedPose) {
    let model = BodyModel::builtin();
    let mut pose = Pose::upright(DVec3::new(0.0, 0.0, 0.92), heading);
    let skeleton = Skeleton::human();
    for (joint, angle) in [
        (JointId::LEFT_HIP, 0.5 * phase.sin()),
        (JointId::RIGHT_HIP, -0.5 * phase.sin()),
        (JointId::LEFT_KNEE, 0.4 + 0.4 * phase.cos()),
        (JointId::RIGHT_KNEE, 0.4 - 0.4 * phase.cos()),
    ] {
        pose.angles[skeleton.joint(joint).dofs.start] += angle;
    }
    pose.clamp();
    let mask = render(&model.mean(), &pose, &camera()).unwrap();
    (mask, ViewedPose::of(&pose, camera().centre_world()))
}

fn predictor() -> &'static PosePredictor {
    static PREDICTOR: OnceLock<PosePredictor> = OnceLock::new();
    PREDICTOR.get_or_init(|| {
        let mut examples = Examples::default();
        for i in 0..240 {
            // Golden-ratio steps fill the square of heading and phase evenly.
            let (mask, pose) = walker(TAU * f64::from(i) / 240.0, TAU * (0.618_034 * f64::from(i)).fract());
            examples.push(&mask, pose);
        }
        let mut config = TrainConfig { pose_dim: 2, ..TrainConfig::default() };
        config.experts = HierarchicalConfig { n_views: 4, ..config.experts };
        let training = Training {
            notice: "rendered".into(),
            activity: "walk".into(),
            camera_height_m: [1.2; 2],
            n_masks: examples.len() as u64,
        };
        fit_predictor(&examples, BodyModel::builtin().mean().rest_joints(), training, &config).unwrap()
    })
}

#[test]
fn one_of_few_modes_is_the_truth() {
    let (mut near, mut dense) = (0, 0);
    let truths: Vec<_> = (0..24).map(|i| (0.1 + 0.26 * f64::from(i), 0.5 + 0.9 * f64::from(i))).collect();
    for &(heading, phase) in &truths {
        let (mask, truth) = walker(heading, phase);
        let density = predictor().density(&mask).unwrap();
        let is_near = |mode: &PoseMode| wrapped(mode.pose.heading_rad - truth.heading_rad).abs() < 0.35;
        near += u32::from(density.modes(4).iter().any(is_near));
        let turned = ViewedPose { heading_rad: truth.heading_rad + 1.6, ..truth.clone() };
        dense += u32::from(density.log_density(&truth) > density.log_density(&turned));
    }
    assert!(near >= 20, "{near} of 24 headings are near a mode");
    assert!(dense >= 20, "{dense} of 24 true headings are denser than a quarter turn off");
}

/// A walker who goes on: pose before, pose now, mask now.
fn step(heading: f64, phase: f64) -> (ViewedPose, ViewedPose, Mask) {
    let (_, before) = walker(heading, phase);
    let (mask, now) = walker(heading + 0.05, phase + 0.5);
    (before, now, mask)
}

#[test]
fn a_transition_goes_on_from_the_pose_before_to_that_of_the_mask() {
    let walked: Vec<_> = (0..200)
        .map(|i| step(TAU * f64::from(i) / 200.0, TAU * (0.618_034 * f64::from(i)).fract()))
        .collect();
    let steps =
        walked.iter().map(|(before, now, mask)| Step { before: before.clone(), now: now.clone(), mask });
    let transitions = fit_transitions(steps, predictor(), &TrainConfig::default()).unwrap();
    let at = Draw { seed: 5, frame: 0, layer: 0, purpose: Purpose::User };
    let (mut rng, space) = (particle_rng(at, 0), predictor().space());
    let (mut stayed, mut gone, mut turned) = (0.0, 0.0, 0.0);
    for i in 0..24 {
        let (before, now, mask) = step(0.11 + 0.26 * f64::from(i), 0.4 + 0.9 * f64::from(i));
        let description = transitions.describe(&mask).unwrap();
        let off = |pose: &ViewedPose| {
            let pairs = space.encode(pose).into_iter().zip(space.encode(&now));
            pairs.map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
        };
        stayed += off(&before) / 24.0;
        for _ in 0..8 {
            let next = transitions.sample(&before, &description, &mut rng);
            gone += off(&next) / (24.0 * 8.0);
            turned += wrapped(next.heading_rad - now.heading_rad).abs() / (24.0 * 8.0);
        }
    }
    assert!(gone < 0.8 * stayed, "samples are {gone:.2} from the next pose, the pose before {stayed:.2}");
    assert!(turned < 0.4, "samples are turned by {turned:.2} rad from the next pose");
}

#[test]
fn samples_are_poses_and_follow_from_the_generator() {
    let (mask, _) = walker(1.0, 2.0);
    let density = predictor().density(&mask).unwrap();
    let at = Draw { seed: 3, frame: 0, layer: 0, purpose: Purpose::User };
    let mut rng = particle_rng(at, 0);
    for _ in 0..50 {
        let pose = density.sample(&mut rng);
        assert!(pose.heading_rad.abs() <= std::f64::consts::PI && density.log_density(&pose).is_finite());
        let dofs = Skeleton::human().dofs();
        assert!(pose.angles.iter().zip(dofs).all(|(angle, dof)| dof.clamp(*angle) == *angle));
    }
    assert_eq!(density.sample(&mut particle_rng(at, 1)), density.sample(&mut particle_rng(at, 1)));
    assert!(predictor().density(&Mask::new(60, 60)).is_none());
}

#[test]
fn a_file_gives_back_the_predictor() {
    let (mask, truth) = walker(2.0, 1.0);
    for bytes in [predictor().to_bytes(), predictor().to_small_bytes()] {
        let read = PosePredictor::from_bytes(&bytes).unwrap();
        assert_eq!(read.training(), predictor().training());
        let (a, b) = (predictor().density(&mask).unwrap(), read.density(&mask).unwrap());
        assert_eq!(a.mean(), b.mean());
        assert_eq!(a.log_density(&truth), b.log_density(&truth));
    }
    assert!(predictor().to_small_bytes().len() < predictor().to_bytes().len());
}

#[test]
fn a_damaged_file_is_refused_by_name() {
    let bytes = predictor().to_small_bytes();
    let message = |bytes: &[u8]| PosePredictor::from_bytes(bytes).unwrap_err().to_string();
    let mut other_version = bytes.clone();
    other_version[8] += 6;
    assert_eq!(message(&other_version), "`version` is 7, expected 1");
    let cut = &bytes[..bytes.len() - 100];
    assert_eq!(message(cut), format!("the file has {} bytes, expected {}", cut.len(), bytes.len()));
    let mut flipped = bytes.clone();
    flipped[200] ^= 1;
    assert!(message(&flipped).starts_with("`checksum` is "));
    assert_eq!(message(b"PNG"), "`magic`: the file does not begin with `UMBRAPRE`");
}

#[test]
fn examples_learnt_online_are_believed_afterwards() {
    let mut model = predictor().clone();
    let (mask, truth) = walker(0.7, 0.3);
    let before = model.density(&mask).unwrap().log_density(&truth);
    let mut told = truth.clone();
    told.heading_rad = wrapped(told.heading_rad + 0.4);
    let told_before = model.density(&mask).unwrap().log_density(&told);
    for _ in 0..5 {
        model.learn(&mask, &[(told.clone(), 1.0), (truth.clone(), 0.2)]).unwrap();
    }
    let told_after = model.density(&mask).unwrap().log_density(&told);
    assert!(told_after > told_before, "{told_before} before, {told_after} after; truth {before}");
    assert!(model.learn(&mask, &[(told.clone(), 2.0)]).is_err());
    let before = model.density(&mask).unwrap().log_density(&told);
    assert_eq!(model.learn(&Mask::new(60, 60), &[(told.clone(), 1.0)]).unwrap(), UpdateReport::default());
    assert_eq!(model.density(&mask).unwrap().log_density(&told), before);
    model.note_lessons(5);
    assert_eq!(model.training().n_masks, predictor().training().n_masks + 5);
}

#[test]
fn another_camera_or_activity_is_named() {
    let training = predictor().training();
    assert_eq!(training.check(1.4, "walk"), Ok(()));
    assert_eq!(
        training.check(2.5, "walk").unwrap_err().to_string(),
        "the model is trained for cameras 1.2 to 1.2 m above the floor, this one is at 2.5 m"
    );
    assert_eq!(
        training.check(1.2, "box").unwrap_err().to_string(),
        "the model is trained for `walk`, not for `box`"
    );
    assert!(training.check(f64::NAN, "walk").is_err());
}

#[test]
fn nothing_to_learn_from_is_an_error() {
    let rest = *BodyModel::builtin().mean().rest_joints();
    let training = predictor().training().clone();
    let error = fit_predictor(&Examples::default(), &rest, training, &TrainConfig::default()).unwrap_err();
    assert_eq!(error.to_string(), "no mask with a person among the training frames, expected some");
}
