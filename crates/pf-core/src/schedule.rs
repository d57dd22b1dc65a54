//! The exponent β of each annealing layer, and how far particles are spread after it.

mod adaptive;
mod geometric;

use crate::weights::LogWeights;

pub use adaptive::{EssConfig, EssSchedule, SurvivalRate, SurvivalRateConfig};
pub use geometric::{Geometric, GeometricConfig};

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
        if value >= 0.0 && value.is_finite() { Ok(Self(value)) } else { Err(BadBeta(value)) }
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
        Self { first: 2.0, ratio: 0.8 }
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
    if (1..=MAX_LAYERS).contains(&layers) { Ok(()) } else { Err(BadSchedule::Layers(layers)) }
}

fn check(field: &'static str, value: f64, expected: &'static str, holds: bool) -> Result<(), BadSchedule> {
    if holds { Ok(()) } else { Err(BadSchedule::OutOfRange { field, value, expected }) }
}

fn check_fraction(field: &'static str, value: f64) -> Result<(), BadSchedule> {
    check(field, value, "a number above 0 and below 1", value > 0.0 && value < 1.0)
}

fn check_diffusion(diffusion: DiffusionConfig) -> Result<(), BadSchedule> {
    let usable = |x: f64| x >= 0.0 && x.is_finite();
    let expected = "a finite number of zero or more";
    check("diffusion.first", diffusion.first, expected, usable(diffusion.first))?;
    check("diffusion.ratio", diffusion.ratio, expected, usable(diffusion.ratio))
}

#[cfg(test)]
mod tests;
