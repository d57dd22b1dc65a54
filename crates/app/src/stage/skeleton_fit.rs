//! Fits our skeleton to the true joints of a sequence: a person's bone lengths, then the joint angles of each frame.

use std::ops::Range;

use body::ik::{IkConfig, Pull, Target, solve, solve_from_scratch};
use body::pose::forward_kinematics;
use body::retarget::Motion;
use body::{JointId, N_DOF, Pose, RestJoints, Skeleton};
use glam::{DQuat, DVec3};

use super::{Markers, Rotations, SEGMENTS, Sequence};

/// The joint of ours whose frame turns with each of the [`SEGMENTS`].
pub const SEGMENT_JOINTS: [JointId; SEGMENTS.len()] = [
    JointId::PELVIS,
    JointId::MID_SPINE,
    JointId::THORAX,
    JointId::NECK,
    JointId::HEAD,
    JointId::LEFT_SHOULDER,
    JointId::LEFT_ELBOW,
    JointId::LEFT_WRIST,
    JointId::LEFT_HIP,
    JointId::LEFT_KNEE,
    JointId::LEFT_ANKLE,
    JointId::RIGHT_SHOULDER,
    JointId::RIGHT_ELBOW,
    JointId::RIGHT_WRIST,
    JointId::RIGHT_HIP,
    JointId::RIGHT_KNEE,
    JointId::RIGHT_ANKLE,
];

/// Our joints that lie at a marker, with the marker's index. Several markers lie at one joint; the other one is left out.
const MARKED: [(JointId, usize); 14] = [
    (JointId::NECK, 0),
    (JointId::LEFT_SHOULDER, 2),
    (JointId::LEFT_ELBOW, 4),
    (JointId::LEFT_WRIST, 5),
    (JointId::RIGHT_SHOULDER, 6),
    (JointId::RIGHT_ELBOW, 8),
    (JointId::RIGHT_WRIST, 9),
    (JointId::LEFT_HIP, 10),
    (JointId::LEFT_KNEE, 12),
    (JointId::LEFT_ANKLE, 13),
    (JointId::RIGHT_HIP, 14),
    (JointId::RIGHT_KNEE, 16),
    (JointId::RIGHT_ANKLE, 17),
    (JointId::HEAD_TOP, 19),
];

/// A segment's rotation is held by two points this far from its joint, metres, and
const ROTATION_ARM_M: f64 = 0.1;
/// each counts this much of a joint.
const ROTATION_WEIGHT: f64 = 0.05;
/// Turning a joint by a radian from one frame to the next costs as much as a joint this many metres off.
const INERTIA_M_PER_RAD: f64 = 0.003;

/// Poses of our skeleton that stand where a sequence's markers are.
#[derive(Clone, Debug)]
pub struct FittedSequence {
    /// The person's joints at rest.
    pub rest: RestJoints,
    /// The poses, one a frame.
    pub motion: Motion,
    /// Mean distance of a joint from its marker, metres.
    pub residual_m: f64,
}

/// The markers of a pose, metres, world; the inverse of what [`fit_sequence`] does.
pub fn markers_of(joints_world: &[DVec3; body::N_JOINTS]) -> Markers {
    let at = |joint: JointId| joints_world[joint.index()];
    let neck = at(JointId::NECK);
    let hips = at(JointId::LEFT_HIP).midpoint(at(JointId::RIGHT_HIP));
    let limb = |[a, b, c]: [JointId; 3]| [at(a), at(b), at(b), at(c)];
    let left_arm = limb([JointId::LEFT_SHOULDER, JointId::LEFT_ELBOW, JointId::LEFT_WRIST]);
    let right_arm = limb([JointId::RIGHT_SHOULDER, JointId::RIGHT_ELBOW, JointId::RIGHT_WRIST]);
    let left_leg = limb([JointId::LEFT_HIP, JointId::LEFT_KNEE, JointId::LEFT_ANKLE]);
    let right_leg = limb([JointId::RIGHT_HIP, JointId::RIGHT_KNEE, JointId::RIGHT_ANKLE]);
    let mut markers = [DVec3::ZERO; 20];
    markers[..2].copy_from_slice(&[neck, hips]);
    for (slot, limb) in [left_arm, right_arm, left_leg, right_leg].iter().enumerate() {
        markers[2 + 4 * slot..6 + 4 * slot].copy_from_slice(limb);
    }
    markers[18..].copy_from_slice(&[neck, at(JointId::HEAD_TOP)]);
    markers
}

/// `template`'s joints at rest with the mean bone lengths of `markers`: limbs, hips, shoulders, trunk and head.
///
/// # Panics
/// Without markers.
pub fn personal_joints(template: &RestJoints, markers: &[Markers]) -> RestJoints {
    let mean =
        |length: &dyn Fn(&Markers) -> f64| markers.iter().map(length).sum::<f64>() / markers.len() as f64;
    let between = |a: usize, b: usize| mean(&|frame: &Markers| frame[a].distance(frame[b]));
    let of_template = |a: JointId, b: JointId| template[a.index()].distance(template[b.index()]);
    let hips = template[JointId::LEFT_HIP.index()].midpoint(template[JointId::RIGHT_HIP.index()]);
    let trunk = between(0, 1) / template[JointId::NECK.index()].distance(hips);
    let head = between(18, 19) / of_template(JointId::NECK, JointId::HEAD_TOP);
    let hip_width = between(10, 14) / of_template(JointId::LEFT_HIP, JointId::RIGHT_HIP);
    let shoulder_width = between(2, 6) / of_template(JointId::LEFT_SHOULDER, JointId::RIGHT_SHOULDER);
    let mut rest = *template;
    for joint in JointId::all() {
        let Some(parent) = joint.parent() else { continue };
        let offset = template[joint.index()] - template[parent.index()];
        let bone = |a: usize, b: usize| between(a, b) / offset.length();
        let scale = match joint {
            JointId::LEFT_HIP | JointId::RIGHT_HIP => DVec3::new(hip_width, trunk, trunk),
            JointId::LEFT_CLAVICLE
            | JointId::RIGHT_CLAVICLE
            | JointId::LEFT_SHOULDER
            | JointId::RIGHT_SHOULDER => DVec3::new(shoulder_width, trunk, trunk),
            JointId::LEFT_ELBOW => DVec3::splat(bone(2, 3)),
            JointId::LEFT_WRIST => DVec3::splat(bone(4, 5)),
            JointId::RIGHT_ELBOW => DVec3::splat(bone(6, 7)),
            JointId::RIGHT_WRIST => DVec3::splat(bone(8, 9)),
            JointId::LEFT_KNEE => DVec3::splat(bone(10, 11)),
            JointId::LEFT_ANKLE => DVec3::splat(bone(12, 13)),
            JointId::RIGHT_KNEE => DVec3::splat(bone(14, 15)),
            JointId::RIGHT_ANKLE => DVec3::splat(bone(16, 17)),
            JointId::HEAD | JointId::HEAD_TOP => DVec3::splat(head),
            _ => DVec3::splat(trunk),
        };
        rest[joint.index()] = rest[parent.index()] + scale * offset;
    }
    rest
}

/// Fits poses to the frames of `range`: to the markers, and to the rotations of the segments where `with_rotations`, which
/// settle the twists that joints leave open. Frames without valid markers keep the pose before.
///
/// # Panics
/// When no frame of `range` has markers.
pub fn fit_sequence(
    sequence: &Sequence,
    range: Range<usize>,
    rest: RestJoints,
    with_rotations: bool,
) -> FittedSequence {
    let mut poses: Vec<Pose> = Vec::with_capacity(range.len());
    let (mut residual_m, mut n_residuals) = (0.0, 0);
    let mut skipped = 0;
    for frame in range {
        let Some(markers) = &sequence.markers[frame] else {
            match poses.last().cloned() {
                Some(pose) => poses.push(pose),
                None => skipped += 1,
            }
            continue;
        };
        let mut targets: Vec<Target> =
            MARKED.iter().map(|(joint, marker)| Target::joint(*joint, markers[*marker])).collect();
        if with_rotations {
            targets.extend(rotation_targets(&rest, &targets, &sequence.rotations[frame]));
        }
        let config = IkConfig::default();
        let solution = match poses.last() {
            None => solve_from_scratch(&rest, &targets, None, &config),
            Some(last) => {
                let pull = Pull { reference: &last.angles, metres_per_rad: &[INERTIA_M_PER_RAD; N_DOF] };
                solve(&rest, &targets, last, Some(pull), &config)
            }
        };
        residual_m += solution.residuals_m[..MARKED.len()].iter().sum::<f64>();
        n_residuals += MARKED.len();
        poses.push(solution.pose);
    }
    assert!(!poses.is_empty(), "{}: no frame has valid joints", sequence.folder.display());
    let first = poses[0].clone();
    poses.splice(0..0, std::iter::repeat_n(first, skipped));
    let motion = Motion { name: sequence.title(), frame_rate_hz: sequence.fps, poses };
    FittedSequence { rest, motion, residual_m: residual_m / n_residuals as f64 }
}

/// Points beside the joints that hold the true rotations of the segments.
fn rotation_targets(rest: &RestJoints, joints: &[Target], rotations: &Rotations) -> Vec<Target> {
    let mut targets = Vec::with_capacity(2 * SEGMENTS.len());
    for (joint, rotation) in SEGMENT_JOINTS.iter().zip(rotations) {
        let world_from_segment = world_from_body_segment(*rotation);
        // A segment whose joint has no marker hangs where the markers around it put it: the hips, or the neck.
        let marked = joints.iter().find(|target| target.joint == *joint).map(|target| target.position);
        let position = marked.unwrap_or_else(|| {
            let anchor = [JointId::NECK, JointId::LEFT_HIP]
                .into_iter()
                .min_by(|a, b| {
                    let gap = |other: &JointId| rest[other.index()].distance(rest[joint.index()]);
                    gap(a).total_cmp(&gap(b))
                })
                .expect("there are two");
            let at = joints.iter().find(|target| target.joint == anchor).expect("it has a marker").position;
            at + world_from_segment * (rest[joint.index()] - rest[anchor.index()])
        });
        for axis in [DVec3::Z, DVec3::X] {
            let offset_m = ROTATION_ARM_M * axis;
            let position = position + world_from_segment * offset_m;
            targets.push(Target { joint: *joint, offset_m, position, weight: ROTATION_WEIGHT });
        }
    }
    targets
}

/// The rotation `world_from_joint` of our segment, for a rotation since a rest pose that looks along -y with z up.
fn world_from_body_segment(since_rest: DQuat) -> DQuat {
    since_rest * DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2)
}

/// The rotations of the segments since the rest pose, for a pose of ours; undoes what the fit to rotations does.
pub fn rotations_of(rest: &RestJoints, pose: &Pose) -> Rotations {
    let world_from_joint = forward_kinematics(Skeleton::human(), rest, pose);
    SEGMENT_JOINTS.map(|joint| {
        let world_from_segment = DQuat::from_mat3(&world_from_joint[joint.index()].matrix3);
        world_from_segment * DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use body::BodyModel;

    /// Markers and rotations of a walk-like motion of the mean body.
    fn motion() -> (RestJoints, Vec<Pose>) {
        let rest = *BodyModel::builtin().mean().rest_joints();
        let skeleton = Skeleton::human();
        let poses = (0..12).map(|frame| {
            let mut pose = Pose::upright(DVec3::new(0.02 * f64::from(frame), 0.0, 0.93), 0.5);
            let swing = 0.4 * (0.3 * f64::from(frame)).sin();
            for (joint, angle) in [
                (JointId::LEFT_HIP, swing),
                (JointId::RIGHT_HIP, -swing),
                (JointId::LEFT_KNEE, 0.5 + swing),
                (JointId::LEFT_ELBOW, 0.6),
                (JointId::RIGHT_SHOULDER, swing),
            ] {
                pose.angles[skeleton.joint(joint).dofs.start] += angle;
            }
            pose.clamp();
            pose
        });
        (rest, poses.collect())
    }

    fn sequence(rest: &RestJoints, poses: &[Pose]) -> Sequence {
        let joints = |pose: &Pose| {
            forward_kinematics(Skeleton::human(), rest, pose)
                .map(|world_from_joint| world_from_joint.translation)
        };
        Sequence {
            folder: "test".into(),
            subject: "S1".into(),
            sex: None,
            stature_m: 1.75,
            activity: "Walking".into(),
            fps: 60.0,
            cameras: Vec::new(),
            test: 0..poses.len(),
            train: 0..poses.len(),
            performers: Vec::new(),
            markers: poses.iter().map(|pose| Some(markers_of(&joints(pose)))).collect(),
            rotations: poses.iter().map(|pose| rotations_of(rest, pose)).collect(),
        }
    }

    #[test]
    fn a_known_motion_is_found_again() {
        let (rest, poses) = motion();
        let sequence = sequence(&rest, &poses);
        let fitted = fit_sequence(&sequence, 0..poses.len(), rest, true);
        assert!(fitted.residual_m < 1e-3, "{} m", fitted.residual_m);
        for (pose, truth) in fitted.motion.poses.iter().zip(&poses) {
            let turn = pose.root_orientation.angle_between(truth.root_orientation);
            assert!(turn < 0.01, "{turn} rad");
            let worst = pose.angles.iter().zip(&truth.angles).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(worst < 0.1, "{worst} rad");
        }
    }

    #[test]
    fn bone_lengths_are_those_of_the_markers() {
        let (rest, poses) = motion();
        let tall = rest.map(|joint| 1.1 * joint);
        let markers: Vec<Markers> = sequence(&tall, &poses).markers.into_iter().flatten().collect();
        let personal = personal_joints(&rest, &markers);
        let length =
            |joints: &RestJoints, a: JointId, b: JointId| joints[a.index()].distance(joints[b.index()]);
        for (a, b) in [
            (JointId::LEFT_HIP, JointId::LEFT_KNEE),
            (JointId::RIGHT_ELBOW, JointId::RIGHT_WRIST),
            (JointId::LEFT_SHOULDER, JointId::RIGHT_SHOULDER),
        ] {
            assert!(
                (length(&personal, a, b) - length(&tall, a, b)).abs() < 1e-3,
                "{} to {}",
                a.name(),
                b.name()
            );
        }
    }
}
