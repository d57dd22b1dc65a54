//! Learning from one input at a time, with one output or several, when the training samples are long gone.
//!
//! The posterior of the weights is all that is left of the samples, and it is enough: ΦᵀWΦ = Σ⁻¹ − A and ΦᵀWt = Σ⁻¹μ. An
//! example adds its own share to both, exactly; then the steps of `[Tipping2003]` go on as in a fit. One candidate is new:
//! a kernel on the example. What the old samples say about it is taken from the few that are remembered one by one
//! ([`Memory`](super::Memory)): there it is split into the combination of present kernels nearest to it, of which all samples have
//! spoken, and a rest. So a kernel where the model is settled brings nothing new, one that would disturb settled
//! samples pays for it, and several examples that agree bring in what each alone has not the evidence for.

use super::memory::Recollection;
use super::sequential::{Action, Noise, Sequential};
use super::{LARGEST, Remembered, Rvm, RvmClassifier, RvmParams, SparseFunction};
use crate::design::Products;
use crate::linalg::{Symmetric, add_scaled, dot, log_sum_exp};
use crate::{Answer, Expert, Gate, Inputs, OnlineUpdate, UpdateError, UpdateReport};

/// Most changes of bases that one example may cause in one function.
const STEPS_PER_EXAMPLE: usize = 10;
/// Stand-ins for bases until the table of centres is settled.
const NEW_CENTRE: usize = usize::MAX - 1;
const BIAS: usize = usize::MAX;
/// Part of a sample's weight added to the products of kernels, which are nearly dependent where centres crowd.
const RIDGE: f64 = 1e-6;
/// Gain in log evidence over the weight of all samples, beyond what the misfit of the new one costs, above which an update is no
/// news but lost digits: a single input cannot make every other sample so much more likely. Seen where functions keep centres
/// instead of samples, which are nearly dependent.
const MOST_GAIN_A_SAMPLE: f64 = 1.0;
/// Rounds that settle where a class function is linearised.
const LINEARISATIONS: usize = 3;

/// Checks an input and the outputs that come with it; shared by all models.
pub(crate) fn check_answers(
    x: &[f64],
    input_dim: usize,
    answers: &[Answer<'_>],
    output_dim: usize,
) -> Result<(), UpdateError> {
    let check_finite =
        |field, values: &[f64]| match values.iter().position(|v| v.is_nan() || v.abs() > LARGEST) {
            Some(index) => Err(UpdateError::NotFinite { field, index, value: values[index] }),
            None => Ok(()),
        };
    if x.len() != input_dim {
        return Err(UpdateError::InputDim { found: x.len(), expected: input_dim });
    }
    check_finite("x", x)?;
    for &Answer { y, responsibility } in answers {
        if y.len() != output_dim {
            return Err(UpdateError::OutputDim { found: y.len(), expected: output_dim });
        }
        check_finite("y", y)?;
        if !(responsibility > 0.0 && responsibility <= 1.0) {
            return Err(UpdateError::Responsibility { value: responsibility });
        }
    }
    Ok(())
}

/// An example as one function sees it.
struct Example<'a> {
    /// All kernels of the model at the input, then 1 for the bias.
    features: &'a [f64],
    /// Its precision in units of the noise (the weight, or the curvature of a class function), and that times target.
    own: Remembered,
    /// Precision times squared target.
    energy: f64,
}

/// ΦᵀWΦ written out.
struct Statistics {
    columns: Vec<Vec<f64>>,
    squares: Vec<f64>,
}

impl Products for Statistics {
    fn squares(&self) -> &[f64] {
        &self.squares
    }

    fn product(&self, basis: usize) -> &[f64] {
        &self.columns[basis]
    }
}

/// A sparse function among the centres of its model.
struct Place<'a> {
    n_centres: usize,
    function: &'a SparseFunction,
    /// The samples kept one by one, and all kernels there.
    remembered: &'a [Remembered],
    recollection: &'a Recollection,
    /// Whether the noise variance is learnt, too.
    learns_noise: bool,
}

impl Place<'_> {
    /// The function after the example, its bases as numbers of centres, [`NEW_CENTRE`] or [`BIAS`].
    ///
    /// `None` when numbers run out of range: the caller keeps what it has.
    fn absorb(&self, example: &Example<'_>, steps: usize) -> Option<(SparseFunction, UpdateReport)> {
        let function = self.function;
        let n = function.bases.len();
        let information = function.covariance.cholesky()?.inverse();
        let own: Vec<f64> = function.bases.iter().map(|&basis| example.features[basis]).collect();
        let old = Symmetric::from_fn(n, |i, j| {
            information.row(i)[j] - if i == j { function.precisions[i] } else { 0.0 }
        });
        let mut products = information.times(&function.mean);
        let Remembered { precision, weighted_target } = example.own;
        let total_weight = function.total_weight + precision;
        let (noise, energy) = if self.learns_noise {
            let remaining = function.noise_variance * function.total_weight;
            (Noise::Estimated { total_weight }, remaining + dot(&products, &function.mean) + example.energy)
        } else {
            (Noise::Known { precision: 1.0 }, 0.0)
        };

        let fitted = dot(&own, &function.mean);
        let misfit = example.energy - 2.0 * weighted_target * fitted + precision * fitted * fitted;
        let misfit_nats =
            0.5 * misfit.max(0.0) / if self.learns_noise { function.noise_variance } else { 1.0 };

        // The candidate, last: a combination `share` of the function's kernels and a rest at the remembered samples.
        let (share, rest) = self.combination()?;
        let seen = old.times(&share);
        let mut columns: Vec<Vec<f64>> = (0..n).map(|i| old.row(i).to_vec()).collect();
        columns.iter_mut().zip(&seen).for_each(|(column, s)| column.push(*s));
        let mut last = seen.clone();
        let rests = || self.remembered.iter().zip(&rest);
        last.push(dot(&share, &seen) + rests().map(|(sample, r)| sample.precision * r * r).sum::<f64>());
        columns.push(last);
        products.push(dot(&share, &products) + rests().map(|(s, r)| s.weighted_target * r).sum::<f64>());
        let mut own_and_new = own;
        own_and_new.push(1.0);
        for (column, value) in columns.iter_mut().zip(&own_and_new) {
            add_scaled(column, precision * value, &own_and_new);
        }
        add_scaled(&mut products, weighted_target, &own_and_new);

        let squares = columns.iter().enumerate().map(|(i, column)| column[i]).collect();
        let statistics = Statistics { columns, squares };
        let active: Vec<usize> = (0..n).collect();
        let mut model = Sequential::new(&statistics, noise, products, energy, 0.0)
            .with_bases(&active, &function.precisions);
        let before = model.log_evidence();
        let mut report = UpdateReport::default();
        let params = RvmParams::default();
        for _ in 0..steps {
            let Some((action, _)) = model.best_action(&params).filter(|&(_, gain)| gain >= params.min_gain)
            else {
                break;
            };
            match action {
                Action::Add { .. } => report.added += 1,
                Action::Reestimate { .. } => report.reestimated += 1,
                Action::Delete { .. } => report.deleted += 1,
            }
            model.apply(action);
        }
        model.refresh();
        report.log_evidence_gain = (model.log_evidence() - before).max(0.0);
        let is_sound = model.noise_variance() > 0.0
            && model.mean().iter().chain(model.precisions()).all(|v| v.is_finite())
            && model.log_evidence().is_finite()
            && report.log_evidence_gain <= MOST_GAIN_A_SAMPLE * total_weight + misfit_nats;
        let number = |&at: &usize| match function.bases.get(at) {
            Some(&basis) if basis == self.n_centres => BIAS,
            Some(&basis) => basis,
            None => NEW_CENTRE,
        };
        is_sound.then(|| {
            let updated = SparseFunction {
                bases: model.active().iter().map(number).collect(),
                precisions: model.precisions().to_vec(),
                mean: model.mean().to_vec(),
                covariance: model.covariance().clone(),
                noise_variance: model.noise_variance(),
                log_evidence: model.log_evidence(),
                total_weight,
            };
            (updated, report)
        })
    }

    /// The combination of the function's bases nearest to a kernel on the example, and what it leaves of that kernel,
    /// both at the remembered samples.
    fn combination(&self) -> Option<(Vec<f64>, Vec<f64>)> {
        let bases = &self.function.bases;
        let own = |features: &Vec<f64>| bases.iter().map(|&basis| features[basis]).collect::<Vec<f64>>();
        let rows: Vec<Vec<f64>> = self.recollection.features.iter().map(own).collect();
        let total: f64 = self.remembered.iter().map(|sample| sample.precision).sum();
        let mut gram =
            Symmetric::from_fn(bases.len(), |i, j| if i == j { RIDGE * total.max(1e-6) } else { 0.0 });
        let mut products = vec![0.0; bases.len()];
        for ((row, sample), new) in rows.iter().zip(self.remembered).zip(&self.recollection.new) {
            gram.add_outer(sample.precision, row);
            add_scaled(&mut products, sample.precision * new, row);
        }
        let share = gram.cholesky()?.solve(&products);
        let rest = rows.iter().zip(&self.recollection.new).map(|(row, new)| new - dot(row, &share)).collect();
        Some((share, rest))
    }
}

/// Brings a new centre in if some function uses it, and drops the centres that none uses any more.
fn settle(centres: &mut Inputs, functions: &mut [SparseFunction], x: &[f64]) {
    let new = centres.len();
    let mut used: Vec<usize> = functions
        .iter()
        .flat_map(|function| function.bases.iter())
        .filter(|&&basis| basis != BIAS)
        .map(|&basis| basis.min(new))
        .collect();
    used.sort_unstable();
    used.dedup();
    let mut all = centres.clone();
    all.push(x);
    *centres = all.select(&used);
    for basis in functions.iter_mut().flat_map(|function| function.bases.iter_mut()) {
        // BIAS is beyond all centres, as the search says.
        *basis = if *basis == BIAS {
            used.len()
        } else {
            used.binary_search(&(*basis).min(new)).unwrap_or(used.len())
        };
    }
}

/// The stand-ins of a function that does not change.
fn unchanged(function: &SparseFunction, n_centres: usize) -> SparseFunction {
    let bases = function.bases.iter().map(|&basis| if basis == n_centres { BIAS } else { basis }).collect();
    SparseFunction { bases, ..function.clone() }
}

impl Rvm {
    /// Answers of length [`output_dim`](Expert::output_dim); nothing for none.
    fn absorb(&mut self, x: &[f64], answers: &[Answer<'_>], steps: usize) -> UpdateReport {
        if answers.is_empty() {
            return UpdateReport::default();
        }
        let features = self.features(x);
        let recollection = self.memory.recall(&self.kernel, &self.centres, x);
        let n_centres = self.centres.len();
        let mut report = UpdateReport::default();
        let mut functions: Vec<SparseFunction> = Vec::with_capacity(self.outputs.len());
        // Several answers to one input are one example: of their total weight, at their mean, with their scatter as noise.
        let sum = |f: &dyn Fn(&Answer<'_>) -> f64| answers.iter().map(f).sum::<f64>();
        let precision = sum(&|a| a.responsibility);
        let weighted_targets = (0..self.outputs.len()).map(|d| sum(&|a| a.responsibility * a.y[d]));
        let parts: Vec<Remembered> =
            weighted_targets.map(|weighted_target| Remembered { precision, weighted_target }).collect();
        for (d, function) in self.outputs.iter().enumerate() {
            let remembered = &self.memory.parts[d];
            let place =
                Place { n_centres, function, remembered, recollection: &recollection, learns_noise: true };
            let energy = sum(&|a| a.responsibility * a.y[d] * a.y[d]);
            let example = Example { features: &features, own: parts[d], energy };
            match place.absorb(&example, steps) {
                Some((updated, change)) => {
                    functions.push(updated);
                    report += change;
                }
                None => functions.push(unchanged(function, n_centres)),
            }
        }
        settle(&mut self.centres, &mut functions, x);
        self.outputs = functions;
        self.memory.remember(x, &recollection, &parts);
        report
    }
}

impl OnlineUpdate for Rvm {
    fn update_all(&mut self, x: &[f64], answers: &[Answer<'_>]) -> Result<UpdateReport, UpdateError> {
        check_answers(x, self.input_dim(), answers, self.output_dim())?;
        Ok(self.absorb(x, answers, STEPS_PER_EXAMPLE))
    }
}

/// `y` holds the share of each class; they are divided by their sum.
impl OnlineUpdate for RvmClassifier {
    fn update_all(&mut self, x: &[f64], answers: &[Answer<'_>]) -> Result<UpdateReport, UpdateError> {
        check_answers(x, self.input_dim(), answers, self.n_classes)?;
        // Weight of all answers, and of those that each class has of it.
        let mut weight = 0.0;
        let mut class_weights = vec![0.0; self.n_classes];
        for &Answer { y, responsibility } in answers {
            if let Some(index) = y.iter().position(|&share| share < 0.0) {
                return Err(UpdateError::Share { index, value: y[index] });
            }
            let total: f64 = y.iter().sum();
            if total <= 0.0 {
                return Err(UpdateError::Share { index: 0, value: y[0] });
            }
            weight += responsibility;
            add_scaled(&mut class_weights, responsibility / total, y);
        }
        if answers.is_empty() {
            return Ok(UpdateReport::default());
        }
        let mut features = Vec::with_capacity(self.centres.len() + 1);
        self.kernel.at_centres(&self.centres, x, &mut features);
        features.push(1.0);
        let mut values: Vec<f64> = self.logits.iter().map(|logit| logit.mean_at(&features)).collect();
        values.resize(self.n_classes, 0.0);
        let recollection = self.memory.recall(&self.kernel, &self.centres, x);
        let n_centres = self.centres.len();
        let mut report = UpdateReport::default();
        let mut functions: Vec<SparseFunction> = Vec::with_capacity(self.logits.len());
        let mut parts = vec![Remembered::default(); self.logits.len()];
        for (c, function) in self.logits.iter().enumerate() {
            let remembered = &self.memory.parts[c];
            let place =
                Place { n_centres, function, remembered, recollection: &recollection, learns_noise: false };
            let mut outcome = None;
            // The mode with the example moves the point of linearisation, which moves the mode.
            for _ in 0..LINEARISATIONS {
                let g = (values[c] - log_sum_exp(&values)).exp();
                let precision = weight * (g * (1.0 - g)).max(1e-6);
                let weighted_target = precision * values[c] + class_weights[c] - weight * g;
                parts[c] = Remembered { precision, weighted_target };
                let example = Example { features: &features, own: parts[c], energy: 0.0 };
                outcome = place.absorb(&example, STEPS_PER_EXAMPLE);
                if let Some((updated, _)) = &outcome {
                    values[c] = value_at(updated, &features);
                }
            }
            match outcome {
                Some((updated, change)) => {
                    let log_evidence = function.log_evidence + change.log_evidence_gain;
                    functions.push(SparseFunction { log_evidence, ..updated });
                    report += change;
                }
                None => functions.push(unchanged(function, n_centres)),
            }
        }
        settle(&mut self.centres, &mut functions, x);
        self.logits = functions;
        self.memory.remember(x, &recollection, &parts);
        self.log_evidence += report.log_evidence_gain;
        Ok(report)
    }
}

/// The value of a function whose bases are stand-ins still; a kernel on the example is 1 there.
fn value_at(function: &SparseFunction, features: &[f64]) -> f64 {
    let parts = function.bases.iter().zip(&function.mean);
    parts.map(|(&basis, weight)| weight * features.get(basis).copied().unwrap_or(1.0)).sum()
}

#[cfg(test)]
mod tests;
