//! The predictor: a description of the mask, and experts over it.

use bme::{Answer, HierarchicalDensity, HierarchicalMixture, OnlineUpdate as _, UpdateError, UpdateReport};
use rand::Rng;
use silhouette::Mask;

use super::descriptor::MaskDescriptor;
use super::pose_space::PoseSpace;
use super::shipped::Activity;
use super::viewed::ViewedPose;

/// What a predictor was trained for.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Training {
    /// Source and licence of the training data.
    pub notice: String,
    /// What the people in it do, as `walk`.
    pub activity: String,
    /// Heights of the cameras above the floor, least and largest, metres.
    pub camera_height_m: [f64; 2],
    /// Masks it was trained on, mirror images counted.
    pub n_masks: u64,
}

/// A camera may stand this much lower or higher than those of the training, metres.
const HEIGHT_TOLERANCE_M: f64 = 0.4;

/// Why a predictor should not be asked.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NotTrainedFor {
    /// A camera from above or below shows other silhouettes.
    #[error(
        "the model is trained for cameras {least_m:.1} to {most_m:.1} m above the floor, this one is at {found_m:.1} m"
    )]
    CameraHeight {
        /// Height of the camera, metres.
        found_m: f64,
        /// Least height in the training, metres.
        least_m: f64,
        /// Largest height in the training, metres.
        most_m: f64,
    },
    /// Another activity.
    #[error("the model is trained for `{trained}`, not for `{found}`")]
    Activity {
        /// What is asked for.
        found: String,
        /// What it was trained for.
        trained: String,
    },
}

impl Training {
    /// Whether the predictor knows what a camera at this height above the floor shows of this activity; a predictor of
    /// `any` knows all activities, and one of something that has no name here counts as told of anything.
    ///
    /// # Errors
    /// [`NotTrainedFor`] says what is different.
    pub fn check(&self, camera_height_m: f64, activity: &str) -> Result<(), NotTrainedFor> {
        let [least_m, most_m] = self.camera_height_m;
        if !(least_m - HEIGHT_TOLERANCE_M..=most_m + HEIGHT_TOLERANCE_M).contains(&camera_height_m) {
            return Err(NotTrainedFor::CameraHeight { found_m: camera_height_m, least_m, most_m });
        }
        let own = Activity::called(&self.activity).name();
        let fits = self.activity == "any" || own == activity;
        if !fits {
            let (found, trained) = (activity.to_owned(), self.activity.clone());
            return Err(NotTrainedFor::Activity { found, trained });
        }
        Ok(())
    }
}

/// Predicts heading and pose from a mask.
#[derive(Clone, Debug)]
pub struct PosePredictor {
    pub(super) training: Training,
    pub(super) descriptor: MaskDescriptor,
    pub(super) space: PoseSpace,
    pub(super) experts: HierarchicalMixture,
}

/// A local maximum of a [`PoseDensity`].
#[derive(Clone, Debug, PartialEq)]
pub struct PoseMode {
    /// Where it is.
    pub pose: ViewedPose,
    /// ln of the density there.
    pub log_density: f64,
}

impl PosePredictor {
    /// Puts trained parts together.
    ///
    /// # Panics
    /// When the experts are over another description or other coordinates.
    pub fn new(
        training: Training,
        descriptor: MaskDescriptor,
        space: PoseSpace,
        experts: HierarchicalMixture,
    ) -> Self {
        let (inputs, expected) = (experts.input_dim(), descriptor.descriptor().dimension());
        assert_eq!(inputs, expected, "experts over {inputs} numbers, a descriptor of {expected}");
        let (outputs, expected) = (experts.output_dim(), space.dim() + 2);
        assert_eq!(outputs, expected, "experts of {outputs} numbers, a space and heading of {expected}");
        Self { training, descriptor, space, experts }
    }

    /// What it was trained for.
    pub fn training(&self) -> &Training {
        &self.training
    }

    /// How it describes masks.
    pub fn descriptor(&self) -> &MaskDescriptor {
        &self.descriptor
    }

    /// The coordinates that its experts predict.
    pub fn space(&self) -> &PoseSpace {
        &self.space
    }

    /// p(heading, pose | mask); `None` when there is no person in the mask. The size of the image does not matter.
    pub fn density(&self, mask: &Mask) -> Option<PoseDensity<'_>> {
        let description = self.descriptor.describe(mask)?;
        Some(PoseDensity { space: &self.space, density: self.experts.density(&description) })
    }

    /// Learns that `mask` shows these poses, each with a weight above 0 and at most 1, in one step of gates and experts; a
    /// mask without a person teaches nothing. The steps are bounded: no more than ten changes of bases in each function of
    /// the experts that have a share in the poses.
    ///
    /// # Errors
    /// When a pose is not finite or a weight out of range; the predictor is then as it was.
    pub fn learn(&mut self, mask: &Mask, poses: &[(ViewedPose, f64)]) -> Result<UpdateReport, UpdateError> {
        let Some(description) = self.descriptor.describe(mask) else { return Ok(UpdateReport::default()) };
        let points: Vec<Vec<f64>> = poses.iter().map(|(pose, _)| self.space.point(pose)).collect();
        let answers = points.iter().zip(poses).map(|(y, (_, weight))| Answer { y, responsibility: *weight });
        self.experts.update_all(&description, &answers.collect::<Vec<_>>())
    }

    /// Notes that it was trained on `n_masks` more masks while it tracked.
    pub fn note_lessons(&mut self, n_masks: u64) {
        self.training.n_masks += n_masks;
        self.training.notice += &format!("; learned on from {n_masks} masks while tracking");
    }
}

/// What a predictor says of one mask.
#[derive(Clone, Debug)]
pub struct PoseDensity<'a> {
    space: &'a PoseSpace,
    density: HierarchicalDensity,
}

impl PoseDensity<'_> {
    /// A random pose.
    pub fn sample<R: Rng + ?Sized>(&self, rng: &mut R) -> ViewedPose {
        self.pose(&self.density.sample(rng))
    }

    /// ln p of the coordinates of `pose` and of the cosine and sine of its heading. What the coordinates leave out of a
    /// pose costs nothing.
    pub fn log_density(&self, pose: &ViewedPose) -> f64 {
        self.density.log_density(&self.space.point(pose))
    }

    /// The mean of coordinates and heading: the answer with the least mean square error where there is one mode.
    pub fn mean(&self) -> ViewedPose {
        self.pose(&self.density.mean())
    }

    /// The `limit` highest modes, highest first.
    pub fn modes(&self, limit: usize) -> Vec<PoseMode> {
        let modes = self.density.modes(limit).into_iter();
        modes.map(|mode| PoseMode { pose: self.pose(&mode.at), log_density: mode.log_density }).collect()
    }

    fn pose(&self, point: &[f64]) -> ViewedPose {
        self.space.pose_at(point)
    }
}
