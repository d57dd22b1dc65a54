//! The growth model of `[Gordon1993]`: one dimension, two modes, a measurement that does not see the sign.

use std::convert::Infallible;

use pf_core::rng::{Draw, Purpose, particle_rng};
use pf_core::{Euclidean, Filter, FilterConfig, FilterParams, Likelihood, ParticleRng, Proposal, Proposed};

const START_VARIANCE: f64 = 5.0;
const STEP_VARIANCE: f64 = 10.0;

/// What is known of one instant.
pub struct Instant {
    /// 8 cos(1.2 k).
    pub drift: f64,
    /// y.
    pub observation: f64,
}

/// x_k = x/2 + 25 x/(1 + x²) + 8 cos(1.2 k) + N(0, 10), k from 0.
pub struct Growth;

impl Growth {
    fn step(x: f64, drift: f64, rng: &mut ParticleRng) -> f64 {
        0.5 * x + 25.0 * x / (1.0 + x * x) + drift + STEP_VARIANCE.sqrt() * rng.standard_normal()
    }
}

impl Proposal<Euclidean<1>> for Growth {
    type Frame = Instant;

    fn propose(
        &self,
        _: &Euclidean<1>,
        [x]: &[f64; 1],
        instant: &Instant,
        rng: &mut ParticleRng,
    ) -> Proposed<[f64; 1]> {
        Proposed { state: [Growth::step(*x, instant.drift, rng)], log_correction: 0.0 }
    }
}

/// y = x²/20 + N(0, 1).
pub struct Squared;

impl Likelihood<[f64; 1]> for Squared {
    type Frame = Instant;
    type Error = Infallible;

    fn log_likelihoods(
        &mut self,
        instant: &Instant,
        states: &[[f64; 1]],
        out: &mut [f64],
    ) -> Result<(), Infallible> {
        for (log_likelihood, [x]) in out.iter_mut().zip(states) {
            let residual = instant.observation - x * x / 20.0;
            *log_likelihood = -0.5 * residual * residual;
        }
        Ok(())
    }
}

/// The instants of a series of observations.
pub fn instants(observations: &[f64]) -> Vec<Instant> {
    let instant =
        |(k, &observation): (usize, &f64)| Instant { drift: 8.0 * (1.2 * k as f64).cos(), observation };
    observations.iter().enumerate().map(instant).collect()
}

/// True states and observations of `n_steps` steps.
pub fn simulate(n_steps: usize, seed: u64) -> (Vec<f64>, Vec<f64>) {
    let mut rng = particle_rng(Draw { seed, frame: 0, layer: 0, purpose: Purpose::User }, 0);
    let mut x = START_VARIANCE.sqrt() * rng.standard_normal();
    (0..n_steps)
        .map(|k| {
            x = Growth::step(x, 8.0 * (1.2 * k as f64).cos(), &mut rng);
            (x, x * x / 20.0 + rng.standard_normal())
        })
        .unzip()
}

/// A bootstrap filter before the first instant.
pub fn filter(n_particles: usize, seed: u64) -> Filter<Euclidean<1>, Growth> {
    let config = FilterConfig { n_particles, seed, ..FilterConfig::default() };
    let params = FilterParams::new(config).expect("the numbers of particles used here are allowed");
    let mut filter = Filter::bootstrap(Euclidean, Growth, params);
    filter.initialise_with(|_, rng| [START_VARIANCE.sqrt() * rng.standard_normal()]);
    filter
}
