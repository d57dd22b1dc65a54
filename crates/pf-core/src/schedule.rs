//! The exponent β of each annealing layer, and how far particles are spread after it.

use crate::weights::LogWeights;

/// An exponent of the likelihood: finite and not negative.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Beta(f64);

/// A number that is no exponent.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("an exponent is {0}, expected a finite number of zero or more")]
pub struct BadBeta(pub f64);

impl Beta {
    /// The prior alone.
    pub const ZERO: Self = Self(0.0);
    /// The likelihood as it is.
    pub const ONE: Self = Self(1.0);

    /// # Errors
    /// When `value` is negative, infinite or NaN.
    pub fn new(value: f64) -> Result<Self, BadBeta> {
        if value >= 0.0 && value.is_finite() {
            Ok(Self(value))
        } else {
            Err(BadBeta(value))
        }
    }

    /// The exponent.
    pub fn get(self) -> f64 {
        self.0
    }
}

/// How sharply each layer weighs and how far it spreads.
///
/// # Laws
/// - `beta` depends on its arguments alone.
/// - Adding one constant to all log weights does not change `beta`.
/// - `diffusion_scale` is finite and not negative for every layer below `layers()`.
pub trait AnnealingSchedule {
    /// Number of layers a frame, at most; one or more.
    fn layers(&self) -> u32;
    /// The exponent of `layer`, seen the weights before annealing.
    fn beta(&self, layer: u32, log_weights: &LogWeights) -> Beta;
    /// Factor on the standard deviation of the noise between `layer` and the next.
    fn diffusion_scale(&self, layer: u32) -> f64;
    /// As [`beta`](Self::beta), for schedules that need to know where the layer before left off.
    fn beta_after(&self, layer: u32, _previous: Beta, log_weights: &LogWeights) -> Beta {
        self.beta(layer, log_weights)
    }
}

/// Noise that shrinks by a constant ratio a layer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiffusionConfig {
    /// Scale after layer 0.
    pub first: f64,
    /// Scale of a layer over that of the layer before.
    pub ratio: f64,
}

impl Default for DiffusionConfig {
    /// Twice the noise of the motion first, a fifth less each layer.
    fn default() -> Self {
        Self {
            first: 2.0,
            ratio: 0.8,
        }
    }
}

impl DiffusionConfig {
    fn scale(self, layer: u32) -> f64 {
        self.first * self.ratio.powf(f64::from(layer))
    }
}

/// Layers of a frame, at most.
pub const MAX_LAYERS: u32 = 256;

/// Why a schedule cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BadSchedule {
    /// No layer, or too many.
    #[error("`layers` is {0}, expected 1 to {max}", max = MAX_LAYERS)]
    Layers(u32),
    /// A setting is out of range.
    #[error("`{field}` is {value}, expected {expected}")]
    OutOfRange {
        /// Name of the setting.
        field: &'static str,
        /// Its value.
        value: f64,
        /// What it may be.
        expected: &'static str,
    },
}

fn check_layers(layers: u32) -> Result<(), BadSchedule> {
    if (1..=MAX_LAYERS).contains(&layers) {
        Ok(())
    } else {
        Err(BadSchedule::Layers(layers))
    }
}

fn check(field: &'static str, value: f64, expected: &'static str, holds: bool) -> Result<(), BadSchedule> {
    if holds {
        Ok(())
    } else {
        Err(BadSchedule::OutOfRange {
            field,
            value,
            expected,
        })
    }
}

fn check_fraction(field: &'static str, value: f64) -> Result<(), BadSchedule> {
    check(
        field,
        value,
        "a number above 0 and below 1",
        value > 0.0 && value < 1.0,
    )
}

fn check_diffusion(diffusion: DiffusionConfig) -> Result<(), BadSchedule> {
    let usable = |x: f64| x >= 0.0 && x.is_finite();
    let expected = "a finite number of zero or more";
    check(
        "diffusion.first",
        diffusion.first,
        expected,
        usable(diffusion.first),
    )?;
    check(
        "diffusion.ratio",
        diffusion.ratio,
        expected,
        usable(diffusion.ratio),
    )
}

/// Settings of [`Geometric`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeometricConfig {
    /// Number of layers.
    pub layers: u32,
    /// β of layer 0.
    pub first_beta: f64,
    /// β of the last layer (of the only one, when there is one).
    pub last_beta: f64,
    /// Noise between layers.
    pub diffusion: DiffusionConfig,
}

impl Default for GeometricConfig {
    fn default() -> Self {
        Self {
            layers: 10,
            first_beta: 0.05,
            last_beta: 1.0,
            diffusion: DiffusionConfig::default(),
        }
    }
}

/// Fixed exponents that grow by a constant ratio from the first layer to the last.
///
/// ```
/// use pf_core::schedule::{AnnealingSchedule, Geometric, GeometricConfig};
/// let schedule = Geometric::new(GeometricConfig { layers: 3, first_beta: 0.04, ..Default::default() })?;
/// let betas = [0, 1, 2].map(|layer| schedule.beta(layer, &Default::default()).get());
/// assert_eq!(betas, [0.04, 0.2, 1.0]);
/// # Ok::<(), pf_core::schedule::BadSchedule>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Geometric(GeometricConfig);

impl Geometric {
    /// # Errors
    /// When a setting is out of range.
    pub fn new(config: GeometricConfig) -> Result<Self, BadSchedule> {
        check_layers(config.layers)?;
        let positive = |x: f64| x > 0.0 && x.is_finite();
        check(
            "first_beta",
            config.first_beta,
            "a finite number above zero",
            positive(config.first_beta),
        )?;
        check(
            "last_beta",
            config.last_beta,
            "a finite number above zero",
            positive(config.last_beta),
        )?;
        check_diffusion(config.diffusion)?;
        Ok(Self(config))
    }

    /// One layer that takes the likelihood as it is.
    pub fn single() -> Self {
        Self(GeometricConfig {
            layers: 1,
            ..GeometricConfig::default()
        })
    }
}

impl AnnealingSchedule for Geometric {
    fn layers(&self) -> u32 {
        self.0.layers
    }

    fn beta(&self, layer: u32, _log_weights: &LogWeights) -> Beta {
        let layers_to_go = f64::from(self.0.layers - 1 - layer);
        let steps = f64::from((self.0.layers - 1).max(1));
        Beta(self.0.last_beta * (self.0.first_beta / self.0.last_beta).powf(layers_to_go / steps))
    }

    fn diffusion_scale(&self, layer: u32) -> f64 {
        self.0.diffusion.scale(layer)
    }
}

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
        Self {
            layers: 10,
            survival_rate: 0.5,
            max_beta: 1e4,
            diffusion: DiffusionConfig::default(),
        }
    }
}

/// Each layer takes the exponent at which a given share of its particles survives.
///
/// `[Deutscher2005]` section 3.2: the survival diagnostic is 1 / Σ w², the survival rate its share of the particles.
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
        check(
            "max_beta",
            config.max_beta,
            "a finite number above zero",
            max_beta_is_usable,
        )?;
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
        Self {
            max_layers: 50,
            ess_fraction: 0.5,
            diffusion: DiffusionConfig::default(),
        }
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
        if rise == left {
            Beta::ONE
        } else {
            Beta(previous.get() + rise)
        }
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
