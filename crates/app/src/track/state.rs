//! The state that the filter moves: a rigid part and the coordinates of a pose model.

use std::sync::Arc;

use body::{N_DOF, Pose};
use glam::{DQuat, DVec3};
use pf_core::StateSpace;

use super::pose_model::PoseModel;

/// Coordinates of the rigid part: three of position, three of orientation.
pub const RIGID_DIM: usize = 6;

/// A body in the world: where the pelvis is, how it is turned, and the coordinates of its pose in a [`PoseModel`].
/// It owns no heap memory, so that the filter's loop copies states without allocating.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyState {
    /// Pelvis, metres, world.
    pub position: DVec3,
    /// `world_from_body` of the pelvis.
    pub orientation: DQuat,
    /// Pose coordinates in the units of the model: the first [`PoseModel::dim`] entries; the others are zero.
    pub latent: [f64; N_DOF],
}

/// Numbers of a state in a file.
const FILE_LEN: usize = 3 + 4 + N_DOF;

impl BodyState {
    /// The state as plain numbers: position, orientation as x y z w, pose coordinates.
    pub fn to_numbers(self) -> [f64; FILE_LEN] {
        let mut numbers = [0.0; FILE_LEN];
        self.position.write_to_slice(&mut numbers[..3]);
        self.orientation.write_to_slice(&mut numbers[3..7]);
        numbers[7..].copy_from_slice(&self.latent);
        numbers
    }

    /// Undoes [`to_numbers`](Self::to_numbers); none of another count of numbers.
    pub fn from_numbers(numbers: &[f64]) -> Option<Self> {
        let latent = numbers.get(7..)?.try_into().ok()?;
        let (position, orientation) = (DVec3::from_slice(numbers), DQuat::from_slice(&numbers[3..]));
        Some(Self { position, orientation, latent })
    }
}

/// The space of [`BodyState`]s. A step is, in this order: position in the pelvis frame (metres), rotation vector in the
/// pelvis frame (radians), pose coordinates. In the pelvis frame the steps of a walk are alike for all headings.
#[derive(Clone)]
pub struct BodySpace {
    model: Arc<dyn PoseModel>,
}

impl BodySpace {
    /// The space over the coordinates of `model`.
    pub fn new(model: Arc<dyn PoseModel>) -> Self {
        Self { model }
    }

    /// The pose model.
    pub fn model(&self) -> &dyn PoseModel {
        &*self.model
    }

    /// Writes the pose of `state` into `pose`, whose memory is reused.
    pub fn pose_into(&self, state: &BodyState, pose: &mut Pose) {
        pose.root_position = state.position;
        pose.root_orientation = state.orientation;
        pose.angles.resize(N_DOF, 0.0);
        self.model.angles_from_latent(&state.latent[..self.model.dim()], &mut pose.angles);
    }

    /// The pose of `state`.
    pub fn pose(&self, state: &BodyState) -> Pose {
        let mut pose = blank_pose();
        self.pose_into(state, &mut pose);
        pose
    }

    /// The state whose pose comes nearest to `pose`.
    pub fn state_from_pose(&self, pose: &Pose) -> BodyState {
        let mut latent = [0.0; N_DOF];
        self.model.latent_from_angles(&pose.angles, &mut latent[..self.model.dim()]);
        BodyState { position: pose.root_position, orientation: pose.root_orientation, latent }
    }
}

impl StateSpace for BodySpace {
    type State = BodyState;

    fn dim(&self) -> usize {
        RIGID_DIM + self.model.dim()
    }

    fn retract(&self, state: &mut BodyState, delta: &[f64]) {
        let (rigid, latent) = delta.split_at(RIGID_DIM);
        state.position += state.orientation * DVec3::from_slice(&rigid[..3]);
        let turn = DQuat::from_scaled_axis(DVec3::from_slice(&rigid[3..]));
        state.orientation = (state.orientation * turn).normalize();
        for (coordinate, step) in state.latent.iter_mut().zip(latent) {
            *coordinate += step;
        }
        self.model.clamp(&mut state.latent[..self.model.dim()]);
    }

    fn local(&self, from: &BodyState, to: &BodyState, delta: &mut [f64]) {
        let body_from_world = from.orientation.inverse();
        (body_from_world * (to.position - from.position)).write_to_slice(&mut delta[..3]);
        let turn = shorter(body_from_world * to.orientation);
        turn.to_scaled_axis().write_to_slice(&mut delta[3..RIGID_DIM]);
        for ((out, a), b) in delta[RIGID_DIM..].iter_mut().zip(&from.latent).zip(&to.latent) {
            *out = b - a;
        }
    }
}

/// A pose to be overwritten.
pub fn blank_pose() -> Pose {
    Pose::upright(DVec3::ZERO, 0.0)
}

/// The one of `q` and `-q`, which are the same rotation, that turns by no more than half a turn.
fn shorter(q: DQuat) -> DQuat {
    if q.w < 0.0 { -q } else { q }
}
