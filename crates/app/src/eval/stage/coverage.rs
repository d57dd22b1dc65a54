//! How many of the poses that go with a mask a tracker has among its particles.

use std::sync::Arc;

use bme::{Coverage, Inputs, Multimodality};
use body::{Body, N_JOINTS};
use glam::DVec3;
use silhouette::Mask;

use super::{MAIN_CAMERA, Prepared, StageEval, TrainOn};
use crate::predict::{MaskDescriptor, ViewedPose};
use crate::track::follower::Follower;
use crate::track::state::BodyState;
use crate::train::{TrainConfig, TrainingFrames, examples_of_frames};

/// Clusters of masks and clusters of poses between which associations are counted: coarse ones, so that two poses of one
/// mask are different readings of it rather than neighbours. Finer ones change the figures of all trackers alike.
const MASK_CLUSTERS: usize = 30;
const POSE_CLUSTERS: usize = 30;
/// Seed of the clusters' first centres.
const SEED: u64 = 1;

/// Which poses go with which masks in the training examples of a sequence, views rendered of them included.
pub(super) struct Associations {
    descriptor: MaskDescriptor,
    body: Arc<Body>,
    measure: Multimodality,
}

/// What the particles of one frame hit of the associations of its mask.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct FrameCoverage {
    /// As they were proposed: the poses that the tracker thought of.
    pub proposed: Coverage,
    /// After the last layer: those that it still believes in.
    pub posterior: Coverage,
}

impl std::ops::AddAssign for FrameCoverage {
    fn add_assign(&mut self, other: Self) {
        self.proposed += other.proposed;
        self.posterior += other.posterior;
    }
}

impl Associations {
    /// The associations of a sequence that trained a predictor; none of one that trained nothing.
    ///
    /// # Errors
    /// When the training frames cannot be read.
    pub fn of(prepared: &Prepared, eval: &StageEval) -> anyhow::Result<Option<Self>> {
        let (TrainOn::Sequence, Some(predictor)) = (eval.train, prepared.predictor.as_deref()) else {
            return Ok(None);
        };
        let frames = TrainingFrames::read(&prepared.sequence, MAIN_CAMERA, "observed")?;
        let all: Vec<usize> = frames.range().collect();
        let examples = examples_of_frames(&frames, &all, &TrainConfig::default())?;
        let (descriptor, body) = (predictor.descriptor().clone(), prepared.body.clone());
        let (mut inputs, mut outputs) = (Vec::new(), Vec::new());
        for (mask, pose) in examples.masks.iter().zip(&examples.poses) {
            if let Some(description) = descriptor.describe(mask) {
                inputs.extend(description);
                outputs.extend(point(&body, pose));
            }
        }
        let inputs = Inputs::from_rows(descriptor.descriptor().dimension(), inputs)?;
        let outputs = Inputs::from_rows(POINT_LEN, outputs)?;
        let measure = Multimodality::new(&inputs, &outputs, MASK_CLUSTERS, POSE_CLUSTERS, SEED);
        Ok(Some(Self { descriptor, body, measure }))
    }

    /// What the particles of `follower` hit on the frame of `mask`, before a camera at `camera_world`, metres; nothing to
    /// hit where there is no person.
    pub fn coverage(&self, follower: &Follower, mask: &Mask, camera_world: DVec3) -> FrameCoverage {
        let Some(description) = self.descriptor.describe(mask) else { return FrameCoverage::default() };
        let of = |particles: &mut dyn Iterator<Item = &BodyState>| {
            let point =
                |state| point(&self.body, &ViewedPose::of(&follower.space().pose(state), camera_world));
            let points: Vec<Vec<f64>> = particles.map(point).collect();
            self.measure.coverage(&description, points.iter().map(Vec::as_slice))
        };
        FrameCoverage {
            proposed: of(&mut follower.trackers().flat_map(|tracker| tracker.proposed())),
            posterior: of(&mut follower.trackers().flat_map(|tracker| tracker.particles())),
        }
    }
}

/// Numbers that poses are clustered by.
const POINT_LEN: usize = 3 * N_JOINTS;

/// The joints of `body` in a pose, pelvis at the origin, as the camera sees them, metres: what tells front from back and left
/// from right, and little of what nobody sees.
fn point(body: &Body, pose: &ViewedPose) -> Vec<f64> {
    let joints = body.joints_world(&pose.pose(-DVec3::Y, DVec3::ZERO));
    joints.iter().flat_map(DVec3::to_array).collect()
}

/// The multimodality of all examples: weight of the clusters of masks that go with n clusters of poses, at index n - 1.
pub(super) fn histogram<'a>(sequences: impl Iterator<Item = &'a Associations>) -> Vec<f64> {
    let mut sum: Vec<f64> = Vec::new();
    for associations in sequences {
        let own = associations.measure.histogram();
        sum.resize(sum.len().max(own.len()), 0.0);
        sum.iter_mut().zip(own).for_each(|(sum, weight)| *sum += weight);
    }
    sum
}
