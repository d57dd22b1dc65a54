//! Acclaim skeletons (`.asf`) and motions (`.amc`), as in the motion capture database of Carnegie Mellon University.
//!
//! A bone has an axis frame `C = Rz Ry Rx`; its angles make `M = Rz Ry Rx`; it turns by `C M C⁻¹` against its parent. Its
//! direction at rest is given in the axes of the world, so that its rotation counts from the rest pose.

use std::path::Path;

use glam::{DQuat, DVec3};

use super::{Channel, LoadMocapError, Words, clip_name, read};
use crate::mocap::{MocapClip, MocapFrame, MocapJoint, world_from_y_up, world_from_y_up_rotation};

/// The database's files count in inches divided by the skeleton's `length`.
const METRES_PER_INCH: f64 = 0.0254;

/// Frames a second of the motions; the files do not say it.
const FRAME_RATE_HZ: f64 = 120.0;

/// Reads the motion `amc` of the skeleton `asf`. Axes: y up, at rest x to the left and z ahead.
///
/// # Errors
/// [`LoadMocapError`] names file, line and word.
pub fn load_asf_amc(asf: &Path, amc: &Path) -> Result<MocapClip, LoadMocapError> {
    let skeleton = Skeleton::parse(asf, &read(asf)?)?;
    parse_amc(&skeleton, amc, &read(amc)?)
}

pub(super) struct Skeleton {
    metres_per_unit: f64,
    radians_per_unit: f64,
    root_channels: Vec<Channel>,
    /// Parents first; the root is not among them.
    bones: Vec<Bone>,
}

struct Bone {
    name: String,
    /// Index among the bones, or none for a bone of the root.
    parent: Option<usize>,
    /// Unit direction at rest, body frame.
    direction: DVec3,
    length_m: f64,
    axes: DQuat,
    channels: Vec<Channel>,
}

impl Bone {
    /// `C M C⁻¹`. Values come in the order of `channels`; M multiplies them as Rz Ry Rx, whatever that order.
    fn rotation(&self, values: &[f64], radians: f64) -> DQuat {
        let turn = |axis: DVec3| {
            let found = self.channels.iter().position(|channel| *channel == Channel::Turn(axis));
            found.map_or(DQuat::IDENTITY, |index| DQuat::from_axis_angle(axis, values[index] * radians))
        };
        let m = turn(DVec3::Z) * turn(DVec3::Y) * turn(DVec3::X);
        self.axes * m * self.axes.inverse()
    }
}

/// `Rz Ry Rx` of three angles in radians.
fn rz_ry_rx(angles: DVec3) -> DQuat {
    DQuat::from_rotation_z(angles.z) * DQuat::from_rotation_y(angles.y) * DQuat::from_rotation_x(angles.x)
}

fn channel(words: &Words<'_>, word: &str) -> Result<Channel, LoadMocapError> {
    let axis = match word.chars().last() {
        Some('x' | 'X') => DVec3::X,
        Some('y' | 'Y') => DVec3::Y,
        Some('z' | 'Z') => DVec3::Z,
        _ => return Err(words.unexpected("a channel: tx ty tz rx ry or rz")),
    };
    match word.chars().next() {
        Some('t' | 'T') if word.len() == 2 => Ok(Channel::Move(axis)),
        Some('r' | 'R') if word.len() == 2 => Ok(Channel::Turn(axis)),
        _ => Err(words.unexpected("a channel: tx ty tz rx ry or rz")),
    }
}

impl Skeleton {
    pub(super) fn parse(path: &Path, text: &str) -> Result<Self, LoadMocapError> {
        let mut words = Words::new(path, text, Some('#'));
        let mut skeleton = Self {
            metres_per_unit: METRES_PER_INCH,
            radians_per_unit: 1.0,
            root_channels: Vec::new(),
            bones: Vec::new(),
        };
        let mut unsorted = Vec::new();
        while let Some(section) = words.peek() {
            words.word("a section")?;
            match section {
                ":units" => skeleton.parse_units(&mut words)?,
                ":root" => skeleton.parse_root(&mut words)?,
                ":bonedata" => unsorted = skeleton.parse_bones(&mut words)?,
                ":hierarchy" => {
                    let parents = parse_hierarchy(&mut words)?;
                    skeleton.bones = sorted(path, std::mem::take(&mut unsorted), &parents)?;
                }
                _ => {} // version, name, documentation: nothing that moves
            }
        }
        if skeleton.bones.is_empty() {
            return Err(LoadMocapError::Ended {
                path: path.to_owned(),
                expected: "`:bonedata` and `:hierarchy`",
            });
        }
        Ok(skeleton)
    }

    fn parse_units(&mut self, words: &mut Words<'_>) -> Result<(), LoadMocapError> {
        while !at_section(words) {
            match words.word("a unit")? {
                "length" => {
                    self.metres_per_unit = METRES_PER_INCH / words.number("a positive length unit")?
                }
                "angle" => {
                    self.radians_per_unit = match words.word("deg or rad")? {
                        "deg" => 1f64.to_radians(),
                        "rad" => 1.0,
                        _ => return Err(words.unexpected("deg or rad")),
                    }
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn parse_root(&mut self, words: &mut Words<'_>) -> Result<(), LoadMocapError> {
        while !at_section(words) {
            if words.word("a field of the root")? == "order" {
                while matches!(words.peek(), Some(word) if word.len() == 2) {
                    let word = words.word("a channel")?;
                    self.root_channels.push(channel(words, word)?);
                }
            }
        }
        Ok(())
    }

    /// Bones with no parents yet.
    fn parse_bones(&self, words: &mut Words<'_>) -> Result<Vec<Bone>, LoadMocapError> {
        let mut bones = Vec::new();
        while !at_section(words) {
            words.keyword("begin")?;
            let mut bone = Bone {
                name: String::new(),
                parent: None,
                direction: DVec3::ZERO,
                length_m: 0.0,
                axes: DQuat::IDENTITY,
                channels: Vec::new(),
            };
            loop {
                match words.word("a field of a bone")? {
                    "end" => break,
                    "name" => bone.name = words.word("a name")?.to_owned(),
                    "direction" => bone.direction = words.vector("a direction")?.normalize_or_zero(),
                    "length" => bone.length_m = words.number("a length")? * self.metres_per_unit,
                    "axis" => {
                        bone.axes = rz_ry_rx(words.vector("the angles of an axis")? * self.radians_per_unit);
                        words.keyword("XYZ")?;
                    }
                    "dof" => {
                        while matches!(words.peek(), Some("rx" | "ry" | "rz")) {
                            let word = words.word("a channel")?;
                            bone.channels.push(channel(words, word)?);
                        }
                    }
                    _ => {} // id, limits, masses: of no use here
                }
            }
            bones.push(bone);
        }
        Ok(bones)
    }

    /// Index of a bone's joint in the clip: the root is joint 0.
    fn joints(&self) -> Vec<MocapJoint> {
        let mut joints = vec![MocapJoint { name: "root".into(), parent: None, rest_position: DVec3::ZERO }];
        let mut ends = Vec::new();
        for (index, bone) in self.bones.iter().enumerate() {
            let begin = bone.parent.map_or(DVec3::ZERO, |parent| {
                joints[parent + 1].rest_position + self.bones[parent].direction * self.bones[parent].length_m
            });
            let parent = Some(bone.parent.map_or(0, |parent| parent + 1));
            joints.push(MocapJoint { name: bone.name.clone(), parent, rest_position: begin });
            if self.bones.iter().all(|other| other.parent != Some(index)) {
                let rest_position = begin + bone.direction * bone.length_m;
                ends.push(MocapJoint {
                    name: format!("{}_end", bone.name),
                    parent: Some(index + 1),
                    rest_position,
                });
            }
        }
        joints.extend(ends);
        joints
    }
}

fn at_section(words: &Words<'_>) -> bool {
    words.peek().is_none_or(|word| word.starts_with(':'))
}

/// Pairs of child and parent.
fn parse_hierarchy(words: &mut Words<'_>) -> Result<Vec<(String, String)>, LoadMocapError> {
    words.keyword("begin")?;
    let mut pairs = Vec::new();
    while words.peek().is_some_and(|word| word != "end") {
        let line: Vec<String> = words.rest_of_line().iter().map(|(_, word)| (*word).to_owned()).collect();
        pairs.extend(line[1..].iter().map(|child| (child.clone(), line[0].clone())));
    }
    words.keyword("end")?;
    Ok(pairs)
}

/// The bones in an order that has parents first.
fn sorted(
    path: &Path,
    mut bones: Vec<Bone>,
    parents: &[(String, String)],
) -> Result<Vec<Bone>, LoadMocapError> {
    let mut sorted: Vec<Bone> = Vec::with_capacity(bones.len());
    let parent_of =
        |name: &str| parents.iter().find(|(child, _)| child == name).map(|(_, parent)| parent.as_str());
    while !bones.is_empty() {
        let ready = bones.iter().position(|bone| {
            parent_of(&bone.name)
                .is_some_and(|parent| parent == "root" || sorted.iter().any(|b| b.name == parent))
        });
        let Some(ready) = ready else {
            let expected = "each bone in `:hierarchy`, joined to the root";
            return Err(LoadMocapError::Ended { path: path.to_owned(), expected });
        };
        let mut bone = bones.remove(ready);
        let parent = parent_of(&bone.name).expect("it was found above");
        bone.parent = sorted.iter().position(|other| other.name == parent);
        sorted.push(bone);
    }
    Ok(sorted)
}

pub(super) fn parse_amc(skeleton: &Skeleton, path: &Path, text: &str) -> Result<MocapClip, LoadMocapError> {
    let mut words = Words::new(path, text, Some('#'));
    while matches!(words.peek(), Some(word) if word.starts_with(':')) {
        words.rest_of_line();
    }
    let joints = skeleton.joints();
    let mut frames = Vec::new();
    while words.peek().is_some() {
        words.number("a frame number")?;
        frames.push(parse_frame(skeleton, &joints, &mut words, frames.len())?);
    }
    if frames.is_empty() {
        return Err(LoadMocapError::NoFrames { path: path.to_owned() });
    }
    Ok(MocapClip { name: clip_name(path), frame_rate_hz: FRAME_RATE_HZ, joints, frames })
}

fn parse_frame(
    skeleton: &Skeleton,
    joints: &[MocapJoint],
    words: &mut Words<'_>,
    frame: usize,
) -> Result<MocapFrame, LoadMocapError> {
    let mut root = (DVec3::ZERO, DQuat::IDENTITY);
    let mut local: Vec<Option<DQuat>> =
        skeleton.bones.iter().map(|bone| bone.channels.is_empty().then_some(DQuat::IDENTITY)).collect();
    while words.peek().is_some_and(|word| word.parse::<f64>().is_err()) {
        let name = words.word("a bone")?;
        let bone = skeleton.bones.iter().position(|bone| bone.name == name);
        let channels = match bone {
            Some(bone) => &skeleton.bones[bone].channels,
            None if name == "root" => &skeleton.root_channels,
            None => return Err(words.unexpected("a bone of the skeleton")),
        };
        let values = channels.iter().map(|_| words.number("a number for each channel of the bone"));
        let values = values.collect::<Result<Vec<f64>, _>>()?;
        match bone {
            Some(bone) => {
                local[bone] = Some(skeleton.bones[bone].rotation(&values, skeleton.radians_per_unit))
            }
            None => root = root_motion(skeleton, &values),
        }
    }
    let mut positions = vec![world_from_y_up(root.0)];
    let mut rotations = vec![world_from_y_up_rotation() * root.1];
    for (bone, local) in skeleton.bones.iter().zip(local) {
        let local = local.ok_or_else(|| LoadMocapError::BoneMissing {
            path: words.path.to_owned(),
            frame,
            bone: bone.name.clone(),
        })?;
        let parent = bone.parent.map_or(0, |parent| parent + 1);
        let reach =
            bone.parent.map_or(DVec3::ZERO, |p| skeleton.bones[p].direction * skeleton.bones[p].length_m);
        positions.push(positions[parent] + rotations[parent] * reach);
        rotations.push(rotations[parent] * local);
    }
    for joint in &joints[positions.len()..] {
        let parent = joint.parent.expect("an end hangs on its bone");
        let reach = joint.rest_position - joints[parent].rest_position;
        positions.push(positions[parent] + rotations[parent] * reach);
        rotations.push(rotations[parent]);
    }
    Ok(MocapFrame { positions, rotations })
}

/// Position in metres and rotation `Rz Ry Rx` of the root, both y up.
fn root_motion(skeleton: &Skeleton, values: &[f64]) -> (DVec3, DQuat) {
    let mut angles = DVec3::ZERO;
    let mut position = DVec3::ZERO;
    for (channel, value) in skeleton.root_channels.iter().zip(values) {
        match *channel {
            Channel::Move(axis) => position += *value * skeleton.metres_per_unit * axis,
            Channel::Turn(axis) => angles += *value * skeleton.radians_per_unit * axis,
        }
    }
    (position, rz_ry_rx(angles))
}
