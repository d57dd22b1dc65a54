//! The loop: propose, then layer after layer weigh, resample, move.

mod error;
mod moves;
mod state;
mod step;
mod work;

use crate::exec::{Exec, ExecConfig, StartThreadsError};
use crate::mutation::{Mutation, Stay};
use crate::observe::FrameView;
use crate::proposal::Proposal;
use crate::resample::{Resampler, Systematic};
use crate::rng::{Draw, ParticleRng, Purpose, particle_rng};
use crate::schedule::{AnnealingSchedule, Geometric};
use crate::space::StateSpace;
use crate::weights::NormalizedWeights;

pub use error::{BadFilterConfig, BadState, StepError};
pub use state::{FilterConfig, FilterParams, FilterState};
use work::Work;

/// What became of a frame.
#[derive(Debug)]
pub enum Step<'a, T> {
    /// The posterior of the frame.
    Tracked(FrameView<'a, T>),
    /// No particle explains the frame. The particles stay those of the frame before; only the frame number moves on.
    Lost(Lost),
}

/// Where a filter lost its target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lost {
    /// Frame number.
    pub frame: u64,
    /// The layer in which every weight was zero.
    pub layer: u32,
}

/// What the weights of a layer are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    /// Likelihood^β, whatever the layer before was weighed with; particles then diffuse freely.
    Annealed,
    /// Likelihood^(rise of β); particles then move under a kernel that leaves their distribution as it is.
    Tempered,
}

/// A particle filter.
///
/// Its three constructors are three algorithms; the table at the top of the crate compares them. All further settings
/// have defaults: systematic resampling, the calling thread.
/// The annealed filter finds a narrow peak far from where it starts:
///
/// ```
/// use pf_core::{Euclidean, Filter, FilterParams, Gaussian, GaussianDiffusion, Geometric, Likelihood, RandomWalk, Step};
/// use pf_core::schedule::GeometricConfig;
///
/// /// A peak of width 0.01 at (3, -2).
/// struct Peak;
/// impl Likelihood<[f64; 2]> for Peak {
///     type Frame = ();
///     type Error = std::convert::Infallible;
///     fn log_likelihoods(&mut self, (): &(), states: &[[f64; 2]], out: &mut [f64]) -> Result<(), Self::Error> {
///         for (log_likelihood, [x, y]) in out.iter_mut().zip(states) {
///             *log_likelihood = -0.5 * ((x - 3.0).powi(2) + (y + 2.0).powi(2)) / 0.01f64.powi(2);
///         }
///         Ok(())
///     }
/// }
///
/// let walk = RandomWalk::new(Gaussian::diagonal(vec![1.0, 1.0])?);
/// let schedule = Geometric::new(GeometricConfig { first_beta: 1e-4, ..Default::default() })?;
/// let diffusion = GaussianDiffusion::of_survivors(vec![0.01, 0.01])?;
/// let params = FilterParams::new(Default::default())?;
/// let mut filter = Filter::annealed(Euclidean, walk, schedule, diffusion, params);
/// filter.initialise(vec![[0.0, 0.0]])?;
/// let Step::Tracked(posterior) = filter.step(&(), &mut Peak, &mut ())? else { panic!("lost") };
/// let [x, y] = posterior.mean(&Euclidean);
/// assert!((x - 3.0).abs() < 0.01 && (y + 2.0).abs() < 0.01);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Filter<S: StateSpace, P: Proposal<S>> {
    space: S,
    proposal: P,
    mode: Mode,
    schedule: Box<dyn AnnealingSchedule + Send>,
    mutation: Box<dyn Mutation<S, P::Frame>>,
    resampler: Box<dyn Resampler + Send>,
    params: FilterParams,
    exec: Exec,
    frame: u64,
    particles: Vec<S::State>,
    weights: NormalizedWeights,
    source_shares: Vec<f64>,
    log_evidence: f64,
    work: Work<S::State>,
}

impl<S: StateSpace, P: Proposal<S>> Filter<S, P> {
    /// One layer that takes the likelihood as it is: the bootstrap filter `[Gordon1993]` where the proposal is the
    /// motion prior, importance sampling and resampling where it is another. Its evidence is unbiased.
    pub fn bootstrap(space: S, proposal: P, params: FilterParams) -> Self {
        Self::new(space, proposal, Mode::Annealed, Box::new(Geometric::single()), Box::new(Stay), params)
    }

    /// The annealed particle filter `[Deutscher2005]`: layer m weighs by likelihood^β_m, resamples, and diffuses. It
    /// finds narrow modes in many dimensions with few particles. What it returns is a weighted set around them, not a
    /// sample of the posterior, for diffusion is not undone by the weights; its evidence Σ_m ln mean likelihood^(β_m − β_{m−1})
    /// is that of [`tempered`](Self::tempered) with this neglected: a heuristic, exact for one layer with β = 1.
    pub fn annealed(
        space: S,
        proposal: P,
        schedule: impl AnnealingSchedule + Send + 'static,
        mutation: impl Mutation<S, P::Frame> + 'static,
        params: FilterParams,
    ) -> Self {
        Self::new(space, proposal, Mode::Annealed, Box::new(schedule), Box::new(mutation), params)
    }

    /// A sequential Monte Carlo sampler `[DelMoral2006]` in each frame: the target of layer m is p(x|x′) likelihood^β_m,
    /// β rising to 1 (the last layer has β = 1 whatever the schedule says, and β never falls); the weights are
    /// likelihood^(β_m − β_{m−1}), and moves are accepted by Metropolis-Hastings, so they leave the target as it is. Its
    /// posterior is exact as the number of particles grows; its evidence is unbiased for a fixed schedule and a fixed
    /// mutation, consistent for adaptive ones.
    ///
    /// The mutation must be symmetric, and the proposal must know
    /// [`log_motion_density`](Proposal::log_motion_density).
    pub fn tempered(
        space: S,
        proposal: P,
        schedule: impl AnnealingSchedule + Send + 'static,
        mutation: impl Mutation<S, P::Frame> + 'static,
        params: FilterParams,
    ) -> Self {
        Self::new(space, proposal, Mode::Tempered, Box::new(schedule), Box::new(mutation), params)
    }

    fn new(
        space: S,
        proposal: P,
        mode: Mode,
        schedule: Box<dyn AnnealingSchedule + Send>,
        mutation: Box<dyn Mutation<S, P::Frame>>,
        params: FilterParams,
    ) -> Self {
        Self {
            space,
            proposal,
            mode,
            schedule,
            mutation,
            resampler: Box::new(Systematic),
            params,
            exec: Exec::calling_thread(),
            frame: 0,
            particles: Vec::new(),
            weights: NormalizedWeights::default(),
            source_shares: Vec::new(),
            log_evidence: 0.0,
            work: Work::default(),
        }
    }

    /// Resamples by another scheme.
    pub fn with_resampler(mut self, resampler: impl Resampler + Send + 'static) -> Self {
        self.resampler = Box::new(resampler);
        self
    }

    /// Runs on other threads.
    ///
    /// # Errors
    /// When the threads cannot be started.
    pub fn with_exec(mut self, exec: ExecConfig) -> Result<Self, StartThreadsError> {
        self.exec = Exec::new(exec)?;
        Ok(self)
    }

    /// Puts equally weighted particles in place of those there are; the frame number and the evidence stay. The number of particles
    /// may differ from that of the filter, which the next frame brings back.
    ///
    /// # Errors
    /// When there are no particles, or too many to number.
    pub fn initialise(&mut self, particles: Vec<S::State>) -> Result<(), BadState> {
        let state = FilterState::from_particles(particles);
        self.restore(FilterState { frame: self.frame, log_evidence: self.log_evidence, ..state })
    }

    /// As [`initialise`](Self::initialise), each particle drawn by `draw` from a stream of its own.
    pub fn initialise_with(&mut self, mut draw: impl FnMut(&S, &mut ParticleRng) -> S::State) {
        let at = self.draw(0, Purpose::Initialise);
        let n_particles = self.params.config().n_particles as u32;
        self.particles = (0..n_particles).map(|i| draw(&self.space, &mut particle_rng(at, i))).collect();
        self.weights = NormalizedWeights::uniform(self.particles.len());
        self.source_shares.clear();
    }

    /// Takes up where a filter of the same settings was when it gave out `state`: what follows is equal bit for bit.
    ///
    /// # Errors
    /// When there are no particles, or the weights are not a distribution over them. The filter stays as it was.
    pub fn restore(&mut self, state: FilterState<S::State>) -> Result<(), BadState> {
        state.check()?;
        self.frame = state.frame;
        self.particles = state.particles;
        self.weights = NormalizedWeights::restore(state.weights);
        self.source_shares = state.source_shares;
        self.log_evidence = state.log_evidence;
        Ok(())
    }

    /// All that the filter remembers, to be given back to [`restore`](Self::restore).
    pub fn checkpoint(&self) -> FilterState<S::State> {
        FilterState {
            frame: self.frame,
            particles: self.particles.clone(),
            weights: self.weights.as_slice().to_vec(),
            source_shares: self.source_shares.clone(),
            log_evidence: self.log_evidence,
        }
    }

    /// The state space.
    pub fn space(&self) -> &S {
        &self.space
    }

    /// The proposal.
    pub fn proposal(&self) -> &P {
        &self.proposal
    }

    /// The proposal, to be changed between frames; what is changed is not in a checkpoint.
    pub fn proposal_mut(&mut self) -> &mut P {
        &mut self.proposal
    }

    /// The particles between frames.
    pub fn particles(&self) -> &[S::State] {
        &self.particles
    }

    /// Their weights.
    pub fn weights(&self) -> &NormalizedWeights {
        &self.weights
    }

    /// Number of the next frame.
    pub fn next_frame(&self) -> u64 {
        self.frame
    }

    /// ln p(all frames so far), lost ones left out.
    pub fn log_evidence(&self) -> f64 {
        self.log_evidence
    }

    fn draw(&self, layer: u32, purpose: Purpose) -> Draw {
        Draw { seed: self.params.config().seed, frame: self.frame, layer, purpose }
    }
}
