//! Follows a person through a clip: decides when to start, and starts again after a loss.

use std::sync::Arc;

use anyhow::Context as _;
use body::{Body, Camera};
use serde::{Deserialize, Serialize};
use silhouette::Mask;

use super::modes::{Modes, ModesState};
use super::pose_model::PoseModel;
use super::tracker::Scene;
use crate::config::TrackParams;
use crate::run_folder::{FrameRecord, Status};

/// A mask of fewer pixels, at full resolution, shows nobody.
const LEAST_AREA_PX: u64 = 400;

/// Follows one person before one camera.
pub struct Follower {
    body: Arc<Body>,
    camera: Camera,
    model: Arc<dyn PoseModel>,
    fps: f64,
    params: TrackParams,
    following: Option<Following>,
}

/// Trackers and the resolution they work at.
struct Following {
    scale: f64,
    modes: Modes,
    is_lost: bool,
}

/// What a follower remembers, in a checkpoint.
#[derive(Serialize, Deserialize)]
struct FollowerState {
    scale: f64,
    modes: ModesState,
    is_lost: bool,
}

impl Follower {
    /// A follower that has seen nobody yet. `camera` is at the resolution of the masks, of which there are `fps` a second.
    pub fn new(
        body: Arc<Body>,
        camera: Camera,
        model: Arc<dyn PoseModel>,
        fps: f64,
        params: TrackParams,
    ) -> Self {
        Self { body, camera, model, fps, params, following: None }
    }

    /// Works on the first of `masks`, that of frame `frame`; the others are those of the frames after it, which a start
    /// looks at. None before somebody was seen.
    ///
    /// # Errors
    /// When the masks do not fit the camera.
    pub fn step(&mut self, frame: u64, masks: &[&Mask]) -> anyhow::Result<Option<FrameRecord>> {
        let shows_somebody = masks[0].area() >= LEAST_AREA_PX;
        let must_start = self.following.as_ref().is_none_or(|following| following.is_lost);
        if must_start && shows_somebody {
            let heading_deg = if self.following.is_none() { self.params.initial_heading_deg } else { None };
            self.following = Some(self.start(frame, masks, heading_deg)?);
        }
        let Some(following) = &mut self.following else { return Ok(None) };
        let record = if shows_somebody {
            following.modes.step(&reduced(masks[0], following.modes.camera()))?
        } else {
            following.modes.coast()?
        };
        following.is_lost = record.status == Status::Lost;
        Ok(Some(record))
    }

    fn start(&self, frame: u64, masks: &[&Mask], heading_deg: Option<f64>) -> anyhow::Result<Following> {
        let rows = masks[0].bounding_box().map_or(1, |person| person.height());
        let scale = (self.params.working_height_px / f64::from(rows)).min(1.0);
        let scene = self.scene(scale);
        let reduced: Vec<Mask> = masks
            .iter()
            .take_while(|mask| mask.area() >= LEAST_AREA_PX)
            .map(|mask| reduced(mask, &scene.camera))
            .collect();
        let modes = Modes::start(&scene, frame, &reduced, heading_deg.map(f64::to_radians))?;
        Ok(Following { scale, modes, is_lost: false })
    }

    fn scene(&self, scale: f64) -> Scene {
        Scene {
            body: self.body.clone(),
            camera: self.camera.scaled(scale),
            model: self.model.clone(),
            fps: self.fps,
            params: self.params.clone(),
        }
    }

    /// All that the follower remembers, as bytes; none before somebody was seen.
    ///
    /// # Errors
    /// When the state has no form in bytes.
    pub fn checkpoint(&self) -> anyhow::Result<Option<Vec<u8>>> {
        let Some(Following { scale, modes, is_lost }) = &self.following else { return Ok(None) };
        let state = FollowerState { scale: *scale, modes: modes.checkpoint(), is_lost: *is_lost };
        postcard::to_stdvec(&state).map(Some).context("the state of the tracker as bytes")
    }

    /// Takes up where another follower of the same person, camera and settings gave out `checkpoint`.
    ///
    /// # Errors
    /// When the bytes are not a checkpoint.
    pub fn restore(&mut self, checkpoint: &[u8]) -> anyhow::Result<()> {
        let FollowerState { scale, modes, is_lost } =
            postcard::from_bytes(checkpoint).context("checkpoint: cannot decode the state of the tracker")?;
        let modes = Modes::resume(&self.scene(scale), modes)?;
        self.following = Some(Following { scale, modes, is_lost });
        Ok(())
    }
}

/// The mask at the resolution of `camera`.
fn reduced(mask: &Mask, camera: &Camera) -> Mask {
    let intrinsics = camera.intrinsics();
    mask.resized(intrinsics.width, intrinsics.height)
}
