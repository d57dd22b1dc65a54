//! The 44-number motions of physics-based characters (`[Peng2018]`): JSON with `Frames` of quaternions and hinge angles.
//!
//! The files give no bone lengths. Ours are those of that paper's humanoid, whose scale the root positions have.

use std::path::Path;

use glam::{DQuat, DVec3};

use super::{LoadMocapError, clip_name, read};
use crate::mocap::{MocapClip, MocapFrame, MocapJoint, world_from_y_up, world_from_y_up_rotation};

const NUMBERS_PER_FRAME: usize = 44;

/// How the numbers of a joint turn it.
#[derive(Clone, Copy, PartialEq)]
enum Turn {
    /// A quaternion w x y z.
    Ball,
    /// An angle about the axis to the right.
    Hinge,
    /// Nothing.
    Fixed,
}

/// Joint, parent, offset from it at rest (x ahead, y up, z to the right; metres), turn. The order is that of the numbers.
const JOINTS: [(&str, Option<usize>, [f64; 3], Turn); 15] = [
    ("root", None, [0.0, 0.0, 0.0], Turn::Ball),
    ("chest", Some(0), [0.0, 0.236, 0.0], Turn::Ball),
    ("neck", Some(1), [0.0, 0.224, 0.0], Turn::Ball),
    ("right_hip", Some(0), [0.0, 0.0, 0.085], Turn::Ball),
    ("right_knee", Some(3), [0.0, -0.422, 0.0], Turn::Hinge),
    ("right_ankle", Some(4), [0.0, -0.410, 0.0], Turn::Ball),
    ("right_shoulder", Some(1), [-0.024, 0.244, 0.183], Turn::Ball),
    ("right_elbow", Some(6), [0.0, -0.275, 0.0], Turn::Hinge),
    ("right_wrist", Some(7), [0.0, -0.259, 0.0], Turn::Fixed),
    ("left_hip", Some(0), [0.0, 0.0, -0.085], Turn::Ball),
    ("left_knee", Some(9), [0.0, -0.422, 0.0], Turn::Hinge),
    ("left_ankle", Some(10), [0.0, -0.410, 0.0], Turn::Ball),
    ("left_shoulder", Some(1), [-0.024, 0.244, -0.183], Turn::Ball),
    ("left_elbow", Some(12), [0.0, -0.275, 0.0], Turn::Hinge),
    ("left_wrist", Some(13), [0.0, -0.259, 0.0], Turn::Fixed),
];

#[derive(serde::Deserialize)]
struct MotionFile {
    #[serde(rename = "Frames")]
    frames: Vec<Vec<f64>>,
}

/// Reads a motion of the 44-number humanoid.
///
/// # Errors
/// [`LoadMocapError`] names file and frame.
pub fn load_humanoid_json(path: &Path) -> Result<MocapClip, LoadMocapError> {
    parse_humanoid(path, &read(path)?)
}

pub(super) fn parse_humanoid(path: &Path, text: &str) -> Result<MocapClip, LoadMocapError> {
    let file: MotionFile = serde_json::from_str(text)
        .map_err(|source| LoadMocapError::Json { path: path.to_owned(), source })?;
    let Some(first) = file.frames.first() else {
        return Err(LoadMocapError::NoFrames { path: path.to_owned() });
    };
    let frame_secs = first.first().copied().unwrap_or_default();
    let mut frames = Vec::with_capacity(file.frames.len());
    for (frame, numbers) in file.frames.iter().enumerate() {
        if numbers.len() != NUMBERS_PER_FRAME || frame_secs <= 0.0 {
            let (count, expected) = (numbers.len(), NUMBERS_PER_FRAME);
            return Err(LoadMocapError::FrameLength { path: path.to_owned(), frame, count, expected });
        }
        frames.push(pose(numbers));
    }
    let mut joints: Vec<MocapJoint> = Vec::with_capacity(JOINTS.len());
    for (name, parent, offset, _) in JOINTS {
        let origin = parent.map_or(DVec3::ZERO, |parent| joints[parent].rest_position);
        joints.push(MocapJoint { name: name.into(), parent, rest_position: origin + y_up(offset.into()) });
    }
    Ok(MocapClip { name: clip_name(path), frame_rate_hz: 1.0 / frame_secs, joints, frames })
}

/// From the file's axes (x ahead, y up, z right) to those of the body frame (x left, y up, z ahead).
fn y_up(v: DVec3) -> DVec3 {
    DVec3::new(-v.z, v.y, v.x)
}

fn pose(numbers: &[f64]) -> MocapFrame {
    let mut rest = &numbers[1..];
    let mut take = |count: usize| {
        let (taken, left) = rest.split_at(count);
        rest = left;
        taken
    };
    let root = y_up(DVec3::from_slice(take(3)));
    let mut positions: Vec<DVec3> = Vec::with_capacity(JOINTS.len());
    let mut rotations: Vec<DQuat> = Vec::with_capacity(JOINTS.len());
    for (_, parent, offset, turn) in JOINTS {
        let turn = match turn {
            Turn::Ball => {
                let q = take(4);
                let axis = y_up(DVec3::new(q[1], q[2], q[3]));
                DQuat::from_xyzw(axis.x, axis.y, axis.z, q[0]).normalize()
            }
            Turn::Hinge => DQuat::from_axis_angle(y_up(DVec3::Z), take(1)[0]),
            Turn::Fixed => DQuat::IDENTITY,
        };
        match parent {
            None => {
                positions.push(world_from_y_up(root));
                rotations.push(world_from_y_up_rotation() * turn);
            }
            Some(parent) => {
                positions.push(positions[parent] + rotations[parent] * y_up(offset.into()));
                rotations.push(rotations[parent] * turn);
            }
        }
    }
    MocapFrame { positions, rotations }
}
