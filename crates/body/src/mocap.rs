//! Recorded motion of a recorded skeleton, whatever file it came from.
//!
//! Recorded skeletons differ from ours in joints, bone lengths and rest pose: [`crate::retarget`] carries the motion over.

use glam::{DQuat, DVec3};

/// A joint of a recorded skeleton: the point at which its segment begins.
#[derive(Clone, Debug, PartialEq)]
pub struct MocapJoint {
    /// Its name in the file; the end of a last segment is called `<segment>_end`.
    pub name: String,
    /// Index of the joint it hangs on; parents come first.
    pub parent: Option<usize>,
    /// Place in the recorded skeleton's rest pose, metres, body frame (y up, faces +z, its left at +x).
    pub rest_position: DVec3,
}

/// One instant of a recorded motion.
#[derive(Clone, Debug, PartialEq)]
pub struct MocapFrame {
    /// Joint positions, `[n_joints]`, metres, world (z up).
    pub positions: Vec<DVec3>,
    /// `world_from_segment`, `[n_joints]`: turns directions of the rest pose (body frame) into the world.
    pub rotations: Vec<DQuat>,
}

/// A recorded motion.
#[derive(Clone, Debug, PartialEq)]
pub struct MocapClip {
    /// File name without its extension.
    pub name: String,
    /// Frames a second.
    pub frame_rate_hz: f64,
    /// The recorded skeleton.
    pub joints: Vec<MocapJoint>,
    /// The motion.
    pub frames: Vec<MocapFrame>,
}

impl MocapClip {
    /// Index of the joint called `name`.
    #[must_use]
    pub fn joint(&self, name: &str) -> Option<usize> {
        self.joints.iter().position(|joint| joint.name == name)
    }

    /// The same motion at another rate, positions interpolated in a straight line, rotations along the shortest arc.
    ///
    /// # Panics
    /// When `frame_rate_hz` is not positive.
    #[must_use]
    pub fn resampled(&self, frame_rate_hz: f64) -> Self {
        assert!(frame_rate_hz > 0.0, "a rate of {frame_rate_hz} frames a second");
        let step = self.frame_rate_hz / frame_rate_hz;
        let last = self.frames.len().saturating_sub(1);
        let n_frames =
            if self.frames.is_empty() { 0 } else { (last as f64 / step + 1e-9).floor() as usize + 1 };
        let frames = (0..n_frames).map(|frame| {
            let at = (frame as f64 * step).min(last as f64);
            let before = at.floor() as usize;
            self.frames[before].towards(&self.frames[(before + 1).min(last)], at - before as f64)
        });
        Self { frame_rate_hz, frames: frames.collect(), ..self.clone() }
    }
}

impl MocapFrame {
    fn towards(&self, next: &Self, share: f64) -> Self {
        let positions = self.positions.iter().zip(&next.positions).map(|(a, b)| a.lerp(*b, share));
        let rotations = self.rotations.iter().zip(&next.rotations).map(|(a, b)| a.slerp(*b, share));
        Self { positions: positions.collect(), rotations: rotations.collect() }
    }
}

/// From the axes of the body frame and of most recordings (x left, y up, z ahead) to those of the world (z up), by
/// exchange of names alone: ahead becomes +x, left +y.
pub(crate) fn world_from_y_up(v: DVec3) -> DVec3 {
    DVec3::new(v.z, v.x, v.y)
}

/// As [`world_from_y_up`], for the rotation that does it.
pub(crate) fn world_from_y_up_rotation() -> DQuat {
    // A third of a turn about the diagonal.
    DQuat::from_xyzw(0.5, 0.5, 0.5, 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_axes_are_exchanged_by_a_rotation() {
        for v in [DVec3::X, DVec3::Y, DVec3::Z] {
            assert!((world_from_y_up_rotation() * v).distance(world_from_y_up(v)) < 1e-15);
        }
    }

    #[test]
    fn resampling_meets_the_old_frames_and_the_middle_between_them() {
        let frame = |turn: f64, x: f64| MocapFrame {
            positions: vec![DVec3::new(x, 0.0, 0.0)],
            rotations: vec![DQuat::from_rotation_z(turn)],
        };
        let joints = vec![MocapJoint { name: "root".into(), parent: None, rest_position: DVec3::ZERO }];
        let frames = vec![frame(0.0, 0.0), frame(0.2, 1.0), frame(0.6, 3.0)];
        let clip = MocapClip { name: "clip".into(), frame_rate_hz: 30.0, joints, frames };
        let twice = clip.resampled(60.0);
        let x: Vec<f64> = twice.frames.iter().map(|f| f.positions[0].x).collect();
        assert_eq!(x, [0.0, 0.5, 1.0, 2.0, 3.0]);
        assert!(twice.frames[3].rotations[0].angle_between(DQuat::from_rotation_z(0.4)) < 1e-7);
        assert_eq!(twice.resampled(30.0).frames.len(), 3);
        assert_eq!(clip.resampled(20.0).frames.len(), 2);
    }
}
