//! Mixtures of sparse Bayesian experts under a softmax gate.

mod em;
mod hierarchical;
mod online;
mod params;

pub use em::EmReport;
pub(crate) use hierarchical::View;
pub use hierarchical::{HierarchicalDensity, HierarchicalMixture, heading_of};
pub use params::{HierarchicalConfig, HierarchicalParams, MixtureConfig, MixtureConfigError, MixtureParams};

use crate::density::{MixtureDensity, moments_into, predict_all};
use crate::{Design, Expert, FitError, Gate, Gaussian, Rvm, RvmClassifier};

/// p(y | x) = Σ_k g_k(x) N(y | expert k at x): one input, several answers.
///
/// Over a product kernel of a previous state and a descriptor it is a conditional mixture of experts.
///
/// ```
/// use bme::{Design, Inputs, Kernel, MixtureConfig, MixtureOfExperts, MixtureParams};
/// // Two branches: the sign of y cannot be known from x.
/// let x: Vec<f64> = (0..120).map(|i| f64::from(i / 2) / 20.0 - 1.5).collect();
/// let y: Vec<f64> = x.iter().enumerate().map(|(i, x)| (1.0 + 0.3 * x) * if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
/// let design = Design::new(Kernel::gaussian(1, 0.5)?, Inputs::from_rows(1, x)?);
/// let params = MixtureParams::new(MixtureConfig { n_experts: 2, ..MixtureConfig::default() })?;
/// let (model, _) = MixtureOfExperts::fit(&design, &[y], &[1.0; 120], &params)?;
/// let modes = model.density(&[0.5]).modes();
/// assert_eq!(modes.len(), 2);
/// assert!((modes[0].at[0].abs() - 1.15).abs() < 0.05);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct MixtureOfExperts {
    pub(crate) gate: RvmClassifier,
    pub(crate) experts: Vec<Rvm>,
}

impl MixtureOfExperts {
    /// Fits gate and experts by expectation maximisation, from k-means clusters of the targets.
    ///
    /// `targets[d][i]` is output d of sample i. Experts that lose all their samples are left out.
    ///
    /// # Errors
    /// As [`Rvm::fit`].
    ///
    /// # Panics
    /// When a length is not the number of samples, or there are no targets.
    pub fn fit(
        design: &Design,
        targets: &[Vec<f64>],
        weights: &[f64],
        params: &MixtureParams,
    ) -> Result<(Self, EmReport), FitError> {
        em::fit(design, targets, weights, params)
    }

    /// p(y | x).
    ///
    /// # Panics
    /// When `x` has the wrong length.
    pub fn density(&self, x: &[f64]) -> MixtureDensity {
        let mut log_gates = vec![0.0; self.experts.len()];
        self.gate.log_gates(x, &mut log_gates);
        predict_all(log_gates, &self.experts, x)
    }

    /// The experts.
    pub fn experts(&self) -> &[Rvm] {
        &self.experts
    }

    /// The gate over them.
    pub fn gate(&self) -> &RvmClassifier {
        &self.gate
    }
}

/// The mean and variance of the whole mixture.
impl Expert for MixtureOfExperts {
    fn input_dim(&self) -> usize {
        self.gate.input_dim()
    }

    fn output_dim(&self) -> usize {
        self.experts.first().map_or(0, Expert::output_dim)
    }

    fn predict(&self, x: &[f64], out: &mut Gaussian) {
        moments_into(&self.density(x), out);
    }
}

#[cfg(test)]
mod tests;
