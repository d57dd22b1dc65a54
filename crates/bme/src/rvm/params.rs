//! Settings of a fit.

/// Open settings of a relevance vector machine; [`RvmParams::new`] checks them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RvmConfig {
    /// Stop when no step gains this much log evidence (nats).
    pub min_gain: f64,
    /// Let a new basis in only when it gains this much log evidence (nats): the price of a vector.
    pub min_gain_of_addition: f64,
    /// Noise variance to begin with, as a fraction of the targets' variance.
    pub initial_noise: f64,
    /// Most bases an output may have, the bias included.
    pub max_bases: usize,
    /// Most steps of one fit.
    pub max_steps: usize,
    /// Variance that noise has at least, as a fraction of the targets' variance: keeps noise-free data from σ² = 0.
    pub noise_floor: f64,
    /// Steps by rank-one updates between two exact recomputations.
    pub refresh_every: usize,
}

impl Default for RvmConfig {
    fn default() -> Self {
        Self {
            min_gain: 1e-3,
            min_gain_of_addition: 0.15,
            initial_noise: 0.01,
            max_bases: 1_000,
            max_steps: 20_000,
            noise_floor: 1e-6,
            refresh_every: 64,
        }
    }
}

/// Checked settings of a relevance vector machine.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct RvmParams(RvmConfig);

/// Which setting is wrong.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RvmConfigError {
    /// A number that has to be positive.
    #[error("`{field}` is {value}, expected a number above 0")]
    NotPositive {
        /// Which setting.
        field: &'static str,
        /// What it is.
        value: f64,
    },
    /// A count that has to be at least one.
    #[error("`{field}` is 0, expected at least 1")]
    Zero {
        /// Which setting.
        field: &'static str,
    },
}

impl RvmParams {
    /// Checks the settings.
    ///
    /// # Errors
    /// Names the first setting that makes no sense.
    pub fn new(config: RvmConfig) -> Result<Self, RvmConfigError> {
        for (field, value) in [
            ("min_gain", config.min_gain),
            ("min_gain_of_addition", config.min_gain_of_addition),
            ("initial_noise", config.initial_noise),
            ("noise_floor", config.noise_floor),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(RvmConfigError::NotPositive { field, value });
            }
        }
        for (field, value) in [
            ("max_bases", config.max_bases),
            ("max_steps", config.max_steps),
            ("refresh_every", config.refresh_every),
        ] {
            if value == 0 {
                return Err(RvmConfigError::Zero { field });
            }
        }
        Ok(Self(config))
    }
}

impl std::ops::Deref for RvmParams {
    type Target = RvmConfig;

    fn deref(&self) -> &RvmConfig {
        &self.0
    }
}
