//! A few samples that a model keeps one by one, to tell what the others say about a kernel that is not in it yet.

use super::SparseFunction;
use crate::{Design, Inputs, Kernel};

/// Samples kept of a fit, and most that are kept at all.
const SAMPLES_OF_FIT: usize = 96;
const MOST_SAMPLES: usize = 192;

/// What a function knows of a sample: how much it counts, and that times its target.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Remembered {
    pub(crate) precision: f64,
    pub(crate) weighted_target: f64,
}

/// Samples that stand for all: some of the fit, each for a share of it, and the latest examples, each for itself.
///
/// Targets of the fit's samples are what the fit made of them: their noise, counted for others' too, would pass for news.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Memory {
    pub(crate) inputs: Inputs,
    /// [function][sample].
    pub(crate) parts: Vec<Vec<Remembered>>,
}

/// The kernels of a model and a new one at every sample of a memory.
pub(crate) struct Recollection {
    /// [sample][centre], 1 for the bias at the end of each row.
    pub(crate) features: Vec<Vec<f64>>,
    /// The new kernel.
    pub(crate) new: Vec<f64>,
}

impl Memory {
    /// Samples at even distances among those that count; `samples[f][i]` is sample i for function f.
    pub(crate) fn of_fit(design: &Design, samples: &[Vec<Remembered>]) -> Self {
        let counts = |i: &usize| samples.iter().any(|samples| samples[*i].precision > 0.0);
        let all: Vec<usize> = (0..design.n_samples()).filter(counts).collect();
        let count = all.len().min(SAMPLES_OF_FIT);
        let kept: Vec<usize> = (0..count).map(|i| all[i * all.len() / count]).collect();
        let parts = samples.iter().map(|samples| {
            let total: f64 = samples.iter().map(|s| s.precision).sum();
            let own: f64 = kept.iter().map(|&i| samples[i].precision).sum();
            let scale = if own > 0.0 { total / own } else { 0.0 };
            let part = |&i: &usize| Remembered {
                precision: scale * samples[i].precision,
                weighted_target: scale * samples[i].weighted_target,
            };
            kept.iter().map(part).collect()
        });
        Self { parts: parts.collect(), inputs: design.inputs().select(&kept) }
    }

    /// Where no samples were kept: the centres, and what the functions say there.
    pub(crate) fn of_centres(kernel: &Kernel, centres: &Inputs, functions: &[SparseFunction]) -> Self {
        let mut memory = Self { inputs: centres.clone(), parts: vec![Vec::new(); functions.len()] };
        for centre in 0..centres.len() {
            let mut features = Vec::with_capacity(centres.len() + 1);
            kernel.at_centres(centres, &centres.row_f64(centre), &mut features);
            features.push(1.0);
            for (function, parts) in functions.iter().zip(&mut memory.parts) {
                let precision = function.total_weight / centres.len() as f64;
                let weighted_target = precision * function.mean_at(&features);
                parts.push(Remembered { precision, weighted_target });
            }
        }
        memory
    }

    pub(crate) fn recall(&self, kernel: &Kernel, centres: &Inputs, x: &[f64]) -> Recollection {
        let rows: Vec<Vec<f64>> = (0..self.inputs.len()).map(|i| self.inputs.row_f64(i)).collect();
        let features = |row: &Vec<f64>| {
            let mut features = Vec::with_capacity(centres.len() + 1);
            kernel.at_centres(centres, row, &mut features);
            features.push(1.0);
            features
        };
        Recollection {
            features: rows.iter().map(features).collect(),
            new: rows.iter().map(|row| kernel.value(row, x)).collect(),
        }
    }

    /// Keeps an example; in a full memory, the nearest sample counts for it, too.
    pub(crate) fn remember(&mut self, x: &[f64], recollection: &Recollection, parts: &[Remembered]) {
        if self.inputs.len() < MOST_SAMPLES {
            self.inputs.push(x);
            self.parts.iter_mut().zip(parts).for_each(|(samples, part)| samples.push(*part));
            return;
        }
        let nearest =
            (0..self.inputs.len()).max_by(|&a, &b| recollection.new[a].total_cmp(&recollection.new[b]));
        if let Some(nearest) = nearest {
            for (samples, part) in self.parts.iter_mut().zip(parts) {
                samples[nearest].precision += part.precision;
                samples[nearest].weighted_target += part.weighted_target;
            }
        }
    }
}
