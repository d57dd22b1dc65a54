//! The camera and the silhouettes it would give.

use std::path::Path;

use body::{Camera, Intrinsics, Pose};
use glam::DVec3;
use pf_core::rng::{Draw, ParticleRng, Purpose, particle_rng};
use silhouette::Mask;

use super::noise::{Noise, NoiseConfig};
use super::people::{FullBody, People};
use super::walk::{WalkConfig, Walks};

/// Distance of the camera from the middle of the space, metres: least and largest.
const DISTANCE_M: [f64; 2] = [4.3, 4.45];
/// Height of the camera, metres, and of the point it looks at.
const HEIGHT_M: f64 = 1.5;
const AIM_HEIGHT_M: f64 = 0.75;
const IMAGE_PX: [u32; 2] = [640, 480];
const FOCAL_PX: [f64; 2] = [690.0, 715.0];
/// Standard deviation of the principal point about the middle of the image.
const PRINCIPAL_SD_PX: f64 = 3.0;
/// First coefficient of the lens distortion.
const K1: [f64; 2] = [-0.22, -0.18];

/// One frame of a walk.
#[derive(Clone, Debug)]
pub struct WalkFrame {
    /// True pose of the person's own skeleton.
    pub pose: Pose,
    /// The exact silhouette.
    pub clean: Mask,
    /// The silhouette as background subtraction might give it.
    pub observed: Mask,
}

/// A person walking, as one camera sees them.
#[derive(Clone, Debug)]
pub struct SyntheticWalk {
    /// Who: index into [`People::truths`].
    pub person: usize,
    /// The recording that moves them.
    pub motion: String,
    /// The camera.
    pub camera: Camera,
    /// Frames a second.
    pub rate_hz: f64,
    /// Frame by frame.
    pub frames: Vec<WalkFrame>,
}

/// People, how they walk through the picture, and the noise of their silhouettes.
pub struct Studio {
    /// Who walks.
    pub people: People,
    /// For how long, and where.
    pub walk: WalkConfig,
    /// What goes wrong with silhouettes.
    pub noise: NoiseConfig,
}

impl Studio {
    /// People of `bodies`.
    ///
    /// # Errors
    /// Names the file at fault.
    pub fn open(bodies: &Path) -> anyhow::Result<Self> {
        Ok(Self { people: People::read(bodies)?, walk: WalkConfig::default(), noise: NoiseConfig::default() })
    }

    /// Person `person` walking as one of `recordings`; equal seeds give equal walks.
    ///
    /// # Errors
    /// When the recorded skeleton is of an unknown kind.
    ///
    /// # Panics
    /// When there is no such person.
    pub fn walk(&self, recordings: &Walks, person: usize, seed: u64) -> anyhow::Result<SyntheticWalk> {
        let stream =
            |layer: u32| particle_rng(Draw { seed, frame: person as u64, layer, purpose: Purpose::User }, 0);
        let body = self.people.body(person);
        let mut motion = recordings.walk(body.rest_joints(), &self.walk, &mut stream(0))?;
        put_on_floor(&body, &mut motion.poses);
        let camera = camera(&mut stream(1))?;
        let mut noise = Noise::new(self.noise.clone(), motion.poses.len(), self.walk.rate_hz, stream(2));
        let mut positions = Vec::new();
        let mut frames = Vec::with_capacity(motion.poses.len());
        for (index, pose) in motion.poses.into_iter().enumerate() {
            let clean = silhouette_of(&body, &pose, &camera, &mut positions)?;
            let observed = noise.observe(index, &clean, &camera, &body.joints_world(&pose));
            frames.push(WalkFrame { pose, clean, observed });
        }
        Ok(SyntheticWalk { person, motion: motion.name, camera, rate_hz: self.walk.rate_hz, frames })
    }
}

/// Lifts or lowers the body on each frame so that it stands on the floor: somebody who walks always does.
fn put_on_floor(body: &FullBody, poses: &mut [Pose]) {
    let mut vertices = Vec::new();
    for pose in poses {
        body.skin_into(&glam::DAffine3::IDENTITY, pose, &mut vertices);
        let lowest = vertices.iter().map(|vertex| vertex[2]).fold(f32::INFINITY, f32::min);
        pose.root_position.z -= f64::from(lowest);
    }
}

/// A camera at a random azimuth.
fn camera(rng: &mut ParticleRng) -> anyhow::Result<Camera> {
    let mut between = |[low, high]: [f64; 2]| low + (high - low) * rng.uniform();
    let (focal_px, distance_m, k1) = (between(FOCAL_PX), between(DISTANCE_M), between(K1));
    let azimuth_rad = between([0.0, std::f64::consts::TAU]);
    let [width, height] = IMAGE_PX;
    let mut middle = |side: u32| f64::from(side) / 2.0 + PRINCIPAL_SD_PX * rng.standard_normal();
    let intrinsics = Intrinsics {
        width,
        height,
        focal_px: [focal_px; 2],
        principal_point_px: [middle(width), middle(height)],
        distortion: [k1, 0.0, 0.0, 0.0, 0.0],
    };
    let (sin, cos) = azimuth_rad.sin_cos();
    let eye = DVec3::new(distance_m * cos, distance_m * sin, HEIGHT_M);
    Ok(Camera::look_at(intrinsics, eye, DVec3::new(0.0, 0.0, AIM_HEIGHT_M))?)
}

/// The exact silhouette of `body` in `pose`.
fn silhouette_of(
    body: &FullBody,
    pose: &Pose,
    camera: &Camera,
    positions: &mut Vec<[f32; 3]>,
) -> anyhow::Result<Mask> {
    body.skin_into(&camera.camera_from_world(), pose, positions);
    let body::Intrinsics { width, height, focal_px, principal_point_px, distortion } = *camera.intrinsics();
    let lens = render_gpu::Intrinsics { width, height, focal_px, principal_point_px, distortion };
    let drawn = render_gpu::rasterize(positions, body.triangles(), &lens)?;
    Ok(Mask::from_words(width, height, drawn.words))
}

#[cfg(test)]
mod tests;
