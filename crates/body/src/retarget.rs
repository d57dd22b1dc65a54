//! Carries recorded motion over to our skeleton.
//!
//! Recorded skeletons rest in other poses and have other bones. For each of our segments a table says which recorded
//! segment it follows, and how the two lie to each other at rest: trunk and feet are upright in both, limbs are laid on
//! one another by their long axis and a second direction (hinge of elbow or knee, side of the thumb). That gives the
//! rotation of each of our segments; with a person's bone lengths, the place of each joint; and by inverse kinematics the
//! angles inside our joint limits.

use glam::{DMat3, DQuat, DVec3};

use crate::ik::{IkConfig, Pull, Target, solve, solve_from_scratch};
use crate::mocap::{MocapClip, MocapFrame};
use crate::pose::{Pose, RestJoints, forward_kinematics};
use crate::skeleton::{JointId, N_DOF, N_JOINTS, Skeleton};

mod smooth;
mod table;

use table::{Lies, Segment};

/// How to carry a motion over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RetargetConfig {
    /// Rate of the poses, frames a second.
    pub frame_rate_hz: f64,
    /// Standard deviation of the Gaussian that smooths angles and root over time, seconds; 0 leaves them as they are.
    /// The default lets half of the amplitude through at about 9 Hz.
    pub smoothing_secs: f64,
}

impl Default for RetargetConfig {
    fn default() -> Self {
        Self { frame_rate_hz: 60.0, smoothing_secs: 0.02 }
    }
}

/// A motion of our skeleton, standing on the floor z = 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// Name of the clip.
    pub name: String,
    /// Frames a second.
    pub frame_rate_hz: f64,
    /// One pose a frame.
    pub poses: Vec<Pose>,
}

impl Motion {
    /// The motion as a mirror shows it, left and right exchanged.
    #[must_use]
    pub fn mirrored(&self) -> Self {
        let name = format!("{} mirrored", self.name);
        Self { name, poses: self.poses.iter().map(Pose::mirror).collect(), ..*self }
    }
}

/// How well a motion could be carried over: what limits and missing degrees of freedom cost, and smoothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RetargetError {
    /// Mean distance of a joint from its place by the recorded directions, metres.
    pub joint_mean_m: f64,
    /// The largest of them.
    pub joint_worst_m: f64,
    /// Mean angle between a bone and the direction recorded, radians.
    pub direction_mean_rad: f64,
}

/// Why a clip cannot be carried over.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum RetargetClipError {
    /// A skeleton of another kind.
    #[error(
        "{clip}: has no joint `{joint}`, expected the joints of the CMU database or of the 44-number humanoid"
    )]
    MissingJoint { clip: String, joint: String },
    /// Nothing to carry over.
    #[error("{clip}: has no frames")]
    NoFrames { clip: String },
}

/// A segment's orientation is held by a point this far from its joint, metres, and
const MARKER_ARM_M: f64 = 0.1;
/// that point counts this much of a joint.
const MARKER_WEIGHT: f64 = 0.3;

/// Turning a joint by a radian from one frame to the next costs as much as a joint this many metres off.
const INERTIA_M_PER_RAD: f64 = 0.01;

/// The motion of `clip` for a person with joints `rest`, and how well it fits.
///
/// # Errors
/// [`RetargetClipError`] when the clip is empty or of a skeleton that no table describes.
///
/// # Panics
/// When the configuration has a rate that is not positive or a negative smoothing.
pub fn retarget(
    clip: &MocapClip,
    rest: &RestJoints,
    config: &RetargetConfig,
) -> Result<(Motion, RetargetError), RetargetClipError> {
    let source = Source::new(clip, rest)?;
    let clip = clip.resampled(config.frame_rate_hz);
    let mut targets: Vec<Vec<Target>> = clip.frames.iter().map(|frame| source.targets(frame, rest)).collect();
    let Some(first) = targets.first() else {
        return Err(RetargetClipError::NoFrames { clip: clip.name });
    };
    let mut pose = solve_from_scratch(rest, first, None, &IkConfig::default()).pose;
    let mut poses = Vec::with_capacity(targets.len());
    for targets in &targets {
        let reference = pose.angles.clone();
        let pull = Pull { reference: &reference, metres_per_rad: &[INERTIA_M_PER_RAD; N_DOF] };
        pose = solve(rest, targets, &pose, Some(pull), &IkConfig::default()).pose;
        poses.push(pose.clone());
    }
    smooth::despike(&mut poses);
    smooth::gaussian(&mut poses, config.smoothing_secs * config.frame_rate_hz);
    let lift = height_above_floor(rest, &poses);
    poses.iter_mut().for_each(|pose| pose.root_position.z -= lift);
    targets.iter_mut().flatten().for_each(|target| target.position.z -= lift);
    let error = fit_error(rest, &poses, &targets);
    Ok((Motion { name: clip.name, frame_rate_hz: config.frame_rate_hz, poses }, error))
}

/// What a clip's skeleton has to do with ours.
struct Source {
    segments: Vec<ResolvedSegment>,
    left_hip: usize,
    right_hip: usize,
    /// Our legs over the recorded ones.
    scale: f64,
}

/// One of our segments, and the recorded ones it follows.
struct ResolvedSegment {
    joint: JointId,
    /// Indices of one or two recorded joints, and the share of the second.
    follows: [usize; 2],
    share: f64,
    /// Turns our rest segment onto the recorded one.
    source_from_ours: DQuat,
}

impl Source {
    fn new(clip: &MocapClip, rest: &RestJoints) -> Result<Self, RetargetClipError> {
        let find = |joint: &str| {
            let missing =
                || RetargetClipError::MissingJoint { clip: clip.name.clone(), joint: joint.to_owned() };
            clip.joint(joint).ok_or_else(missing)
        };
        let table = if clip.joint("chest").is_some() { table::humanoid() } else { table::cmu() };
        let mut segments = Vec::with_capacity(table.segments.len());
        for Segment { joint, follows: [first, second], share, lies } in &table.segments {
            let follows = [find(first)?, find(second)?];
            let source_from_ours = match lies {
                Lies::Upright => DQuat::IDENTITY,
                Lies::Along { end, our_end, side, our_side } => {
                    let along = clip.joints[find(end)?].rest_position - clip.joints[follows[0]].rest_position;
                    let ours = rest[our_end.index()] - rest[joint.index()];
                    frame(along, *side) * frame(ours, *our_side).inverse()
                }
            };
            segments.push(ResolvedSegment { joint: *joint, follows, share: *share, source_from_ours });
        }
        let [hip, knee, ankle] = table.left_leg;
        let at = |joint| find(joint).map(|index| clip.joints[index].rest_position);
        let recorded_leg = at(hip)?.distance(at(knee)?) + at(knee)?.distance(at(ankle)?);
        let ours = |joint: JointId| rest[joint.index()];
        let our_leg = ours(JointId::LEFT_HIP).distance(ours(JointId::LEFT_KNEE))
            + ours(JointId::LEFT_KNEE).distance(ours(JointId::LEFT_ANKLE));
        Ok(Self {
            segments,
            left_hip: find(hip)?,
            right_hip: find(table.right_hip)?,
            scale: our_leg / recorded_leg,
        })
    }

    /// Joints and orientation markers of a person with joints `rest` who does what `frame` recorded.
    fn targets(&self, frame: &MocapFrame, rest: &RestJoints) -> Vec<Target> {
        // Segments that follow nothing go with their parents.
        let mut world_from_segment = [DQuat::IDENTITY; N_JOINTS];
        for joint in JointId::all() {
            let followed = self.segments.iter().find(|segment| segment.joint == joint);
            world_from_segment[joint.index()] = match (followed, joint.parent()) {
                (Some(segment), _) => {
                    let [first, second] = segment.follows.map(|index| frame.rotations[index]);
                    first.slerp(second, segment.share) * segment.source_from_ours
                }
                (None, Some(parent)) => world_from_segment[parent.index()],
                (None, None) => DQuat::IDENTITY,
            };
        }
        let middle = |a: DVec3, b: DVec3| 0.5 * (a + b);
        let hips_world = self.scale * middle(frame.positions[self.left_hip], frame.positions[self.right_hip]);
        let hips_body = middle(rest[JointId::LEFT_HIP.index()], rest[JointId::RIGHT_HIP.index()]);
        let mut positions = [DVec3::ZERO; N_JOINTS];
        for joint in JointId::all() {
            let (from, at, body) = match joint.parent() {
                None => (JointId::PELVIS, hips_world, hips_body),
                Some(parent) => (parent, positions[parent.index()], rest[parent.index()]),
            };
            positions[joint.index()] = at + world_from_segment[from.index()] * (rest[joint.index()] - body);
        }
        let joints = JointId::all().map(|joint| Target::joint(joint, positions[joint.index()]));
        let markers = self.segments.iter().map(|segment| {
            let offset_m = MARKER_ARM_M * DVec3::Z;
            let index = segment.joint.index();
            let position = positions[index] + world_from_segment[index] * offset_m;
            Target { joint: segment.joint, offset_m, position, weight: MARKER_WEIGHT }
        });
        joints.chain(markers).collect()
    }
}

/// A right-handed frame with its first axis along `along` and its second as near to `side` as can be.
fn frame(along: DVec3, side: DVec3) -> DQuat {
    let x = along.normalize();
    let z = x.cross(side).normalize();
    DQuat::from_mat3(&DMat3::from_cols(x, z.cross(x), z))
}

/// How far the soles are above the floor when they are on it: in all but the lowest twentieth of the frames they may fly.
fn height_above_floor(rest: &RestJoints, poses: &[Pose]) -> f64 {
    const SOLES: [JointId; 6] = [
        JointId::LEFT_HEEL,
        JointId::LEFT_BALL,
        JointId::LEFT_TOE_TIP,
        JointId::RIGHT_HEEL,
        JointId::RIGHT_BALL,
        JointId::RIGHT_TOE_TIP,
    ];
    let lowest = |pose: &Pose| {
        let frames = forward_kinematics(Skeleton::human(), rest, pose);
        // At rest the body stands on y = 0.
        let height = |joint: JointId| frames[joint.index()].translation.z - rest[joint.index()].y;
        SOLES.map(height).into_iter().fold(f64::INFINITY, f64::min)
    };
    let mut heights: Vec<f64> = poses.iter().map(lowest).collect();
    heights.sort_by(f64::total_cmp);
    heights[heights.len() / 20]
}

fn fit_error(rest: &RestJoints, poses: &[Pose], targets: &[Vec<Target>]) -> RetargetError {
    let (mut distance, mut worst, mut angle) = (0.0, 0f64, 0.0);
    for (pose, targets) in poses.iter().zip(targets) {
        let frames = forward_kinematics(Skeleton::human(), rest, pose);
        for joint in JointId::all() {
            let (place, target) = (frames[joint.index()].translation, targets[joint.index()].position);
            distance += place.distance(target);
            worst = worst.max(place.distance(target));
            if let Some(parent) = joint.parent() {
                let bone = place - frames[parent.index()].translation;
                angle += bone.angle_between(target - targets[parent.index()].position);
            }
        }
    }
    let n_frames = poses.len() as f64;
    RetargetError {
        joint_mean_m: distance / (n_frames * N_JOINTS as f64),
        joint_worst_m: worst,
        direction_mean_rad: angle / (n_frames * (N_JOINTS - 1) as f64),
    }
}

#[cfg(test)]
mod tests;
