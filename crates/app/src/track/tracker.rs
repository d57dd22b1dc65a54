//! The top-down tracker: one annealed particle filter over the body's state, frame after frame.

use std::f64::consts::TAU;
use std::sync::Arc;

use body::{Body, Camera, N_JOINTS, Pose};
use glam::DVec3;
use pf_core::schedule::{DiffusionConfig, Geometric, GeometricConfig};
use pf_core::{Filter, FilterConfig, FilterParams, FilterState, FrameView, Gaussian, RandomWalk, Step};
use silhouette::Mask;

use super::likelihood::{Observation, SilhouetteLikelihood};
use super::moves::BodyMoves;
use super::overlap::BodyOverlap;
use super::pose_model::PoseModel;
use super::start::place_upright;
use super::state::{BodySpace, BodyState, RIGID_DIM};
use crate::config::TrackParams;

/// What became of the person on a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tracking {
    /// Seen and explained by the body.
    Tracked,
    /// Not seen: the pose is carried on from the frames before.
    Coasting,
    /// Not seen for too long, or not explained by any pose tried.
    Lost,
}

/// The tracker's answer to a frame.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// Whether to rely on it.
    pub tracking: Tracking,
    /// Weighted mean of the particles.
    pub pose: Pose,
    /// Joint positions of that pose, [n_joints], metres, world.
    pub joints_world: [DVec3; N_JOINTS],
    /// Standard deviation of each joint's position among the particles, [n_joints], metres: root of the summed variances.
    pub joint_sd_m: [f64; N_JOINTS],
    /// Intersection over union of that pose and the mask; 0 without a mask.
    pub iou: f64,
    /// Effective sample size of the last layer.
    pub effective_sample_size: f64,
    /// Particles of the frame before that have a descendant in the last layer.
    pub unique_ancestors: usize,
    /// The filter's log evidence of the frame; 0 without a mask.
    pub log_evidence: f64,
}

/// Standard deviation of the pelvis's change from one frame to the next: position (metres) and rotation (radians), in the
/// pelvis frame.
const RIGID_STEP_SD: [f64; RIGID_DIM] = [0.012, 0.012, 0.012, 0.02, 0.02, 0.02];
/// Share of the mask's extent by which a start may be off; the spread of its first particles. Position (metres) and
/// rotation (radians) in the pelvis frame.
const START_SD: [f64; RIGID_DIM] = [0.08, 0.05, 0.08, 0.1, 0.25, 0.1];
/// Spread of a start's pose coordinates, in standard deviations of a step.
const START_LATENT_STEPS: f64 = 8.0;
/// Times that a start works on its first mask before it looks at the next ones.
const START_ROUNDS: usize = 4;
/// Headings that a start tries when none is given.
const START_HEADINGS: usize = 8;
/// The best of them that are followed over the next masks.
const START_RIVALS: usize = 3;
/// Overlap under which the body is taken not to be on the person.
const LOST_IOU: f64 = 0.4;
/// Frames under that overlap in a row that make a loss.
const LOST_FRAMES: u32 = 5;
/// A mask of fewer pixels, at working resolution, shows nobody.
const LEAST_AREA_PX: u64 = 200;

type BodyFilter = Filter<BodySpace, RandomWalk<Observation>>;

/// What a tracker is made for: a body of one size before one camera, under one pose model.
#[derive(Clone)]
pub struct Scene {
    /// The person's body.
    pub body: Arc<Body>,
    /// The camera at the working resolution.
    pub camera: Camera,
    /// Coordinates and prior of the pose.
    pub model: Arc<dyn PoseModel>,
    /// Settings.
    pub params: TrackParams,
}

/// Follows one person. Masks have the size of the scene's camera.
pub struct Tracker {
    scene: Scene,
    likelihood: SilhouetteLikelihood,
    filter: BodyFilter,
    unseen: u32,
    badly_explained: u32,
}

/// What a tracker remembers between frames.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct TrackerState {
    filter: FilterState<BodyState>,
    unseen: u32,
    badly_explained: u32,
}

impl Tracker {
    /// Finds the person on the first of `masks`; the others, the frames that follow, help to choose among headings.
    /// The first call of [`step`](Self::step) is about the first mask again.
    ///
    /// # Errors
    /// When the masks do not fit the camera.
    ///
    /// # Panics
    /// Without a mask, or when the first one [shows nobody](shows_somebody).
    pub fn start(scene: Scene, frame: u64, masks: &[Mask]) -> anyhow::Result<Self> {
        let headings: Vec<f64> = match scene.params.initial_heading_deg {
            Some(heading_deg) => vec![heading_deg.to_radians()],
            None => (0..START_HEADINGS).map(|k| k as f64 * TAU / START_HEADINGS as f64).collect(),
        };
        let mut rivals = Vec::new();
        for heading in headings {
            rivals.push(Self::start_towards(scene.clone(), frame, &masks[0], heading)?);
        }
        rivals.sort_by(|(_, a), (_, b)| b.total_cmp(a));
        rivals.truncate(START_RIVALS);
        if rivals.len() == 1 || masks.len() == 1 {
            return Ok(rivals.swap_remove(0).0);
        }
        let mut best: Option<(TrackerState, f64)> = None;
        for (mut rival, _) in rivals {
            let beginning = rival.checkpoint();
            let mut evidence = 0.0;
            for mask in masks {
                evidence += rival.step(mask)?.log_evidence;
            }
            if best.as_ref().is_none_or(|(_, most)| evidence > *most) {
                best = Some((beginning, evidence));
            }
        }
        let (state, _) = best.expect("there is at least one heading");
        Self::resume(scene, state)
    }

    /// A tracker on `mask` whose body looks towards `heading_rad`, and its log evidence there.
    fn start_towards(scene: Scene, frame: u64, mask: &Mask, heading_rad: f64) -> anyhow::Result<(Self, f64)> {
        let mut tracker = Self::new(scene)?;
        tracker.likelihood.overlap.set_mask(mask)?;
        let mut angles = vec![0.0; body::N_DOF];
        tracker.scene.model.mean_angles(&mut angles);
        let placement = place_upright(&mut tracker.likelihood.overlap, mask, &angles, heading_rad)?;
        let placed = tracker.filter.space().state_from_pose(&placement.pose);
        let spread = Gaussian::diagonal(
            START_SD
                .into_iter()
                .chain(tracker.scene.model.step_sd().iter().map(|sd| START_LATENT_STEPS * sd))
                .collect(),
        )?;
        tracker.filter.restore(FilterState { frame, ..FilterState::from_particles(vec![placed]) })?;
        tracker.filter.initialise_with(|space, rng| {
            let mut state = placed;
            let mut delta = [0.0; RIGID_DIM + body::N_DOF];
            let delta = &mut delta[..space.dim()];
            spread.sample(1.0, rng, delta);
            space.retract(&mut state, delta);
            state
        });
        let mut evidence = 0.0;
        for _ in 0..START_ROUNDS {
            evidence = tracker.step(mask)?.log_evidence;
        }
        tracker.filter.restore(FilterState { frame, ..tracker.filter.checkpoint() })?;
        Ok((tracker, evidence))
    }
}

impl Tracker {
    /// A tracker without particles.
    fn new(scene: Scene) -> anyhow::Result<Self> {
        let params = &scene.params;
        let space = BodySpace::new(scene.model.clone());
        let step_sd: Vec<f64> =
            RIGID_STEP_SD.iter().chain(scene.model.step_sd()).map(|sd| params.diffusion * sd).collect();
        let noise = Gaussian::diagonal(step_sd)?;
        let schedule = Geometric::new(GeometricConfig {
            layers: params.layers,
            first_beta: params.annealing_ratio.powi(params.layers as i32 - 1),
            last_beta: 1.0,
            diffusion: DiffusionConfig { first: params.diffusion_ratio, ratio: params.diffusion_ratio },
        })?;
        let moves = BodyMoves::new(noise.clone(), &scene);
        let filter_params = FilterParams::new(FilterConfig {
            n_particles: params.particles as usize,
            seed: params.seed,
            ..FilterConfig::default()
        })?;
        let overlap = BodyOverlap::new(scene.body.clone(), scene.camera.clone());
        let likelihood =
            SilhouetteLikelihood::new(space.clone(), overlap, params.sharpness, params.prior_weight);
        let filter = Filter::annealed(space, RandomWalk::new(noise), schedule, moves, filter_params);
        Ok(Self { scene, likelihood, filter, unseen: 0, badly_explained: 0 })
    }

    /// A tracker that goes on where another of the same scene gave out `state`; what follows is equal bit for bit.
    ///
    /// # Errors
    /// When the state is not that of a filter.
    pub fn resume(scene: Scene, state: TrackerState) -> anyhow::Result<Self> {
        let mut tracker = Self::new(scene)?;
        tracker.filter.restore(state.filter)?;
        tracker.unseen = state.unseen;
        tracker.badly_explained = state.badly_explained;
        Ok(tracker)
    }

    /// All that the tracker remembers.
    pub fn checkpoint(&self) -> TrackerState {
        TrackerState {
            filter: self.filter.checkpoint(),
            unseen: self.unseen,
            badly_explained: self.badly_explained,
        }
    }

    /// Works on the next frame.
    ///
    /// # Errors
    /// When the mask does not fit the camera.
    pub fn step(&mut self, mask: &Mask) -> anyhow::Result<Estimate> {
        let observation = Observation { mask: mask.clone() };
        if !shows_somebody(mask) {
            return self.coast(&observation);
        }
        self.unseen = 0;
        self.likelihood.overlap.set_mask(mask)?;
        let view = match self.filter.step(&observation, &mut self.likelihood, &mut ())? {
            Step::Tracked(view) => Some(Figures::of(&view)),
            Step::Lost(_) => None,
        };
        let mut estimate = self.estimate(Tracking::Tracked);
        estimate.iou = self.likelihood.overlap.counts(std::slice::from_ref(&estimate.pose))?[0].iou();
        let is_explained = view.is_some() && estimate.iou >= LOST_IOU;
        self.badly_explained = if is_explained { 0 } else { self.badly_explained + 1 };
        if self.badly_explained >= LOST_FRAMES || view.is_none() {
            estimate.tracking = Tracking::Lost;
        }
        if let Some(figures) = view {
            estimate.effective_sample_size = figures.effective_sample_size;
            estimate.unique_ancestors = figures.unique_ancestors;
            estimate.log_evidence = figures.log_evidence;
        }
        Ok(estimate)
    }

    /// A frame that shows nobody: the particles spread as the motion does.
    fn coast(&mut self, observation: &Observation) -> anyhow::Result<Estimate> {
        self.unseen += 1;
        self.filter.predict(observation)?;
        let is_short = self.unseen <= self.scene.params.coast_frames;
        Ok(self.estimate(if is_short { Tracking::Coasting } else { Tracking::Lost }))
    }
}
