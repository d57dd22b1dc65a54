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
//! # Example
//! ```
//! use pf_core::{Euclidean, Filter, FilterConfig, FilterParams, Gaussian, Likelihood, RandomWalk, Step};
//!
//! /// A position measured with a standard deviation of 0.5.
//! struct Ruler;
//! impl Likelihood<[f64; 1]> for Ruler {
//!     type Frame = f64;
//!     type Error = std::convert::Infallible;
//!     fn log_likelihoods(&mut self, measured: &f64, states: &[[f64; 1]], out: &mut [f64]) -> Result<(), Self::Error> {
//!         for (log_likelihood, [x]) in out.iter_mut().zip(states) {
//!             *log_likelihood = -0.5 * ((measured - x) / 0.5).powi(2);
//!         }
//!         Ok(())
//!     }
//! }
//!
//! let params = FilterParams::new(FilterConfig { n_particles: 1000, seed: 1, ..Default::default() })?;
//! let mut filter = Filter::bootstrap(Euclidean, RandomWalk::new(Gaussian::diagonal(vec![1.0])?), params);
//! filter.initialise(vec![[0.0]])?;
//! let Step::Tracked(posterior) = filter.step(&2.0, &mut Ruler, &mut ())? else { panic!("lost") };
//! // Prior N(0, 1), measurement 2 with variance 1/4: the posterior mean is 2 / (1 + 1/4) = 1.6.
//! assert!((posterior.mean(&Euclidean)[0] - 1.6).abs() < 0.1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
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

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
