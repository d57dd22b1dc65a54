//! What recorded motion of many people teaches: a prior over poses, and a predictor from masks rendered of many bodies, seen
//! from all sides by cameras at several heights.

use std::f64::consts::TAU;
use std::path::Path;

use anyhow::{Context as _, ensure};
use body::build::prior::{CMU_NOTICE, RetargetedClip, retargeted_clips};
use body::pose_prior::{PosePrior, PosePriorConfig};
use body::retarget::{Motion, RetargetConfig};
use body::{BodyModel, Camera, Intrinsics, Pose};
use glam::{DQuat, DVec3};
use pf_core::rng::{Draw, Purpose, particle_rng, standard_normal_quantile};
use rand::RngExt as _;
use rayon::prelude::*;
use silhouette::Mask;

use super::noise::segmentation_noise;
use super::render::render;
use super::{Examples, TrainConfig, TrainingFrames, fit_predictor};
use crate::predict::{Activity, LatentPoses, PosePredictor, Training, ViewedPose};
use crate::stage::Sequence;
use crate::synth::performer_of;

/// Cameras stand so high above the floor, metres,
const CAMERA_HEIGHT_M: [f64; 2] = [0.8, 2.2];
/// so far from the person, metres,
const DISTANCE_M: [f64; 2] = [3.2, 6.5];
/// and look past the person by up to this much, metres.
const ASIDE_M: f64 = 1.0;
const IMAGE_PX: [u32; 2] = [640, 480];
const FOCAL_PX: f64 = 620.0;
/// Shape coefficients that are drawn; the others stay 0.
const SHAPE_COEFFICIENTS: usize = 20;
/// Source and terms of the motion of a stage-like data set.
const STAGE_NOTICE: &str = "\
Beside it, the training frames of synthetic sequences made from the same database: its motion on parametric bodies (Anny,
NAVER Corp., code Apache-2.0, assets CC0 1.0), everything else CC0 1.0.
";

/// Recorded motion of many people, on the skeleton of the mean body.
#[derive(Clone, Debug)]
pub struct Recordings {
    notices: Vec<String>,
    clips: Vec<Recording>,
}

#[derive(Clone, Debug)]
struct Recording {
    /// Who moves.
    performers: Vec<String>,
    action: String,
    motion: Motion,
}

impl Recordings {
    /// The training clips of a folder of recorded motion (`cmu`).
    ///
    /// # Errors
    /// When a clip cannot be read.
    pub fn read(folder: &Path) -> anyhow::Result<Self> {
        Self::read_split(folder, "train")
    }

    /// The clips of one split, `train` or `validate`.
    ///
    /// # Errors
    /// When a clip cannot be read.
    pub fn read_split(folder: &Path, split: &str) -> anyhow::Result<Self> {
        let rest = *BodyModel::builtin().mean().rest_joints();
        let clips = retargeted_clips(folder, split, &rest, &RetargetConfig::default())?;
        let recording = |clip: RetargetedClip| Recording {
            performers: vec![performer_of(&clip.motion.name).to_owned()],
            action: clip.action,
            motion: clip.motion,
        };
        Ok(Self { notices: vec![CMU_NOTICE.to_owned()], clips: clips.into_iter().map(recording).collect() })
    }

    /// Adds the motion of the training frames of `sequences`, as the masks of `camera` and the true joints show it.
    ///
    /// # Errors
    /// When a sequence cannot be read.
    pub fn add_stage(&mut self, sequences: &[Sequence], camera: &str) -> anyhow::Result<()> {
        for sequence in sequences {
            let frames = TrainingFrames::read(sequence, camera, "observed")?;
            self.clips.push(Recording {
                performers: sequence.performers.clone(),
                action: Activity::called(&sequence.activity).name().to_owned(),
                motion: frames.motion.motion,
            });
        }
        if !sequences.is_empty() {
            self.notices.push(STAGE_NOTICE.to_owned());
        }
        Ok(())
    }

    /// The recordings in which none of `performers` moves.
    #[must_use]
    pub fn without(&self, performers: &[String]) -> Self {
        let is_other = |clip: &&Recording| !clip.performers.iter().any(|name| performers.contains(name));
        let mut notices = self.notices.clone();
        notices.push(format!("Without the performers {}.", performers.join(", ")));
        Self { notices, clips: self.clips.iter().filter(is_other).cloned().collect() }
    }

    /// Sources and terms of the recordings, and who is left out.
    pub fn notice(&self) -> String {
        self.notices.join("\n")
    }

    /// Whether somebody does it.
    pub fn show(&self, activity: Activity) -> bool {
        self.of(activity).next().is_some()
    }

    fn ensure_shown(&self, activity: Activity) -> anyhow::Result<()> {
        ensure!(self.show(activity), "no training clip shows `{}`, expected some", activity.name());
        Ok(())
    }

    /// The motions of those who do it.
    pub fn motions(&self, activity: Activity) -> impl Iterator<Item = &Motion> {
        self.of(activity).map(|clip| &clip.motion)
    }

    fn of(&self, activity: Activity) -> impl Iterator<Item = &Recording> {
        self.clips.iter().filter(move |clip| activity.includes(&clip.action))
    }

    /// Poses and steps of those who do it.
    ///
    /// # Errors
    /// When too few poses show the activity.
    pub fn prior(&self, activity: Activity) -> anyhow::Result<PosePrior> {
        self.ensure_shown(activity)?;
        let motions: Vec<Motion> = self.motions(activity).cloned().collect();
        PosePrior::learn(&motions, &self.notice(), &PosePriorConfig::default())
            .with_context(|| format!("cannot learn the poses of `{}`", activity.name()))
    }

    /// `n_dims` coordinates for the poses of those who do it, and how they go on.
    ///
    /// # Errors
    /// When too few poses show the activity.
    pub fn latent(&self, activity: Activity, n_dims: usize) -> anyhow::Result<LatentPoses> {
        self.ensure_shown(activity)?;
        let motions: Vec<Motion> = self.motions(activity).cloned().collect();
        LatentPoses::fit(&motions, n_dims, true, &self.notice())
            .with_context(|| format!("cannot learn the latent poses of `{}`", activity.name()))
    }

    /// What a mask says of the pose of somebody who does it.
    ///
    /// # Errors
    /// When no clip shows the activity.
    pub fn predictor(&self, activity: Activity, config: &TrainConfig) -> anyhow::Result<PosePredictor> {
        let mut examples = self.examples(activity, config)?;
        examples.mirror();
        let training = Training {
            notice: self.notice(),
            activity: activity.name().to_owned(),
            camera_height_m: CAMERA_HEIGHT_M,
            n_masks: examples.len() as u64,
        };
        fit_predictor(&examples, BodyModel::builtin().mean().rest_joints(), training, config)
    }

    /// Rendered masks: an action of the activity, a frame of it, a body, a camera and a side, all at random.
    fn examples(&self, activity: Activity, config: &TrainConfig) -> anyhow::Result<Examples> {
        self.ensure_shown(activity)?;
        let mut actions: Vec<&str> = self.of(activity).map(|clip| clip.action.as_str()).collect();
        actions.sort_unstable();
        actions.dedup();
        let poses: Vec<Vec<&Pose>> = actions
            .iter()
            .map(|action| {
                let clips = self.clips.iter().filter(|clip| clip.action == *action);
                clips.flat_map(|clip| &clip.motion.poses).collect()
            })
            .collect();
        Ok(rendered(&poses, config))
    }
}

/// [`TrainConfig::rendered_masks`] masks of poses in `groups`, each group as often as any other.
fn rendered(groups: &[Vec<&Pose>], config: &TrainConfig) -> Examples {
    let model = BodyModel::builtin();
    let mean_stature_m = model.mean().stature_m();
    let seen: Vec<Option<(Mask, ViewedPose)>> = (0..config.rendered_masks)
        .into_par_iter()
        .map(|index| {
            let at = Draw { seed: config.seed, frame: index as u64, layer: 1, purpose: Purpose::User };
            let mut rng = particle_rng(at, 0);
            let mut uniform = |[low, high]: [f64; 2]| low + (high - low) * rng.random::<f64>();
            let poses = &groups[index % groups.len()];
            let mut pose = poses[uniform([0.0, poses.len() as f64]) as usize].clone();
            let shape: Vec<f64> = (0..SHAPE_COEFFICIENTS)
                .map(|_| standard_normal_quantile(uniform([1e-3, 1.0 - 1e-3])))
                .collect();
            let body = model.shape(&shape);
            let side = DQuat::from_rotation_z(uniform([0.0, TAU]));
            pose.root_orientation = side * pose.root_orientation;
            let height_m = pose.root_position.z * body.stature_m() / mean_stature_m;
            pose.root_position = DVec3::new(uniform([-ASIDE_M, ASIDE_M]), uniform(DISTANCE_M), height_m);
            let eye = DVec3::new(0.0, 0.0, uniform(CAMERA_HEIGHT_M));
            let target = DVec3::new(0.0, pose.root_position.y, uniform([0.7, 1.1]));
            let intrinsics = Intrinsics::from_focal(IMAGE_PX[0], IMAGE_PX[1], FOCAL_PX).ok()?;
            let camera = Camera::look_at(intrinsics, eye, target).ok()?;
            let mask = render(&body, &pose, &camera)?;
            let person = mask.bounding_box()?;
            let is_whole =
                person.x0 > 0 && person.y0 > 0 && person.x1 < mask.width() && person.y1 < mask.height();
            is_whole.then(|| (segmentation_noise(&mask, &mut rng), ViewedPose::of(&pose, eye)))
        })
        .collect();
    let mut examples = Examples::default();
    for (mask, pose) in seen.into_iter().flatten() {
        examples.push(&mask, pose);
    }
    examples
}
