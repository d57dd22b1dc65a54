//! Mixtures that learn from one input at a time: rounds of expectation maximisation for its outputs.

use rayon::prelude::*;

use super::{HierarchicalMixture, MixtureOfExperts};
use crate::linalg::shares;
use crate::rvm::check_answers;
use crate::{Answer, Expert, OnlineUpdate, UpdateError, UpdateReport};

/// Rounds for one input: the shares are those of the model that has learnt from it.
const ROUNDS: usize = 2;
/// An expert with less of an example than this does not learn from it.
const LEAST_SHARE: f64 = 1e-2;

/// What is left of the answers for the expert that has `shares[answer][expert]` of each.
fn part<'a>(answers: &[Answer<'a>], shares: &[Vec<f64>], expert: usize) -> Vec<Answer<'a>> {
    let own = answers.iter().zip(shares).filter(|(_, shares)| shares[expert] > LEAST_SHARE);
    own.map(|(a, shares)| Answer { y: a.y, responsibility: a.responsibility * shares[expert].min(1.0) })
        .collect()
}

/// The same answers, each with the shares of the experts in it as its output: what a gate learns.
fn gate_answers<'a>(answers: &[Answer<'_>], shares: &'a [Vec<f64>]) -> Vec<Answer<'a>> {
    answers.iter().zip(shares).map(|(a, y)| Answer { y, responsibility: a.responsibility }).collect()
}

impl MixtureOfExperts {
    /// The mixture after it has learnt the answers, and what that did.
    fn updated(&self, x: &[f64], answers: &[Answer<'_>]) -> Result<(Self, UpdateReport), UpdateError> {
        let (mut model, mut report) = (self.clone(), UpdateReport::default());
        for _ in 0..ROUNDS {
            let density = model.density(x);
            let shares: Vec<Vec<f64>> = answers.iter().map(|a| shares(&density.log_joint(a.y))).collect();
            model = self.clone();
            report = model.gate.update_all(x, &gate_answers(answers, &shares))?;
            for (k, expert) in model.experts.iter_mut().enumerate() {
                report += expert.update_all(x, &part(answers, &shares, k))?;
            }
        }
        Ok((model, report))
    }
}

impl OnlineUpdate for MixtureOfExperts {
    fn update_all(&mut self, x: &[f64], answers: &[Answer<'_>]) -> Result<UpdateReport, UpdateError> {
        check_answers(x, self.input_dim(), answers, self.output_dim())?;
        let (model, report) = self.updated(x, answers)?;
        *self = model;
        Ok(report)
    }
}

/// Outputs are points: the latent coordinates, then cosine and sine of the heading.
impl OnlineUpdate for HierarchicalMixture {
    fn update_all(&mut self, x: &[f64], answers: &[Answer<'_>]) -> Result<UpdateReport, UpdateError> {
        check_answers(x, self.input_dim(), answers, self.output_dim())?;
        let density = self.density(x);
        let shares: Vec<Vec<f64>> = answers.iter().map(|a| shares(&density.log_joint(a.y))).collect();
        let mut gate = self.gate.clone();
        let mut report = gate.update_all(x, &gate_answers(answers, &shares))?;
        // Every block of every view that has part in an answer; they do not touch each other.
        let mut tasks: Vec<(&mut MixtureOfExperts, Vec<Answer<'_>>)> = Vec::new();
        for (v, view) in self.views.iter_mut().enumerate() {
            let own = part(answers, &shares, v);
            let mut start = 0;
            for block in view.blocks.iter_mut().filter(|_| !own.is_empty()) {
                let range = start..start + block.output_dim();
                start = range.end;
                let of_block = own
                    .iter()
                    .map(|&Answer { y, responsibility }| Answer { y: &y[range.clone()], responsibility });
                tasks.push((block, of_block.collect()));
            }
        }
        let updated: Vec<(MixtureOfExperts, UpdateReport)> =
            tasks.par_iter().map(|(block, answers)| block.updated(x, answers)).collect::<Result<_, _>>()?;
        for ((block, _), (model, change)) in tasks.into_iter().zip(updated) {
            *block = model;
            report += change;
        }
        self.gate = gate;
        Ok(report)
    }
}
