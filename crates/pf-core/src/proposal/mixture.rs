//! Two proposals side by side, their shares following what each of them brings in.

use super::{Proposal, Proposed};
use crate::rng::ParticleRng;
use crate::space::StateSpace;

/// What the weights of particles from a mixture are made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weighting {
    /// The likelihood alone: simple, and biased towards where the cue proposes.
    LikelihoodOnly,
    /// The likelihood times p / q, with the density of the whole mixture in the denominator: exact.
    Importance,
}

/// Settings of [`MixtureProposal`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MixtureConfig {
    /// Share γ of the cue in the first frame, and in all frames when it does not adapt.
    pub initial_cue_share: f64,
    /// Neither source ever has a smaller share than this.
    pub least_share: f64,
    /// Whether γ follows the posterior weight of the cue's particles in the frame before.
    pub adapts: bool,
    /// What the weights are made of.
    pub weighting: Weighting,
}

impl Default for MixtureConfig {
    fn default() -> Self {
        Self { initial_cue_share: 0.5, least_share: 0.05, adapts: true, weighting: Weighting::Importance }
    }
}

/// Why a mixture cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BadMixture {
    /// The smallest share leaves no room for the other source.
    #[error("`least_share` is {0}, expected a number above 0 and at most 0.5")]
    LeastShare(f64),
    /// The first share is beyond the smallest ones.
    #[error("`initial_cue_share` is {share}, expected {least} to {most}", most = 1.0 - least)]
    InitialCueShare {
        /// The share asked for.
        share: f64,
        /// The smallest share allowed.
        least: f64,
    },
}

/// q(x|x′,z) = (1 − γ) p(x|x′) + γ c(x|x′,z): the motion prior `P` and a cue `C` that looks at the frame.
///
/// γ of a frame is the share of the posterior weight that descends from the cue's particles of the frame before, kept
/// between floors so that neither source dies out. Source 0 is the prior, source 1 the cue.
#[derive(Clone, Debug)]
pub struct MixtureProposal<P, C> {
    prior: P,
    cue: C,
    config: MixtureConfig,
    cue_share: f64,
}

impl<P, C> MixtureProposal<P, C> {
    /// A mixture of `prior`, which must be the motion prior itself, and `cue`.
    ///
    /// # Errors
    /// When the shares are out of range.
    pub fn new(prior: P, cue: C, config: MixtureConfig) -> Result<Self, BadMixture> {
        let (share, least) = (config.initial_cue_share, config.least_share);
        if !(least > 0.0 && least <= 0.5) {
            return Err(BadMixture::LeastShare(least));
        }
        if !(share >= least && share <= 1.0 - least) {
            return Err(BadMixture::InitialCueShare { share, least });
        }
        Ok(Self { prior, cue, config, cue_share: share })
    }

    /// The share γ of the cue in the frame at hand.
    pub fn cue_share(&self) -> f64 {
        self.cue_share
    }
}

impl<S: StateSpace, P: Proposal<S>, C: Proposal<S, Frame = P::Frame>> Proposal<S> for MixtureProposal<P, C> {
    type Frame = P::Frame;

    fn propose(
        &self,
        space: &S,
        previous: &S::State,
        frame: &P::Frame,
        rng: &mut ParticleRng,
    ) -> Proposed<S::State> {
        self.propose_from_source(space, previous, frame, rng).0
    }

    fn log_motion_density(&self, space: &S, previous: &S::State, state: &S::State) -> Option<f64> {
        self.prior.log_motion_density(space, previous, state)
    }

    fn log_density(&self, space: &S, previous: &S::State, frame: &P::Frame, state: &S::State) -> Option<f64> {
        let prior = self.prior.log_density(space, previous, frame, state)?;
        let cue = self.cue.log_density(space, previous, frame, state)?;
        Some(log_add_exp((1.0 - self.cue_share).ln() + prior, self.cue_share.ln() + cue))
    }

    fn n_sources(&self) -> usize {
        2
    }

    /// # Panics
    /// Under [`Weighting::Importance`], when one of the two cannot evaluate its density.
    fn propose_from_source(
        &self,
        space: &S,
        previous: &S::State,
        frame: &P::Frame,
        rng: &mut ParticleRng,
    ) -> (Proposed<S::State>, u8) {
        let from_cue = rng.uniform() < self.cue_share;
        let Proposed { state, .. } = if from_cue {
            self.cue.propose(space, previous, frame, rng)
        } else {
            self.prior.propose(space, previous, frame, rng)
        };
        let log_correction = match self.config.weighting {
            Weighting::LikelihoodOnly => 0.0,
            Weighting::Importance => {
                let motion = self.log_motion_density(space, previous, &state);
                let mixture = self.log_density(space, previous, frame, &state);
                let (Some(motion), Some(mixture)) = (motion, mixture) else {
                    panic!("importance weights need the densities of both proposals of a mixture")
                };
                motion - mixture
            }
        };
        (Proposed { state, log_correction }, u8::from(from_cue))
    }

    fn adapt(&mut self, source_shares: &[f64]) {
        let MixtureConfig { initial_cue_share, least_share, adapts, .. } = self.config;
        self.cue_share = match source_shares {
            [_, cue] if adapts => cue.clamp(least_share, 1.0 - least_share),
            _ => initial_cue_share,
        };
    }
}

/// ln(exp a + exp b) without overflow.
fn log_add_exp(a: f64, b: f64) -> f64 {
    let (large, small) = if a > b { (a, b) } else { (b, a) };
    if small == f64::NEG_INFINITY { large } else { large + (small - large).exp().ln_1p() }
}
