//! A pose as a camera sees it, wherever the person stands.

use body::{N_DOF, Pose};
use glam::{DQuat, DVec3};

/// A body pose without its place: the same for every camera that sees the same silhouette, up to perspective.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewedPose {
    /// The direction that the pelvis faces less the direction from the camera to it, both in the floor plane, radians in
    /// (−π, π]: 0 shows the back, ±π the front, +π/2 faces the left of the image.
    pub heading_rad: f64,
    /// Rotation of the pelvis out of upright, a rotation vector in the body frame, radians.
    pub tilt_rad: DVec3,
    /// Joint angles, ``[n_dof]``, radians.
    pub angles: Vec<f64>,
}

impl ViewedPose {
    /// `pose` as seen by a camera at `camera_world`, metres.
    pub fn of(pose: &Pose, camera_world: DVec3) -> Self {
        let heading = pose.heading_rad();
        let upright = Pose::upright(DVec3::ZERO, heading).root_orientation;
        let tilt = upright.inverse() * pose.root_orientation;
        let shorter = if tilt.w < 0.0 { -tilt } else { tilt };
        Self {
            heading_rad: wrapped(heading - viewing_direction(camera_world, pose.root_position)),
            tilt_rad: shorter.to_scaled_axis(),
            angles: pose.angles.clone(),
        }
    }

    /// The pose of a pelvis at `root_world` before a camera at `camera_world`, metres; undoes [`Self::of`].
    pub fn pose(&self, camera_world: DVec3, root_world: DVec3) -> Pose {
        let heading = self.heading_rad + viewing_direction(camera_world, root_world);
        let mut pose = Pose::upright(root_world, heading);
        pose.root_orientation *= DQuat::from_scaled_axis(self.tilt_rad);
        pose.angles.clone_from(&self.angles);
        pose
    }

    /// What the mirrored mask shows.
    #[must_use]
    pub fn mirrored(&self) -> Self {
        // Seen along the mirror plane x = 0.
        Self::of(&self.pose(DVec3::ZERO, DVec3::Y).mirror(), DVec3::ZERO)
    }

    /// Tilt and angles in one row, [`ROW_LEN`] numbers.
    pub(super) fn to_row(&self) -> Vec<f64> {
        self.tilt_rad.to_array().iter().chain(&self.angles).copied().collect()
    }

    /// Undoes [`Self::to_row`]; angles come back inside their limits.
    pub(super) fn from_row(heading_rad: f64, row: &[f64]) -> Self {
        let mut pose = Pose::upright(DVec3::ZERO, 0.0);
        pose.angles.copy_from_slice(&row[3..]);
        pose.clamp();
        Self { heading_rad, tilt_rad: DVec3::from_slice(row), angles: pose.angles }
    }
}

/// Length of a row of tilt and angles: as many coordinates as a pose can have.
pub const ROW_LEN: usize = 3 + N_DOF;

/// Direction in the floor plane from a camera to a point, radians, as headings count.
fn viewing_direction(camera_world: DVec3, point_world: DVec3) -> f64 {
    let away = point_world - camera_world;
    away.y.atan2(away.x)
}

/// The same angle in (−π, π].
pub fn wrapped(angle_rad: f64) -> f64 {
    let (sin, cos) = angle_rad.sin_cos();
    sin.atan2(cos)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose() -> Pose {
        let mut pose = Pose::upright(DVec3::new(1.0, 2.5, 0.9), 0.7);
        pose.root_orientation *= DQuat::from_rotation_x(0.2) * DQuat::from_rotation_z(-0.1);
        pose.angles.iter_mut().enumerate().for_each(|(i, angle)| *angle = 0.01 * i as f64);
        pose
    }

    #[test]
    fn place_and_camera_are_taken_out_and_put_back() {
        let camera = DVec3::new(-2.0, -1.0, 1.5);
        let back = ViewedPose::of(&pose(), camera).pose(camera, pose().root_position);
        assert!(back.root_orientation.angle_between(pose().root_orientation) < 1e-9);
        assert_eq!(back.angles, pose().angles);
        // Turning camera and person together changes nothing.
        let turn = DQuat::from_rotation_z(1.1);
        let turned = Pose {
            root_position: turn * pose().root_position,
            root_orientation: turn * pose().root_orientation,
            angles: pose().angles,
        };
        let (a, b) = (ViewedPose::of(&pose(), camera), ViewedPose::of(&turned, turn * camera));
        assert!((a.heading_rad - b.heading_rad).abs() < 1e-9 && a.tilt_rad.distance(b.tilt_rad) < 1e-9);
    }

    #[test]
    fn heading_says_which_side_is_seen() {
        let camera = DVec3::new(0.0, -4.0, 1.0);
        let heading = |world: f64| ViewedPose::of(&Pose::upright(DVec3::Z, world), camera).heading_rad;
        // The camera looks along +y: who walks away faces +y, who faces -x looks to the left of the image.
        assert!(heading(std::f64::consts::FRAC_PI_2).abs() < 1e-9);
        assert!((heading(-std::f64::consts::FRAC_PI_2).abs() - std::f64::consts::PI).abs() < 1e-9);
        assert!((heading(std::f64::consts::PI) - std::f64::consts::FRAC_PI_2).abs() < 1e-9);
    }

    #[test]
    fn a_mirror_turns_the_heading_round_and_twice_is_none() {
        let seen = ViewedPose::of(&pose(), DVec3::new(0.0, -3.0, 1.0));
        let mirrored = seen.mirrored();
        assert!((mirrored.heading_rad + seen.heading_rad).abs() < 1e-9);
        let again = mirrored.mirrored();
        assert!((again.heading_rad - seen.heading_rad).abs() < 1e-9);
        assert!(again.tilt_rad.distance(seen.tilt_rad) < 1e-9);
        assert!(again.angles.iter().zip(&seen.angles).all(|(a, b)| (a - b).abs() < 1e-12));
    }
}
