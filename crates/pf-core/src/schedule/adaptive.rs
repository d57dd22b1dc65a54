//! Exponents that follow the effective sample size.

use super::{AnnealingSchedule, BadSchedule, Beta, DiffusionConfig};
use super::{check, check_diffusion, check_fraction, check_layers};
use crate::weights::LogWeights;

/// Settings of [`SurvivalRate`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurvivalRateConfig {
    /// Number of layers.
    pub layers: u32,
    /// Share of the particles that should survive resampling, between 0 and 1.
    pub survival_rate: f64,
    /// β never exceeds this, however alike the particles are.
    pub max_beta: f64,
    /// Noise between layers.
    pub diffusion: DiffusionConfig,
}

impl Default for SurvivalRateConfig {
    fn default() -> Self {
        Self { layers: 10, survival_rate: 0.5, max_beta: 1e4, diffusion: DiffusionConfig::default() }
    }
}

/// Each layer takes the exponent at which a given share of its particles survives.
///
/// `[Deutscher2005]`: the survival diagnostic is 1 / Σ w², the survival rate its share of the particles.
/// Deviation: the share is of the particles whose weight is not zero, for zeros stay zero under every exponent and
/// the asked-for rate might not exist (test `survival_rate_counts_possible_particles`).
#[derive(Clone, Copy, Debug)]
pub struct SurvivalRate(SurvivalRateConfig);

impl SurvivalRate {
    /// # Errors
    /// When a setting is out of range.
    pub fn new(config: SurvivalRateConfig) -> Result<Self, BadSchedule> {
        check_layers(config.layers)?;
        check_fraction("survival_rate", config.survival_rate)?;
        let max_beta_is_usable = config.max_beta > 0.0 && config.max_beta.is_finite();
        check("max_beta", config.max_beta, "a finite number above zero", max_beta_is_usable)?;
        check_diffusion(config.diffusion)?;
        Ok(Self(config))
    }
}

impl AnnealingSchedule for SurvivalRate {
    fn layers(&self) -> u32 {
        self.0.layers
    }

    fn beta(&self, _layer: u32, log_weights: &LogWeights) -> Beta {
        exponent_for_ess(log_weights, self.0.survival_rate, self.0.max_beta)
    }

    fn diffusion_scale(&self, layer: u32) -> f64 {
        self.0.diffusion.scale(layer)
    }
}

/// Settings of [`EssSchedule`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EssConfig {
    /// Number of layers, at most: the last one takes all that is left.
    pub max_layers: u32,
    /// Effective sample size after a step over the number of particles, between 0 and 1.
    pub ess_fraction: f64,
    /// Noise between layers.
    pub diffusion: DiffusionConfig,
}

impl Default for EssConfig {
    fn default() -> Self {
        Self { max_layers: 50, ess_fraction: 0.5, diffusion: DiffusionConfig::default() }
    }
}

/// β rises to 1 in steps as large as the effective sample size allows; the frame ends where it arrives.
///
/// The steps are those of adaptive sequential Monte Carlo `[DelMoral2012]`: the weights of a step are
/// likelihood^(rise of β), and the rise is found by bisection.
#[derive(Clone, Copy, Debug)]
pub struct EssSchedule(EssConfig);

impl EssSchedule {
    /// # Errors
    /// When a setting is out of range.
    pub fn new(config: EssConfig) -> Result<Self, BadSchedule> {
        check_layers(config.max_layers)?;
        check_fraction("ess_fraction", config.ess_fraction)?;
        check_diffusion(config.diffusion)?;
        Ok(Self(config))
    }
}

impl AnnealingSchedule for EssSchedule {
    fn layers(&self) -> u32 {
        self.0.max_layers
    }

    fn beta(&self, layer: u32, log_weights: &LogWeights) -> Beta {
        self.beta_after(layer, Beta::ZERO, log_weights)
    }

    fn diffusion_scale(&self, layer: u32) -> f64 {
        self.0.diffusion.scale(layer)
    }

    fn beta_after(&self, layer: u32, previous: Beta, log_weights: &LogWeights) -> Beta {
        let left = (1.0 - previous.get()).max(0.0);
        if layer + 1 == self.0.max_layers {
            return Beta::ONE;
        }
        let rise = exponent_for_ess(log_weights, self.0.ess_fraction, left).get();
        if rise == left { Beta::ONE } else { Beta(previous.get() + rise) }
    }
}

/// The exponent in [0, `max`] that brings the effective sample size down to `fraction` of the possible particles;
/// `max` when even that exponent leaves more. Found by bisection: the size falls as the exponent grows.
fn exponent_for_ess(log_weights: &LogWeights, fraction: f64, max: f64) -> Beta {
    /// Relative width at which the bracket is narrow enough: the exponent need not be better than this.
    const TOLERANCE: f64 = 1e-9;
    let target = fraction * log_weights.n_possible() as f64;
    let too_flat = |beta: f64| log_weights.effective_sample_size(Beta(beta)) > target;
    if too_flat(max) {
        return Beta(max);
    }
    let (mut low, mut high) = (0.0, max);
    while high - low > TOLERANCE * high {
        let middle = 0.5 * (low + high);
        if too_flat(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    Beta(high)
}
