use super::*;
use crate::predict::Activity;
use body::{Intrinsics, Pose};
use glam::DVec3;
use nalgebra::{DMatrix, DVector};

fn camera() -> Camera {
    let intrinsics = Intrinsics::from_focal(640, 480, 700.0).expect("sound");
    Camera::look_at(intrinsics, DVec3::new(0.0, -4.3, 1.5), DVec3::new(0.0, 0.0, 0.8)).expect("sound")
}

/// A fit of the mean body on `n_frames`, from each to the next turned by `turn_rad`.
fn fit(n_frames: u64, turn_rad: f64) -> ShapeFit {
    let n_shape = ShapeConfig::default().n_shape;
    let pose = |frame: u64| Pose::upright(DVec3::new(0.0, 0.0, 0.9), turn_rad * frame as f64);
    ShapeFit {
        shape: vec![0.0; n_shape],
        mean: DVector::zeros(n_shape + 1),
        covariance: DMatrix::identity(n_shape + 1, n_shape + 1) * 0.01,
        frames: (0..n_frames).map(|frame| (frame, pose(frame))).collect(),
        misfit_px: vec![1.1; n_frames as usize],
        lowest_m: vec![0.003; n_frames as usize],
    }
}

fn found(fit: &ShapeFit) -> Biosignatures {
    let known = Known::default();
    biosignatures(fit, Predictor::of(Activity::Any).predict(fit, &known), &known, &camera(), &[])
}

#[test]
fn a_clip_that_says_little_has_wider_intervals_and_says_why() {
    let sound = fit(16, 0.15);
    let plain = found(&sound);
    assert!(plain.warnings.is_empty(), "{:?}", plain.warnings);
    let widths = |found: &Biosignatures| -> Vec<f64> {
        found.measurements.iter().map(|m| m.estimate.interval90[1] - m.estimate.interval90[0]).collect()
    };
    let poor = |warning: &str, fit: &ShapeFit| {
        let found = found(fit);
        assert_eq!(found.warnings.len(), 1, "{:?}", found.warnings);
        assert!(found.warnings[0].contains(warning), "{:?}", found.warnings);
        for (wide, narrow) in widths(&found).iter().zip(widths(&plain)) {
            assert!(*wide > 1.02 * narrow, "{warning}: {wide} {narrow}");
        }
    };
    poor("about one side only", &fit(16, 0.02));
    poor("only 5 frames", &fit(5, 0.5));
    poor("off by 1.8 pixels", &ShapeFit { misfit_px: vec![1.8; 16], ..sound.clone() });
    poor("-4 cm off the floor", &ShapeFit { lowest_m: vec![-0.04; 16], ..sound });
}

#[test]
fn no_shape_has_a_reason_and_no_numbers() {
    let known = Known { stature_m: Some(1.8), weight_kg: None };
    let none = without_shape(&NoShape::TooFewFrames { found: 2, expected: 4 }, &known, Vec::new());
    assert_eq!(none.warnings, ["no shape: 2 frames show a whole person, expected 4 at least"]);
    assert!(none.measurements.is_empty() && none.male_probability.is_none());
    assert_eq!(none.known_stature_m, Some(1.8));
}
