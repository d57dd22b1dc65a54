//! The particles of the frame being worked on, and room that is kept between frames.

use crate::exec::Exec;
use crate::observe::LayerStats;
use crate::schedule::Beta;
use crate::weights::{LogWeights, NormalizedWeights};

/// Particles of the current layer, all `[n_particles]`.
pub(super) struct Work<T> {
    pub states: Vec<T>,
    /// ln of the weight that each particle brings into the layer, before the likelihood.
    pub log_prior_weights: Vec<f64>,
    pub log_likelihoods: LogWeights,
    pub weights: NormalizedWeights,
    /// Indices into the layer before; for layer 0 into the frame before.
    pub parents: Vec<u32>,
    /// Indices into the frame before.
    pub ancestors: Vec<u32>,
    pub sources: Vec<u8>,
    /// Figures of the layers so far.
    pub layers: Vec<LayerStats>,
    /// Room for the particles of the next layer, or for moves that are yet to be accepted.
    pub next_states: Vec<T>,
    pub next_log_likelihoods: Vec<f64>,
    pub next_ancestors: Vec<u32>,
    pub next_sources: Vec<u8>,
    /// ln p(moved|x′) − ln p(unmoved|x′).
    pub log_motion_ratios: Vec<f64>,
    log_weights: LogWeights,
}

impl<T> Default for Work<T> {
    fn default() -> Self {
        Self {
            states: Vec::new(),
            log_prior_weights: Vec::new(),
            log_likelihoods: LogWeights::default(),
            weights: NormalizedWeights::default(),
            parents: Vec::new(),
            ancestors: Vec::new(),
            sources: Vec::new(),
            layers: Vec::new(),
            next_states: Vec::new(),
            next_log_likelihoods: Vec::new(),
            next_ancestors: Vec::new(),
            next_sources: Vec::new(),
            log_motion_ratios: Vec::new(),
            log_weights: LogWeights::default(),
        }
    }
}

impl<T: Clone + Send + Sync> Work<T> {
    /// Makes room for `n_particles`; `any` fills it until it is written over.
    pub fn resize(&mut self, n_particles: usize, any: &T) {
        self.states.resize_with(n_particles, || any.clone());
        self.log_prior_weights.resize(n_particles, 0.0);
        self.log_likelihoods.resize(n_particles);
        self.log_weights.resize(n_particles);
        self.parents.resize(n_particles, 0);
        self.sources.resize(n_particles, 0);
    }

    /// Weighs the layer by prior weight times likelihood^`exponent`. Returns ln of the sum of the weights, or `None`
    /// when every weight is zero.
    pub fn weigh(&mut self, exponent: f64) -> Option<f64> {
        self.set_log_weights(exponent);
        self.log_weights.normalize_into(&mut self.weights)
    }

    /// ln Σ prior weight times likelihood^`exponent`, the weights being left alone.
    pub fn log_sum(&mut self, exponent: f64) -> f64 {
        self.set_log_weights(exponent);
        self.log_weights.log_sum_exp()
    }

    fn set_log_weights(&mut self, exponent: f64) {
        let terms = self.log_prior_weights.iter().zip(self.log_likelihoods.as_slice());
        for (log_weight, (prior, log_likelihood)) in self.log_weights.as_mut_slice().iter_mut().zip(terms) {
            *log_weight = prior + scaled(exponent, *log_likelihood);
        }
    }

    /// Makes the particles that `parents` names the particles of the next layer, equally weighted.
    pub fn replace_by_parents(&mut self, exec: &Exec) {
        let Self { states, next_states, parents, .. } = self;
        next_states.resize_with(states.len(), || states[0].clone());
        exec.for_each(next_states, |i, next| next.clone_from(&states[parents[i] as usize]));
        std::mem::swap(states, next_states);
        take_from_parents(parents, &mut self.ancestors, &mut self.next_ancestors);
        take_from_parents(parents, &mut self.sources, &mut self.next_sources);
        self.next_log_likelihoods.clear();
        let log_likelihoods = self.log_likelihoods.as_mut_slice();
        self.next_log_likelihoods.extend(parents.iter().map(|&p| log_likelihoods[p as usize]));
        log_likelihoods.copy_from_slice(&self.next_log_likelihoods);
        let equal = -(parents.len() as f64).ln();
        self.log_prior_weights.fill(equal);
    }

    /// Notes the figures of the layer just weighed.
    pub fn note_layer(&mut self, layer: u32, beta: Beta, log_evidence: f64, acceptance: f64) {
        let unique_parents = count_distinct(&self.parents);
        let unique_ancestors = if layer == 0 { unique_parents } else { count_distinct(&self.ancestors) };
        self.layers.push(LayerStats {
            layer,
            beta,
            effective_sample_size: self.weights.effective_sample_size(),
            unique_parents,
            unique_ancestors,
            max_log_likelihood: self.log_likelihoods.max(),
            log_evidence,
            acceptance,
        });
    }
}

/// ln of likelihood^exponent; impossible stays impossible, also for exponent zero.
pub(super) fn scaled(exponent: f64, log_likelihood: f64) -> f64 {
    if log_likelihood == f64::NEG_INFINITY { log_likelihood } else { exponent * log_likelihood }
}

fn take_from_parents<A: Copy>(parents: &[u32], values: &mut Vec<A>, room: &mut Vec<A>) {
    room.clear();
    room.extend(parents.iter().map(|&p| values[p as usize]));
    std::mem::swap(values, room);
}

/// Number of distinct indices, which come in rising order.
fn count_distinct(indices: &[u32]) -> usize {
    1 + indices.windows(2).filter(|pair| pair[0] != pair[1]).count()
}
