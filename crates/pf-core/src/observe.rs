//! Looking on: what a layer and a frame show to observers and callers.

use crate::schedule::Beta;
use crate::space::StateSpace;
use crate::weights::NormalizedWeights;

/// Figures of one layer, taken before it is resampled.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct LayerStats {
    /// Which layer, from 0.
    pub layer: u32,
    /// Exponent of the likelihood.
    pub beta: Beta,
    /// Effective sample size of the layer's weights.
    pub effective_sample_size: f64,
    /// Distinct particles among the parents of this layer's particles: of the layer before, for layer 0 of the frame before.
    pub unique_parents: usize,
    /// Distinct particles of the frame before that have a descendant here.
    pub unique_ancestors: usize,
    /// Largest ln p(frame|state) of the layer.
    pub max_log_likelihood: f64,
    /// What the layer adds to the log evidence of the frame.
    pub log_evidence: f64,
    /// Share of the moves that led here and were accepted; one where every move is.
    pub acceptance: f64,
}

/// A layer, weighed and not yet resampled.
#[derive(Debug)]
pub struct LayerView<'a, T> {
    /// Frame number, from 0.
    pub frame: u64,
    /// Figures of the layer.
    pub stats: &'a LayerStats,
    /// The particles, `[n_particles]`.
    pub states: &'a [T],
    /// ln p(frame|state), `[n_particles]`, before annealing.
    pub log_likelihoods: &'a [f64],
    /// Weights of the layer, `[n_particles]`.
    pub weights: &'a NormalizedWeights,
    /// For each particle its ancestor among the particles of the frame before, `[n_particles]`.
    pub ancestors: &'a [u32],
    /// For each particle the source of the proposal that its ancestor in layer 0 came from, `[n_particles]`.
    pub sources: &'a [u8],
}

/// The posterior of a frame: the weighted particles of its last layer.
#[derive(Debug)]
pub struct FrameView<'a, T> {
    /// Frame number, from 0.
    pub frame: u64,
    /// The particles, `[n_particles]`.
    pub states: &'a [T],
    /// Their weights, `[n_particles]`.
    pub weights: &'a NormalizedWeights,
    /// ln p(frame|state), `[n_particles]`.
    pub log_likelihoods: &'a [f64],
    /// For each particle its ancestor among the particles of the frame before, `[n_particles]`.
    pub ancestors: &'a [u32],
    /// Posterior weight of the descendants of each source of the proposal, `[n_sources]`.
    pub source_shares: &'a [f64],
    /// Figures of the layers, `[layers run]`.
    pub layers: &'a [LayerStats],
    /// ln p(frame|frames before): see the table at the top of the crate for what it is worth.
    pub log_evidence: f64,
}

impl<T> FrameView<'_, T> {
    /// The particle of the largest weight.
    pub fn heaviest(&self) -> &T {
        &self.states[self.weights.heaviest()]
    }

    /// The weighted mean, see [`weighted_mean`](crate::estimate::weighted_mean).
    pub fn mean<S: StateSpace<State = T>>(&self, space: &S) -> T {
        crate::estimate::weighted_mean(space, self.states, self.weights)
    }
}

/// Sees each layer and each frame, and steers nothing.
///
/// ```
/// use pf_core::{LayerView, Observer};
///
/// /// Keeps the smallest effective sample size.
/// struct Worst(f64);
/// impl<T> Observer<T> for Worst {
///     fn layer_done(&mut self, view: &LayerView<'_, T>) {
///         self.0 = self.0.min(view.stats.effective_sample_size);
///     }
/// }
/// ```
pub trait Observer<T> {
    /// After a layer is weighed.
    fn layer_done(&mut self, _view: &LayerView<'_, T>) {}
    /// After a frame is tracked; a lost frame has no posterior to show.
    fn frame_done(&mut self, _view: &FrameView<'_, T>) {}
}

/// Nobody looks.
impl<T> Observer<T> for () {}

/// Remembers who descends from whom.
#[derive(Clone, Debug, Default)]
pub struct Genealogy {
    ancestors: Vec<Vec<u32>>,
}

impl Genealogy {
    /// Number of frames seen.
    pub fn n_frames(&self) -> usize {
        self.ancestors.len()
    }

    /// The line of `particle` of the last frame: its index in each frame from the last one back, and at the end its
    /// index among the particles before the first frame.
    pub fn lineage(&self, particle: u32) -> Vec<u32> {
        let mut line = vec![particle];
        let mut index = particle;
        for ancestors in self.ancestors.iter().rev() {
            index = ancestors[index as usize];
            line.push(index);
        }
        line
    }
}

impl<T> Observer<T> for Genealogy {
    fn frame_done(&mut self, view: &FrameView<'_, T>) {
        self.ancestors.push(view.ancestors.to_vec());
    }
}
