//! How particles move between the layers of a frame.

use super::step::{ask, first_bad};
use super::work::scaled;
use super::{Filter, StepError};
use crate::likelihood::Likelihood;
use crate::mutation::LayerStep;
use crate::proposal::Proposal;
use crate::rng::{Purpose, particle_rng};
use crate::schedule::Beta;
use crate::space::StateSpace;

impl<S: StateSpace, P: Proposal<S>> Filter<S, P> {
    fn layer_step(&self, layer: u32) -> LayerStep {
        LayerStep {
            layer,
            layers: self.schedule.layers(),
            diffusion_scale: self.schedule.diffusion_scale(layer),
        }
    }

    /// Lets each particle drift.
    pub(super) fn diffuse(&mut self, layer: u32, frame: &P::Frame) {
        let step = self.layer_step(layer);
        let at = self.draw(layer, Purpose::Mutate);
        let Self { space, mutation, work, exec, .. } = self;
        mutation.prepare(space, &work.states, &step);
        let (space, mutation) = (&*space, &*mutation);
        exec.for_each(&mut work.states, |i, state| {
            mutation.mutate(space, frame, &step, state, &mut particle_rng(at, i as u32));
        });
    }

    /// Moves each particle under Metropolis-Hastings kernels of the target p(x|x′) likelihood^β. Returns the share of
    /// moves that were accepted.
    pub(super) fn move_within_target<L>(
        &mut self,
        layer: u32,
        beta: Beta,
        frame: &P::Frame,
        likelihood: &mut L,
    ) -> Result<f64, StepError<L::Error>>
    where
        L: Likelihood<S::State, Frame = P::Frame>,
    {
        let step = self.layer_step(layer);
        let n_moves = self.params.config().moves_per_layer;
        self.mutation.prepare(&self.space, &self.work.states, &step);
        let mut n_accepted = 0;
        for k in 0..n_moves {
            let address = layer * n_moves + k;
            self.draw_moves(&step, address, frame);
            let Self { work, frame: number, .. } = self;
            ask(*number, layer, likelihood, frame, &work.next_states, &mut work.next_log_likelihoods)?;
            if let Some((particle, _)) = first_bad(&work.log_motion_ratios) {
                return Err(StepError::NoMotionDensity { frame: *number, layer, particle });
            }
            n_accepted += self.accept_moves(address, beta);
        }
        Ok(n_accepted as f64 / (n_moves as usize * self.work.states.len()) as f64)
    }

    /// Fills `next_states` with moved copies of the particles, and the ratios of their motion densities.
    fn draw_moves(&mut self, step: &LayerStep, address: u32, frame: &P::Frame) {
        let at = self.draw(address, Purpose::Mutate);
        let Self { space, proposal, mutation, work, exec, particles, .. } = self;
        let (space, proposal, mutation, particles) = (&*space, &*proposal, &*mutation, &*particles);
        let (states, ancestors) = (&*work.states, &*work.ancestors);
        exec.for_each(&mut work.next_states, |i, moved| {
            moved.clone_from(&states[i]);
            mutation.mutate(space, frame, step, moved, &mut particle_rng(at, i as u32));
        });
        let next_states = &*work.next_states;
        work.log_motion_ratios.resize(states.len(), 0.0);
        exec.for_each(&mut work.log_motion_ratios, |i, ratio| {
            let previous = &particles[ancestors[i] as usize];
            let log_density = |state| proposal.log_motion_density(space, previous, state).unwrap_or(f64::NAN);
            *ratio = log_density(&next_states[i]) - log_density(&states[i]);
        });
    }

    /// Puts accepted moves in the place of what they moved; returns their number.
    fn accept_moves(&mut self, address: u32, beta: Beta) -> usize {
        let at = self.draw(address, Purpose::Accept);
        let work = &mut self.work;
        let now = work.states.iter_mut().zip(work.log_likelihoods.as_mut_slice());
        let moved = work.next_states.iter_mut().zip(&work.next_log_likelihoods);
        let mut n_accepted = 0;
        for (i, ((state, log_likelihood), (moved, log_likelihood_moved))) in now.zip(moved).enumerate() {
            let log_target_ratio = scaled(beta.get(), *log_likelihood_moved)
                - scaled(beta.get(), *log_likelihood)
                + work.log_motion_ratios[i];
            if particle_rng(at, i as u32).uniform().ln() < log_target_ratio {
                std::mem::swap(state, moved);
                *log_likelihood = *log_likelihood_moved;
                n_accepted += 1;
            }
        }
        n_accepted
    }
}
