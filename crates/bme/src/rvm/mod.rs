//! Relevance vector machines: regression and classification with few bases.

mod classification;
pub(crate) mod laplace;
mod memory;
mod online;
mod params;
mod regression;
pub(crate) mod sequential;
mod widths;

pub use classification::RvmClassifier;
pub(crate) use memory::{Memory, Remembered};
pub(crate) use online::check_answers;
pub use params::{RvmConfig, RvmConfigError, RvmParams};
pub use regression::Rvm;
pub(crate) use regression::{SparseFit, fit_output};

use crate::linalg::{Symmetric, dot};
use crate::{Design, Inputs};

/// Targets and weights beyond this are refused: sums of their squares have to stay finite.
pub(crate) const LARGEST: f64 = 1e100;

/// The posterior of one output's weights.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SparseFunction {
    /// Which of the model's centres; the number of centres stands for the bias.
    pub(crate) bases: Vec<usize>,
    /// Prior precision of each weight; in units of the noise precision for a regression.
    pub(crate) precisions: Vec<f64>,
    pub(crate) mean: Vec<f64>,
    /// Posterior covariance of the weights; divided by the noise variance for a regression.
    pub(crate) covariance: Symmetric,
    /// 1 where there is no such noise (classification).
    pub(crate) noise_variance: f64,
    pub(crate) log_evidence: f64,
    /// The weight of all samples that it was fitted to.
    pub(crate) total_weight: f64,
}

impl SparseFunction {
    /// The mean alone.
    pub(crate) fn mean_at(&self, features: &[f64]) -> f64 {
        self.bases.iter().zip(&self.mean).map(|(&basis, weight)| weight * features[basis]).sum()
    }

    /// The variance of the function (without noise), likewise.
    fn variance_at(&self, features: &[f64]) -> f64 {
        let feature = |i: usize| features[self.bases[i]];
        let quadratic = |i: usize| -> f64 {
            feature(i) * self.covariance.row(i).iter().enumerate().map(|(j, c)| c * feature(j)).sum::<f64>()
        };
        self.noise_variance * (0..self.bases.len()).map(quadratic).sum::<f64>().max(0.0)
    }

    /// Mean and variance of the function (without noise) from all kernels of the model at an input.
    pub(crate) fn predict(&self, features: &[f64]) -> (f64, f64) {
        let own: Vec<f64> = self.bases.iter().map(|&basis| features[basis]).collect();
        (dot(&self.mean, &own), self.noise_variance * self.covariance.quadratic(&own).max(0.0))
    }
}

/// Why a model cannot be fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    /// A target is NaN, or so large that its square would be infinite.
    #[error("the target of sample {sample} is {value}, expected a finite number within ±{LARGEST:e}")]
    Target {
        /// Which sample.
        sample: usize,
        /// What it is.
        value: f64,
    },
    /// A weight is negative, NaN or too large.
    #[error("the weight of sample {sample} is {value}, expected 0 to {LARGEST:e}")]
    Weight {
        /// Which sample.
        sample: usize,
        /// What it is.
        value: f64,
    },
    /// No sample has any weight.
    #[error("the weights of {samples} samples sum to 0, expected more")]
    NoWeight {
        /// How many samples there are.
        samples: usize,
    },
}

/// The kernels among `bases`, in rising order and once each, with what they are centred on.
fn used_centres(design: &Design, bases: impl Iterator<Item = usize>) -> (Vec<usize>, Inputs) {
    let mut used: Vec<usize> = bases.filter(|&basis| basis != design.bias()).collect();
    used.sort_unstable();
    used.dedup();
    let centres = design.centres().select(&used);
    (used, centres)
}

/// Checks what comes from outside.
pub(crate) fn check_samples(design: &Design, target: &[f64], weights: &[f64]) -> Result<(), FitError> {
    let samples = design.n_samples();
    assert_eq!(target.len(), samples, "{} targets, {samples} samples", target.len());
    assert_eq!(weights.len(), samples, "{} weights, {samples} samples", weights.len());
    if let Some(sample) = target.iter().position(|t| t.is_nan() || t.abs() > LARGEST) {
        return Err(FitError::Target { sample, value: target[sample] });
    }
    if let Some(sample) = weights.iter().position(|&w| !(0.0..=LARGEST).contains(&w)) {
        return Err(FitError::Weight { sample, value: weights[sample] });
    }
    if weights.iter().sum::<f64>() > 0.0 { Ok(()) } else { Err(FitError::NoWeight { samples }) }
}

#[cfg(test)]
mod tests;
