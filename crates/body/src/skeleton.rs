//! The skeleton: 30 joints, 49 joint angles, their axes and limits.

use std::ops::Range;
use std::sync::LazyLock;

use glam::DVec3;

mod table;
#[cfg(test)]
mod tests;

/// Joints, end points (head top, fingertips, toe tips, heels) included.
pub const N_JOINTS: usize = 30;
/// Joint angles. With the position and orientation of the pelvis a pose has 55 degrees of freedom.
pub const N_DOF: usize = 49;

/// Index of a joint; parents come before their children.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct JointId(u8);

macro_rules! joints {
    ($($index:literal $constant:ident $name:literal $parent:expr;)*) => {
        impl JointId {
            $(#[doc = concat!("`", $name, "`")] pub const $constant: Self = Self($index);)*
        }
        /// Name and parent of every joint.
        const JOINTS: [(&str, Option<JointId>); N_JOINTS] = [$(($name, $parent)),*];
    };
}

joints! {
    0 PELVIS "pelvis" None;
    1 LUMBAR "lumbar" Some(JointId::PELVIS);
    2 MID_SPINE "mid_spine" Some(JointId::LUMBAR);
    3 THORAX "thorax" Some(JointId::MID_SPINE);
    4 UPPER_CHEST "upper_chest" Some(JointId::THORAX);
    5 NECK "neck" Some(JointId::UPPER_CHEST);
    6 HEAD "head" Some(JointId::NECK);
    7 HEAD_TOP "head_top" Some(JointId::HEAD);
    8 LEFT_CLAVICLE "left_clavicle" Some(JointId::UPPER_CHEST);
    9 LEFT_SHOULDER "left_shoulder" Some(JointId::LEFT_CLAVICLE);
    10 LEFT_ELBOW "left_elbow" Some(JointId::LEFT_SHOULDER);
    11 LEFT_WRIST "left_wrist" Some(JointId::LEFT_ELBOW);
    12 LEFT_FINGERTIP "left_fingertip" Some(JointId::LEFT_WRIST);
    13 LEFT_HIP "left_hip" Some(JointId::PELVIS);
    14 LEFT_KNEE "left_knee" Some(JointId::LEFT_HIP);
    15 LEFT_ANKLE "left_ankle" Some(JointId::LEFT_KNEE);
    16 LEFT_BALL "left_ball" Some(JointId::LEFT_ANKLE);
    17 LEFT_TOE_TIP "left_toe_tip" Some(JointId::LEFT_BALL);
    18 RIGHT_CLAVICLE "right_clavicle" Some(JointId::UPPER_CHEST);
    19 RIGHT_SHOULDER "right_shoulder" Some(JointId::RIGHT_CLAVICLE);
    20 RIGHT_ELBOW "right_elbow" Some(JointId::RIGHT_SHOULDER);
    21 RIGHT_WRIST "right_wrist" Some(JointId::RIGHT_ELBOW);
    22 RIGHT_FINGERTIP "right_fingertip" Some(JointId::RIGHT_WRIST);
    23 RIGHT_HIP "right_hip" Some(JointId::PELVIS);
    24 RIGHT_KNEE "right_knee" Some(JointId::RIGHT_HIP);
    25 RIGHT_ANKLE "right_ankle" Some(JointId::RIGHT_KNEE);
    26 RIGHT_BALL "right_ball" Some(JointId::RIGHT_ANKLE);
    27 RIGHT_TOE_TIP "right_toe_tip" Some(JointId::RIGHT_BALL);
    28 LEFT_HEEL "left_heel" Some(JointId::LEFT_ANKLE);
    29 RIGHT_HEEL "right_heel" Some(JointId::RIGHT_ANKLE);
}

impl JointId {
    /// The joint at `index`, if there are so many.
    pub const fn from_index(index: usize) -> Option<Self> {
        if index < N_JOINTS { Some(Self(index as u8)) } else { None }
    }

    /// The joint called `name`, as in `left_knee`.
    pub fn from_name(name: &str) -> Option<Self> {
        JOINTS.iter().position(|&(known, _)| known == name).and_then(Self::from_index)
    }

    /// All joints, parents first.
    pub fn all() -> impl Iterator<Item = Self> {
        (0..N_JOINTS as u8).map(Self)
    }

    /// Position in arrays over joints.
    pub const fn index(self) -> usize {
        self.0 as usize
    }

    /// Its name, as in `left_knee`.
    pub const fn name(self) -> &'static str {
        JOINTS[self.index()].0
    }

    /// The joint it hangs on; none for the pelvis.
    pub const fn parent(self) -> Option<Self> {
        JOINTS[self.index()].1
    }

    /// The joint on the other side; a joint of the trunk is its own.
    pub const fn mirror(self) -> Self {
        match self.0 {
            8..=17 => Self(self.0 + 10),
            18..=27 => Self(self.0 - 10),
            28 => Self(29),
            29 => Self(28),
            _ => self,
        }
    }
}

/// A joint and where its angles lie in [`Pose::angles`](crate::Pose::angles).
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Which joint.
    pub id: JointId,
    /// Its degrees of freedom: its rotation is the product of theirs from first to last, so that the first axis is
    /// fixed in the parent and the last one (axial rotation, where there are three) in the joint's own segment.
    pub dofs: Range<usize>,
}

/// One joint angle: a rotation about one axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Dof {
    /// Joint and movement, as in `left_knee_flexion`; a positive angle makes the movement named.
    pub name: String,
    /// The joint it turns.
    pub joint: JointId,
    /// Unit axis at rest, body frame.
    pub axis: DVec3,
    /// Least and largest angle, radians; 0 is the rest pose.
    pub limits_rad: [f64; 2],
    /// The degree of freedom of the mirror image, and
    pub mirror: usize,
    /// the factor of its angle: 1 at paired joints, -1 where the trunk bends or turns to a side.
    pub mirror_sign: f64,
}

impl Dof {
    /// `angle_rad` brought inside the limits.
    pub fn clamp(&self, angle_rad: f64) -> f64 {
        angle_rad.clamp(self.limits_rad[0], self.limits_rad[1])
    }
}

/// The joints and joint angles of a human body. Lengths belong to a person: see [`RestJoints`](crate::RestJoints).
///
/// ```
/// use body::{JointId, Skeleton};
/// let skeleton = Skeleton::human();
/// let knee = skeleton.dof_index("left_knee_flexion").unwrap();
/// assert_eq!(skeleton.dofs()[knee].joint, JointId::LEFT_KNEE);
/// assert_eq!(skeleton.dofs().len() + 6, 55);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Skeleton {
    joints: Vec<Joint>,
    dofs: Vec<Dof>,
}

impl Skeleton {
    /// The one skeleton of this crate.
    pub fn human() -> &'static Self {
        static HUMAN: LazyLock<Skeleton> = LazyLock::new(|| {
            let dofs = table::dofs();
            let joints = JointId::all()
                .map(|id| {
                    let first = dofs.iter().position(|dof| dof.joint == id).unwrap_or(0);
                    let count = dofs.iter().filter(|dof| dof.joint == id).count();
                    Joint { id, dofs: first..first + count }
                })
                .collect();
            Skeleton { joints, dofs }
        });
        &HUMAN
    }

    /// [`N_JOINTS`] joints, parents before children.
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// [`N_DOF`] joint angles, in the order of [`Pose::angles`](crate::Pose::angles): grouped by joint, in the order of the joints.
    pub fn dofs(&self) -> &[Dof] {
        &self.dofs
    }

    /// The joint and its range of angles.
    pub fn joint(&self, id: JointId) -> &Joint {
        &self.joints[id.index()]
    }

    /// Where the angle called `name` lies in a pose.
    pub fn dof_index(&self, name: &str) -> Option<usize> {
        self.dofs.iter().position(|dof| dof.name == name)
    }
}
