//! Mixtures that learn from one example at a time: rounds of expectation maximisation for that example.

use super::{HierarchicalMixture, MixtureOfExperts};
use crate::linalg::log_sum_exp;
use crate::rvm::check_example;
use crate::{Expert, OnlineUpdate, UpdateError, UpdateReport};

/// Rounds for one example: the shares are those of the model that has learnt from it.
const ROUNDS: usize = 2;
/// An expert with less of an example than this does not learn from it.
const LEAST_SHARE: f64 = 1e-2;

/// exp of each less the log-sum-exp of all; even shares where all are −∞.
fn shares(log_joint: &[f64]) -> Vec<f64> {
    let total = log_sum_exp(log_joint);
    let even = 1.0 / log_joint.len() as f64;
    log_joint.iter().map(|j| if total > f64::NEG_INFINITY { (j - total).exp() } else { even }).collect()
}

impl OnlineUpdate for MixtureOfExperts {
    fn update(&mut self, x: &[f64], y: &[f64], responsibility: f64) -> Result<UpdateReport, UpdateError> {
        check_example(x, self.input_dim(), y, self.output_dim(), responsibility)?;
        let before = self.clone();
        let mut report = UpdateReport::default();
        for _ in 0..ROUNDS {
            let shares = shares(&self.density(x).log_joint(y));
            let mut next = before.clone();
            report = next.gate.update(x, &shares, responsibility)?;
            for (expert, share) in
                next.experts.iter_mut().zip(&shares).filter(|(_, share)| **share > LEAST_SHARE)
            {
                report += expert.update(x, y, responsibility * share.min(1.0))?;
            }
            *self = next;
        }
        Ok(report)
    }
}

/// `y` is a point: the latent coordinates, then cosine and sine of the heading.
impl OnlineUpdate for HierarchicalMixture {
    fn update(&mut self, x: &[f64], y: &[f64], responsibility: f64) -> Result<UpdateReport, UpdateError> {
        check_example(x, self.input_dim(), y, self.output_dim(), responsibility)?;
        let shares = shares(&self.density(x).log_joint(y));
        let mut next = self.clone();
        let mut report = next.gate.update(x, &shares, responsibility)?;
        for (view, share) in next.views.iter_mut().zip(&shares).filter(|(_, share)| **share > LEAST_SHARE) {
            let mut rest = y;
            for block in &mut view.blocks {
                let (part, tail) = rest.split_at(block.output_dim());
                rest = tail;
                report += block.update(x, part, responsibility * share.min(1.0))?;
            }
        }
        *self = next;
        Ok(report)
    }
}
