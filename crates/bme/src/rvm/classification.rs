//! Relevance vector classification of any number of classes from soft labels; also the softmax gates.

use super::laplace::{Labels, Posterior};
use super::{FitError, Memory, RvmParams, SparseFunction, check_samples, used_centres};
use crate::linalg::log_sum_exp;
use crate::{Design, Gate, Inputs, Kernel};

/// Class probabilities softmax(f_1(x), …, f_K(x)), each f a sparse sum of kernels.
///
/// Two classes need one function (the other is 0): the classifier of `[Tipping2003]`. More classes have one each.
///
/// ```
/// use bme::{Design, Gate, Inputs, Kernel, RvmClassifier, RvmParams};
/// let x: Vec<f64> = (0..60).map(|i| f64::from(i) * 0.1 - 3.0).collect();
/// let left: Vec<f64> = x.iter().map(|x| f64::from(u8::from(*x < 0.0))).collect();
/// let right: Vec<f64> = left.iter().map(|l| 1.0 - l).collect();
/// let design = Design::new(Kernel::gaussian(1, 0.5)?, Inputs::from_rows(1, x)?);
/// let model = RvmClassifier::fit(&design, &[left, right], &RvmParams::default())?;
/// let mut log_gates = [0.0; 2];
/// model.log_gates(&[-1.5], &mut log_gates);
/// assert!(log_gates[0].exp() > 0.9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct RvmClassifier {
    pub(crate) kernel: Kernel,
    pub(crate) centres: Inputs,
    pub(crate) logits: Vec<SparseFunction>,
    pub(crate) n_classes: usize,
    pub(crate) log_evidence: f64,
    pub(crate) memory: Memory,
}

impl RvmClassifier {
    /// Fits to soft labels: `labels[k][i]` ≥ 0 is how much of sample i is of class k (their sum is its weight).
    ///
    /// One class needs no samples of any other: it is then certain.
    ///
    /// # Errors
    /// When a label is negative or not finite, or all are zero.
    ///
    /// # Panics
    /// When there are no classes or a length is not the number of samples.
    pub fn fit(design: &Design, labels: &[Vec<f64>], params: &RvmParams) -> Result<Self, FitError> {
        assert!(!labels.is_empty(), "no classes, expected at least one");
        let weights = Labels::weights(labels);
        for label in labels {
            check_samples(design, &weights, label).or_else(|error| {
                if matches!(error, FitError::NoWeight { .. }) { Ok(()) } else { Err(error) }
            })?;
        }
        check_samples(design, &weights, &weights)?;
        let labels = Labels::new(design, labels, weights);
        let mut posterior = Posterior::new(&labels);
        posterior.climb(params);
        Ok(Self::from_posterior(design, &labels, &posterior))
    }

    pub(crate) fn from_posterior(design: &Design, labels: &Labels<'_>, posterior: &Posterior<'_>) -> Self {
        let (used, centres) = used_centres(design, posterior.bases());
        let slot = |basis: usize| used.binary_search(&basis).unwrap_or(used.len());
        Self {
            kernel: design.kernel().clone(),
            centres,
            logits: posterior.functions(slot),
            n_classes: labels.n_classes(),
            log_evidence: posterior.log_evidence(),
            memory: Memory::of_fit(design, &posterior.linearised_samples()),
        }
    }

    /// Bases of all classes together, biases included.
    pub fn n_bases(&self) -> usize {
        self.logits.iter().map(|logit| logit.bases.len()).sum()
    }

    /// Laplace's log evidence of the training labels.
    pub fn log_evidence(&self) -> f64 {
        self.log_evidence
    }
}

impl Gate for RvmClassifier {
    fn input_dim(&self) -> usize {
        self.kernel.dim()
    }

    fn n_experts(&self) -> usize {
        self.n_classes
    }

    /// Each function is moderated by its own uncertainty, f / √(1 + π σ² / 8), as `[MacKay1992]`: far from all
    /// samples the gates become even.
    fn log_gates(&self, x: &[f64], out: &mut [f64]) {
        assert_eq!(out.len(), self.n_classes, "{} gates, {} classes", out.len(), self.n_classes);
        let mut features = Vec::with_capacity(self.centres.len() + 1);
        self.kernel.at_centres(&self.centres, x, &mut features);
        features.push(1.0);
        out.fill(0.0);
        for (gate, logit) in out.iter_mut().zip(&self.logits) {
            let (mean, variance) = logit.predict(&features);
            *gate = mean / (1.0 + std::f64::consts::PI * variance / 8.0).sqrt();
        }
        let total = log_sum_exp(out);
        out.iter_mut().for_each(|gate| *gate -= total);
    }
}
