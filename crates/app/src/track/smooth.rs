//! Fixed-lag smoothing: what the frames after one say of it.
//!
//! Filters side by side hold readings of the same silhouettes that one frame cannot tell apart. Over a stretch of frames they
//! are the states of a hidden Markov model, whose emissions are the fits of the readings and whose transitions are the motion
//! prior; its forward-backward pass `[Rabiner1989]` weighs the readings of a frame by all frames up to `lag` later. The path
//! so chosen is then smoothed as a random walk seen with noise: the steady Rauch-Tung-Striebel smoother of that model
//! weighs the frames about one by rho to the power of their distance.

use std::collections::VecDeque;
use std::sync::Arc;

use bme::log_sum_exp;
use body::Body;
use pf_core::estimate::weighted_mean;
use pf_core::scratch::with_buffer;
use pf_core::{Gaussian, NormalizedWeights, StateSpace as _};
use silhouette::Mask;

use super::overlap::BodyOverlap;
use super::reading::{Reading, is_same_way, log_weight, weights};
use super::state::{BodySpace, BodyState};
use crate::run_folder::FrameRecord;

/// Weight of a frame next to one, for a state that is seen with as much noise as it moves: the root in (0, 1) of
/// rho + 1/rho = 2 + (step / noise)².
const RHO: f64 = 0.382;
/// Frames further away than this weigh less than a thousandth.
const REACH: usize = 7;

/// A frame with its readings.
pub struct ReadFrame {
    /// What is known of the frame without those after it.
    pub record: FrameRecord,
    /// The readings, at least one.
    pub readings: Vec<Reading>,
    /// The mask, at the resolution of the camera that sees the body; none where nobody was seen.
    pub mask: Option<(Mask, body::Camera)>,
}

/// Holds frames back until those after them have been seen.
pub struct Smoother {
    space: BodySpace,
    body: Arc<Body>,
    /// The motion from one frame to the next.
    step: Gaussian,
    lag: usize,
    /// The last frames given out, oldest first, smoothed over readings but not over time.
    past: VecDeque<BodyState>,
    /// Frames held back, oldest first, each with the log forward variable of its readings.
    held: VecDeque<(ReadFrame, Vec<f64>)>,
}

impl Smoother {
    /// A smoother that looks `lag` frames ahead, for a body that moves by `step` (standard deviations of the space's
    /// coordinates) between frames.
    pub fn new(space: BodySpace, body: Arc<Body>, step: Gaussian, lag: usize) -> Self {
        Self { space, body, step, lag, past: VecDeque::new(), held: VecDeque::new() }
    }

    /// Takes the next frame, and gives out the one that lies `lag` before it, where there is one.
    ///
    /// # Errors
    /// When the mask does not fit its camera.
    pub fn push(&mut self, frame: ReadFrame) -> anyhow::Result<Option<FrameRecord>> {
        let arrived = match self.held.back() {
            None => vec![0.0; frame.readings.len()],
            Some((before, forward)) => frame
                .readings
                .iter()
                .map(|to| {
                    let ways = before.readings.iter().zip(forward);
                    let ways: Vec<f64> =
                        ways.map(|(from, forward)| forward + self.log_step(from, to)).collect();
                    log_sum_exp(&ways)
                })
                .collect(),
        };
        let forward: Vec<f64> = arrived
            .iter()
            .zip(&frame.readings)
            .map(|(arrived, reading)| arrived + log_weight(reading.fit))
            .collect();
        let total = log_sum_exp(&forward);
        self.held.push_back((frame, forward.iter().map(|log| log - total).collect()));
        if self.held.len() > self.lag { self.pop() } else { Ok(None) }
    }

    /// Gives out the oldest frame that is still held back.
    ///
    /// # Errors
    /// As [`Self::push`].
    pub fn pop(&mut self) -> anyhow::Result<Option<FrameRecord>> {
        let ahead = self.path();
        let Some((ReadFrame { mut record, mask, .. }, _)) = self.held.pop_front() else { return Ok(None) };
        let state = self.over_time(&ahead);
        self.past.push_back(ahead[0]);
        if self.past.len() > REACH {
            self.past.pop_front();
        }
        record.pose = self.space.pose(&state);
        record.joints_world = self.body.joints_world(&record.pose);
        if let Some((mask, camera)) = mask {
            let mut overlap = BodyOverlap::new(self.body.clone(), camera);
            overlap.set_mask(&mask)?;
            record.iou = overlap.counts(std::slice::from_ref(&record.pose))?[0].iou();
        }
        Ok(Some(record))
    }

    /// The mean reading of each frame held, given all of them: the backward pass.
    fn path(&self) -> Vec<BodyState> {
        let mut means = Vec::with_capacity(self.held.len());
        let mut after: Option<(&ReadFrame, Vec<f64>)> = None;
        for (frame, forward) in self.held.iter().rev() {
            let backward: Vec<f64> = match &after {
                None => vec![0.0; frame.readings.len()],
                Some((next, backward)) => frame
                    .readings
                    .iter()
                    .map(|from| {
                        let ways = next.readings.iter().zip(backward);
                        let ways: Vec<f64> = ways
                            .map(|(to, backward)| self.log_step(from, to) + log_weight(to.fit) + backward)
                            .collect();
                        log_sum_exp(&ways)
                    })
                    .collect(),
            };
            let log_posterior: Vec<f64> = forward.iter().zip(&backward).map(|(f, b)| f + b).collect();
            means.push(self.mean(&frame.readings, &log_posterior));
            after = Some((frame, backward));
        }
        means.reverse();
        means
    }

    /// The mean of the readings that are turned like the most probable one.
    fn mean(&self, readings: &[Reading], log_posterior: &[f64]) -> BodyState {
        let best = (0..readings.len())
            .fold(0, |best, k| if log_posterior[k] > log_posterior[best] { k } else { best });
        let states: Vec<BodyState> = readings.iter().map(|reading| reading.state).collect();
        weighted_mean(&self.space, &states, &weights(&states, log_posterior, best))
    }

    /// The first of `ahead`, smoothed by its neighbours on both sides as far as they are the same reading.
    fn over_time(&self, ahead: &[BodyState]) -> BodyState {
        let here = ahead[0];
        let (mut states, mut weights) = (vec![here], vec![1.0]);
        let before: Vec<&BodyState> = self.past.iter().rev().take(REACH).collect();
        let after: Vec<&BodyState> = ahead[1..].iter().take(REACH).collect();
        for side in [before, after] {
            let same = side.into_iter().take_while(|state| is_same_way(state, &here));
            for (distance, state) in (1..).zip(same) {
                states.push(*state);
                weights.push(RHO.powi(distance));
            }
        }
        let weights = NormalizedWeights::from_linear(weights).expect("the frame itself weighs 1");
        weighted_mean(&self.space, &states, &weights)
    }

    /// ln p of the way from one reading to the next frame's, up to a constant.
    fn log_step(&self, from: &Reading, to: &Reading) -> f64 {
        with_buffer(self.space.dim(), |delta| {
            self.space.local(&from.state, &to.state, delta);
            self.step.log_density(delta)
        })
    }
}

#[cfg(test)]
mod tests {
    use body::pose_prior::PosePrior;
    use body::{BodyModel, N_JOINTS, Pose};
    use glam::DVec3;

    use super::*;
    use crate::config::{TrackConfig, TrackParams};
    use crate::run_folder::Status;
    use crate::track::pose_model::pose_model;

    fn smoother(lag: usize) -> Smoother {
        let params = TrackParams::new(TrackConfig::default()).expect("defaults are sound");
        let space = BodySpace::new(
            pose_model(&PosePrior::builtin(), || unreachable!("free joints"), &params).expect("free joints"),
        );
        let step = Gaussian::diagonal(vec![0.03; space.dim()]).expect("deviations above 0");
        Smoother::new(space, Arc::new(BodyModel::builtin().mean()), step, lag)
    }

    /// A frame with readings at these places along x, metres, with these fits.
    fn frame(smoother: &Smoother, number: u64, readings: &[(f64, f64)]) -> ReadFrame {
        let state = |x: f64| {
            let mut pose = Pose::upright(DVec3::new(x, 4.0, 0.95), 0.0);
            pose.angles.copy_from_slice(PosePrior::builtin().mean_rad());
            smoother.space.state_from_pose(&pose)
        };
        let readings: Vec<Reading> =
            readings.iter().map(|&(x, fit)| Reading { state: state(x), fit }).collect();
        let record = FrameRecord {
            frame: number,
            status: Status::Tracked,
            pose: smoother.space.pose(&readings[0].state),
            joints_world: [DVec3::ZERO; N_JOINTS],
            joint_sd_m: [0.0; N_JOINTS],
            iou: 0.9,
            effective_sample_size: 1.0,
            unique_ancestors: 1,
            log_evidence: 0.0,
            learned: None,
        };
        ReadFrame { record, readings, mask: None }
    }

    fn run(lag: usize, frames: &[Vec<(f64, f64)>]) -> Vec<FrameRecord> {
        let mut smoother = smoother(lag);
        let mut records = Vec::new();
        for (number, readings) in (0..).zip(frames) {
            let frame = frame(&smoother, number, readings);
            records.extend(smoother.push(frame).expect("no mask that could fail"));
        }
        while let Some(record) = smoother.pop().expect("no mask that could fail") {
            records.push(record);
        }
        records
    }

    #[test]
    fn every_frame_comes_out_once_in_order_whatever_the_lag() {
        for lag in [0, 1, 5, 40] {
            let records = run(lag, &vec![vec![(0.0, -3.0)]; 12]);
            assert_eq!(records.iter().map(|r| r.frame).collect::<Vec<_>>(), (0..12).collect::<Vec<_>>());
        }
    }

    #[test]
    fn later_frames_choose_between_readings_that_one_frame_cannot_tell() {
        // Two readings half a metre apart fit alike, until the ninth frame fits the first one only.
        let mut frames = vec![vec![(0.0, -3.0), (0.5, -3.0)]; 12];
        for readings in &mut frames[8..] {
            readings[1].1 = -60.0;
        }
        let at_fourth = |lag: usize| run(lag, &frames)[3].pose.root_position.x;
        assert!((at_fourth(2) - 0.25).abs() < 0.01, "{}", at_fourth(2));
        assert!(at_fourth(10).abs() < 0.01, "{}", at_fourth(10));
    }

    #[test]
    fn noise_about_a_place_shrinks_as_the_kernel_says() {
        // Alternating error e: the two-sided kernel leaves e (1 - rho)² / (1 + rho)².
        let error_m = 0.02;
        let frames: Vec<_> =
            (0..30).map(|i| vec![(if i % 2 == 0 { error_m } else { -error_m }, -3.0)]).collect();
        let records = run(10, &frames);
        let left = records[15].pose.root_position.x.abs();
        let expected = error_m * ((1.0 - RHO) / (1.0 + RHO)).powi(2);
        assert!((left - expected).abs() < 2e-4, "{left} {expected}");
    }

    #[test]
    fn the_weight_of_a_neighbour_solves_its_equation() {
        assert!((RHO + 1.0 / RHO - 3.0).abs() < 1e-3);
    }
}
