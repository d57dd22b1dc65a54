//! Laplace's approximation of a softmax posterior, and the climb of its evidence.
//!
//! About the mode, each function f_k sees a regression of known noise: precisions B = w g(1 − g) and working targets
//! z with Bz = Bf + (r − w g) (`[Tipping2003]` section 3.2). The [`Sequential`] steps of that regression are tried on the
//! real posterior and kept only when Laplace's evidence did rise.
//!
//! Deviation: with three classes and more, the Hessian is taken block-diagonal over the functions.

use super::sequential::{Noise, Sequential};
use super::{Remembered, RvmParams, SparseFunction};
use crate::Design;
use crate::design::WeightedDesign;
use crate::linalg::{Symmetric, add_scaled, dot, log_sum_exp};

/// Steps that one linearisation is trusted for.
const STEPS_PER_LINEARISATION: usize = 8;
/// Newton's method stops when the expected gain of log posterior (nats) is below this.
const MODE_TOLERANCE: f64 = 1e-9;
/// A sample's g(1 − g) counts at least this much, so that certain samples do not make B singular.
const CURVATURE_FLOOR: f64 = 1e-8;

/// Soft labels of the samples of a design.
pub(crate) struct Labels<'a> {
    design: &'a Design,
    labels: &'a [Vec<f64>],
    weights: Vec<f64>,
}

impl<'a> Labels<'a> {
    /// The sum of the labels of each sample.
    pub(crate) fn weights(labels: &[Vec<f64>]) -> Vec<f64> {
        let mut weights = vec![0.0; labels[0].len()];
        labels.iter().for_each(|label| add_scaled(&mut weights, 1.0, label));
        weights
    }

    pub(crate) fn new(design: &'a Design, labels: &'a [Vec<f64>], weights: Vec<f64>) -> Self {
        Self { design, labels, weights }
    }

    pub(crate) fn n_classes(&self) -> usize {
        self.labels.len()
    }

    pub(crate) fn design(&self) -> &'a Design {
        self.design
    }

    /// The labels, class by class.
    pub(crate) fn classes(&self) -> &'a [Vec<f64>] {
        self.labels
    }

    /// Functions needed: none for one class, one for two, else one each.
    fn n_logits(&self) -> usize {
        match self.n_classes() {
            1 => 0,
            2 => 1,
            classes => classes,
        }
    }
}

/// One function: its bases with the mode of their weights, and its values at the samples.
#[derive(Clone)]
struct Logit {
    active: Vec<usize>,
    precisions: Vec<f64>,
    mean: Vec<f64>,
    values: Vec<f64>,
}

/// All functions at the mode of their posterior.
#[derive(Clone)]
pub(crate) struct Posterior<'a> {
    labels: &'a Labels<'a>,
    logits: Vec<Logit>,
    log_evidence: f64,
}

impl<'a> Posterior<'a> {
    /// Without any basis: all classes equally likely.
    pub(crate) fn new(labels: &'a Labels<'a>) -> Self {
        let empty = Logit {
            active: Vec::new(),
            precisions: Vec::new(),
            mean: Vec::new(),
            values: vec![0.0; labels.design.n_samples()],
        };
        let mut posterior = Self { labels, logits: vec![empty; labels.n_logits()], log_evidence: 0.0 };
        posterior.log_evidence = posterior.evidence_at_mode();
        posterior
    }

    /// With the bases of an earlier fit in place (see [`Self::start`]), at the mode; nothing to start from is fine.
    pub(crate) fn with_bases(labels: &'a Labels<'a>, start: &[(Vec<usize>, Vec<f64>)]) -> Self {
        let mut posterior = Self::new(labels);
        for (logit, (active, precisions)) in posterior.logits.iter_mut().zip(start) {
            logit.active.clone_from(active);
            logit.precisions.clone_from(precisions);
            logit.mean = vec![0.0; active.len()];
        }
        for c in 0..posterior.logits.len() {
            posterior.find_mode(c);
        }
        posterior.log_evidence = posterior.evidence_at_mode();
        posterior
    }

    /// The bases and precisions of each function, for a fit that goes on from here.
    pub(crate) fn start(&self) -> Vec<(Vec<usize>, Vec<f64>)> {
        self.logits.iter().map(|logit| (logit.active.clone(), logit.precisions.clone())).collect()
    }

    pub(crate) fn log_evidence(&self) -> f64 {
        self.log_evidence
    }

    /// The bases of all functions, one after the other.
    pub(crate) fn bases(&self) -> impl Iterator<Item = usize> {
        self.logits.iter().flat_map(|logit| logit.active.iter().copied())
    }

    /// Each function with its covariance; `slot` renumbers the bases.
    pub(crate) fn functions(&self, slot: impl Fn(usize) -> usize) -> Vec<SparseFunction> {
        (0..self.logits.len())
            .map(|c| {
                let logit = &self.logits[c];
                SparseFunction {
                    bases: logit.active.iter().map(|&basis| slot(basis)).collect(),
                    precisions: logit.precisions.clone(),
                    mean: logit.mean.clone(),
                    covariance: self.information(c).cholesky().map(|f| f.inverse()).unwrap_or_default(),
                    noise_variance: 1.0,
                    log_evidence: self.log_evidence,
                    total_weight: self.labels.weights.iter().sum(),
                }
            })
            .collect()
    }

    /// Each function's samples as those of a regression: precisions B, and its values at the mode as targets.
    pub(crate) fn linearised_samples(&self) -> Vec<Vec<Remembered>> {
        let samples = |c: usize| {
            let parts = self.curvature(c).into_iter().zip(&self.logits[c].values);
            parts.map(|(b, f)| Remembered { precision: b, weighted_target: b * f }).collect()
        };
        (0..self.logits.len()).map(samples).collect()
    }

    /// Goes round the functions until a round gains less than `min_gain`; gives back the evidence after every step.
    pub(crate) fn climb(&mut self, params: &RvmParams) -> Vec<f64> {
        let mut course = Vec::new();
        while course.len() < params.max_steps {
            let before = self.log_evidence;
            for c in 0..self.logits.len() {
                if self.improve(c, params) {
                    course.push(self.log_evidence);
                }
            }
            if self.log_evidence - before < params.min_gain {
                break;
            }
        }
        course
    }

    /// Tries the best steps of function `c` about the present mode; says whether the evidence rose.
    fn improve(&mut self, c: usize, params: &RvmParams) -> bool {
        let curvature = self.curvature(c);
        let residual = self.residual(c);
        let logit = &self.logits[c];
        // B z = B f + (r − w g).
        let targets: Vec<f64> =
            curvature.iter().zip(&logit.values).zip(&residual).map(|((b, f), r)| b * f + r).collect();
        let design = self.labels.design;
        let weighted = WeightedDesign::new(design, curvature);
        weighted.prepare(&logit.active);
        let mut steps = STEPS_PER_LINEARISATION;
        while steps > 0 {
            let mut model = Sequential::new(
                &weighted,
                Noise::Known { precision: 1.0 },
                design.project(&targets),
                0.0,
                0.0,
            )
            .with_bases(&logit.active, &logit.precisions);
            let mut taken = 0;
            while taken < steps {
                match model.best_action(params).filter(|&(_, gain)| gain >= params.min_gain) {
                    Some((action, _)) => model.apply(action),
                    None => break,
                }
                taken += 1;
            }
            if taken == 0 {
                return false;
            }
            let mut trial = self.clone();
            trial.logits[c] = Logit {
                active: model.active().to_vec(),
                precisions: model.precisions().to_vec(),
                mean: model.mean().to_vec(),
                values: Vec::new(),
            };
            trial.logits[c].set_values(design);
            trial.find_mode(c);
            trial.log_evidence = trial.evidence_at_mode();
            if trial.log_evidence > self.log_evidence {
                *self = trial;
                return true;
            }
            // The linearisation promised too much: trust it for fewer steps.
            steps = taken / 2;
        }
        false
    }

    /// Newton's method on the weights of function `c`, halving steps that lower the posterior.
    fn find_mode(&mut self, c: usize) {
        let design = self.labels.design;
        let mut height = self.log_posterior();
        for _ in 0..50 {
            let gradient = self.gradient(c);
            let Some(factor) = self.information(c).cholesky() else { return };
            let step = factor.solve(&gradient);
            if dot(&gradient, &step) < MODE_TOLERANCE {
                return;
            }
            let start = self.logits[c].clone();
            let mut length = 1.0;
            loop {
                let logit = &mut self.logits[c];
                logit.mean.clone_from(&start.mean);
                add_scaled(&mut logit.mean, length, &step);
                logit.set_values(design);
                let new_height = self.log_posterior();
                if new_height > height {
                    height = new_height;
                    break;
                }
                length *= 0.5;
                if length < 1e-6 {
                    self.logits[c] = start;
                    return;
                }
            }
        }
    }

    /// ln g_k of every class at sample `i`.
    pub(crate) fn log_gates(&self, i: usize, out: &mut [f64]) {
        out.fill(0.0);
        out.iter_mut().zip(&self.logits).for_each(|(gate, logit)| *gate = logit.values[i]);
        let total = log_sum_exp(out);
        out.iter_mut().for_each(|gate| *gate -= total);
    }

    /// g_c of every sample.
    fn probabilities(&self, c: usize) -> Vec<f64> {
        let mut gates = vec![0.0; self.labels.n_classes()];
        (0..self.labels.weights.len())
            .map(|i| {
                self.log_gates(i, &mut gates);
                gates[c].exp()
            })
            .collect()
    }

    /// w g (1 − g) of function `c`.
    fn curvature(&self, c: usize) -> Vec<f64> {
        let probabilities = self.probabilities(c);
        probabilities
            .iter()
            .zip(&self.labels.weights)
            .map(|(g, w)| w * (g * (1.0 - g)).max(CURVATURE_FLOOR))
            .collect()
    }

    /// r − w g of function `c`.
    fn residual(&self, c: usize) -> Vec<f64> {
        let probabilities = self.probabilities(c);
        let labels = self.labels.labels[c].iter().zip(&self.labels.weights);
        labels.zip(probabilities).map(|((r, w), g)| r - w * g).collect()
    }

    /// Slope of the log posterior along the weights of function `c`: Φᵀ(r − w g) − Aw.
    fn gradient(&self, c: usize) -> Vec<f64> {
        let (logit, residual) = (&self.logits[c], self.residual(c));
        let bases = logit.active.iter().zip(logit.precisions.iter().zip(&logit.mean));
        bases.map(|(&basis, (a, w))| dot(self.labels.design.column(basis), &residual) - a * w).collect()
    }

    /// ΦᵀBΦ + A of function `c`.
    fn information(&self, c: usize) -> Symmetric {
        let (logit, curvature) = (&self.logits[c], self.curvature(c));
        let columns: Vec<&[f64]> =
            logit.active.iter().map(|&basis| self.labels.design.column(basis)).collect();
        let weighted: Vec<Vec<f64>> = columns
            .iter()
            .map(|column| column.iter().zip(&curvature).map(|(x, b)| x * b).collect())
            .collect();
        let lower: Vec<Vec<f64>> =
            (0..columns.len()).map(|i| (0..=i).map(|j| dot(columns[j], &weighted[i])).collect()).collect();
        Symmetric::from_fn(columns.len(), |i, j| {
            lower[i.max(j)][i.min(j)] + if i == j { logit.precisions[i] } else { 0.0 }
        })
    }

    /// Σ r ln g − ½ wᵀAw, without constants of A.
    fn log_posterior(&self) -> f64 {
        let classes = self.labels.labels;
        let mut gates = vec![0.0; classes.len()];
        let mut sum = 0.0;
        for i in 0..self.labels.weights.len() {
            self.log_gates(i, &mut gates);
            // 0 · −∞ is 0 here: a class that a sample has no part of.
            sum += classes.iter().zip(&gates).filter(|(r, _)| r[i] > 0.0).map(|(r, g)| r[i] * g).sum::<f64>();
        }
        let penalty: f64 = self
            .logits
            .iter()
            .flat_map(|logit| logit.precisions.iter().zip(&logit.mean).map(|(a, w)| a * w * w))
            .sum();
        sum - 0.5 * penalty
    }

    /// Laplace: ln p(labels | mode) p(mode) + ½ Σ_c (ln |A_c| − ln |Φ_cᵀB_cΦ_c + A_c|); −∞ where that is undefined.
    fn evidence_at_mode(&self) -> f64 {
        let mut evidence = self.log_posterior();
        for (c, logit) in self.logits.iter().enumerate() {
            match self.information(c).cholesky() {
                Some(factor) => {
                    let prior: f64 = logit.precisions.iter().map(|a| a.ln()).sum();
                    evidence += 0.5 * (prior - factor.log_determinant());
                }
                None => return f64::NEG_INFINITY,
            }
        }
        evidence
    }
}

impl Logit {
    fn set_values(&mut self, design: &Design) {
        self.values = vec![0.0; design.n_samples()];
        for (&basis, &weight) in self.active.iter().zip(&self.mean) {
            add_scaled(&mut self.values, weight, design.column(basis));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Inputs, Kernel, RvmConfig};

    /// Three overlapping classes along a line, 90 samples.
    fn labels() -> Vec<Vec<f64>> {
        let share = |class: usize, i: usize| if (i / 20).min(2) == class { 0.8 } else { 0.1 };
        (0..3).map(|class| (0..90).map(|i| share(class, i)).collect()).collect()
    }

    /// With weight `i` of function `c` moved.
    fn moved<'a>(posterior: &Posterior<'a>, c: usize, i: usize, by: f64) -> Posterior<'a> {
        let mut moved = posterior.clone();
        moved.logits[c].mean[i] += by;
        moved.logits[c].set_values(posterior.labels.design);
        moved
    }

    #[test]
    fn the_gradient_of_the_log_posterior_is_that_of_its_differences_and_vanishes_at_the_mode() {
        let x = (0..90).map(|i| f64::from(i) * 0.05);
        let design = Design::new(Kernel::gaussian(1, 1.0).unwrap(), Inputs::from_rows(1, x).unwrap());
        let labels = labels();
        let labels = Labels::new(&design, &labels, Labels::weights(&labels));
        let mut posterior = Posterior::new(&labels);
        posterior.climb(&RvmParams::new(RvmConfig::default()).unwrap());
        for c in 0..3 {
            assert!(!posterior.logits[c].active.is_empty());
            for i in 0..posterior.logits[c].active.len() {
                let off = moved(&posterior, c, i, 0.3);
                let [low, high] = [-1e-4, 1e-4].map(|by| moved(&off, c, i, by).log_posterior());
                let (slope, difference) = (off.gradient(c)[i], (high - low) / 2e-4);
                assert!((slope - difference).abs() < 1e-5 * slope.abs().max(1.0), "{slope} and {difference}");
                assert!(off.log_posterior() < posterior.log_posterior());
            }
            // The mode of each function given the others, to the tolerance of the search.
            let mut at_mode = posterior.clone();
            at_mode.find_mode(c);
            assert!(at_mode.gradient(c).iter().all(|slope| slope.abs() < 1e-3), "{:?}", at_mode.gradient(c));
        }
    }
}
