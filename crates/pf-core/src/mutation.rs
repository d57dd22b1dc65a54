//! How particles move between annealing layers.

use crate::estimate::{covariance_about, mean_of};
use crate::gaussian::{BadCovariance, Gaussian};
use crate::rng::ParticleRng;
use crate::scratch::with_buffer;
use crate::space::StateSpace;

/// Where in the frame a move takes place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayerStep {
    /// The layer just weighed; the move leads to the next one.
    pub layer: u32,
    /// Layers of the frame, at most.
    pub layers: u32,
    /// The schedule's factor on the standard deviation of noise.
    pub diffusion_scale: f64,
}

/// Moves a particle after resampling, so that copies part.
///
/// # Laws
/// - The result follows from the arguments and from what `prepare` saw.
/// - For [`Filter::tempered`](crate::Filter::tempered) a move is as likely as its reverse, in density.
///
/// ```
/// use pf_core::{GaussianDiffusion, LayerStep, Mutation, ParticleRng, StateSpace};
///
/// /// Diffusion, and now and then a jump to the mirror image.
/// struct MirrorSometimes {
///     diffusion: GaussianDiffusion,
///     probability: f64,
/// }
/// impl<S: StateSpace<State = [f64; 1]>, F: ?Sized + Sync> Mutation<S, F> for MirrorSometimes {
///     fn prepare(&mut self, space: &S, survivors: &[[f64; 1]], step: &LayerStep) {
///         Mutation::<S, F>::prepare(&mut self.diffusion, space, survivors, step);
///     }
///     fn mutate(&self, space: &S, frame: &F, step: &LayerStep, state: &mut [f64; 1], rng: &mut ParticleRng) {
///         if rng.uniform() < self.probability {
///             state[0] = -state[0];
///         }
///         self.diffusion.mutate(space, frame, step, state, rng);
///     }
/// }
/// # let step = LayerStep { layer: 0, layers: 2, diffusion_scale: 1.0 };
/// # let mut rng = pf_core::rng::particle_rng(pf_core::rng::Draw { seed: 1, frame: 0, layer: 0, purpose: pf_core::rng::Purpose::User }, 0);
/// # let mutation = MirrorSometimes { diffusion: GaussianDiffusion::diagonal(vec![0.0])?, probability: 1.0 };
/// let mut state = [2.0];
/// mutation.mutate(&pf_core::Euclidean::<1>, "any frame", &step, &mut state, &mut rng);
/// assert_eq!(state, [-2.0]);
/// # Ok::<(), pf_core::BadCovariance>(())
/// ```
pub trait Mutation<S: StateSpace, F: ?Sized>: Send + Sync {
    /// Sees the resampled particles of a layer, copies included, before any of them moves.
    fn prepare(&mut self, _space: &S, _survivors: &[S::State], _step: &LayerStep) {}
    /// Moves one particle. [`with_buffer`] has room for increments.
    fn mutate(&self, space: &S, frame: &F, step: &LayerStep, state: &mut S::State, rng: &mut ParticleRng);
}

/// No move at all: the copies of a particle stay together.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stay;

impl<S: StateSpace, F: ?Sized> Mutation<S, F> for Stay {
    fn mutate(&self, _: &S, _: &F, _: &LayerStep, _: &mut S::State, _: &mut ParticleRng) {}
}

/// Gaussian noise in local coordinates, its standard deviation times the schedule's factor.
#[derive(Clone, Debug)]
pub struct GaussianDiffusion {
    noise: Gaussian,
    survivors: Option<SurvivorCovariance>,
}

#[derive(Clone, Debug)]
struct SurvivorCovariance {
    least_standard_deviations: Vec<f64>,
    covariance: Vec<f64>,
}

impl From<Gaussian> for GaussianDiffusion {
    fn from(noise: Gaussian) -> Self {
        Self { noise, survivors: None }
    }
}

impl GaussianDiffusion {
    /// Independent noise of these standard deviations, `[dim]`.
    ///
    /// # Errors
    /// When one is negative or not finite.
    pub fn diagonal(standard_deviations: Vec<f64>) -> Result<Self, BadCovariance> {
        Gaussian::diagonal(standard_deviations).map(Self::from)
    }

    /// Noise of this covariance `[dim, dim]`, row after row.
    ///
    /// # Errors
    /// When it is not positive definite.
    pub fn full(covariance: &[f64], dim: usize) -> Result<Self, BadCovariance> {
        Gaussian::full(covariance, dim).map(Self::from)
    }

    /// Noise of the covariance that the surviving particles of the layer have, `[Deutscher2005]`: the
    /// search stays wide where the particles still disagree. `least_standard_deviations` `[dim]`, each above zero, are
    /// added in square, for survivors that are all alike would never part again.
    ///
    /// # Errors
    /// When one is not a finite number above zero.
    pub fn of_survivors(least_standard_deviations: Vec<f64>) -> Result<Self, BadCovariance> {
        let usable = |s: &f64| *s > 0.0 && s.is_finite();
        if let Some(coordinate) = least_standard_deviations.iter().position(|s| !usable(s)) {
            let value = least_standard_deviations[coordinate];
            return Err(BadCovariance::StandardDeviation { coordinate, value });
        }
        let covariance = vec![0.0; least_standard_deviations.len().pow(2)];
        Ok(Self {
            noise: Gaussian::diagonal(least_standard_deviations.clone())?,
            survivors: Some(SurvivorCovariance { least_standard_deviations, covariance }),
        })
    }
}

impl<S: StateSpace, F: ?Sized> Mutation<S, F> for GaussianDiffusion {
    fn prepare(&mut self, space: &S, survivors: &[S::State], _step: &LayerStep) {
        let Some(SurvivorCovariance { least_standard_deviations, covariance }) = &mut self.survivors else {
            return;
        };
        let dim = space.dim();
        let weight = |_| 1.0 / survivors.len() as f64;
        let mean = mean_of(space, survivors, weight, &survivors[0]);
        covariance_about(space, &mean, survivors, weight, covariance);
        for (i, least) in least_standard_deviations.iter().enumerate() {
            covariance[i * dim + i] += least * least;
        }
        self.noise
            .set_full(covariance, dim)
            .expect("a covariance plus a positive diagonal is positive definite");
    }

    fn mutate(&self, space: &S, _frame: &F, step: &LayerStep, state: &mut S::State, rng: &mut ParticleRng) {
        with_buffer(space.dim(), |delta| {
            self.noise.sample(step.diffusion_scale, rng, delta);
            space.retract(state, delta);
        });
    }
}
