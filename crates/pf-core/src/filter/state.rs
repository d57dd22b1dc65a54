//! Settings of a filter, and all that it remembers between frames.

use super::error::{BadFilterConfig, BadState, MAX_MOVES};
use crate::weights::{BadWeights, NormalizedWeights};

/// Settings of a filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilterConfig {
    /// Number of particles.
    pub n_particles: usize,
    /// Seed of all random numbers.
    pub seed: u64,
    /// The particles of a frame are resampled before the next one when their effective sample size is at most this
    /// share of their number: 1 for every frame, 0 for never. Between the layers of a frame they always are.
    pub resample_below: f64,
    /// Metropolis-Hastings moves between layers of a tempered filter.
    pub moves_per_layer: u32,
}

impl Default for FilterConfig {
    fn default() -> Self {
        Self { n_particles: 200, seed: 0, resample_below: 1.0, moves_per_layer: 1 }
    }
}

/// Checked settings of a filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilterParams(FilterConfig);

impl FilterParams {
    /// # Errors
    /// When a setting is out of range.
    pub fn new(config: FilterConfig) -> Result<Self, BadFilterConfig> {
        if config.n_particles == 0 || u32::try_from(config.n_particles).is_err() {
            return Err(BadFilterConfig::Particles(config.n_particles));
        }
        if !(config.resample_below >= 0.0 && config.resample_below <= 1.0) {
            return Err(BadFilterConfig::ResampleBelow(config.resample_below));
        }
        if !(1..=MAX_MOVES).contains(&config.moves_per_layer) {
            return Err(BadFilterConfig::Moves(config.moves_per_layer));
        }
        Ok(Self(config))
    }

    /// The settings.
    pub fn config(&self) -> &FilterConfig {
        &self.0
    }
}

/// All that a filter remembers between frames, as plain data: a filter that gets it back goes on bit for bit.
///
/// The settings, the state space, the proposal and the method are not in it. Feature `serde` writes and reads it;
/// use a format that keeps `f64` exactly.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct FilterState<T> {
    /// Number of the next frame.
    pub frame: u64,
    /// The particles.
    pub particles: Vec<T>,
    /// Their weights, summing to one, `[n_particles]`.
    pub weights: Vec<f64>,
    /// Posterior weight of each source of the proposal in the last frame, `[n_sources]`; empty before the first.
    pub source_shares: Vec<f64>,
    /// ln p(all frames so far), lost ones left out.
    pub log_evidence: f64,
}

impl<T> FilterState<T> {
    /// Equally weighted particles before the first frame.
    pub fn from_particles(particles: Vec<T>) -> Self {
        let weights = vec![1.0 / particles.len() as f64; particles.len()];
        Self { frame: 0, particles, weights, source_shares: Vec::new(), log_evidence: 0.0 }
    }

    pub(super) fn check(&self) -> Result<(), BadState> {
        let (particles, weights) = (self.particles.len(), self.weights.len());
        if particles == 0 {
            return Err(BadState::Empty);
        }
        if u32::try_from(particles).is_err() {
            return Err(BadState::TooMany(particles));
        }
        if particles != weights {
            return Err(BadState::Lengths { particles, weights });
        }
        /// More than rounding leaves after dividing by the sum, whatever the number of particles.
        const TOLERANCE: f64 = 1e-6;
        let sum: f64 = self.weights.iter().sum();
        NormalizedWeights::check(&self.weights)
            .and(if (sum - 1.0).abs() <= TOLERANCE { Ok(()) } else { Err(BadWeights::Sum { sum }) })
            .map_err(|source| BadState::Weights { source })
    }
}
