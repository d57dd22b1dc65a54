//! Weights of particles: natural logs while they are worked out, a distribution when they are used.

use crate::lanes::{self, exp_of_nonpositive};
use crate::schedule::Beta;

/// Natural logs of weights that need not sum to one; −∞ is a weight of zero.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LogWeights(Vec<f64>);

impl LogWeights {
    /// Takes the logs as they are: each below +∞ and not NaN.
    pub fn new(log_weights: Vec<f64>) -> Self {
        Self(log_weights)
    }

    /// The logs.
    pub fn as_slice(&self) -> &[f64] {
        &self.0
    }

    /// The logs, to be written over.
    pub fn as_mut_slice(&mut self) -> &mut [f64] {
        &mut self.0
    }

    pub(crate) fn resize(&mut self, n_particles: usize) {
        self.0.resize(n_particles, 0.0);
    }

    /// The largest log; −∞ when every weight is zero or there is none.
    pub fn max(&self) -> f64 {
        lanes::max(&self.0)
    }

    /// ln Σ exp of the logs, without overflow.
    pub fn log_sum_exp(&self) -> f64 {
        let max = self.max();
        if max == f64::NEG_INFINITY {
            return max;
        }
        max + lanes::sum(&self.0, |w| exp_of_nonpositive(w - max)).ln()
    }

    /// Number of weights that are not zero.
    pub fn n_possible(&self) -> usize {
        self.0.iter().filter(|&&w| w > f64::NEG_INFINITY).count()
    }

    /// (Σ w)² / Σ w² of the weights raised to `beta`; zero when every weight is zero.
    pub fn effective_sample_size(&self, beta: Beta) -> f64 {
        let max = self.max();
        if max == f64::NEG_INFINITY {
            return 0.0;
        }
        // 0 times −∞ is no number, but an impossible particle stays so under every exponent.
        let raised = |w: f64| if w == f64::NEG_INFINITY { w } else { beta.get() * (w - max) };
        let sum = lanes::sum(&self.0, |w| exp_of_nonpositive(raised(w)));
        sum * sum / lanes::sum(&self.0, |w| exp_of_nonpositive(2.0 * raised(w)))
    }

    /// Writes the weights as a distribution into `out` and returns ln of their sum.
    ///
    /// `None`, with `out` left alone, when every weight is zero.
    pub fn normalize_into(&self, out: &mut NormalizedWeights) -> Option<f64> {
        let max = self.max();
        if max == f64::NEG_INFINITY {
            return None;
        }
        out.weights.clear();
        out.weights.extend(self.0.iter().map(|w| exp_of_nonpositive(w - max)));
        let sum = out.normalize();
        Some(max + sum.ln())
    }
}

/// Weights of zero or more that sum to one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NormalizedWeights {
    weights: Vec<f64>,
    effective_sample_size: f64,
}

/// Why numbers cannot be made into a distribution.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum BadWeights {
    /// A weight is negative, infinite or NaN.
    #[error("weight {index} is {value}, expected a finite number of zero or more")]
    NotAWeight {
        /// Which weight.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// Nothing to share out.
    #[error("the weights sum to {sum}, expected a finite sum above zero")]
    Sum {
        /// The sum.
        sum: f64,
    },
}

impl NormalizedWeights {
    /// Scales `weights` to sum one.
    ///
    /// # Errors
    /// When a weight is negative or not finite, or all are zero.
    pub fn from_linear(weights: Vec<f64>) -> Result<Self, BadWeights> {
        Self::check(&weights)?;
        let sum: f64 = weights.iter().sum();
        if !(sum > 0.0 && sum.is_finite()) {
            return Err(BadWeights::Sum { sum });
        }
        let mut normalized = Self { weights, effective_sample_size: 0.0 };
        normalized.normalize();
        Ok(normalized)
    }

    /// Takes weights that were normalised before as they are, bit for bit.
    pub(crate) fn restore(weights: Vec<f64>) -> Self {
        let effective_sample_size = effective_sample_size(&weights);
        Self { weights, effective_sample_size }
    }

    pub(crate) fn check(weights: &[f64]) -> Result<(), BadWeights> {
        match weights.iter().position(|w| !(w.is_finite() && *w >= 0.0)) {
            Some(index) => Err(BadWeights::NotAWeight { index, value: weights[index] }),
            None => Ok(()),
        }
    }

    /// The same weight for each of `n` particles.
    pub fn uniform(n: usize) -> Self {
        Self { weights: vec![1.0 / n as f64; n], effective_sample_size: n as f64 }
    }

    /// The weights.
    pub fn as_slice(&self) -> &[f64] {
        &self.weights
    }

    /// 1 / Σ w²: about how many equally weighted particles would be as good.
    pub fn effective_sample_size(&self) -> f64 {
        self.effective_sample_size
    }

    /// Index of the largest weight, the first of equals.
    pub fn heaviest(&self) -> usize {
        let mut best = 0;
        for (i, w) in self.weights.iter().enumerate() {
            if *w > self.weights[best] {
                best = i;
            }
        }
        best
    }

    /// Divides by the sum and returns it.
    fn normalize(&mut self) -> f64 {
        let sum = lanes::sum(&self.weights, |w| w);
        let scale = 1.0 / sum;
        for w in &mut self.weights {
            *w *= scale;
        }
        self.effective_sample_size = effective_sample_size(&self.weights);
        sum
    }
}

fn effective_sample_size(weights: &[f64]) -> f64 {
    1.0 / lanes::sum(weights, |w| w * w)
}
