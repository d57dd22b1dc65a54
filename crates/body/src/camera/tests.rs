use glam::{DMat3, DQuat, DVec2, DVec3};
use proptest::prelude::*;

use super::*;

/// A wide lens, and the camera of OpenCV's `Rodrigues([0.3, -1.1, 0.4])` with `t = (0.2, -0.3, 4.1)`.
fn distorted_camera() -> Camera {
    let intrinsics = Intrinsics {
        width: 640,
        height: 480,
        focal_px: [704.2, 703.6],
        principal_point_px: [322.9, 242.2], // OpenCV's (322.4, 241.7)
        distortion: [-0.21, 0.09, 0.0011, -0.0007, 0.013],
    };
    let rotation = DMat3::from_cols_array(&[
        0.394389753664,
        -0.455406868379,
        -0.79816120329,
        0.163653027079,
        0.889487181326,
        -0.426650021664,
        0.904253509218,
        0.03764489993,
        0.425333342893,
    ])
    .transpose();
    Camera::new(intrinsics, rotation, DVec3::new(0.2, -0.3, 4.1)).expect("a good camera")
}

/// From `cv2.projectPoints` (OpenCV 5.0): world point, pixel with centres at whole numbers.
const OPENCV_PROJECTIONS: [([f64; 3], [f64; 2]); 5] = [
    ([0.0, 0.0, 0.0], [356.683929300501, 190.318194552534]),
    ([0.5, 0.2, 1.7], [184.041669763052, 141.047021668939]),
    ([-1.2, 0.9, 0.1], [150.88527026159, 300.475242231801]),
    ([0.3, -1.5, -0.8], [598.05292888075, 32.918221099486]),
    ([1.0, 1.0, 1.0], [237.781211311221, 283.585463909113]),
];

/// From `cv2.undistortPoints` with 500 iterations (OpenCV 5.0).
const OPENCV_UNDISTORTIONS: [([f64; 2], [f64; 2]); 4] = [
    ([10.0, 20.0], [-0.471610418601, -0.33554092262]),
    ([320.0, 240.0], [-0.003408124821, -0.002416174906]),
    ([600.0, 470.0], [0.416454309352, 0.342272434586]),
    ([639.0, 0.0], [0.481556400401, -0.368167454167]),
];

#[test]
fn projects_as_opencv_does() {
    let camera = distorted_camera();
    for (point, pixel) in OPENCV_PROJECTIONS {
        let ours = camera.project(point.into()).expect("in view");
        assert!(
            (ours - DVec2::splat(0.5)).distance(pixel.into()) < 1e-6,
            "{point:?}: {ours} against {pixel:?}"
        );
    }
}

#[test]
fn undistorts_as_opencv_does() {
    let camera = distorted_camera();
    for (pixel, ideal) in OPENCV_UNDISTORTIONS {
        let ours = camera.undistort(DVec2::from(pixel) + 0.5).expect("inside the image");
        assert!(ours.distance(ideal.into()) < 1e-9, "{pixel:?}: {ours} against {ideal:?}");
    }
}

#[test]
fn points_beyond_the_fold_are_not_seen() {
    // With k1 = -0.2 alone, r (1 - 0.2 r²) grows up to r = sqrt(1 / 0.6) = 1.291 and there is 0.8607.
    let intrinsics = Intrinsics {
        distortion: [-0.2, 0.0, 0.0, 0.0, 0.0],
        ..Intrinsics::from_focal(640, 480, 700.0).expect("a good camera")
    };
    let camera = Camera::new(intrinsics, DMat3::IDENTITY, DVec3::ZERO).expect("a good camera");
    assert!(camera.project_from_camera(DVec3::new(1.290, 0.0, 1.0)).is_some());
    assert_eq!(camera.project_from_camera(DVec3::new(1.292, 0.0, 1.0)), None);
    assert!(camera.undistort(DVec2::new(320.0 + 700.0 * 0.8605, 240.0)).is_some());
    assert_eq!(camera.undistort(DVec2::new(320.0 + 700.0 * 0.8610, 240.0)), None);
}

#[test]
fn points_behind_the_camera_are_not_seen() {
    let camera = distorted_camera();
    let behind = camera.centre_world() - camera.ray(DVec2::new(320.0, 240.0)).expect("in view").direction;
    assert_eq!(camera.project(behind), None);
    assert_eq!(camera.project(DVec3::NAN), None);
}

#[test]
fn an_upright_camera_sees_up_as_up() {
    let intrinsics = Intrinsics::from_horizontal_fov(640, 480, 60f64.to_radians()).expect("a good camera");
    assert!((intrinsics.focal_px[0] - 554.2562584220407).abs() < 1e-9); // 320 / tan 30°
    let camera = Camera::upright(intrinsics, 1.5, 0.1).expect("a good camera");
    assert!(camera.centre_world().distance(DVec3::new(0.0, 0.0, 1.5)) < 1e-12);
    let feet = camera.project(DVec3::new(0.0, 4.0, 0.0)).expect("in view");
    let head = camera.project(DVec3::new(0.0, 4.0, 1.8)).expect("in view");
    let east = camera.project(DVec3::new(1.0, 4.0, 1.0)).expect("in view");
    assert!(feet.y > head.y && (feet.x - 320.0).abs() < 1e-9 && (head.x - 320.0).abs() < 1e-9);
    assert!(east.x > 320.0);
    let floor = camera.ray(feet).expect("in view").at_height(0.0).expect("the ray goes down");
    assert!(floor.distance(DVec3::new(0.0, 4.0, 0.0)) < 1e-9);
    assert_eq!(camera.ray(head).expect("in view").at_height(0.0), None);
}

#[test]
fn scaling_keeps_corners() {
    let camera = distorted_camera();
    let half = camera.scaled(0.37); // 236.8 x 177.6 pixels become 237 x 178
    assert_eq!((half.intrinsics().width, half.intrinsics().height), (237, 178));
    for (point, pixel) in OPENCV_PROJECTIONS {
        let expected = (DVec2::from(pixel) + 0.5) * DVec2::new(237.0 / 640.0, 178.0 / 480.0);
        assert!(half.project(point.into()).expect("in view").distance(expected) < 1e-6);
    }
}

#[test]
fn says_what_is_wrong() {
    let good = *distorted_camera().intrinsics();
    let message = |intrinsics, rotation, translation| {
        Camera::new(intrinsics, rotation, translation).expect_err("a bad camera").to_string()
    };
    assert_eq!(
        message(Intrinsics { focal_px: [-3.0, 7.0], ..good }, DMat3::IDENTITY, DVec3::ZERO),
        "focal length is [-3.0, 7.0] px, expected two positive numbers"
    );
    assert_eq!(
        message(Intrinsics { height: 0, ..good }, DMat3::IDENTITY, DVec3::ZERO),
        "image size is 640 x 0, expected at least 1 x 1 pixels"
    );
    assert_eq!(
        message(good, DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.0)), DVec3::ZERO),
        "rotation is [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]] with determinant 0.000, \
         expected orthonormal rows with determinant 1 ± 0.001"
    );
    assert!(message(good, DMat3::from_diagonal(DVec3::NEG_ONE), DVec3::ZERO).contains("determinant -1.000"));
    assert!(message(good, DMat3::from_diagonal(DVec3::splat(f64::NAN)), DVec3::ZERO).contains("NaN"));
    assert!(message(good, DMat3::IDENTITY, DVec3::NAN).starts_with("translation is [NaN"));
    assert_eq!(
        Camera::look_at(good, DVec3::ZERO, DVec3::Z).expect_err("vertical").to_string(),
        "camera at [0.0, 0.0, 0.0] looks at [0.0, 0.0, 1.0], expected a direction that is not vertical"
    );
    assert_eq!(
        Intrinsics::from_horizontal_fov(640, 480, f64::NAN).expect_err("no angle").to_string(),
        "field of view is NaN rad, expected more than 0 and less than pi"
    );
}

proptest! {
    #[test]
    fn rays_go_through_the_points_of_their_pixels(
        k1 in -0.4..0.4f64, k2 in -0.2..0.2f64, k3 in -0.1..0.1f64, p1 in -0.005..0.005f64, p2 in -0.005..0.005f64,
        axis in prop::array::uniform3(-1.0..1.0f64), angle in -3.0..3.0f64,
        x in -0.55..0.55f64, y in -0.45..0.45f64, depth in 0.3..9.0f64,
    ) {
        let intrinsics = Intrinsics { distortion: [k1, k2, p1, p2, k3], ..*distorted_camera().intrinsics() };
        let rotation = DQuat::from_axis_angle((DVec3::from(axis) + 1.1 * DVec3::Z).normalize(), angle);
        let camera = Camera::new(intrinsics, DMat3::from_quat(rotation), DVec3::new(0.3, -0.2, 2.0)).unwrap();
        let point_camera = DVec3::new(x * depth, y * depth, depth);
        let point_world = camera.camera_from_world().inverse().transform_point3(point_camera);
        if let Some(pixel) = camera.project(point_world) {
            let ray = camera.ray(pixel).expect("a projected point has a ray");
            let along = (point_world - ray.origin).dot(ray.direction);
            prop_assert!((ray.origin + along * ray.direction).distance(point_world) < 1e-8 * depth);
        } else {
            prop_assert!(x.hypot(y) > 0.6, "a lens of mild distortion folded over at {x}, {y}");
        }
    }

    #[test]
    fn undistortion_never_invents(k in prop::array::uniform5(-2.0..2.0f64), x in -3000.0..3000.0f64, y in -3000.0..3000.0f64) {
        let intrinsics = Intrinsics { distortion: k, ..*distorted_camera().intrinsics() };
        let camera = Camera::new(intrinsics, DMat3::IDENTITY, DVec3::ZERO).unwrap();
        if let Some(ideal) = camera.undistort(DVec2::new(x, y)) {
            let back = camera.project_from_camera(ideal.extend(1.0)).expect("inside the fold");
            prop_assert!(back.distance(DVec2::new(x, y)) < 1e-6);
        }
    }
}
