//! Masks of posed bodies as a camera would see them.

use body::{Body, BodyModel, Camera, Pose};
use glam::DQuat;
use pf_core::rng::{Draw, Purpose, particle_rng};
use rand::RngExt as _;
use rayon::prelude::*;
use render_gpu::rasterize;
use silhouette::Mask;

use super::Examples;
use super::noise::segmentation_noise;
use crate::predict::ViewedPose;
use crate::track::overlap::scorer_intrinsics;

/// A rendered body differs from the person's by this many standard deviations in each of the first shape coefficients.
const SHAPE_SD: f64 = 0.4;
const SHAPE_COEFFICIENTS: usize = 10;

/// The exact silhouette of `body` in `pose`; `None` when a vertex lies where the camera cannot show it.
pub fn render(body: &Body, pose: &Pose, camera: &Camera) -> Option<Mask> {
    let mut positions = vec![[0.0; 3]; body.n_vertices()];
    body.skin_batch_into(&camera.camera_from_world(), std::slice::from_ref(pose), &mut positions);
    let silhouette = rasterize(&positions, body.triangles(), &scorer_intrinsics(camera.intrinsics())).ok()?;
    Some(Mask::from_words(silhouette.width, silhouette.height, silhouette.words))
}

/// Each pose from `n_views` random sides, where it stands, on bodies about `shape`, with the noise of a segmenter.
pub fn turned_views(poses: &[&Pose], shape: &[f64], camera: &Camera, n_views: usize, seed: u64) -> Examples {
    let model = BodyModel::builtin();
    let seen: Vec<Option<(Mask, ViewedPose)>> = (0..poses.len() * n_views)
        .into_par_iter()
        .map(|index| {
            let at = Draw { seed, frame: index as u64, layer: 0, purpose: Purpose::User };
            let mut rng = particle_rng(at, 0);
            let mut pose = poses[index / n_views].clone();
            let turn = DQuat::from_rotation_z(std::f64::consts::TAU * rng.random::<f64>());
            pose.root_orientation = turn * pose.root_orientation;
            let mut coefficients = shape.to_vec();
            for coefficient in coefficients.iter_mut().take(SHAPE_COEFFICIENTS) {
                // Uniform with that standard deviation.
                *coefficient += SHAPE_SD * 12f64.sqrt() * (rng.random::<f64>() - 0.5);
            }
            let mask = render(&model.shape(&coefficients), &pose, camera)?;
            let noisy = segmentation_noise(&mask, &mut rng);
            Some((noisy, ViewedPose::of(&pose, camera.centre_world())))
        })
        .collect();
    let mut examples = Examples::default();
    for (mask, pose) in seen.into_iter().flatten() {
        examples.push(&mask, pose);
    }
    examples
}
