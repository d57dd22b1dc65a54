//! Motion about which nothing is known but its size.

use std::marker::PhantomData;

use super::{Proposal, Proposed};
use crate::gaussian::Gaussian;
use crate::rng::ParticleRng;
use crate::scratch::with_buffer;
use crate::space::StateSpace;

/// A Gaussian step in local coordinates; `F` is the type of the frame, which it does not look at.
///
/// Its density is exact where `local` undoes `retract`, that is away from the limits of the space and for steps that
/// do not lead around it.
#[derive(Debug)]
pub struct RandomWalk<F: ?Sized> {
    step: Gaussian,
    frame: PhantomData<fn(&F)>,
}

impl<F: ?Sized> Clone for RandomWalk<F> {
    fn clone(&self) -> Self {
        Self::new(self.step.clone())
    }
}

impl<F: ?Sized> RandomWalk<F> {
    /// A walk with steps from `step`.
    pub fn new(step: Gaussian) -> Self {
        Self { step, frame: PhantomData }
    }
}

impl<S: StateSpace, F: ?Sized + Sync> Proposal<S> for RandomWalk<F> {
    type Frame = F;

    fn propose(&self, space: &S, previous: &S::State, _: &F, rng: &mut ParticleRng) -> Proposed<S::State> {
        let mut state = previous.clone();
        with_buffer(space.dim(), |delta| {
            self.step.sample(1.0, rng, delta);
            space.retract(&mut state, delta);
        });
        Proposed { state, log_correction: 0.0 }
    }

    fn log_motion_density(&self, space: &S, previous: &S::State, state: &S::State) -> Option<f64> {
        with_buffer(space.dim(), |delta| {
            space.local(previous, state, delta);
            Some(self.step.log_density(delta))
        })
    }

    fn log_density(&self, space: &S, previous: &S::State, _: &F, state: &S::State) -> Option<f64> {
        self.log_motion_density(space, previous, state)
    }
}
