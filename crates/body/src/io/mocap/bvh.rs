//! Biovision motions (`.bvh`): a tree of joints with offsets, then one line of channel values a frame.

use std::path::Path;

use glam::{DQuat, DVec3};

use super::{Channel, LoadMocapError, Words, clip_name, read};
use crate::mocap::{MocapClip, MocapFrame, MocapJoint, world_from_y_up, world_from_y_up_rotation};

/// Reads a motion whose lengths are in units of `metres_per_unit`: the file does not say it (often 0.01, or 0.0254).
/// Axes: y up, at rest x to the left and z ahead.
///
/// # Errors
/// [`LoadMocapError`] names file, line and word.
pub fn load_bvh(path: &Path, metres_per_unit: f64) -> Result<MocapClip, LoadMocapError> {
    parse_bvh(path, &read(path)?, metres_per_unit)
}

struct Node {
    parent: Option<usize>,
    offset_m: DVec3,
    channels: Vec<Channel>,
}

pub(super) fn parse_bvh(path: &Path, text: &str, metres_per_unit: f64) -> Result<MocapClip, LoadMocapError> {
    let mut words = Words::new(path, text, None);
    words.keyword("HIERARCHY")?;
    let mut joints = Vec::new();
    let mut nodes = Vec::new();
    words.keyword("ROOT")?;
    parse_joint(&mut words, None, metres_per_unit, &mut joints, &mut nodes)?;
    words.keyword("MOTION")?;
    words.keyword("Frames:")?;
    let n_frames = words.number("the number of frames")?;
    words.keyword("Frame")?;
    words.keyword("Time:")?;
    let frame_secs = words.number("a positive frame time")?;
    if frame_secs <= 0.0 {
        return Err(words.unexpected("a positive frame time"));
    }
    let mut frames = Vec::new();
    while words.peek().is_some() {
        frames.push(parse_frame(&mut words, &nodes, frames.len(), metres_per_unit)?);
    }
    if frames.is_empty() {
        return Err(LoadMocapError::NoFrames { path: path.to_owned() });
    }
    if (frames.len() as f64) < n_frames {
        return Err(LoadMocapError::Ended {
            path: path.to_owned(),
            expected: "as many frames as `Frames:` says",
        });
    }
    Ok(MocapClip { name: clip_name(path), frame_rate_hz: 1.0 / frame_secs, joints, frames })
}

/// Reads from the name of a joint to its closing brace.
fn parse_joint(
    words: &mut Words<'_>,
    parent: Option<usize>,
    metres_per_unit: f64,
    joints: &mut Vec<MocapJoint>,
    nodes: &mut Vec<Node>,
) -> Result<(), LoadMocapError> {
    let mut name = words.word("the name of a joint")?.to_owned();
    if let ("Site", Some(parent)) = (name.as_str(), parent) {
        name = format!("{}_end", joints[parent].name);
    }
    words.keyword("{")?;
    words.keyword("OFFSET")?;
    let offset_m = words.vector("an offset of three numbers")? * metres_per_unit;
    let mut channels = Vec::new();
    if words.peek() == Some("CHANNELS") {
        words.keyword("CHANNELS")?;
        for _ in 0..words.number("the number of channels")? as usize {
            channels.push(match words.word("a channel")? {
                "Xposition" => Channel::Move(DVec3::X),
                "Yposition" => Channel::Move(DVec3::Y),
                "Zposition" => Channel::Move(DVec3::Z),
                "Xrotation" => Channel::Turn(DVec3::X),
                "Yrotation" => Channel::Turn(DVec3::Y),
                "Zrotation" => Channel::Turn(DVec3::Z),
                _ => return Err(words.unexpected("a channel such as Xposition or Zrotation")),
            });
        }
    }
    let rest_position = parent.map_or(DVec3::ZERO, |parent| joints[parent].rest_position) + offset_m;
    let index = joints.len();
    joints.push(MocapJoint { name, parent, rest_position });
    nodes.push(Node { parent, offset_m, channels });
    loop {
        match words.word("JOINT, End Site or }")? {
            "}" => return Ok(()),
            "JOINT" | "End" => parse_joint(words, Some(index), metres_per_unit, joints, nodes)?,
            _ => return Err(words.unexpected("JOINT, End Site or }")),
        }
    }
}

fn parse_frame(
    words: &mut Words<'_>,
    nodes: &[Node],
    frame: usize,
    metres_per_unit: f64,
) -> Result<MocapFrame, LoadMocapError> {
    let expected = nodes.iter().map(|node| node.channels.len()).sum();
    let count = words.left_in_line();
    if count != expected {
        return Err(LoadMocapError::FrameLength { path: words.path.to_owned(), frame, count, expected });
    }
    let mut positions: Vec<DVec3> = Vec::with_capacity(nodes.len());
    let mut rotations: Vec<DQuat> = Vec::with_capacity(nodes.len());
    for node in nodes {
        let (mut shift, mut turn) = (DVec3::ZERO, DQuat::IDENTITY);
        for channel in &node.channels {
            let value = words.number("a number")?;
            match *channel {
                Channel::Move(axis) => shift += value * metres_per_unit * axis,
                Channel::Turn(axis) => turn *= DQuat::from_axis_angle(axis, value.to_radians()),
            }
        }
        // Position channels stand in place of the offset.
        let moves = node.channels.iter().any(|channel| matches!(channel, Channel::Move(_)));
        let local = if moves { shift } else { node.offset_m };
        match node.parent {
            None => {
                positions.push(world_from_y_up(local));
                rotations.push(world_from_y_up_rotation() * turn);
            }
            Some(parent) => {
                positions.push(positions[parent] + rotations[parent] * local);
                rotations.push(rotations[parent] * turn);
            }
        }
    }
    Ok(MocapFrame { positions, rotations })
}
