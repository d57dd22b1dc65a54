//! The tracker: one annealed particle filter over the body's state, frame after frame.

use std::f64::consts::TAU;
use std::iter::once;
use std::sync::Arc;

use anyhow::Context as _;
use body::{Body, Camera, Intrinsics, N_JOINTS, Pose};
use glam::DVec3;
use pf_core::estimate::weighted_mean;
use pf_core::proposal::{MixtureConfig, MixtureProposal};
use pf_core::schedule::{DiffusionConfig, Geometric, GeometricConfig};
use pf_core::scratch::with_buffer;
use pf_core::{
    Filter, FilterConfig, FilterParams, FilterState, Gaussian, LayerView, Likelihood as _, Observer,
    StateSpace as _, Step,
};
use rayon::prelude::*;
use render_gpu::ScoreError;
use silhouette::Mask;

use super::cue::{BottomUp, Cue};
use super::likelihood::{Observation, SilhouetteLikelihood};
use super::motion::BodyMotion;
use super::moves::BodyMoves;
use super::overlap::BodyOverlap;
use super::pose_model::{PoseModel, STEP_RATE_HZ};
use super::proposal::{BodyProposal, Transition};
use super::reading::{self, Reading};
use super::refine::Refiner;
use super::start::place_upright;
use super::state::{BodySpace, BodyState, RIGID_DIM, blank_pose};
use crate::config::{Method, TrackParams};
use crate::predict::{PosePredictor, TransitionPredictor};
use crate::run_folder::{FrameRecord, Status};

/// Rates of clips between which steps follow the rate.
const STEP_RATES_HZ: std::ops::RangeInclusive<f64> = 10.0..=120.0;
/// Share of the mask's extent by which a start may be off; the spread of its first particles. Position (metres) and
/// rotation (radians) in the pelvis frame.
const START_SD: [f64; RIGID_DIM] = [0.08, 0.05, 0.08, 0.1, 0.25, 0.1];
/// Spread of a start's pose coordinates, in standard deviations of a step.
const START_LATENT_STEPS: f64 = 8.0;
/// Times that a start works on its first mask before it looks at the next ones.
const START_ROUNDS: usize = 4;
/// Headings that a start tries when none is given.
const START_HEADINGS: usize = 8;
/// Headings that a start tries about one that is given: people know it to the nearest eighth of a turn.
const GIVEN_HEADING_OFFSETS_RAD: [f64; 3] = [-0.4, 0.0, 0.4];
/// Starts beyond the number of modes that are followed over the next masks before the modes are chosen.
const START_RIVALS: usize = 2;
/// Trackers of one seed differ in the bits from here on.
const STREAM_SHIFT: u32 = 48;
/// Overlap under which the body is taken not to be on the person.
const LOST_IOU: f64 = 0.4;
/// Frames under that overlap in a row that make a loss.
const LOST_FRAMES: u32 = 5;
/// Modes of a prediction that are taken to the outline beside the mean of the particles.
const N_RIVALS: usize = 2;
/// A mode that explains a frame so much worse (log-likelihood) than the mean of the particles is not taken there: steps to
/// the outline seldom gain half of it.
const HOPELESS: f64 = 50.0;

type BodyFilter = Filter<BodySpace, BodyProposal>;

/// What a tracker is made for: a body of one size before one camera, under one pose model.
#[derive(Clone)]
pub struct Scene {
    /// The person's body.
    pub body: Arc<Body>,
    /// The camera at the working resolution.
    pub camera: Camera,
    /// Coordinates and prior of the pose.
    pub model: Arc<dyn PoseModel>,
    /// Predicts poses from masks alone, where there is one.
    pub predictor: Option<Arc<PosePredictor>>,
    /// Predicts poses from the pose before and the mask now, where there is one.
    pub transitions: Option<Arc<TransitionPredictor>>,
    /// Brings poses onto the outline, where that is wanted.
    pub refiner: Option<Arc<Refiner>>,
    /// Frames a second.
    pub fps: f64,
    /// Settings.
    pub params: TrackParams,
}

/// Follows one person. Masks have the size of the scene's camera.
pub struct Tracker {
    scene: Scene,
    /// Which of the trackers of a seed it is.
    stream: u64,
    likelihood: SilhouetteLikelihood,
    filter: BodyFilter,
    unseen: u32,
    badly_explained: u32,
    /// Largest ln p(mask|state) of the last frame.
    fit: f64,
    /// The particles of the last frame as they were proposed, before the mask had a say.
    proposed: Vec<BodyState>,
}

/// Keeps the particles of the first layer.
struct Proposed<'a>(&'a mut Vec<BodyState>);

impl Observer<BodyState> for Proposed<'_> {
    fn layer_done(&mut self, view: &LayerView<'_, BodyState>) {
        if view.stats.layer == 0 {
            self.0.clear();
            self.0.extend_from_slice(view.states);
        }
    }
}

/// What a tracker remembers between frames.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct TrackerState {
    stream: u64,
    frame: u64,
    /// [`BodyState::to_numbers`] of each particle.
    particles: Vec<Vec<f64>>,
    weights: Vec<f64>,
    source_shares: Vec<f64>,
    log_evidence: f64,
    unseen: u32,
    badly_explained: u32,
}

impl Tracker {
    /// Finds the person on the first of `frames` and gives the settings' number of trackers, each with how well it explains
    /// the masks, best first. The other frames, those that follow, help to choose. The first call of [`step`](Self::step) is
    /// about the first frame again.
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
    ) -> anyhow::Result<Vec<(Self, f64)>> {
        let n_modes = scene.params.modes as usize;
        let candidates = candidates(scene, &frames[0], heading_rad);
        // Rivals that all drew from the predictor would soon be one.
        let unaided = |seen: &Observation| Observation { cue: None, ..seen.clone() };
        let frames = &frames.iter().map(unaided).collect::<Vec<_>>();
        let begin = |(stream, candidate): (usize, &Pose)| {
            Self::near(scene.clone(), stream as u64, frame, &frames[0], candidate).map(Rival::new)
        };
        let mut rivals: Vec<Rival> =
            candidates.par_iter().enumerate().map(begin).collect::<anyhow::Result<_>>()?;
        // The first mask, again and again: once they have found their place, half of the rivals go each time.
        for round in 0..START_ROUNDS {
            step_all(&mut rivals, &frames[0])?;
            if round > 0 {
                let half = rivals.len().div_ceil(2);
                keep_best(&mut rivals, half.max(n_modes + START_RIVALS));
            }
            rivals.iter_mut().for_each(|rival| rival.fit_sum = 0.0);
        }
        for Rival { tracker, beginning, .. } in &mut rivals {
            tracker.filter.restore(FilterState { frame, ..tracker.filter.checkpoint() })?;
            *beginning = tracker.checkpoint();
        }
        // The masks that follow: in their second half, rivals go one by one.
        let half = frames.len() / 2;
        let every = half.div_ceil(rivals.len().saturating_sub(n_modes).max(1)).max(1);
        let mut n_seen = 0;
        for frame in frames {
            if rivals.len() <= n_modes && n_seen > 0 {
                break;
            }
            step_all(&mut rivals, frame)?;
            n_seen += 1;
            if n_seen >= half && (n_seen - half) % every == 0 {
                let all_but_one = rivals.len() - 1;
                keep_best(&mut rivals, all_but_one.max(n_modes));
            }
        }
        keep_best(&mut rivals, n_modes);
        let back = |Rival { beginning, fit_sum, .. }: Rival| {
            Ok((Self::resume(scene.clone(), beginning)?, fit_sum / n_seen as f64))
        };
        rivals.into_iter().map(back).collect()
    }

    /// A tracker before its first step on the frame `seen` that begins about `candidate`, an upright pose wherever.
    fn near(
        scene: Scene,
        stream: u64,
        frame: u64,
        seen: &Observation,
        candidate: &Pose,
    ) -> anyhow::Result<Self> {
        let mut tracker = Self::new(scene, stream)?;
        tracker.likelihood.overlap.set_mask(&seen.mask)?;
        let overlap = &mut tracker.likelihood.overlap;
        let placement = place_upright(overlap, &seen.mask, &candidate.angles, candidate.heading_rad())?;
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
        Ok(tracker)
    }
}

/// A tracker among those that a start tries.
struct Rival {
    tracker: Tracker,
    /// Where it goes back to once it is chosen.
    beginning: TrackerState,
    /// Sum of its fits since the rivals were last judged afresh.
    fit_sum: f64,
}

impl Rival {
    fn new(tracker: Tracker) -> Self {
        Self { beginning: tracker.checkpoint(), tracker, fit_sum: 0.0 }
    }
}

/// Each rival works on the same frame.
fn step_all(rivals: &mut [Rival], seen: &Observation) -> anyhow::Result<()> {
    rivals.par_iter_mut().try_for_each(|rival| {
        rival.tracker.step(seen)?;
        rival.fit_sum += rival.tracker.fit;
        Ok(())
    })
}

/// Leaves the `count` rivals that fit best, best first.
fn keep_best(rivals: &mut Vec<Rival>, count: usize) {
    rivals.sort_by(|a, b| b.fit_sum.total_cmp(&a.fit_sum));
    rivals.truncate(count);
}

/// The states with how well they explain the frame.
fn judge(
    likelihood: &mut SilhouetteLikelihood,
    seen: &Observation,
    states: &[BodyState],
) -> Result<Vec<Reading>, ScoreError> {
    let mut fits = vec![0.0; states.len()];
    likelihood.log_likelihoods(seen, states, &mut fits)?;
    Ok(states.iter().zip(fits).map(|(&state, fit)| Reading { state, fit }).collect())
}

/// Standard deviations of the motion from one frame to the next, times `factor`, `[dim]`.
pub(super) fn step_sd(scene: &Scene, factor: f64) -> Vec<f64> {
    // Over short times people move evenly: twice the time, twice the way.
    let factor = factor * frame_scale(scene);
    let rigid = scene.model.rigid_step_sd();
    rigid.iter().chain(scene.model.step_sd()).map(|sd| factor * sd).collect()
}

/// Length of a frame over that for which pose models give their steps.
fn frame_scale(scene: &Scene) -> f64 {
    STEP_RATE_HZ / scene.fps.clamp(*STEP_RATES_HZ.start(), *STEP_RATES_HZ.end())
}

/// Where a start tries to begin: about a heading that is given; else all around, the way the person goes, and where the mask
/// alone suggests.
fn candidates(scene: &Scene, first: &Observation, heading_rad: Option<f64>) -> Vec<Pose> {
    let facing = |heading_rad: f64| {
        let mut pose = Pose::upright(DVec3::ZERO, heading_rad);
        pose.angles.copy_from_slice(scene.model.mean_angles());
        pose
    };
    if let Some(heading_rad) = heading_rad {
        return GIVEN_HEADING_OFFSETS_RAD.iter().map(|offset| facing(heading_rad + offset)).collect();
    }
    let space = BodySpace::new(scene.model.clone());
    let around = (0..START_HEADINGS).map(|k| facing(k as f64 * TAU / START_HEADINGS as f64));
    let ahead = first.travel.map(|travel| facing(travel.to_angle()));
    let suggested = first.cue.iter().flat_map(Cue::modes).map(|mode| space.pose(mode));
    around.chain(ahead).chain(suggested).collect()
}

impl Tracker {
    /// A tracker without particles; its random numbers are those of `stream`.
    fn new(scene: Scene, stream: u64) -> anyhow::Result<Self> {
        let params = &scene.params;
        let space = BodySpace::new(scene.model.clone());
        let step_sd = step_sd(&scene, params.diffusion);
        let noise = Gaussian::diagonal(step_sd.clone())?;
        let schedule = Geometric::new(GeometricConfig {
            layers: params.layers,
            first_beta: params.annealing_ratio.powi(params.layers as i32 - 1),
            last_beta: 1.0,
            diffusion: DiffusionConfig { first: params.diffusion_ratio, ratio: params.diffusion_ratio },
        })?;
        let moves = BodyMoves {
            step_sd: step_sd.clone(),
            body: scene.body.clone(),
            camera_centre: scene.camera.centre_world(),
            exchange_share: params.exchange_share,
            part_share: params.part_share,
            mirror_share: params.mirror_share,
            ground_share: params.ground_share,
            survivors: Vec::new(),
        };
        let filter_params = FilterParams::new(FilterConfig {
            n_particles: params.particles as usize,
            seed: params.seed ^ (stream << STREAM_SHIFT),
            ..FilterConfig::default()
        })?;
        let cue_exponent = (params.method == Method::Jlm).then_some(params.cue_exponent);
        let overlap = BodyOverlap::new(scene.body.clone(), scene.camera);
        let likelihood = SilhouetteLikelihood::new(
            space.clone(),
            overlap,
            params.sharpness,
            params.prior_weight,
            params.travel_weight,
            cue_exponent,
        );
        let motion = BodyMotion::new(step_sd.clone(), frame_scale(&scene), params.diffusion)?;
        let proposal = match (params.method, &scene.transitions) {
            (Method::Opf, Some(transitions)) => BodyProposal::Transition(Transition::new(
                transitions.clone(),
                scene.camera.centre_world(),
                &step_sd,
                motion,
            )),
            (Method::Jpf, _) if scene.predictor.is_some() => BodyProposal::Joint(MixtureProposal::new(
                motion,
                BottomUp::new(&step_sd, noise),
                MixtureConfig {
                    initial_cue_share: params.cue_share,
                    least_share: params.least_share,
                    adapts: true,
                    weighting: params.weighting.into(),
                },
            )?),
            _ => BodyProposal::Motion(motion),
        };
        let filter = Filter::annealed(space, proposal, schedule, moves, filter_params);
        Ok(Self {
            scene,
            stream,
            likelihood,
            filter,
            unseen: 0,
            badly_explained: 0,
            fit: f64::NEG_INFINITY,
            proposed: Vec::new(),
        })
    }

    /// A tracker that goes on where another of the same scene gave out `state`; what follows is equal bit for bit.
    ///
    /// # Errors
    /// When the state is not that of a filter.
    pub fn resume(scene: Scene, state: TrackerState) -> anyhow::Result<Self> {
        let mut tracker = Self::new(scene, state.stream)?;
        let particles: Option<Vec<_>> =
            state.particles.iter().map(|numbers| BodyState::from_numbers(numbers)).collect();
        tracker.filter.restore(FilterState {
            frame: state.frame,
            particles: particles.context("checkpoint: `particles` have the wrong number of coordinates")?,
            weights: state.weights,
            source_shares: state.source_shares,
            log_evidence: state.log_evidence,
        })?;
        tracker.unseen = state.unseen;
        tracker.badly_explained = state.badly_explained;
        Ok(tracker)
    }

    /// Forgets where the person is and takes `pose` for it, as a study of wrong poses does.
    ///
    /// # Errors
    /// Never for a tracker that has started.
    pub fn displace(&mut self, pose: &Pose) -> anyhow::Result<()> {
        let state = self.filter.space().state_from_pose(pose);
        let FilterState { frame, log_evidence, .. } = self.filter.checkpoint();
        let displaced = FilterState { frame, log_evidence, ..FilterState::from_particles(vec![state]) };
        Ok(self.filter.restore(displaced)?)
    }

    /// The camera, at working resolution.
    pub fn camera(&self) -> &Camera {
        &self.scene.camera
    }

    /// Largest ln p(mask|state) among the particles of the last frame.
    pub fn fit(&self) -> f64 {
        self.fit
    }

    /// The joints of `pose`, metres, world.
    pub fn joints_world(&self, pose: &Pose) -> [DVec3; N_JOINTS] {
        self.scene.body.joints_world(pose)
    }

    /// The particles of the last frame with a mask as they were proposed, before the mask had a say; of a
    /// [joint](Method::Jpf) filter, those that the predictor drew among them.
    pub fn proposed(&self) -> &[BodyState] {
        &self.proposed
    }

    /// The particles of the last frame.
    pub fn particles(&self) -> &[BodyState] {
        self.filter.particles()
    }

    /// The `n` heaviest particles of the last frame as poses, with their weights, heaviest first.
    pub fn best_particles(&self, n: usize) -> Vec<(Pose, f64)> {
        let (states, weights) = (self.filter.particles(), self.filter.weights().as_slice());
        let mut order: Vec<usize> = (0..states.len()).collect();
        order.sort_by(|&a, &b| weights[b].total_cmp(&weights[a]));
        let best = order.into_iter().take(n);
        best.map(|particle| (self.filter.space().pose(&states[particle]), weights[particle])).collect()
    }

    /// Intersection over union of the body in `pose` and the mask of the last step.
    ///
    /// # Errors
    /// When no step was made, or the pose is not finite.
    pub fn iou(&mut self, pose: &Pose) -> Result<f64, ScoreError> {
        Ok(self.likelihood.overlap.counts(std::slice::from_ref(pose))?[0].iou())
    }

    /// All that the tracker remembers.
    pub fn checkpoint(&self) -> TrackerState {
        let filter = self.filter.checkpoint();
        TrackerState {
            stream: self.stream,
            frame: filter.frame,
            particles: filter.particles.iter().map(|state| state.to_numbers().to_vec()).collect(),
            weights: filter.weights,
            source_shares: filter.source_shares,
            log_evidence: filter.log_evidence,
            unseen: self.unseen,
            badly_explained: self.badly_explained,
        }
    }

    /// Works on the next frame.
    ///
    /// # Errors
    /// When the mask does not fit the camera.
    pub fn step(&mut self, seen: &Observation) -> anyhow::Result<FrameRecord> {
        self.unseen = 0;
        self.likelihood.overlap.set_mask(&seen.mask)?;
        let figures = match self.filter.step(seen, &mut self.likelihood, &mut Proposed(&mut self.proposed))? {
            Step::Tracked(view) => view
                .layers
                .last()
                .map(|last| (last.unique_ancestors as u64, view.log_evidence, last.max_log_likelihood)),
            Step::Lost(_) => None,
        };
        let (unique_ancestors, log_evidence, fit) =
            figures.unwrap_or((0, f64::NEG_INFINITY, f64::NEG_INFINITY));
        self.fit = fit;
        let answer = self.read(seen)?;
        let estimate = self.estimate(Status::Tracked, &answer);
        let iou = self.iou(&estimate.pose)?;
        let mut estimate = FrameRecord { iou, unique_ancestors, log_evidence, ..estimate };
        let is_explained = figures.is_some() && estimate.iou >= LOST_IOU;
        self.badly_explained = if is_explained { 0 } else { self.badly_explained + 1 };
        if self.badly_explained >= LOST_FRAMES || figures.is_none() {
            estimate.status = Status::Lost;
        }
        Ok(estimate)
    }

    /// The answer of a frame, of what the particles and, in a [joint](Method::Jpf) filter, the predictor make of it. The particles
    /// go along with the reading that explains the mask best.
    fn read(&mut self, seen: &Observation) -> anyhow::Result<BodyState> {
        let mean = self.mean();
        let readings = self.readings(seen, mean)?;
        let leader = reading::leader(&readings);
        if readings[leader].state != mean {
            self.carry(&mean, &readings[leader].state)?;
        }
        let has_rivals = readings.len() > 1;
        Ok(if has_rivals { reading::mean(self.filter.space(), &readings, leader) } else { self.mean() })
    }

    /// The `mean` of the particles, taken to the outline of the mask where that explains it better, and after it those of the
    /// likeliest poses of the predictor that are not hopeless, taken there likewise.
    fn readings(&mut self, seen: &Observation, mean: BodyState) -> anyhow::Result<Vec<Reading>> {
        let steps = self.scene.params.refine_steps as usize;
        let (Some(refiner), Some(outline)) = (self.scene.refiner.as_deref(), &seen.outline) else {
            return Ok(vec![Reading { state: mean, fit: self.fit }]);
        };
        let n_rivals = if self.scene.params.method == Method::Jpf { N_RIVALS } else { 0 };
        let modes = seen.cue.iter().flat_map(Cue::modes).take(n_rivals);
        let states: Vec<BodyState> =
            once(mean).chain(modes.map(|mode| BodyState { position: mean.position, ..*mode })).collect();
        let begun = judge(&mut self.likelihood, seen, &states)?;
        let has_hope = |mode: &&Reading| mode.fit >= begun[0].fit - HOPELESS;
        let hopeful: Vec<BodyState> =
            once(mean).chain(begun[1..].iter().filter(has_hope).map(|mode| mode.state)).collect();
        let (space, camera) = (self.filter.space(), &self.scene.camera);
        let refine = |state: &BodyState| {
            space.state_from_pose(&refiner.refine(camera, outline, &space.pose(state), steps))
        };
        let refined: Vec<BodyState> = hopeful.par_iter().map(refine).collect();
        let mut readings = judge(&mut self.likelihood, seen, &refined)?;
        if readings[0].fit <= begun[0].fit {
            readings[0] = begun[0];
        }
        Ok(readings)
    }

    /// The weighted mean of the particles.
    fn mean(&self) -> BodyState {
        weighted_mean(self.filter.space(), self.filter.particles(), self.filter.weights())
    }

    /// Moves every particle by what leads from one state to the other.
    fn carry(&mut self, from: &BodyState, to: &BodyState) -> anyhow::Result<()> {
        let mut state = self.filter.checkpoint();
        let space = self.filter.space();
        with_buffer(space.dim(), |delta| {
            space.local(from, to, delta);
            state.particles.iter_mut().for_each(|particle| space.retract(particle, delta));
        });
        Ok(self.filter.restore(state)?)
    }

    /// A frame that shows nobody: the particles spread as the motion does.
    ///
    /// # Errors
    /// Never for a tracker that has started.
    pub fn coast(&mut self) -> anyhow::Result<FrameRecord> {
        self.unseen += 1;
        let Intrinsics { width, height, .. } = *self.scene.camera.intrinsics();
        self.filter.predict(&Observation {
            mask: Mask::new(width, height),
            cue: None,
            outline: None,
            travel: None,
            description: None,
        })?;
        let is_short = self.unseen <= self.scene.params.coast_frames;
        Ok(self.estimate(if is_short { Status::Coasting } else { Status::Lost }, &self.mean()))
    }

    /// The record of an answer, with the spread of the particles about it, without what only a mask tells.
    fn estimate(&self, status: Status, answer: &BodyState) -> FrameRecord {
        let (space, body) = (self.filter.space(), &self.scene.body);
        let (states, weights) = (self.filter.particles(), self.filter.weights());
        let pose = space.pose(answer);
        let joints_world = body.joints_world(&pose);
        let mut variance_m2 = [0.0; N_JOINTS];
        let mut particle = blank_pose();
        for (state, weight) in states.iter().zip(weights.as_slice()) {
            space.pose_into(state, &mut particle);
            for (variance, (a, b)) in
                variance_m2.iter_mut().zip(body.joints_world(&particle).iter().zip(&joints_world))
            {
                *variance += weight * a.distance_squared(*b);
            }
        }
        FrameRecord {
            frame: self.filter.next_frame() - 1,
            status,
            pose,
            joints_world,
            joint_sd_m: variance_m2.map(f64::sqrt),
            iou: 0.0,
            effective_sample_size: weights.effective_sample_size(),
            unique_ancestors: 0,
            log_evidence: 0.0,
            learned: None,
        }
    }
}
