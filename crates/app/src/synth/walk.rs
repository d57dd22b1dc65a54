//! Recorded walking on a curved path, carried over to a person.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::Path;

use anyhow::bail;
use body::io::mocap::{load_index, load_indexed_clip};
use body::mocap::{MocapClip, MocapFrame};
use body::retarget::{Motion, RetargetConfig, retarget};
use body::{Pose, RestJoints};
use glam::{DQuat, DVec2, DVec3};
use pf_core::rng::ParticleRng;

/// How long a walk is seen, how often, and how it bends.
#[derive(Clone, Debug, PartialEq)]
pub struct WalkConfig {
    /// Frames, at most: recordings are 2 to 5 seconds long.
    pub n_frames: usize,
    /// Frames a second.
    pub rate_hz: f64,
    /// Least and largest radius of the arc, metres.
    pub radius_m: [f64; 2],
    /// Standard deviation along x and y of the middle of the arc about the world's origin, metres.
    pub centre_sd_m: f64,
}

impl Default for WalkConfig {
    fn default() -> Self {
        Self { n_frames: 60, rate_hz: 25.0, radius_m: [1.05, 1.3], centre_sd_m: 0.1 }
    }
}

/// Recordings of walking.
pub struct Walks {
    clips: Vec<MocapClip>,
}

/// Who was recorded: the part of a recording's name before the number of the trial, as in `35_02`.
pub fn performer_of(recording: &str) -> &str {
    recording.split('_').next().unwrap_or(recording)
}

impl Walks {
    /// The clips of `folder` whose action is `walk` and whose split is one of `splits` (`train`, `validate`).
    ///
    /// # Errors
    /// Names the file at fault; also when there is no such clip.
    pub fn read(folder: &Path, splits: &[&str]) -> anyhow::Result<Self> {
        let mut clips = Vec::new();
        for entry in load_index(folder)? {
            if entry.action == "walk" && splits.contains(&entry.split.as_str()) {
                clips.push(load_indexed_clip(folder, &entry)?);
            }
        }
        if clips.is_empty() {
            bail!("{}: no clip of action `walk` and split {splits:?}", folder.join("index.csv").display());
        }
        Ok(Self { clips })
    }

    /// The recordings of each performer, by name.
    pub fn by_performer(self) -> BTreeMap<String, Self> {
        let mut parts: BTreeMap<String, Self> = BTreeMap::new();
        for clip in self.clips {
            let part = parts.entry(performer_of(&clip.name).to_owned());
            part.or_insert_with(|| Self { clips: Vec::new() }).clips.push(clip);
        }
        parts
    }

    /// A stretch of a random recording on a random arc, by a person with joints `rest`.
    ///
    /// # Errors
    /// When the recorded skeleton is of an unknown kind.
    pub fn walk(
        &self,
        rest: &RestJoints,
        config: &WalkConfig,
        rng: &mut ParticleRng,
    ) -> anyhow::Result<Motion> {
        let clip = &self.clips[(rng.uniform() * self.clips.len() as f64) as usize];
        let wanted = ((config.n_frames - 1) as f64 / config.rate_hz * clip.frame_rate_hz).ceil() as usize + 1;
        let spare = clip.frames.len().saturating_sub(wanted);
        let first = (rng.uniform() * (spare + 1) as f64) as usize;
        let last = (first + wanted).min(clip.frames.len());
        let stretch = MocapClip { frames: clip.frames[first..last].to_vec(), ..clip.clone() };
        let [least, largest] = config.radius_m;
        let arc = Arc {
            centre: config.centre_sd_m * DVec2::new(rng.standard_normal(), rng.standard_normal()),
            radius_m: least + (largest - least) * rng.uniform(),
            turn: if rng.uniform() < 0.5 { 1.0 } else { -1.0 },
            first_heading_rad: TAU * rng.uniform(),
        };
        let settings = RetargetConfig { frame_rate_hz: config.rate_hz, ..RetargetConfig::default() };
        let (mut motion, _) = retarget(&arc.bend(&stretch), rest, &settings)?;
        motion.poses.truncate(config.n_frames);
        // Half of the people walk as in a mirror: few recordings, many gaits.
        if rng.uniform() < 0.5 {
            motion.poses = motion.poses.iter().map(Pose::mirror).collect();
        }
        Ok(motion)
    }
}

/// A circular path on the floor.
struct Arc {
    centre: DVec2,
    radius_m: f64,
    /// 1 to the left, -1 to the right.
    turn: f64,
    first_heading_rad: f64,
}

impl Arc {
    /// The clip with its line of travel laid on the arc. Each joint goes by its own place along the line, so that a foot
    /// that stands stays where it is.
    fn bend(&self, clip: &MocapClip) -> MocapClip {
        let root = |frame: &MocapFrame| frame.positions[0].truncate();
        let (Some(first), Some(last)) = (clip.frames.first().map(root), clip.frames.last().map(root)) else {
            return clip.clone();
        };
        let ahead = (last - first).normalize_or(DVec2::X);
        let recorded_heading_rad = ahead.to_angle();
        let bent = |frame: &MocapFrame| {
            let moved = frame.positions.iter().zip(&frame.rotations).map(|(&position, &rotation)| {
                let offset = position.truncate() - first;
                let (along_m, left_m) = (ahead.dot(offset), ahead.perp_dot(offset));
                let heading_rad = self.first_heading_rad + self.turn * along_m / self.radius_m;
                let left = DVec2::from_angle(heading_rad).perp();
                let place = self.centre - (self.turn * self.radius_m - left_m) * left;
                let turn = DQuat::from_rotation_z(heading_rad - recorded_heading_rad);
                (DVec3::new(place.x, place.y, position.z), turn * rotation)
            });
            let (positions, rotations) = moved.unzip();
            MocapFrame { positions, rotations }
        };
        MocapClip { frames: clip.frames.iter().map(bent).collect(), ..clip.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use body::mocap::MocapJoint;

    #[test]
    fn a_straight_line_becomes_an_arc_of_its_length() {
        let frame = |x: f64| MocapFrame {
            positions: vec![DVec3::new(x, 2.0, 0.9), DVec3::new(x, 2.1, 0.1)],
            rotations: vec![DQuat::IDENTITY; 2],
        };
        let joint = MocapJoint { name: "root".into(), parent: None, rest_position: DVec3::ZERO };
        let clip = MocapClip {
            name: "line".into(),
            frame_rate_hz: 30.0,
            joints: vec![joint.clone(), joint],
            frames: (0..50).map(|k| frame(0.04 * f64::from(k))).collect(),
        };
        for turn in [1.0, -1.0] {
            let arc = Arc { centre: DVec2::new(0.3, -0.2), radius_m: 1.2, turn, first_heading_rad: 0.7 };
            let bent = arc.bend(&clip);
            let places: Vec<DVec2> = bent.frames.iter().map(|f| f.positions[0].truncate()).collect();
            let length: f64 = places.windows(2).map(|pair| pair[0].distance(pair[1])).sum();
            assert!((length - 49.0 * 0.04).abs() < 1e-3, "{length}");
            assert!(places.iter().all(|place| (place.distance(arc.centre) - 1.2).abs() < 1e-9));
            // It goes where it looks, and the left foot stays on the left.
            let heading = |k: usize| {
                let ahead = bent.frames[k].rotations[0] * DVec3::X;
                ahead.truncate()
            };
            let step = (places[11] - places[9]).normalize();
            assert!(step.dot(heading(10)) > 0.9999, "{step} {}", heading(10));
            let left = bent.frames[10].positions[1].truncate() - places[10];
            assert!((left.dot(heading(10).perp()) - 0.1).abs() < 1e-9);
            let swept = heading(0).angle_to(heading(49));
            assert!((swept - turn * 49.0 * 0.04 / 1.2).abs() < 1e-9, "{swept}");
        }
    }
}
