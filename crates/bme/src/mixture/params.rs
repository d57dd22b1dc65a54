//! Settings of a mixture of experts.

use crate::{RvmConfig, RvmConfigError, RvmParams};

/// Open settings of a mixture; [`MixtureParams::new`] checks them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MixtureConfig {
    /// Experts to begin with.
    pub n_experts: usize,
    /// Most rounds of expectation and maximisation.
    pub max_iterations: usize,
    /// Stop when a round gains less log likelihood (nats per sample) than this.
    pub min_gain: f64,
    /// An expert with less sample weight than this is left out.
    pub min_expert_weight: f64,
    /// Seed of the first clusters.
    pub seed: u64,
    /// Settings of each expert's fit.
    pub expert: RvmConfig,
    /// Settings of the gate's fit; `max_steps` counts the steps of one round.
    pub gate: RvmConfig,
}

impl Default for MixtureConfig {
    fn default() -> Self {
        Self {
            n_experts: 5,
            max_iterations: 20,
            min_gain: 1e-3,
            min_expert_weight: 4.0,
            seed: 0,
            expert: RvmConfig { min_gain: 1e-2, max_bases: 200, ..RvmConfig::default() },
            gate: RvmConfig { min_gain: 1e-2, max_bases: 60, max_steps: 15, ..RvmConfig::default() },
        }
    }
}

/// Checked settings of a mixture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MixtureParams {
    pub(crate) config: MixtureConfig,
    pub(crate) expert: RvmParams,
    pub(crate) gate: RvmParams,
}

/// Which setting is wrong.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MixtureConfigError {
    /// A count that has to be at least one.
    #[error("`{field}` is 0, expected at least 1")]
    Zero {
        /// Which setting.
        field: &'static str,
    },
    /// A number out of range.
    #[error("`{field}` is {value}, expected a number above 0")]
    NotPositive {
        /// Which setting.
        field: &'static str,
        /// What it is.
        value: f64,
    },
    /// A setting of the experts.
    #[error("`expert` cannot be used")]
    Expert(#[source] RvmConfigError),
    /// A setting of the gate.
    #[error("`gate` cannot be used")]
    Gate(#[source] RvmConfigError),
}

impl MixtureParams {
    /// Checks the settings.
    ///
    /// # Errors
    /// Names the first setting that makes no sense.
    pub fn new(config: MixtureConfig) -> Result<Self, MixtureConfigError> {
        for (field, value) in [("n_experts", config.n_experts), ("max_iterations", config.max_iterations)] {
            if value == 0 {
                return Err(MixtureConfigError::Zero { field });
            }
        }
        for (field, value) in [("min_gain", config.min_gain), ("min_expert_weight", config.min_expert_weight)]
        {
            if !(value > 0.0 && value.is_finite()) {
                return Err(MixtureConfigError::NotPositive { field, value });
            }
        }
        Ok(Self {
            config,
            expert: RvmParams::new(config.expert).map_err(MixtureConfigError::Expert)?,
            gate: RvmParams::new(config.gate).map_err(MixtureConfigError::Gate)?,
        })
    }

    /// The settings as they were given.
    pub fn config(&self) -> &MixtureConfig {
        &self.config
    }
}

/// Open settings of a hierarchical mixture; [`HierarchicalParams::new`] checks them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HierarchicalConfig {
    /// Sectors of headings, the first one centred on heading 0.
    pub n_views: usize,
    /// Experts per view and latent coordinate.
    pub experts_per_output: usize,
    /// Experts per view for the heading.
    pub heading_experts: usize,
    /// A sector with less sample weight than this is left out.
    pub min_view_weight: f64,
    /// Most samples that may carry a kernel, drawn by `seed`: bounds memory and time.
    pub max_centres: usize,
    /// Seed of the centres and of the first clusters.
    pub seed: u64,
    /// Settings of each small mixture; its `n_experts` and `seed` are not used.
    pub mixture: MixtureConfig,
    /// Settings of the gate over the views.
    pub gate: RvmConfig,
}

impl Default for HierarchicalConfig {
    fn default() -> Self {
        let mixture = MixtureConfig::default();
        Self {
            n_views: 8,
            experts_per_output: 2,
            heading_experts: 3,
            min_view_weight: 10.0,
            max_centres: 1_500,
            seed: 0,
            mixture,
            gate: RvmConfig { min_gain: 0.1, max_bases: 60, max_steps: 400, ..RvmConfig::default() },
        }
    }
}

/// Checked settings of a hierarchical mixture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HierarchicalParams {
    config: HierarchicalConfig,
    latent: MixtureParams,
    heading: MixtureParams,
    gate: RvmParams,
}

impl HierarchicalParams {
    /// Checks the settings.
    ///
    /// # Errors
    /// Names the first setting that makes no sense.
    pub fn new(config: HierarchicalConfig) -> Result<Self, MixtureConfigError> {
        for (field, value) in [("n_views", config.n_views), ("max_centres", config.max_centres)] {
            if value == 0 {
                return Err(MixtureConfigError::Zero { field });
            }
        }
        if !(config.min_view_weight > 0.0 && config.min_view_weight.is_finite()) {
            return Err(MixtureConfigError::NotPositive {
                field: "min_view_weight",
                value: config.min_view_weight,
            });
        }
        let mixture = |n_experts| MixtureConfig { n_experts, seed: config.seed, ..config.mixture };
        Ok(Self {
            latent: MixtureParams::new(mixture(config.experts_per_output))?,
            heading: MixtureParams::new(mixture(config.heading_experts))?,
            gate: RvmParams::new(config.gate).map_err(MixtureConfigError::Gate)?,
            config,
        })
    }

    /// The settings as they were given.
    pub fn config(&self) -> &HierarchicalConfig {
        &self.config
    }

    pub(crate) fn latent(&self) -> &MixtureParams {
        &self.latent
    }

    pub(crate) fn heading(&self) -> &MixtureParams {
        &self.heading
    }

    pub(crate) fn gate(&self) -> &RvmParams {
        &self.gate
    }
}
