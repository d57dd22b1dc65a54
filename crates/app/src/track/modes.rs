//! Several trackers side by side: readings of the same silhouettes that one frame cannot tell apart.
//!
//! A filter of a few hundred particles settles on one reading of a limb's depth within frames. A few filters settle on
//! several; what they agree on is sure, the mean of what they do not agree on is nearer to the truth than any of them, and
//! a reading that explains the masks badly loses its say.

use body::{N_JOINTS, Pose};
use glam::DVec3;
use pf_core::NormalizedWeights;
use pf_core::estimate::weighted_mean;
use rayon::prelude::*;

use super::likelihood::Observation;
use super::reading::{self, Reading};
use super::state::{BodySpace, BodyState};
use super::tracker::{Scene, Tracker, TrackerState};
use crate::run_folder::FrameRecord;

/// Share of a mode's fit that is carried on from the frames before: it looks back over some ten frames.
const FIT_MEMORY: f64 = 0.9;

/// Trackers of one person, best first or not.
pub struct Modes {
    space: BodySpace,
    modes: Vec<Mode>,
    /// What each mode made of the last frame.
    readings: Vec<Reading>,
}

struct Mode {
    tracker: Tracker,
    /// Mean fit of the last frames.
    fit: f64,
}

/// What the modes remember between frames.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct ModesState {
    trackers: Vec<TrackerState>,
    fits: Vec<f64>,
}

impl Modes {
    /// Finds the person on the first of `frames`, see [`Tracker::start`].
    ///
    /// # Errors
    /// When the masks do not fit the camera.
    ///
    /// # Panics
    /// Without a frame, or when the mask of the first one is empty.
    pub fn start(
        scene: &Scene,
        frame: u64,
        frames: &[Observation],
        heading_rad: Option<f64>,
    ) -> anyhow::Result<Self> {
        let trackers = Tracker::start(scene, frame, frames, heading_rad)?;
        let modes = trackers.into_iter().map(|(tracker, fit)| Mode { tracker, fit }).collect();
        Ok(Self { space: BodySpace::new(scene.model.clone()), modes, readings: Vec::new() })
    }

    /// Goes on where others of the same scene gave out `state`.
    ///
    /// # Errors
    /// When the state is not that of modes.
    pub fn resume(scene: &Scene, state: ModesState) -> anyhow::Result<Self> {
        anyhow::ensure!(
            !state.trackers.is_empty() && state.trackers.len() == state.fits.len(),
            "checkpoint: {} trackers and {} fits, expected as many, and one at least",
            state.trackers.len(),
            state.fits.len()
        );
        let modes = state
            .trackers
            .into_iter()
            .zip(state.fits)
            .map(|(tracker, fit)| Ok(Mode { tracker: Tracker::resume(scene.clone(), tracker)?, fit }));
        let modes = modes.collect::<anyhow::Result<_>>()?;
        Ok(Self { space: BodySpace::new(scene.model.clone()), modes, readings: Vec::new() })
    }

    /// All that the modes remember.
    pub fn checkpoint(&self) -> ModesState {
        ModesState {
            trackers: self.modes.iter().map(|mode| mode.tracker.checkpoint()).collect(),
            fits: self.modes.iter().map(|mode| mode.fit).collect(),
        }
    }

    /// Works on the next frame.
    ///
    /// # Errors
    /// When the mask does not fit the camera.
    pub fn step(&mut self, seen: &Observation) -> anyhow::Result<FrameRecord> {
        let step = |Mode { tracker, fit }: &mut Mode| {
            let record = tracker.step(seen)?;
            *fit = FIT_MEMORY * *fit + (1.0 - FIT_MEMORY) * tracker.fit();
            Ok(record)
        };
        let records = self.modes.par_iter_mut().map(step).collect::<anyhow::Result<Vec<_>>>()?;
        self.readings = self.readings_of(&records, |mode| mode.tracker.fit());
        self.combine(records)
    }

    /// A frame that shows nobody.
    ///
    /// # Errors
    /// Never for trackers that have started.
    pub fn coast(&mut self) -> anyhow::Result<FrameRecord> {
        let records =
            self.modes.iter_mut().map(|mode| mode.tracker.coast()).collect::<anyhow::Result<Vec<_>>>()?;
        self.readings = self.readings_of(&records, |_| 0.0);
        self.combine(records)
    }

    /// Puts `pose` in place of what every mode believes, see [`Tracker::displace`].
    ///
    /// # Errors
    /// Never for trackers that have started.
    pub fn displace(&mut self, pose: &Pose) -> anyhow::Result<()> {
        self.modes.iter_mut().try_for_each(|mode| mode.tracker.displace(pose))
    }

    /// The camera, at working resolution.
    pub fn camera(&self) -> &body::Camera {
        self.modes[0].tracker.camera()
    }

    /// The mode that has explained the last masks best.
    fn best(&self) -> usize {
        (0..self.modes.len())
            .fold(0, |best, k| if self.modes[k].fit > self.modes[best].fit { k } else { best })
    }

    /// How well the best mode explains the masks: mean log-likelihood of the last frames, or of those that a start looked at.
    pub fn fit(&self) -> f64 {
        self.modes[self.best()].fit
    }

    /// The `n` heaviest particles of the best mode, see [`Tracker::best_particles`].
    pub fn best_particles(&self, n: usize) -> Vec<(Pose, f64)> {
        self.modes[self.best()].tracker.best_particles(n)
    }

    /// What each mode made of the last frame.
    pub fn readings(&self) -> &[Reading] {
        &self.readings
    }

    fn readings_of(&self, records: &[FrameRecord], fit: impl Fn(&Mode) -> f64) -> Vec<Reading> {
        let reading = |(record, mode): (&FrameRecord, &Mode)| Reading {
            state: self.space.state_from_pose(&record.pose),
            fit: fit(mode),
        };
        records.iter().zip(&self.modes).map(reading).collect()
    }

    /// The trackers, in no order.
    pub fn trackers(&self) -> impl Iterator<Item = &Tracker> {
        self.modes.iter().map(|mode| &mode.tracker)
    }

    /// One record of the modes' records, whose poses are those of the readings: the best mode's, its pose replaced by the
    /// weighted mean of the poses.
    fn combine(&mut self, records: Vec<FrameRecord>) -> anyhow::Result<FrameRecord> {
        let best = self.best();
        let states: Vec<BodyState> = self.readings.iter().map(|reading| reading.state).collect();
        let log_weights: Vec<f64> = self.modes.iter().map(|mode| reading::log_weight(mode.fit)).collect();
        let weights = reading::weights(&states, &log_weights, best);
        let mut record = records[best].clone();
        if weights.as_slice()[best] == 1.0 {
            return Ok(record);
        }
        let tracker = &mut self.modes[best].tracker;
        record.pose = self.space.pose(&weighted_mean(&self.space, &states, &weights));
        record.joints_world = tracker.joints_world(&record.pose);
        record.joint_sd_m = joint_sd_m(&records, &weights, &record.joints_world);
        if record.iou > 0.0 {
            record.iou = tracker.iou(&record.pose)?;
        }
        Ok(record)
    }
}

/// Standard deviation of each joint: within the modes, and between them.
fn joint_sd_m(
    records: &[FrameRecord],
    weights: &NormalizedWeights,
    mean: &[DVec3; N_JOINTS],
) -> [f64; N_JOINTS] {
    std::array::from_fn(|joint| {
        let variance = |record: &FrameRecord| {
            record.joint_sd_m[joint].powi(2) + record.joints_world[joint].distance_squared(mean[joint])
        };
        records
            .iter()
            .zip(weights.as_slice())
            .map(|(record, weight)| weight * variance(record))
            .sum::<f64>()
            .sqrt()
    })
}
