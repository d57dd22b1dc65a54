//! Where the particles of a new frame come from: one variant a tracker.

use pf_core::proposal::MixtureProposal;
use pf_core::{ParticleRng, Proposal, Proposed, RandomWalk};

use super::cue::BottomUp;
use super::likelihood::Observation;
use super::state::{BodySpace, BodyState};

/// p(x_n | x_{n-1}), or its mixture with what the mask itself suggests.
pub enum BodyProposal {
    /// The motion prior alone: the annealed particle filter, and the joint likelihood model.
    Motion(RandomWalk<Observation>),
    /// (1 − γ) p(x_n | x_{n-1}) + γ p_B(x_n | r_n): the joint particle filter.
    Joint(MixtureProposal<RandomWalk<Observation>, BottomUp>),
}

impl Proposal<BodySpace> for BodyProposal {
    type Frame = Observation;

    fn propose(
        &self,
        space: &BodySpace,
        previous: &BodyState,
        frame: &Observation,
        rng: &mut ParticleRng,
    ) -> Proposed<BodyState> {
        match self {
            Self::Motion(motion) => motion.propose(space, previous, frame, rng),
            Self::Joint(joint) => joint.propose(space, previous, frame, rng),
        }
    }

    fn log_motion_density(&self, space: &BodySpace, previous: &BodyState, state: &BodyState) -> Option<f64> {
        match self {
            Self::Motion(motion) => motion.log_motion_density(space, previous, state),
            Self::Joint(joint) => joint.log_motion_density(space, previous, state),
        }
    }

    fn log_density(
        &self,
        space: &BodySpace,
        previous: &BodyState,
        frame: &Observation,
        state: &BodyState,
    ) -> Option<f64> {
        match self {
            Self::Motion(motion) => motion.log_density(space, previous, frame, state),
            Self::Joint(joint) => joint.log_density(space, previous, frame, state),
        }
    }

    fn n_sources(&self) -> usize {
        match self {
            Self::Motion(_) => 1,
            Self::Joint(joint) => joint.n_sources(),
        }
    }

    fn propose_from_source(
        &self,
        space: &BodySpace,
        previous: &BodyState,
        frame: &Observation,
        rng: &mut ParticleRng,
    ) -> (Proposed<BodyState>, u8) {
        match self {
            Self::Motion(motion) => motion.propose_from_source(space, previous, frame, rng),
            Self::Joint(joint) => joint.propose_from_source(space, previous, frame, rng),
        }
    }

    fn adapt(&mut self, source_shares: &[f64]) {
        match self {
            Self::Motion(motion) => Proposal::<BodySpace>::adapt(motion, source_shares),
            Self::Joint(joint) => Proposal::<BodySpace>::adapt(joint, source_shares),
        }
    }
}
