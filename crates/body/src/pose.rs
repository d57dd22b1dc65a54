//! A pose and the joints it moves: forward kinematics.

use glam::{DAffine3, DQuat, DVec3};

use crate::skeleton::{JointId, N_DOF, N_JOINTS, Skeleton};

#[cfg(test)]
mod tests;

/// Joint positions of a person at rest, `[n_joints]`, metres, body frame: the person's bone lengths.
pub type RestJoints = [DVec3; N_JOINTS];

/// `world_from_joint` of every joint, `[n_joints]`; its translation is the joint's position in the world, metres.
/// A joint frame has its origin at the joint and, at rest, the axes of the body frame.
pub type JointTransforms = [DAffine3; N_JOINTS];

/// Where a body is and how its joints are bent.
#[derive(Clone, Debug, PartialEq)]
pub struct Pose {
    /// The pelvis joint, metres, world.
    pub root_position: DVec3,
    /// `world_from_body` of the pelvis.
    pub root_orientation: DQuat,
    /// Joint angles, `[n_dof]`, radians, in the order of [`Skeleton::dofs`]; all zero at rest.
    pub angles: Vec<f64>,
}

impl Pose {
    /// The rest pose, upright in a world with z up, the pelvis at `root_position`, looking along
    /// `heading_rad` (0 is world +x, counted counter-clockwise from above).
    pub fn upright(root_position: DVec3, heading_rad: f64) -> Self {
        let facing_minus_y = DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2);
        let turn = DQuat::from_rotation_z(heading_rad + std::f64::consts::FRAC_PI_2);
        Self { root_position, root_orientation: turn * facing_minus_y, angles: vec![0.0; N_DOF] }
    }

    /// The rest pose where the rest joints are: the body frame is the world.
    pub fn rest(joints: &RestJoints) -> Self {
        let root_position = joints[JointId::PELVIS.index()];
        Self { root_position, root_orientation: DQuat::IDENTITY, angles: vec![0.0; N_DOF] }
    }

    /// The direction the pelvis faces as an angle in the floor plane, radians; undoes [`Pose::upright`].
    pub fn heading_rad(&self) -> f64 {
        let facing = self.root_orientation * DVec3::Z;
        facing.y.atan2(facing.x)
    }

    /// Brings every angle inside its limits.
    pub fn clamp(&mut self) {
        for (angle, dof) in self.angles.iter_mut().zip(Skeleton::human().dofs()) {
            *angle = dof.clamp(*angle);
        }
    }

    /// The pose as a mirror in the world's plane x = 0 shows it, left and right exchanged.
    pub fn mirror(&self) -> Self {
        let mut angles = vec![0.0; self.angles.len()];
        for (angle, dof) in self.angles.iter().zip(Skeleton::human().dofs()) {
            angles[dof.mirror] = dof.mirror_sign * angle;
        }
        let q = self.root_orientation;
        Self {
            root_position: self.root_position * DVec3::new(-1.0, 1.0, 1.0),
            root_orientation: DQuat::from_xyzw(q.x, -q.y, -q.z, q.w),
            angles,
        }
    }
}

/// Rotation of `joint` against its parent for the `angles` of a pose (`[n_dof]`, radians).
pub fn joint_rotation(skeleton: &Skeleton, joint: JointId, angles: &[f64]) -> DQuat {
    let range = skeleton.joint(joint).dofs.clone();
    let turns = skeleton.dofs()[range.clone()].iter().zip(&angles[range]);
    turns.fold(DQuat::IDENTITY, |rotation, (dof, &angle)| rotation * DQuat::from_axis_angle(dof.axis, angle))
}

/// Forward kinematics: the frames of all joints of a person with joints `rest` in `pose`.
///
/// ```
/// use body::{pose::forward_kinematics, Pose, RestJoints, Skeleton, N_JOINTS};
/// use glam::DVec3;
/// let rest: RestJoints = std::array::from_fn(|joint| DVec3::new(0.0, 0.1 * joint as f64, 0.0));
/// let pose = Pose::upright(DVec3::new(1.0, 2.0, 0.9), 0.0);
/// let world_from_joint = forward_kinematics(Skeleton::human(), &rest, &pose);
/// assert!(world_from_joint[7].translation.distance(DVec3::new(1.0, 2.0, 1.6)) < 1e-12);
/// ```
///
/// # Panics
/// When the pose does not have [`N_DOF`] angles.
pub fn forward_kinematics(skeleton: &Skeleton, rest: &RestJoints, pose: &Pose) -> JointTransforms {
    assert_eq!(
        pose.angles.len(),
        N_DOF,
        "a pose of {} angles for {N_DOF} degrees of freedom",
        pose.angles.len()
    );
    let mut world_from_joint = [DAffine3::IDENTITY; N_JOINTS];
    for joint in JointId::all() {
        let parent_from_joint = |parent: JointId| {
            DAffine3::from_rotation_translation(
                joint_rotation(skeleton, joint, &pose.angles),
                rest[joint.index()] - rest[parent.index()],
            )
        };
        world_from_joint[joint.index()] = match joint.parent() {
            None => DAffine3::from_rotation_translation(pose.root_orientation, pose.root_position),
            Some(parent) => world_from_joint[parent.index()] * parent_from_joint(parent),
        };
    }
    world_from_joint
}
