use super::*;
use body::Intrinsics;
use glam::DVec3;

const SHAPE: [f64; 6] = [1.2, -0.9, 0.8, 0.6, -0.5, 0.7];

fn camera() -> Camera {
    let intrinsics = Intrinsics::from_focal(640, 480, 700.0).unwrap();
    Camera::look_at(intrinsics, DVec3::new(0.0, -4.3, 1.5), DVec3::new(0.0, 0.0, 0.8)).unwrap()
}

/// A body of known shape that turns on the spot, one leg after the other ahead, and where a tracker might have it.
fn frames(n_frames: usize) -> (f64, Vec<ShapeFrame>) {
    let body = BodyModel::builtin().shape(&SHAPE);
    let camera = camera();
    let intrinsics = *camera.intrinsics();
    let lens = render_gpu::Intrinsics::centred(intrinsics.width, intrinsics.height, intrinsics.focal_px[0]);
    let frame = |k: usize| {
        let heading_rad = 0.3 + 0.35 * k as f64;
        let mut pose = Pose::upright(DVec3::new(0.1, 0.05 * k as f64, 0.0), heading_rad);
        pose.angles.copy_from_slice(PosePrior::builtin().mean_rad());
        let swing = if k.is_multiple_of(2) { 0.25 } else { -0.25 };
        pose.angles[Skeleton::human().dof_index("left_hip_flexion").unwrap()] += swing;
        pose.angles[Skeleton::human().dof_index("right_hip_flexion").unwrap()] -= swing;
        let mut vertices = vec![[0.0; 3]; body.n_vertices()];
        body.skin_into(&pose, &mut vertices);
        let lowest = vertices.iter().map(|vertex| vertex[2]).fold(f32::INFINITY, f32::min);
        pose.root_position.z -= f64::from(lowest);
        body.skin_batch_into(&camera.camera_from_world(), std::slice::from_ref(&pose), &mut vertices);
        let drawn = render_gpu::rasterize(&vertices, body.triangles(), &lens).unwrap();
        let mask = Mask::from_words(intrinsics.width, intrinsics.height, drawn.words);
        pose.root_position += DVec3::new(0.03, 0.1, 0.02);
        pose.root_orientation *= glam::DQuat::from_rotation_y(0.2);
        pose.angles.iter_mut().for_each(|angle| *angle += 0.05);
        ShapeFrame { index: k as u64, mask, pose, sighting: None }
    };
    (body.stature_m(), (0..n_frames).map(frame).collect())
}

#[test]
fn a_known_body_is_found_again() {
    let (stature_m, frames) = frames(8);
    let model = BodyModel::builtin();
    let config = ShapeConfig { n_shape: 10, ..ShapeConfig::default() };
    let fit = fit_shape(&model, &camera(), &frames, 8.0, 1.72, &config).unwrap();
    let found = model.shape(&fit.shape);
    let mut worst = 0f64;
    let expected = model.shape(&SHAPE);
    for (a, b) in found.rest_vertices().iter().zip(expected.rest_vertices()) {
        worst = worst.max(DVec3::from_array(a.map(f64::from)).distance(DVec3::from_array(b.map(f64::from))));
    }
    println!("worst vertex {:.1} mm, shape {:?}", 1e3 * worst, fit.shape);
    // Clean silhouettes of the model's own surface: what is left is pixels and pose.
    assert!((found.stature_m() - stature_m).abs() < 0.01, "{} instead of {stature_m}", found.stature_m());
    assert!(worst < 0.03, "{worst}");
    assert!((fit.shape[0] - SHAPE[0]).abs() < 0.2, "{:?}", fit.shape);
    assert!(fit.misfit_px.iter().all(|misfit| *misfit < 1.0), "{:?}", fit.misfit_px);
}

#[test]
fn the_annealed_search_comes_nearer_to_a_known_body() {
    let (stature_m, frames) = frames(4);
    let model = BodyModel::builtin();
    let search = SearchConfig { particles: 40, layers: 5, rounds: 2, ..SearchConfig::default() };
    let config = ShapeConfig { n_shape: 6, method: ShapeMethod::Annealed, search, ..ShapeConfig::default() };
    let fit = fit_shape(&model, &camera(), &frames, 8.0, 1.72, &config).unwrap();
    let found = model.shape(&fit.shape);
    println!("stature {:.3} of {stature_m:.3} m, shape {:.2?}", found.stature_m(), fit.shape);
    // Forty particles come half of the way, and the same way each time.
    let off_m = |stature: f64| (stature - stature_m).abs();
    assert!(off_m(found.stature_m()) < 0.6 * off_m(1.72), "{} instead of {stature_m}", found.stature_m());
    assert!(fit.covariance.diagonal().iter().all(|variance| *variance > 0.0), "{}", fit.covariance);
    assert_eq!(fit_shape(&model, &camera(), &frames, 8.0, 1.72, &config).unwrap().shape, fit.shape);
}

#[test]
fn more_views_make_it_surer() {
    let (_, frames) = frames(6);
    let model = BodyModel::builtin();
    let config = ShapeConfig { n_shape: 6, least_frames: 1, ..ShapeConfig::default() };
    let fit = |frames: &[ShapeFrame]| fit_shape(&model, &camera(), frames, 8.0, 1.72, &config).unwrap();
    let (one, all) = (fit(&frames[..1]), fit(&frames));
    assert!(all.covariance.trace() < 0.6 * one.covariance.trace());
    assert!(all.covariance.trace() > 0.0);
}

#[test]
fn two_frames_and_a_cropped_person_are_no_shape() {
    let (_, mut frames) = frames(5);
    let model = BodyModel::builtin();
    let config = ShapeConfig { n_shape: 4, ..ShapeConfig::default() };
    let fit = |frames: &[ShapeFrame]| fit_shape(&model, &camera(), frames, 8.0, 1.7, &config).map(|_| ());
    let error = fit(&frames[..2]).unwrap_err();
    assert_eq!(error.to_string(), "2 frames show a whole person, expected 4 at least");
    // The feet are below the picture's edge.
    for frame in &mut frames[1..4] {
        let full = frame.mask.clone();
        frame.mask = Mask::from_fn(640, 480, |x, y| y >= 120 && full.get(x, y - 120));
    }
    assert_eq!(fit(&frames), Err(NoShape::TooFewFrames { found: 2, expected: 4 }));
}

#[test]
fn weights_of_near_frames_are_shared() {
    assert_eq!(weights(&[0.0, 1.0, 2.0], 0.5), [1.0, 1.0, 1.0]);
    let shared = weights(&[0.0, 0.0, 2.0], 0.5);
    assert_eq!(shared, [0.5, 0.5, 1.0]);
}
