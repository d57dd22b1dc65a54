//! Exponents laid down beforehand.

use super::{AnnealingSchedule, BadSchedule, Beta, DiffusionConfig};
use super::{check, check_diffusion, check_layers};
use crate::weights::LogWeights;

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
        Self { layers: 10, first_beta: 0.05, last_beta: 1.0, diffusion: DiffusionConfig::default() }
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
        check("first_beta", config.first_beta, "a finite number above zero", positive(config.first_beta))?;
        check("last_beta", config.last_beta, "a finite number above zero", positive(config.last_beta))?;
        check_diffusion(config.diffusion)?;
        Ok(Self(config))
    }

    /// One layer that takes the likelihood as it is.
    pub fn single() -> Self {
        Self(GeometricConfig { layers: 1, ..GeometricConfig::default() })
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
