//! One frame.

use std::convert::Infallible;
use std::error::Error;

use super::{Filter, Lost, Mode, Step, StepError};
use crate::lanes;
use crate::likelihood::Likelihood;
use crate::observe::{FrameView, LayerView, Observer};
use crate::proposal::Proposal;
use crate::rng::{Purpose, particle_rng};
use crate::schedule::Beta;
use crate::space::StateSpace;

impl<S: StateSpace, P: Proposal<S>> Filter<S, P> {
    /// Works on one frame.
    ///
    /// # Errors
    /// When the filter has no particles, the likelihood fails, or a likelihood or proposal returns NaN or +∞. The
    /// filter is then as it was before the frame.
    pub fn step<L>(
        &mut self,
        frame: &P::Frame,
        likelihood: &mut L,
        observer: &mut dyn Observer<S::State>,
    ) -> Result<Step<'_, S::State>, StepError<L::Error>>
    where
        L: Likelihood<S::State, Frame = P::Frame>,
    {
        self.propose(frame)?;
        self.score(0, frame, likelihood)?;
        let n_layers = self.schedule.layers();
        let (mut layer, mut beta, mut acceptance) = (0, Beta::ZERO, 1.0);
        loop {
            let beta_before = beta;
            let is_last = layer + 1 == n_layers;
            beta = self.next_beta(layer, beta_before, is_last);
            if !self.weigh(layer, beta_before, beta, acceptance) {
                return Ok(Step::Lost(self.lose(layer)));
            }
            observer.layer_done(&self.layer_view());
            if is_last || (self.mode == Mode::Tempered && beta == Beta::ONE) {
                break;
            }
            self.resample(layer + 1);
            acceptance = match self.mode {
                Mode::Annealed => {
                    self.diffuse(layer, frame);
                    self.score(layer + 1, frame, likelihood)?;
                    1.0
                }
                Mode::Tempered => self.move_within_target(layer, beta, frame, likelihood)?,
            };
            layer += 1;
        }
        self.finish();
        let view = self.frame_view();
        observer.frame_done(&view);
        Ok(Step::Tracked(view))
    }

    /// Moves the particles by the proposal without asking a likelihood, for a frame that shows nothing: the view has no
    /// layers, and its weights are the old ones times the proposal's corrections.
    ///
    /// # Errors
    /// When the filter has no particles, or the proposal returns NaN or +∞. The filter is then as it was.
    pub fn predict(&mut self, frame: &P::Frame) -> Result<Step<'_, S::State>, StepError<Infallible>> {
        self.propose(frame)?;
        self.work.layers.clear();
        self.work.log_likelihoods.as_mut_slice().fill(0.0);
        if self.work.weigh(0.0).is_none() {
            return Ok(Step::Lost(self.lose(0)));
        }
        self.finish();
        Ok(Step::Tracked(self.frame_view()))
    }

    /// Draws the particles of layer 0.
    fn propose<E: Error + 'static>(&mut self, frame: &P::Frame) -> Result<(), StepError<E>> {
        let Some(any) = self.particles.first() else {
            return Err(StepError::NotInitialised);
        };
        self.work.resize(self.params.config().n_particles, any);
        self.proposal.adapt(&self.source_shares);
        let resampled = self.choose_parents();
        let at = self.draw(0, Purpose::Propose);
        let Self { space, proposal, particles, weights, work, .. } = self;
        let (particles, weights, parents) = (&*particles, weights.as_slice(), &*work.parents);
        let equal = -(parents.len() as f64).ln();
        let (space, proposal) = (&*space, &*proposal);
        self.exec.for_each3(
            (&mut work.states, &mut work.log_prior_weights, &mut work.sources),
            |i, state, log_weight, source| {
                let parent = parents[i] as usize;
                let mut rng = particle_rng(at, i as u32);
                let (proposed, drawn_from) =
                    proposal.propose_from_source(space, &particles[parent], frame, &mut rng);
                *state = proposed.state;
                *log_weight = if resampled { equal } else { weights[parent].ln() } + proposed.log_correction;
                *source = drawn_from;
            },
        );
        work.ancestors.clone_from(&work.parents);
        match first_bad(&work.log_prior_weights) {
            Some((particle, value)) => {
                Err(StepError::BadLogCorrection { frame: self.frame, particle, value })
            }
            None => Ok(()),
        }
    }

    /// Picks for each particle one of the frame before, and says whether by resampling.
    fn choose_parents(&mut self) -> bool {
        let config = self.params.config();
        let (n, parents) = (config.n_particles, &mut self.work.parents);
        let weights = self.weights.as_slice();
        let keeps_number = weights.len() == n;
        let equal = weights.iter().all(|w| *w == weights[0]);
        let enough = self.weights.effective_sample_size() > config.resample_below * n as f64;
        let skip = keeps_number && (equal || (enough && config.resample_below < 1.0));
        if skip {
            for (i, parent) in parents.iter_mut().enumerate() {
                *parent = i as u32;
            }
        } else {
            let mut rng = particle_rng(self.draw(0, Purpose::Resample), 0);
            self.resampler.resample(&self.weights, &mut rng, &mut self.work.parents);
        }
        !skip
    }

    /// Asks the likelihood about the particles of `layer`.
    fn score<L>(
        &mut self,
        layer: u32,
        frame: &P::Frame,
        likelihood: &mut L,
    ) -> Result<(), StepError<L::Error>>
    where
        L: Likelihood<S::State, Frame = P::Frame>,
    {
        let log_likelihoods = self.work.log_likelihoods.as_mut_slice();
        ask(self.frame, layer, likelihood, frame, &self.work.states, log_likelihoods)
    }

    fn next_beta(&self, layer: u32, before: Beta, is_last: bool) -> Beta {
        match self.mode {
            Mode::Tempered if is_last => Beta::ONE,
            Mode::Tempered => {
                let beta = self.schedule.beta_after(layer, before, &self.work.log_likelihoods).get();
                Beta::new(beta.clamp(before.get(), 1.0)).expect("a number from 0 to 1 is an exponent")
            }
            Mode::Annealed => self.schedule.beta_after(layer, before, &self.work.log_likelihoods),
        }
    }

    /// Weighs the particles of `layer` and notes its figures; `false` when every weight is zero.
    fn weigh(&mut self, layer: u32, before: Beta, beta: Beta, acceptance: f64) -> bool {
        let rise = beta.get() - before.get();
        let work = &mut self.work;
        let log_evidence = match self.mode {
            Mode::Tempered => work.weigh(rise),
            Mode::Annealed if layer == 0 => work.weigh(beta.get()),
            Mode::Annealed => {
                let log_sum = work.log_sum(rise);
                work.weigh(beta.get()).map(|_| log_sum)
            }
        };
        if layer == 0 {
            work.layers.clear();
        }
        let Some(log_evidence) = log_evidence else {
            return false;
        };
        work.note_layer(layer, beta, log_evidence, acceptance);
        true
    }

    /// Draws the particles of `layer` from those of the layer before.
    fn resample(&mut self, layer: u32) {
        let mut rng = particle_rng(self.draw(layer, Purpose::Resample), 0);
        self.resampler.resample(&self.work.weights, &mut rng, &mut self.work.parents);
        self.work.replace_by_parents(&self.exec);
    }

    /// Gives the frame up.
    fn lose(&mut self, layer: u32) -> Lost {
        let lost = Lost { frame: self.frame, layer };
        self.frame += 1;
        lost
    }

    /// Makes the particles of the last layer the posterior.
    fn finish(&mut self) {
        let work = &mut self.work;
        self.source_shares.clear();
        self.source_shares.resize(self.proposal.n_sources(), 0.0);
        for (weight, &source) in work.weights.as_slice().iter().zip(&work.sources) {
            self.source_shares[usize::from(source)] += weight;
        }
        std::mem::swap(&mut self.particles, &mut work.states);
        std::mem::swap(&mut self.weights, &mut work.weights);
        self.log_evidence += work.layers.iter().map(|l| l.log_evidence).sum::<f64>();
        self.frame += 1;
    }

    fn layer_view(&self) -> LayerView<'_, S::State> {
        let work = &self.work;
        LayerView {
            frame: self.frame,
            stats: work.layers.last().expect("a layer was noted before it is shown"),
            states: &work.states,
            log_likelihoods: work.log_likelihoods.as_slice(),
            weights: &work.weights,
            ancestors: &work.ancestors,
            sources: &work.sources,
        }
    }

    fn frame_view(&self) -> FrameView<'_, S::State> {
        FrameView {
            frame: self.frame - 1,
            states: &self.particles,
            weights: &self.weights,
            log_likelihoods: self.work.log_likelihoods.as_slice(),
            ancestors: &self.work.ancestors,
            source_shares: &self.source_shares,
            layers: &self.work.layers,
            log_evidence: self.work.layers.iter().map(|l| l.log_evidence).sum(),
        }
    }
}

/// Asks `likelihood` about `states` and looks at its answers.
pub(super) fn ask<T, L: Likelihood<T>>(
    number: u64,
    layer: u32,
    likelihood: &mut L,
    frame: &L::Frame,
    states: &[T],
    out: &mut [f64],
) -> Result<(), StepError<L::Error>> {
    likelihood.log_likelihoods(frame, states, out).map_err(|source| StepError::Likelihood {
        frame: number,
        layer,
        source,
    })?;
    match first_bad(out) {
        Some((particle, value)) => Err(StepError::BadLogLikelihood { frame: number, layer, particle, value }),
        None => Ok(()),
    }
}

/// The first log weight that is NaN or +∞.
pub(super) fn first_bad(log_weights: &[f64]) -> Option<(usize, f64)> {
    if lanes::all_below_infinity(log_weights) {
        return None;
    }
    log_weights.iter().copied().enumerate().find(|(_, w)| w.is_nan() || *w == f64::INFINITY)
}
