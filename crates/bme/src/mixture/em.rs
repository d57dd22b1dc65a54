//! Expectation maximisation of a mixture of experts (`[Jordan1994]`, `[Kanaujia2007]`).

use rayon::prelude::*;

use super::{MixtureOfExperts, MixtureParams};
use crate::design::WeightedDesign;
use crate::kmeans::Clusters;
use crate::linalg::{add_scaled, log_sum_exp, shares};
use crate::rvm::laplace::{Labels, Posterior};
use crate::rvm::{SparseFit, check_samples, fit_output};
use crate::{Design, FitError, Inputs, Rvm, RvmClassifier};

/// Share of a sample that the expert of its cluster has at first.
const FIRST_SHARE: f64 = 0.9;
/// Responsibilities below this are none: the sample costs nothing.
const LEAST_RESPONSIBILITY: f64 = 1e-6;

/// How the fit went.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EmReport {
    /// Mean log likelihood of a sample (nats) after each round.
    pub log_likelihood: Vec<f64>,
}

/// The experts and the gate in the numbering of the design.
struct State<'a> {
    experts: Vec<Vec<SparseFit>>,
    gate: Posterior<'a>,
}

pub(super) fn fit(
    design: &Design,
    targets: &[Vec<f64>],
    weights: &[f64],
    params: &MixtureParams,
) -> Result<(MixtureOfExperts, EmReport), FitError> {
    assert!(!targets.is_empty(), "no targets, expected at least one output");
    for target in targets {
        check_samples(design, target, weights)?;
    }
    let total_weight: f64 = weights.iter().sum();
    let mut responsibilities = first_responsibilities(targets, weights, params);
    let mut report = EmReport::default();
    let mut best: Option<MixtureOfExperts> = None;
    let mut experts: Option<Vec<Vec<SparseFit>>> = None;
    let mut gate_bases = Vec::new();
    for _ in 0..params.config.max_iterations {
        drop_starved(&mut responsibilities, &mut experts, &mut gate_bases, weights, params);
        let labels = Labels::new(design, &responsibilities, weights.to_vec());
        let state = maximise(&labels, targets, experts.as_deref(), &gate_bases, params);
        let (next, log_likelihood) = expectation(&state, design, targets, weights);
        let mean = log_likelihood / total_weight;
        let gain = report.log_likelihood.last().map_or(f64::INFINITY, |last| mean - last);
        if gain < 0.0 {
            break;
        }
        report.log_likelihood.push(mean);
        best = Some(MixtureOfExperts {
            gate: RvmClassifier::from_posterior(design, &labels, &state.gate),
            experts: state
                .experts
                .iter()
                .zip(&responsibilities)
                .map(|(fits, weights)| Rvm::from_fits(design, fits, weights))
                .collect(),
        });
        gate_bases = state.gate.start();
        experts = Some(state.experts);
        responsibilities = next;
        if gain < params.config.min_gain {
            break;
        }
    }
    let model = best.expect("the first round always gains");
    Ok((model, report))
}

/// Most of a sample goes to the expert of its cluster of targets, which are compared in standard deviations.
fn first_responsibilities(targets: &[Vec<f64>], weights: &[f64], params: &MixtureParams) -> Vec<Vec<f64>> {
    let n = weights.len();
    let scales: Vec<f64> = targets
        .iter()
        .map(|target| {
            let mean = target.iter().sum::<f64>() / n as f64;
            let variance = target.iter().map(|t| (t - mean).powi(2)).sum::<f64>() / n as f64;
            if variance > 0.0 { variance.sqrt() } else { 1.0 }
        })
        .collect();
    let rows = (0..n).flat_map(|i| targets.iter().zip(&scales).map(move |(t, scale)| t[i] / scale));
    let rows = Inputs::from_rows(targets.len(), rows).expect("the targets are finite and come in whole rows");
    let clusters = Clusters::new(&rows, params.config.n_experts, params.config.seed);
    let n_experts = clusters.centres.len();
    let others = if n_experts > 1 { (1.0 - FIRST_SHARE) / (n_experts - 1) as f64 } else { 0.0 };
    let own = if n_experts > 1 { FIRST_SHARE } else { 1.0 };
    (0..n_experts)
        .map(|k| {
            (0..n).map(|i| weights[i] * if clusters.assignment[i] == k { own } else { others }).collect()
        })
        .collect()
}

/// Takes experts out that have lost their samples, and shares what was left of those among the others.
fn drop_starved(
    responsibilities: &mut Vec<Vec<f64>>,
    experts: &mut Option<Vec<Vec<SparseFit>>>,
    gate_bases: &mut Vec<(Vec<usize>, Vec<f64>)>,
    weights: &[f64],
    params: &MixtureParams,
) {
    let totals: Vec<f64> = responsibilities.iter().map(|r| r.iter().sum()).collect();
    let largest = totals.iter().copied().fold(0.0, f64::max);
    let least = params.config.min_expert_weight.min(largest);
    let keep: Vec<bool> = totals.iter().map(|&total| total >= least).collect();
    if keep.iter().all(|&k| k) {
        return;
    }
    let retain = |k: &mut std::slice::Iter<'_, bool>| *k.next().expect("one flag an expert");
    let mut flags = keep.iter();
    responsibilities.retain(|_| retain(&mut flags));
    if let Some(experts) = experts {
        let mut flags = keep.iter();
        experts.retain(|_| retain(&mut flags));
    }
    // Another number of functions: the gate starts anew.
    gate_bases.clear();
    for (i, &weight) in weights.iter().enumerate() {
        let left: f64 = responsibilities.iter().map(|r| r[i]).sum();
        let n_experts = responsibilities.len() as f64;
        for r in responsibilities.iter_mut() {
            r[i] = if left > 0.0 { r[i] * weight / left } else { weight / n_experts };
        }
    }
}

/// Fits each expert to its share of the samples, and the gate to the shares; goes on from the bases there are.
fn maximise<'a>(
    labels: &'a Labels<'a>,
    targets: &[Vec<f64>],
    previous: Option<&[Vec<SparseFit>]>,
    gate_bases: &[(Vec<usize>, Vec<f64>)],
    params: &MixtureParams,
) -> State<'a> {
    let design = labels.design();
    let experts = labels
        .classes()
        .par_iter()
        .enumerate()
        .map(|(k, responsibility)| {
            let share =
                responsibility.iter().map(|&r| if r < LEAST_RESPONSIBILITY { 0.0 } else { r }).collect();
            let weighted = WeightedDesign::new(design, share);
            let fits = targets.iter().enumerate().map(|(d, target)| {
                let start = previous.map(|experts| &experts[k][d]);
                fit_output(&weighted, target, &params.expert, start)
            });
            fits.collect()
        })
        .collect();
    let mut gate = Posterior::with_bases(labels, gate_bases);
    gate.climb(&params.gate);
    State { experts, gate }
}

/// The responsibilities (times the sample weights) and the log likelihood.
fn expectation(
    state: &State<'_>,
    design: &Design,
    targets: &[Vec<f64>],
    weights: &[f64],
) -> (Vec<Vec<f64>>, f64) {
    let log_densities: Vec<Vec<f64>> = state
        .experts
        .par_iter()
        .map(|fits| {
            let mut sum = vec![0.0; weights.len()];
            for (fit, target) in fits.iter().zip(targets) {
                add_scaled(&mut sum, 1.0, &fit.log_densities(design, target));
            }
            sum
        })
        .collect();
    let n_experts = state.experts.len();
    let mut responsibilities = vec![vec![0.0; weights.len()]; n_experts];
    let mut joint = vec![0.0; n_experts];
    let mut log_likelihood = 0.0;
    for (i, &weight) in weights.iter().enumerate() {
        state.gate.log_gates(i, &mut joint);
        joint.iter_mut().zip(&log_densities).for_each(|(joint, density)| *joint += density[i]);
        for (r, share) in responsibilities.iter_mut().zip(shares(&joint)) {
            r[i] = weight * share;
        }
        if weight > 0.0 {
            log_likelihood += weight * log_sum_exp(&joint);
        }
    }
    (responsibilities, log_likelihood)
}
