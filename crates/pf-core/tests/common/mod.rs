//! A linear-Gaussian model with its exact solution, and the statistics that compare a filter with it.

#![allow(dead_code, reason = "each test file uses its own part")]

use std::convert::Infallible;

use pf_core::{Euclidean, FilterConfig, FilterParams, Gaussian, Likelihood, ParticleRng, Proposal, Proposed};

pub type Plane = Euclidean<2>;

/// x = (position, velocity), x_k = A x_{k−1} + N(0, Q), y_k = position + N(0, r), x_0 ~ N(0, I).
pub struct ConstantVelocity {
    noise: Gaussian,
}

pub const A: [[f64; 2]; 2] = [[1.0, 0.5], [0.0, 0.9]];
pub const Q: [[f64; 2]; 2] = [[0.30, 0.08], [0.08, 0.20]];
pub const R: f64 = 0.25;
pub const OBSERVATIONS: [f64; 8] = [0.4, 1.1, 0.7, -0.6, -1.9, -1.6, 0.2, 0.9];

impl ConstantVelocity {
    pub fn new() -> Self {
        Self { noise: Gaussian::full(Q.as_flattened(), 2).expect("Q is positive definite") }
    }

    fn predicted(x: &[f64; 2]) -> [f64; 2] {
        [A[0][0] * x[0] + A[0][1] * x[1], A[1][0] * x[0] + A[1][1] * x[1]]
    }
}

impl Proposal<Plane> for ConstantVelocity {
    type Frame = f64;

    fn propose(&self, _: &Plane, x: &[f64; 2], _: &f64, rng: &mut ParticleRng) -> Proposed<[f64; 2]> {
        let mut step = [0.0; 2];
        self.noise.sample(1.0, rng, &mut step);
        let centre = Self::predicted(x);
        Proposed { state: [centre[0] + step[0], centre[1] + step[1]], log_correction: 0.0 }
    }

    fn log_motion_density(&self, _: &Plane, previous: &[f64; 2], x: &[f64; 2]) -> Option<f64> {
        let centre = Self::predicted(previous);
        Some(self.noise.log_density(&[x[0] - centre[0], x[1] - centre[1]]))
    }

    fn log_density(&self, space: &Plane, previous: &[f64; 2], _: &f64, x: &[f64; 2]) -> Option<f64> {
        self.log_motion_density(space, previous, x)
    }
}

/// Proposes positions around the measurement, and any velocity.
pub struct AroundMeasurement {
    noise: Gaussian,
}

impl AroundMeasurement {
    pub fn new() -> Self {
        Self { noise: Gaussian::diagonal(vec![0.6, 1.2]).expect("both are positive") }
    }
}

impl Proposal<Plane> for AroundMeasurement {
    type Frame = f64;

    fn propose(&self, _: &Plane, _: &[f64; 2], y: &f64, rng: &mut ParticleRng) -> Proposed<[f64; 2]> {
        let mut x = [0.0; 2];
        self.noise.sample(1.0, rng, &mut x);
        Proposed { state: [x[0] + y, x[1]], log_correction: 0.0 }
    }

    fn log_density(&self, _: &Plane, _: &[f64; 2], y: &f64, x: &[f64; 2]) -> Option<f64> {
        Some(self.noise.log_density(&[x[0] - y, x[1]]))
    }
}

/// N(y; position, r), normalised, so that evidence can be compared.
pub struct Position;

impl Likelihood<[f64; 2]> for Position {
    type Frame = f64;
    type Error = Infallible;

    fn log_likelihoods(&mut self, y: &f64, states: &[[f64; 2]], out: &mut [f64]) -> Result<(), Infallible> {
        for (log_likelihood, x) in out.iter_mut().zip(states) {
            *log_likelihood = log_normal(*y - x[0], R);
        }
        Ok(())
    }
}

pub fn log_normal(residual: f64, variance: f64) -> f64 {
    -0.5 * (residual * residual / variance + (2.0 * std::f64::consts::PI * variance).ln())
}

pub struct Exact {
    pub mean: [f64; 2],
    pub covariance: [[f64; 2]; 2],
    pub log_evidence: f64,
}

/// The Kalman filter over [`OBSERVATIONS`].
pub fn kalman() -> Exact {
    let (mut m, mut p, mut log_evidence) = ([0.0; 2], [[1.0, 0.0], [0.0, 1.0]], 0.0);
    for y in OBSERVATIONS {
        m = ConstantVelocity::predicted(&m);
        let ap = product(A, p);
        p = product(ap, [[A[0][0], A[1][0]], [A[0][1], A[1][1]]]);
        for (row, noise) in p.iter_mut().zip(Q) {
            row[0] += noise[0];
            row[1] += noise[1];
        }
        let innovation_variance = p[0][0] + R;
        log_evidence += log_normal(y - m[0], innovation_variance);
        let gain = [p[0][0] / innovation_variance, p[1][0] / innovation_variance];
        let innovation = y - m[0];
        m = [m[0] + gain[0] * innovation, m[1] + gain[1] * innovation];
        let first_row = p[0];
        for (row, k) in p.iter_mut().zip(gain) {
            row[0] -= k * first_row[0];
            row[1] -= k * first_row[1];
        }
    }
    Exact { mean: m, covariance: p, log_evidence }
}

fn product(a: [[f64; 2]; 2], b: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    let entry = |i: usize, j: usize| a[i][0] * b[0][j] + a[i][1] * b[1][j];
    [[entry(0, 0), entry(0, 1)], [entry(1, 0), entry(1, 1)]]
}

pub fn params(n_particles: usize, seed: u64) -> FilterParams {
    FilterParams::new(FilterConfig { n_particles, seed, ..FilterConfig::default() }).expect("sizes are sane")
}

/// By how many standard errors the mean of `samples` misses `truth`.
pub fn standard_errors_off(samples: &[f64], truth: f64) -> f64 {
    let n = samples.len() as f64;
    let mean = samples.iter().sum::<f64>() / n;
    let variance = samples.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean - truth) / (variance / n).sqrt()
}
