//! What becomes of a pose that is suddenly wrong.

use std::f64::consts::PI;

use body::Pose;
use glam::{DQuat, DVec3};
use rayon::prelude::*;
use serde::Serialize;

use super::rows::follow;
use super::{MAIN_CAMERA, Prepared, StageEval};
use crate::config::{Method, TrackConfig};
use crate::run_folder::FrameRecord;

/// The frame on which the pose is replaced,
const REPLACED_AT: usize = 100;
/// the frames the tracker has to find back.
const FRAMES_TO_RECOVER: usize = 10;
/// Frames that a study takes.
pub(super) const N_FRAMES: usize = REPLACED_AT + FRAMES_TO_RECOVER;
/// The root-relative error under which it has, mm.
const RECOVERED_MM: f64 = 60.0;

/// How often a tracker came back from one kind of wrong pose.
#[derive(Clone, Debug, Serialize)]
pub struct RecoveryRow {
    /// Subject and activity.
    pub sequence: String,
    /// What was wrong.
    pub wrong_pose: &'static str,
    /// Tracker.
    pub method: Method,
    /// Trials: one a seed.
    pub trials: usize,
    /// Trials in which the error was small again after so many frames.
    pub recovered: usize,
}

/// A wrong pose made of a right one, seen from a camera.
type Wrong = fn(&Pose, DVec3) -> Pose;

/// The wrong poses.
const WRONG_POSES: [(&str, Wrong); 3] = [
    ("its mirror image in depth", |pose, camera| flipped_in_depth(pose, camera)),
    ("mirrored legs", |pose, _| mirrored_legs(pose)),
    ("a turn by 180 degrees", |pose, _| Pose {
        root_orientation: DQuat::from_rotation_z(PI) * pose.root_orientation,
        ..pose.clone()
    }),
];

/// Replaces the pose of every tracker on a frame of its track, and counts how often it is right soon after.
pub(super) fn study(prepared: &Prepared, eval: &StageEval) -> anyhow::Result<Vec<RecoveryRow>> {
    if prepared.n_frames() < N_FRAMES {
        return Ok(Vec::new());
    }
    let Some(kind) = eval.masks.first() else { return Ok(Vec::new()) };
    let masks = prepared.masks(MAIN_CAMERA, kind)?;
    let camera = prepared.sequence.camera(MAIN_CAMERA)?.centre_world();
    let runs: Vec<(Method, u64)> =
        eval.methods.iter().flat_map(|method| (1..=eval.seeds).map(|seed| (*method, seed))).collect();
    let recovered: Vec<[bool; WRONG_POSES.len()]> = runs
        .par_iter()
        .map(|(method, seed)| {
            // A predictor that learns would go into a trial with what it learned in the one before.
            let config =
                TrackConfig { seed: *seed, method: *method, adapt: 0, smooth: 0, ..eval.config.clone() };
            let mut follower = prepared.follower(config, MAIN_CAMERA)?;
            let before = follow(&mut follower, &masks, 0..REPLACED_AT, |_, _| ())?;
            let (Some(FrameRecord { pose, .. }), Some(checkpoint)) = (before.last(), follower.checkpoint()?)
            else {
                return Ok([false; WRONG_POSES.len()]);
            };
            let mut recovered = [false; WRONG_POSES.len()];
            for (recovered, (_, wrong)) in recovered.iter_mut().zip(WRONG_POSES) {
                follower.restore(&checkpoint)?;
                follower.displace(&wrong(pose, camera))?;
                let frames = REPLACED_AT..N_FRAMES;
                let after = follow(&mut follower, &masks, frames, |_, _| ())?;
                let errors = prepared.score_from(&after[FRAMES_TO_RECOVER - 1..], N_FRAMES - 1);
                *recovered = errors.root_mm < RECOVERED_MM;
            }
            Ok(recovered)
        })
        .collect::<anyhow::Result<_>>()?;
    let mut rows = Vec::new();
    for (method, runs) in eval.methods.iter().zip(recovered.chunks(eval.seeds as usize)) {
        for (index, (wrong_pose, _)) in WRONG_POSES.iter().enumerate() {
            rows.push(RecoveryRow {
                sequence: prepared.sequence.title(),
                wrong_pose,
                method: *method,
                trials: runs.len(),
                recovered: runs.iter().filter(|run| run[index]).count(),
            });
        }
    }
    Ok(rows)
}

/// The mirror image of the pose in the plane through the pelvis square to the line of sight: nearly the same silhouette.
fn flipped_in_depth(pose: &Pose, camera: DVec3) -> Pose {
    let sight = (pose.root_position - camera).with_z(0.0).normalize();
    // Turns the line of sight to x, the axis along which poses are mirrored.
    let to_x = DQuat::from_rotation_z(-sight.y.atan2(sight.x));
    let turned = Pose {
        root_position: DVec3::ZERO,
        root_orientation: to_x * pose.root_orientation,
        angles: pose.angles.clone(),
    };
    let mirrored = turned.mirror();
    Pose {
        root_position: pose.root_position,
        root_orientation: to_x.inverse() * mirrored.root_orientation,
        angles: mirrored.angles,
    }
}

/// The pose with the angles of the left leg on the right one and the other way round.
fn mirrored_legs(pose: &Pose) -> Pose {
    let mirrored = pose.mirror();
    let mut swapped = pose.clone();
    for (index, dof) in body::Skeleton::human().dofs().iter().enumerate() {
        if dof.name.contains("hip") || dof.name.contains("knee") || dof.name.contains("ankle") {
            swapped.angles[index] = mirrored.angles[index];
        }
    }
    swapped
}

#[cfg(test)]
mod tests {
    use super::*;
    use body::pose::forward_kinematics;
    use body::{BodyModel, JointId, Skeleton};

    #[test]
    fn a_flip_in_depth_keeps_the_image_and_turns_the_depth() {
        let rest = *BodyModel::builtin().mean().rest_joints();
        let mut pose = Pose::upright(DVec3::new(0.3, 0.2, 0.95), 0.4);
        pose.angles[Skeleton::human().joint(JointId::LEFT_HIP).dofs.start] = 0.5;
        let camera = DVec3::new(0.3, -1000.0, 0.95);
        let flipped = flipped_in_depth(&pose, camera);
        let joints =
            |pose: &Pose| forward_kinematics(Skeleton::human(), &rest, pose).map(|frame| frame.translation);
        let (before, after) = (joints(&pose), joints(&flipped));
        // A mirror exchanges left and right; depth is y.
        let (knee, knee_after) = (before[JointId::LEFT_KNEE.index()], after[JointId::RIGHT_KNEE.index()]);
        assert!((knee - knee_after).with_y(0.0).length() < 0.01, "{knee} and {knee_after}");
        let depth = |point: DVec3| point.y - pose.root_position.y;
        assert!((depth(knee) + depth(knee_after)).abs() < 0.01);
    }

    #[test]
    fn mirrored_legs_leave_the_arms() {
        let mut pose = Pose::upright(DVec3::ZERO, 0.0);
        let skeleton = Skeleton::human();
        let [hip, other_hip] =
            [JointId::LEFT_HIP, JointId::RIGHT_HIP].map(|joint| skeleton.joint(joint).dofs.start);
        let elbow = skeleton.joint(JointId::LEFT_ELBOW).dofs.start;
        (pose.angles[hip], pose.angles[elbow]) = (0.4, 0.7);
        let swapped = mirrored_legs(&pose);
        assert_eq!((swapped.angles[hip], swapped.angles[other_hip], swapped.angles[elbow]), (0.0, 0.4, 0.7));
    }
}
