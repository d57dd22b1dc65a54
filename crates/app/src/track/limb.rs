//! A limb turned to the mirror image of where it points, as seen from the camera.

use body::pose::{forward_kinematics, joint_rotation};
use body::{JointId, Pose, RestJoints, Skeleton};
use glam::{DMat3, DQuat, DVec3};

/// Two segments that hang on a ball joint: an arm or a leg.
#[derive(Clone, Copy, Debug)]
pub struct Limb {
    /// Shoulder or hip.
    pub ball: JointId,
    /// Elbow or knee; its first angle is the flexion.
    pub hinge: JointId,
    /// Wrist or ankle.
    pub end: JointId,
}

/// Both arms and both legs.
pub const LIMBS: [Limb; 4] = [
    Limb { ball: JointId::LEFT_SHOULDER, hinge: JointId::LEFT_ELBOW, end: JointId::LEFT_WRIST },
    Limb { ball: JointId::RIGHT_SHOULDER, hinge: JointId::RIGHT_ELBOW, end: JointId::RIGHT_WRIST },
    Limb { ball: JointId::LEFT_HIP, hinge: JointId::LEFT_KNEE, end: JointId::LEFT_ANKLE },
    Limb { ball: JointId::RIGHT_HIP, hinge: JointId::RIGHT_KNEE, end: JointId::RIGHT_ANKLE },
];

/// What of a limb is mirrored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Upper and lower segment.
    Whole,
    /// Forearm or shank alone.
    Lower,
}

/// Mirrors a limb in depth: across the plane through its ball joint (or its hinge) square to the line of sight there.
/// From `camera_centre` (metres, world) the limb looks nearly as before. Angles are brought inside the joint limits, so a
/// mirror image that no body can take is only approached.
pub fn mirror_limb(pose: &mut Pose, rest: &RestJoints, limb: &Limb, part: Part, camera_centre: DVec3) {
    let skeleton = Skeleton::human();
    let world_from_joint = forward_kinematics(skeleton, rest, pose);
    let place = |joint: JointId| world_from_joint[joint.index()].translation;
    let (ball, hinge, end) = (place(limb.ball), place(limb.hinge), place(limb.end));
    let fixed = if part == Part::Whole { ball } else { hinge };
    let sight = (fixed - camera_centre).normalize_or_zero();
    let mirrored = |segment: DVec3| segment - 2.0 * segment.dot(sight) * sight;
    let lower_world = mirrored(end - hinge);
    let upper_world = if part == Part::Whole { mirrored(hinge - ball) } else { hinge - ball };

    // The flexion that makes the angle between the segments.
    let upper_rest = rest[limb.hinge.index()] - rest[limb.ball.index()];
    let lower_rest = rest[limb.end.index()] - rest[limb.hinge.index()];
    let flexion = skeleton.joint(limb.hinge).dofs.start;
    let cosine = upper_world.normalize_or_zero().dot(lower_world.normalize_or_zero());
    let dof = &skeleton.dofs()[flexion];
    pose.angles[flexion] = dof.clamp(hinge_angle(dof.axis, upper_rest, lower_rest, cosine));

    // The rotation of the ball joint that brings both segments to their directions.
    let lower_in_upper = joint_rotation(skeleton, limb.hinge, &pose.angles) * lower_rest;
    let world_from_upper =
        frame_of(upper_world, lower_world) * frame_of(upper_rest, lower_in_upper).transpose();
    let parent = limb.ball.parent().expect("an arm or leg hangs on the trunk");
    let world_from_parent = world_from_joint[parent.index()].matrix3;
    let parent_from_upper = DQuat::from_mat3(&(world_from_parent.transpose() * world_from_upper));
    solve_rotation(pose, skeleton, limb.ball, parent_from_upper);
}

/// The larger of the two angles about `axis` that turn `lower` until the cosine of its angle to `upper` is `cosine`; the
/// nearest possible one when none does.
fn hinge_angle(axis: DVec3, upper: DVec3, lower: DVec3, cosine: f64) -> f64 {
    let (upper, lower) = (upper.normalize(), lower.normalize());
    // upper . R(axis, t) lower = a cos t + b sin t + c, by Rodrigues' formula.
    let along = axis.dot(lower) * axis;
    let a = upper.dot(lower - along);
    let b = upper.dot(axis.cross(lower));
    let c = upper.dot(along);
    b.atan2(a) + ((cosine - c) / a.hypot(b)).clamp(-1.0, 1.0).acos()
}

/// An orthonormal frame: first axis along `first`, second in the plane of both. Parallel vectors get any such frame.
fn frame_of(first: DVec3, second: DVec3) -> DMat3 {
    let x = first.normalize();
    let z = x.cross(second).try_normalize().unwrap_or_else(|| x.any_orthonormal_vector());
    DMat3::from_cols(x, z.cross(x), z)
}

/// Sets the angles of `joint` so that its rotation comes nearest to `target`, by Gauss-Newton from where they are, and
/// clamps them.
fn solve_rotation(pose: &mut Pose, skeleton: &Skeleton, joint: JointId, target: DQuat) {
    /// Quadratic convergence: from half a turn away, eight steps reach rounding.
    const STEPS: usize = 12;
    /// Keeps the step finite where two axes are parallel.
    const DAMPING: f64 = 1e-6;
    let dofs = skeleton.joint(joint).dofs.clone();
    debug_assert_eq!(dofs.len(), 3, "a ball joint has three angles");
    for _ in 0..STEPS {
        let mut rotation = DQuat::IDENTITY;
        let mut axes = DMat3::ZERO;
        for (column, dof) in dofs.clone().enumerate() {
            let axis = skeleton.dofs()[dof].axis;
            *axes.col_mut(column) = rotation * axis;
            rotation *= DQuat::from_axis_angle(axis, pose.angles[dof]);
        }
        let turn = target * rotation.inverse();
        let turn = if turn.w < 0.0 { -turn } else { turn };
        let normal = axes * axes.transpose() + DMat3::from_diagonal(DVec3::splat(DAMPING));
        let step = axes.transpose() * (normal.inverse() * turn.to_scaled_axis());
        for (dof, change) in dofs.clone().zip(step.to_array()) {
            pose.angles[dof] += change;
        }
    }
    for dof in dofs {
        let angle = pose.angles[dof];
        let wrapped = angle.sin().atan2(angle.cos());
        pose.angles[dof] = skeleton.dofs()[dof].clamp(wrapped);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rest() -> RestJoints {
        *body::BodyModel::builtin().mean().rest_joints()
    }

    /// A pose with a bent right arm and left leg before a camera on the -y side.
    fn posed() -> Pose {
        let mut pose = Pose::upright(DVec3::new(0.0, 0.0, 0.95), 0.7);
        let skeleton = Skeleton::human();
        for limb in [&LIMBS[1], &LIMBS[2]] {
            pose.angles[skeleton.joint(limb.hinge).dofs.start] = 0.8;
            pose.angles[skeleton.joint(limb.ball).dofs.start] = 0.3;
        }
        pose
    }

    const CAMERA: DVec3 = DVec3::new(0.0, -50.0, 1.0);

    fn ends(pose: &Pose, limb: &Limb) -> [DVec3; 3] {
        let joints = forward_kinematics(Skeleton::human(), &rest(), pose);
        [limb.ball, limb.hinge, limb.end].map(|joint| joints[joint.index()].translation)
    }

    #[test]
    fn a_mirrored_arm_swaps_depth_and_keeps_its_place_in_the_image() {
        let (before, limb) = (posed(), &LIMBS[1]);
        let mut after = before.clone();
        mirror_limb(&mut after, &rest(), limb, Part::Whole, CAMERA);
        let ([ball, hinge, end], [ball2, hinge2, end2]) = (ends(&before, limb), ends(&after, limb));
        assert!(ball.distance(ball2) < 1e-9, "the ball joint stays");
        for (a, b) in [(hinge, hinge2), (end, end2)] {
            // The camera is 50 m away along y: depth is y, to a few millimetres.
            assert!((a - b).with_y(0.0).length() < 0.02, "{a} to {b}");
            assert!(((a.y - ball.y) + (b.y - ball.y)).abs() < 0.02, "{a} to {b}");
        }
    }

    /// The mirror image of a bent leg has a knee that bends forwards: it is approached within the limits.
    #[test]
    fn what_no_body_can_do_is_clamped() {
        let mut pose = posed();
        mirror_limb(&mut pose, &rest(), &LIMBS[2], Part::Whole, CAMERA);
        for (angle, dof) in pose.angles.iter().zip(Skeleton::human().dofs()) {
            assert!(angle.is_finite() && *angle == dof.clamp(*angle), "{}: {angle}", dof.name);
        }
    }

    #[test]
    fn mirroring_twice_is_no_move() {
        let before = posed();
        let mut after = before.clone();
        for _ in 0..2 {
            mirror_limb(&mut after, &rest(), &LIMBS[1], Part::Whole, CAMERA);
        }
        for (a, b) in ends(&before, &LIMBS[1]).into_iter().zip(ends(&after, &LIMBS[1])) {
            assert!(a.distance(b) < 1e-6);
        }
    }
}
