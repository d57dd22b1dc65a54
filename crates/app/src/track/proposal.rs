//! Where the particles of a new frame come from: one variant a tracker.

use std::sync::Arc;

use glam::DVec3;
use pf_core::proposal::MixtureProposal;
use pf_core::{ParticleRng, Proposal, Proposed};

use super::cue::BottomUp;
use super::likelihood::Observation;
use super::motion::BodyMotion;
use super::state::{BodySpace, BodyState};
use crate::predict::{TransitionPredictor, ViewedPose};

/// p(x_n | x_{n-1}), or its mixture with what the mask itself suggests.
pub enum BodyProposal {
    /// The motion prior alone: the annealed particle filter, and the joint likelihood model.
    Motion(BodyMotion),
    /// p(x_n | x_{n-1}, r_n): the observation-driven particle filter.
    Transition(Transition),
    /// (1 − γ) p(x_n | x_{n-1}) + γ p_B(x_n | r_n): the joint particle filter.
    Joint(MixtureProposal<BodyMotion, BottomUp>),
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
            Self::Transition(transition) => transition.propose(space, previous, frame, rng),
            Self::Joint(joint) => joint.propose(space, previous, frame, rng),
        }
    }

    fn log_motion_density(&self, space: &BodySpace, previous: &BodyState, state: &BodyState) -> Option<f64> {
        match self {
            Self::Motion(motion) => motion.log_motion_density(space, previous, state),
            Self::Transition(transition) => transition.walk.log_motion_density(space, previous, state),
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
            Self::Transition(transition) => transition.log_density(space, previous, frame, state),
            Self::Joint(joint) => joint.log_density(space, previous, frame, state),
        }
    }

    fn n_sources(&self) -> usize {
        match self {
            Self::Motion(_) | Self::Transition(_) => 1,
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
            Self::Transition(transition) => transition.propose_from_source(space, previous, frame, rng),
            Self::Joint(joint) => joint.propose_from_source(space, previous, frame, rng),
        }
    }

    fn adapt(&mut self, source_shares: &[f64]) {
        match self {
            Self::Motion(_) | Self::Transition(_) => {}
            Self::Joint(joint) => Proposal::<BodySpace>::adapt(joint, source_shares),
        }
    }
}

/// Draws orientation and pose from p(x_n | x_{n-1}, r_n) and the place from the motion; everything from the motion on a frame
/// without a description.
pub struct Transition {
    predictor: Arc<TransitionPredictor>,
    camera_centre: DVec3,
    place_sd: DVec3,
    walk: BodyMotion,
}

impl Transition {
    /// The proposal before a camera at `camera_centre` (metres, world), for the steps `[dim]` of the motion `walk`.
    pub fn new(
        predictor: Arc<TransitionPredictor>,
        camera_centre: DVec3,
        step_sd: &[f64],
        walk: BodyMotion,
    ) -> Self {
        Self { predictor, camera_centre, place_sd: DVec3::from_slice(step_sd), walk }
    }
}

impl Proposal<BodySpace> for Transition {
    type Frame = Observation;

    fn propose(
        &self,
        space: &BodySpace,
        previous: &BodyState,
        frame: &Observation,
        rng: &mut ParticleRng,
    ) -> Proposed<BodyState> {
        let Some(description) = &frame.description else {
            return self.walk.propose(space, previous, frame, rng);
        };
        let before = ViewedPose::of(&space.pose(previous), self.camera_centre);
        let step = DVec3::from_array(std::array::from_fn(|_| rng.standard_normal())) * self.place_sd;
        let position = previous.position + previous.orientation * step;
        let next = self.predictor.sample(&before, description, rng);
        Proposed {
            state: space.state_from_pose(&next.pose(self.camera_centre, position)),
            log_correction: 0.0,
        }
    }
}
