//! Annealed particle filtering over any state space.
//!
//! Give it a [`StateSpace`], a [`Proposal`] and a [`Likelihood`]; each frame gives back a weighted set of states.
//! It knows nothing of what is tracked or how it is observed.
//!
//! # Three filters
//! | constructor | weights of a layer | evidence |
//! |---|---|---|
//! | [`Filter::bootstrap`] | the likelihood, once | unbiased |
//! | [`Filter::annealed`] | likelihood^β after diffusion: searches, does not sample | heuristic |
//! | [`Filter::tempered`] | the rise of likelihood^β, moves accepted by Metropolis-Hastings | unbiased for fixed β, consistent for adaptive β |
//!
//! # Conventions
//! Weights are natural logs in `f64`. Layer 0 is the widest one. Noise is in the units of the state's coordinates.
//! # Map
//! [`filter`] the loop · [`schedule`] β per layer · [`resample`] · [`mutation`] · [`proposal`] · [`weights`] · [`rng`] ·
//! [`observe`] · [`estimate`]
//! # References
//! `[Gordon1993]`, `[Deutscher2005]`, `[DelMoral2006]`, `[Salmon2011]`; the keys are in `docs/papers.md`.

#[cfg(feature = "conformance")]
pub mod conformance;
pub mod estimate;
pub mod exec;
pub mod filter;
mod gaussian;
mod lanes;
pub mod likelihood;
pub mod mutation;
pub mod observe;
pub mod proposal;
pub mod resample;
pub mod rng;
pub mod schedule;
pub mod scratch;
pub mod space;
pub mod weights;

pub use exec::ExecConfig;
pub use filter::{Filter, FilterConfig, FilterParams, FilterState, Lost, Step, StepError};
pub use gaussian::{BadCovariance, Gaussian};
pub use likelihood::Likelihood;
pub use mutation::{GaussianDiffusion, LayerStep, Mutation, Stay};
pub use observe::{FrameView, Genealogy, LayerStats, LayerView, Observer};
pub use proposal::{MixtureConfig, MixtureProposal, Proposal, Proposed, RandomWalk, Weighting};
pub use resample::{Multinomial, Resampler, Residual, Stratified, Systematic};
pub use rng::ParticleRng;
pub use schedule::{AnnealingSchedule, Beta, EssSchedule, Geometric, SurvivalRate};
pub use space::{Euclidean, StateSpace};
pub use weights::{LogWeights, NormalizedWeights};
