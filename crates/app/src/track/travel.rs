//! Which way somebody goes, from where the masks have shown them to stand: who walks or runs faces that way, and a silhouette
//! hardly tells front from back.

use std::collections::VecDeque;

use body::Camera;
use glam::DVec2;
use serde::{Deserialize, Serialize};
use silhouette::Mask;

use crate::shape::survey::{Sighting, TRAVEL_SECS, direction_of_travel, sight};

/// Places on the floor of the last frames, and of those ahead that are known already.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Travel {
    /// Frames looked at, first and one after the last,
    looked_at: (u64, u64),
    /// and those on which somebody stands, with the place, metres, world.
    path: VecDeque<(u64, [f64; 2])>,
}

impl Travel {
    /// Looks at the frames from `frame` on; those that were looked at before cost nothing. `camera` is that of the masks.
    pub fn look(&mut self, frame: u64, masks: &[&Mask], camera: &Camera, fps: f64) {
        if !(self.looked_at.0..=self.looked_at.1).contains(&frame) {
            *self = Self { looked_at: (frame, frame), path: VecDeque::new() };
        }
        for (frame, mask) in (frame..).zip(masks) {
            if frame >= self.looked_at.1 {
                self.looked_at.1 = frame + 1;
                if let Some(Sighting { place, .. }) = sight(mask, camera) {
                    self.path.push_back((frame, place.to_array()));
                }
            }
        }
        while self.path.front().is_some_and(|(first, _)| (first + n_frames(fps)) < frame) {
            self.path.pop_front();
        }
        self.looked_at.0 = frame;
    }

    /// Direction of travel about `frame`, unit, world; none for somebody who stands.
    pub fn direction(&self, frame: u64, fps: f64) -> Option<DVec2> {
        let near = self.path.iter().filter(|(at, _)| at.abs_diff(frame) <= n_frames(fps));
        let near: Vec<(f64, DVec2)> =
            near.map(|(at, place)| (*at as f64 / fps, DVec2::from_array(*place))).collect();
        direction_of_travel(&near)
    }
}

/// Frames on either side that count.
fn n_frames(fps: f64) -> u64 {
    (fps * TRAVEL_SECS / 2.0).round() as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn walk(step_m: f64) -> Travel {
        let path = (0..40).map(|frame| (frame, [0.0, step_m * frame as f64])).collect();
        Travel { looked_at: (0, 40), path }
    }

    #[test]
    fn a_walk_has_a_direction_and_a_sway_has_none() {
        let direction = walk(0.02).direction(20, 60.0).unwrap();
        assert!(direction.distance(DVec2::Y) < 1e-9, "{direction}");
        assert_eq!(walk(0.001).direction(20, 60.0), None);
    }

    #[test]
    fn a_jump_in_time_forgets_the_path() {
        let mut travel = walk(0.02);
        let camera = Camera::look_at(
            body::Intrinsics::from_focal(64, 48, 70.0).unwrap(),
            glam::DVec3::new(0.0, -4.0, 1.5),
            glam::DVec3::Z,
        )
        .unwrap();
        let nobody = Mask::new(64, 48);
        travel.look(200, &[&nobody], &camera, 60.0);
        assert_eq!(travel.direction(200, 60.0), None);
    }
}
