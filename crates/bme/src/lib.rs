//! Sparse Bayesian mixtures of experts: several answers to one input, each with its uncertainty.
//!
//! Give a [`Design`] (kernels at inputs) and targets to [`Rvm::fit`], and a few bases come back; give them to
//! [`MixtureOfExperts::fit`], and so do gates over several such experts. Models are data: they predict, learn on from
//! single examples ([`OnlineUpdate`]), and turn into plain structs for a file ([`mod@file`]).
//! This crate knows nothing of what inputs and outputs mean.
//!
//! # Conventions
//! Numbers are `f64`; what bases are centred on is `f32` ([`Inputs`]), so that a model read back predicts the same bits.
//! Weights of mixtures are natural logs, and −∞ is a weight of zero. A sample of weight w counts as w samples. Headings
//! are radians. Results do not depend on the number of threads; random choices follow from seeds ([`stream`]).
//! # Map
//! [`Kernel`] and [`Design`] bases · [`Rvm`] regression · [`RvmClassifier`] classification and gates ·
//! [`MixtureOfExperts`], [`HierarchicalMixture`] experts under gates · [`MixtureDensity`] what they predict ·
//! [`SpectralLatentModel`] few coordinates for many outputs · [`Multimodality`] how many answers there are ·
//! [`Split`], [`choose`] cross-validation
//! # Example
//! ```
//! use bme::{Design, Inputs, Kernel, MixtureConfig, MixtureOfExperts, MixtureParams, OnlineUpdate};
//!
//! // y² = x: two answers wherever x is above 0.
//! let y: Vec<f64> = (0..100).map(|i| f64::from(i - 50) / 25.0 + 0.01).collect();
//! let x = Inputs::from_rows(1, y.iter().map(|y| y * y))?;
//! let design = Design::new(Kernel::gaussian(1, 0.5)?, x);
//! let params = MixtureParams::new(MixtureConfig { n_experts: 2, ..MixtureConfig::default() })?;
//! let (mut model, _) = MixtureOfExperts::fit(&design, &[y], &[1.0; 100], &params)?;
//! let modes = model.density(&[1.44]).modes();
//! assert!(modes.len() == 2 && modes.iter().all(|mode| (mode.at[0].abs() - 1.2).abs() < 0.1));
//! assert!(model.update(&[9.0], &[3.0], 1.0)?.log_evidence_gain >= 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//! # References
//! `[Tipping2001]`, `[Tipping2003]`, `[Ji2009]`, `[Jordan1994]`, `[Kanaujia2007]`, `[Belkin2003]`; the keys are in
//! `docs/papers.md`.

mod cross_validation;
mod density;
mod design;
pub mod file;
mod inputs;
mod kernel;
mod kmeans;
mod latent;
mod linalg;
mod mixture;
mod multimodality;
mod rng;
mod rvm;
mod traits;

pub use cross_validation::{Split, choose, kernels_by_spread, mean_squared_distance};
pub use density::{MixtureDensity, Mode};
pub use design::Design;
pub use inputs::{Inputs, InputsError};
pub use kernel::{Kernel, KernelError};
pub use kmeans::Clusters;
pub use latent::{Decoder, LatentConfig, LatentConfigError, LatentError, LatentParams, SpectralLatentModel};
pub use linalg::log_sum_exp;
pub use mixture::{
    EmReport, HierarchicalConfig, HierarchicalDensity, HierarchicalMixture, HierarchicalParams,
    MixtureConfig, MixtureConfigError, MixtureOfExperts, MixtureParams, heading_of,
};
pub use multimodality::{Coverage, Multimodality};
pub use rng::{Purpose, stream};
pub use rvm::{FitError, Rvm, RvmClassifier, RvmConfig, RvmConfigError, RvmParams};
pub use traits::{Answer, Expert, Gate, Gaussian, OnlineUpdate, UpdateError, UpdateReport};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
