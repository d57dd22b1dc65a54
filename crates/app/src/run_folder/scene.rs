//! The posed body as the camera and the files want it.

use std::sync::Arc;

use body::{Body, Camera, JointId, N_JOINTS, Pose};
use glam::{DAffine3, DVec3};

use super::record::{FrameRecord, Status};
use crate::draw::{Overlay, OverlayScene, SeenMesh, paint_overlay};
use crate::input::RgbFrame;
use silhouette::Mask;

/// Longest side of an overlay, pixels.
const OVERLAY_SIDE: u32 = 800;

/// A body before a camera at the size of the overlays.
pub(super) struct Scene {
    pub body: Arc<Body>,
    /// The camera of the overlays.
    pub camera: Camera,
    bones: Vec<[usize; 2]>,
    points_camera: Vec<[f32; 3]>,
    pixels: Vec<[f32; 2]>,
}

impl Scene {
    /// The scene for overlays of at most [`OVERLAY_SIDE`] pixels.
    pub fn new(body: Arc<Body>, camera: &Camera) -> Self {
        let longest = camera.intrinsics().width.max(camera.intrinsics().height);
        let factor = (f64::from(OVERLAY_SIDE) / f64::from(longest)).min(1.0);
        let n_vertices = body.n_vertices();
        Self {
            body,
            camera: camera.scaled(factor),
            bones: bones().map(|(parent, child)| [parent.index(), child.index()]).collect(),
            points_camera: vec![[0.0; 3]; n_vertices],
            pixels: vec![[0.0; 2]; n_vertices],
        }
    }

    /// Columns and rows of an overlay.
    pub fn size(&self) -> [u32; 2] {
        let intrinsics = self.camera.intrinsics();
        [intrinsics.width, intrinsics.height]
    }

    /// Vertices of the posed body, `[n_vertices]`, metres, world.
    pub fn vertices_world(&self, pose: &Pose) -> Vec<[f32; 3]> {
        let mut vertices = vec![[0.0; 3]; self.body.n_vertices()];
        self.body.skin_into(pose, &mut vertices);
        vertices
    }

    /// World points in the overlay, NaN where the camera does not see one.
    pub fn project(&self, points_world: &[DVec3; N_JOINTS]) -> [[f32; 2]; N_JOINTS] {
        points_world.map(|point| {
            self.camera
                .project(point)
                .map_or([f32::NAN; 2], |pixel| pixel.to_array().map(|value| value as f32))
        })
    }

    /// Paints the overlay of a frame.
    pub fn paint(&mut self, record: &FrameRecord, picture: Option<&RgbFrame>, mask: &Mask) -> Overlay {
        let camera_from_world: DAffine3 = self.camera.camera_from_world();
        let pose = std::slice::from_ref(&record.pose);
        self.body.skin_batch_into(&camera_from_world, pose, &mut self.points_camera);
        for (pixel, point) in self.pixels.iter_mut().zip(&self.points_camera) {
            let seen = self.camera.project_from_camera(DVec3::from_array(point.map(f64::from)));
            *pixel = seen.map_or([f32::NAN; 2], |seen| seen.to_array().map(|value| value as f32));
        }
        let label = match record.status {
            Status::Tracked => format!("{}", record.frame),
            status => format!("{} {}", record.frame, status.name()),
        };
        paint_overlay(&OverlayScene {
            size: self.size(),
            picture,
            mask,
            mesh: SeenMesh {
                pixels: &self.pixels,
                points_camera: &self.points_camera,
                triangles: self.body.triangles(),
            },
            joints: &self.project(&record.joints_world),
            bones: &self.bones,
            body_color: body_color(record.status),
            label: &label,
        })
    }
}

/// Parent and child joint of each bone.
pub(super) fn bones() -> impl Iterator<Item = (JointId, JointId)> {
    JointId::all().filter_map(|child| child.parent().map(|parent| (parent, child)))
}

/// The colour that tells the status of a frame in every picture.
pub(super) fn body_color(status: Status) -> [u8; 3] {
    match status {
        Status::Tracked => [255, 158, 84],
        Status::Coasting => [160, 176, 204],
        Status::Lost => [236, 84, 104],
    }
}
