//! Follows a person through a clip: decides when to start, starts again after a loss, and tries another start when there is doubt.

use std::sync::Arc;

use anyhow::Context as _;
use body::{Camera, Pose};
use glam::DVec2;
use pf_core::Gaussian;
use pf_core::rng::{Draw, Purpose, particle_rng};
use serde::{Deserialize, Serialize};
use silhouette::Mask;

use super::cue::Cue;
use super::doubt::{Doubt, Standing};
use super::learning::Learner;
use super::likelihood::Observation;
use super::modes::{Modes, ModesState};
use super::smooth::{ReadFrame, Smoother};
use super::state::BodySpace;
use super::tracker::{Scene, Tracker, step_sd};
use super::travel::Travel;
use crate::predict::{PosePredictor, TransitionPredictor};
use crate::run_folder::{FrameRecord, Status};
use crate::shape::rim::Seen;

/// A mask of fewer pixels, at full resolution, shows nobody.
const LEAST_AREA_PX: u64 = 400;

/// Follows one person before one camera.
pub struct Follower {
    /// The scene at the resolution of the masks.
    scene: Scene,
    space: BodySpace,
    travel: Travel,
    /// The predictor that frames are shown to; that of the scene stays as it was.
    learner: Option<Learner>,
    smoother: Option<Smoother>,
    following: Option<Following>,
}

/// Trackers and the resolution they work at.
struct Following {
    scale: f64,
    modes: Modes,
    is_lost: bool,
    doubt: Doubt,
}

/// What a follower remembers, in a checkpoint.
#[derive(Serialize, Deserialize)]
struct FollowerState {
    scale: f64,
    modes: ModesState,
    travel: Travel,
    is_lost: bool,
    doubt: Doubt,
}

impl Follower {
    /// A follower that has seen nobody yet. The camera of `scene` is at the resolution of the masks.
    pub fn new(scene: Scene) -> Self {
        let space = BodySpace::new(scene.model.clone());
        let learner = scene.predictor.clone();
        let learner = learner.map(|predictor| Learner::new(predictor, scene.params.adapt as usize));
        let smoother = (scene.params.smooth > 0).then(|| {
            let step = Gaussian::diagonal(step_sd(&scene, 1.0)).expect("motion has deviations above 0");
            Smoother::new(space.clone(), scene.body.clone(), step, scene.params.smooth as usize)
        });
        Self { scene, space, travel: Travel::default(), learner, smoother, following: None }
    }

    /// Works on the first of `masks`, that of frame `frame`; the others are those of the frames after it, which a start
    /// looks at. Gives out the record of this frame, or, when it [smooths](crate::config::TrackConfig::smooth), that of an
    /// earlier one; none before somebody was seen.
    ///
    /// # Errors
    /// When the masks do not fit the camera.
    pub fn step(&mut self, frame: u64, masks: &[&Mask]) -> anyhow::Result<Option<FrameRecord>> {
        self.travel.look(frame, masks, &self.scene.camera, self.scene.fps);
        let shows_somebody = masks[0].area() >= LEAST_AREA_PX;
        let must_start = self.following.as_ref().is_none_or(|following| following.is_lost);
        if must_start && shows_somebody {
            let heading_deg =
                if self.following.is_none() { self.scene.params.initial_heading_deg } else { None };
            let rows = masks[0].bounding_box().map_or(1, |person| person.height());
            let scale = (self.scene.params.working_height_px / f64::from(rows)).min(1.0);
            self.following = Some(self.start(frame, masks, heading_deg, scale)?);
        }
        let Some(following) = &self.following else { return Ok(None) };
        let seen = shows_somebody.then(|| self.observation(frame, masks[0], following.modes.camera()));
        let Some(following) = &mut self.following else { return Ok(None) };
        let mut record = match &seen {
            Some(seen) => following.modes.step(seen)?,
            None => following.modes.coast()?,
        };
        following.is_lost = record.status == Status::Lost;
        if let Some(seen) = seen.as_ref().filter(|_| record.status == Status::Tracked) {
            let standing = standing(&self.space, seen, &record.pose, following.modes.fit());
            if following.doubt.look(&standing) {
                record = self.test(frame, masks, seen, standing)?.unwrap_or(record);
            }
        }
        let Some(following) = &mut self.following else { return Ok(None) };
        if let Some(learner) = self.learner.as_mut().filter(|learner| learner.wants(&record)) {
            let particles = following.modes.best_particles(learner.n_particles());
            record.learned = Some(learner.learn(masks[0], self.scene.camera.centre_world(), &particles)?);
        }
        let Some(smoother) = &mut self.smoother else { return Ok(Some(record)) };
        let mask = seen.map(|seen| (seen.mask, *following.modes.camera()));
        smoother.push(ReadFrame { record, readings: following.modes.readings().to_vec(), mask })
    }

    /// Whether somebody was seen.
    pub fn has_started(&self) -> bool {
        self.following.is_some()
    }

    /// Gives out the next record that is held back, once there are no more frames.
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn finish(&mut self) -> anyhow::Result<Option<FrameRecord>> {
        self.smoother.as_mut().map_or(Ok(None), Smoother::pop)
    }

    /// Starts anew beside what is believed, and believes the better of the two: the record of this frame when that is the new
    /// one.
    fn test(
        &mut self,
        frame: u64,
        masks: &[&Mask],
        seen: &Observation,
        standing: Standing,
    ) -> anyhow::Result<Option<FrameRecord>> {
        let Some(Following { scale, .. }) = self.following else { return Ok(None) };
        let mut rival = self.start(frame, masks, None, scale)?;
        let fit = rival.modes.fit();
        let record = rival.modes.step(seen)?;
        if self::standing(&self.space, seen, &record.pose, fit).beats(&standing) {
            self.following = Some(rival);
            return Ok(Some(record));
        }
        if let Some(following) = &mut self.following {
            following.doubt.rest(standing.fit);
        }
        Ok(None)
    }

    /// Trackers that work at `scale` times the resolution of the masks.
    fn start(
        &self,
        frame: u64,
        masks: &[&Mask],
        heading_deg: Option<f64>,
        scale: f64,
    ) -> anyhow::Result<Following> {
        let scene = self.scene_at(scale);
        let frames: Vec<Observation> = (frame..)
            .zip(masks)
            .take_while(|(_, mask)| mask.area() >= LEAST_AREA_PX)
            .map(|(frame, mask)| self.observation(frame, mask, &scene.camera))
            .collect();
        let modes = Modes::start(&scene, frame, &frames, heading_deg.map(f64::to_radians))?;
        Ok(Following { scale, modes, is_lost: false, doubt: Doubt::default() })
    }

    fn scene_at(&self, scale: f64) -> Scene {
        Scene { camera: self.scene.camera.scaled(scale), ..self.scene.clone() }
    }

    /// What trackers see on a frame: the mask at the resolution of `camera`, and what the predictor says of it.
    fn observation(&self, frame: u64, mask: &Mask, camera: &Camera) -> Observation {
        let cue = self.predictor().and_then(|predictor| {
            let middle_px = DVec2::from_array(mask.centroid_px()?);
            let ray = self.scene.camera.ray(middle_px)?;
            let at = Draw { seed: self.scene.params.seed, frame, layer: 0, purpose: Purpose::User };
            let mut rng = particle_rng(at, 0);
            Cue::new(predictor, mask, ray.origin, ray.origin + ray.direction, &self.space, &mut rng)
        });
        let describe = |transitions: &Arc<TransitionPredictor>| transitions.describe(mask);
        let description = self.scene.transitions.as_ref().and_then(describe);
        let travel = self.travel.direction(frame, self.scene.fps);
        let mask = reduced(mask, camera);
        let refines = self.scene.refiner.is_some() && self.scene.params.refine_steps > 0;
        let outline = if refines { Seen::of(&mask).map(Arc::new) } else { None };
        Observation { mask, cue, outline, travel, description }
    }

    /// The space that particles are in.
    pub fn space(&self) -> &BodySpace {
        &self.space
    }

    /// The trackers at work; none before somebody was seen.
    pub fn trackers(&self) -> impl Iterator<Item = &Tracker> {
        self.following.iter().flat_map(|following| following.modes.trackers())
    }

    /// What predicts poses from masks, with all that it has learned so far.
    pub fn predictor(&self) -> Option<&PosePredictor> {
        self.learner.as_ref().map(Learner::predictor)
    }

    /// Whether [`Self::checkpoint`] holds all that is remembered: not what a predictor has learned, nor frames held back.
    pub fn fits_a_checkpoint(&self) -> bool {
        self.smoother.is_none() && self.learner.as_ref().is_none_or(|learner| learner.n_particles() == 0)
    }

    /// The predictor to be kept, with a note of what it has learned.
    pub fn learned_predictor(&self) -> Option<PosePredictor> {
        self.learner.as_ref().map(Learner::noted)
    }

    /// Puts `pose` in place of what is believed, as a study of wrong poses does; nothing before somebody was seen.
    ///
    /// # Errors
    /// Never.
    pub fn displace(&mut self, pose: &Pose) -> anyhow::Result<()> {
        self.following.as_mut().map_or(Ok(()), |following| following.modes.displace(pose))
    }

    /// All that the follower remembers but for what its predictor has learned, as bytes; none before somebody was seen.
    ///
    /// # Errors
    /// When the state has no form in bytes.
    pub fn checkpoint(&self) -> anyhow::Result<Option<Vec<u8>>> {
        let Some(Following { scale, modes, is_lost, doubt }) = &self.following else { return Ok(None) };
        let state = FollowerState {
            scale: *scale,
            modes: modes.checkpoint(),
            travel: self.travel.clone(),
            is_lost: *is_lost,
            doubt: doubt.clone(),
        };
        postcard::to_stdvec(&state).map(Some).context("the state of the tracker as bytes")
    }

    /// Takes up where another follower of the same person, camera and settings gave out `checkpoint`; the predictor stays as
    /// it is.
    ///
    /// # Errors
    /// When the bytes are not a checkpoint.
    pub fn restore(&mut self, checkpoint: &[u8]) -> anyhow::Result<()> {
        let FollowerState { scale, modes, travel, is_lost, doubt } =
            postcard::from_bytes(checkpoint).context("checkpoint: cannot decode the state of the tracker")?;
        let modes = Modes::resume(&self.scene_at(scale), modes)?;
        self.travel = travel;
        self.following = Some(Following { scale, modes, is_lost, doubt });
        Ok(())
    }
}

/// What speaks for `pose` on a frame, of a reading with this mean fit.
fn standing(space: &BodySpace, seen: &Observation, pose: &Pose, fit: f64) -> Standing {
    let state = space.state_from_pose(pose);
    let agreement = seen.cue.as_ref().and_then(|cue| cue.agreement(&state));
    Standing { fit, agreement }
}

/// The mask at the resolution of `camera`.
fn reduced(mask: &Mask, camera: &Camera) -> Mask {
    let intrinsics = camera.intrinsics();
    mask.resized(intrinsics.width, intrinsics.height)
}
