use std::path::{Path, PathBuf};

use glam::{DMat3, DVec2, DVec3};

use super::*;

const TOML: &str = "\
name = \"cam\"
image_size = [1088, 1920]
fps = 60.0
focal_px = [1675.25, 1675.5]
principal_point_px = [540.0, 964]
distortion = [0.1, -0.2, 0.001, 0.002, 0.03]
rotation = [[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]]
translation_m = [0.5, 0.25, 4.5]
";

/// Written by `cv2.FileStorage` (OpenCV 5.0; its version 4 begins with `%YAML:1.0`).
const OPENCV_YAML: &str = "\
%YAML:1.0
---
calibration_time: \"Sun Nov 22 05:46:07 2026\"
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 704.20000000000005, 0., 322.39999999999998, 0.,
       703.60000000000002, 241.69999999999999, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ -0.20999999999999999, 0.089999999999999997,
       0.0011000000000000001, -0.00069999999999999999,
       0.012999999999999999 ]
rvec: !!opencv-matrix
   rows: 3
   cols: 1
   dt: d
   data: [ 0.29999999999999999, -1.1000000000000001, 0.40000000000000002 ]
tvec: !!opencv-matrix
   rows: 3
   cols: 1
   dt: d
   data: [ 0.20000000000000001, -0.29999999999999999, 4.0999999999999996 ]
";

const CAL: &str = "700 710 320 240 0 -0.19 0 0 0 0  1 0 0 0 0 -1 0 1 0  5.5 749 4591";

fn message(name: &str, text: &str) -> String {
    parse_camera(Path::new(name), text).expect_err("a bad file").to_string()
}

#[test]
fn reads_toml() {
    let file = parse_camera(Path::new("camera.toml"), TOML).expect("a good file");
    assert_eq!(file.name.as_deref(), Some("cam"));
    assert_eq!(file.frame_rate_hz, Some(60.0));
    let camera = file.camera().expect("it has a place");
    assert_eq!(
        *camera.intrinsics(),
        Intrinsics {
            width: 1088,
            height: 1920,
            focal_px: [1675.25, 1675.5],
            principal_point_px: [540.5, 964.5],
            distortion: [0.1, -0.2, 0.001, 0.002, 0.03],
        }
    );
    // The rows of the rotation are the camera's axes in the world.
    assert!((camera.rotation() * DVec3::Y).distance(DVec3::X) < 1e-12);
    assert_eq!(camera.translation_m(), DVec3::new(0.5, 0.25, 4.5));
}

#[test]
fn reads_opencv_yaml() {
    let file = parse_camera(Path::new("camera.yml"), OPENCV_YAML).expect("a good file");
    // cv2.projectPoints gives (184.0417, 141.0470), with pixel centres at whole numbers.
    let pixel = file.camera().expect("it has a place").project(DVec3::new(0.5, 0.2, 1.7)).expect("in view");
    assert!(pixel.distance(DVec2::new(184.541669763, 141.547021669)) < 1e-6, "{pixel}");

    let intrinsics_only = &OPENCV_YAML[..OPENCV_YAML.find("rvec").expect("it is there")];
    let file = parse_camera(Path::new("camera.yml"), intrinsics_only).expect("a good file");
    assert_eq!(file.camera(), None);
    assert_eq!(file.intrinsics.principal_point_px, [322.9, 242.2]);
}

#[test]
fn reads_cal_in_millimetres() {
    let file = parse_camera(Path::new("C1.cal"), CAL).expect("a good file");
    assert_eq!(file.intrinsics.principal_point_px, [320.5, 240.5]);
    assert_eq!(file.intrinsics.distortion, [-0.19, 0.0, 0.0, 0.0, 0.0]);
    let place = file.camera_from_world.expect("it has a place");
    assert!(place.translation.distance(DVec3::new(0.0055, 0.749, 4.591)) < 1e-12);
    let rows = DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y).transpose();
    assert!(place.matrix3.abs_diff_eq(rows, 1e-12));
}

#[test]
fn formats_are_known_by_content_too() {
    for (text, format) in [
        (TOML, Format::Toml),
        (OPENCV_YAML, Format::OpenCvYaml),
        (CAL, Format::Cal),
        ("{\"K\": 1}", Format::Json),
    ] {
        assert_eq!(Format::of(Path::new("camera.txt"), text), format);
    }
}

#[test]
fn messages_name_file_field_and_value() {
    let toml = |from: &str, to: &str| {
        assert!(TOML.contains(from), "{from}");
        message("camera.toml", &TOML.replace(from, to))
    };
    assert_eq!(toml("[1675.25, ", "[nan, "), "camera.toml: `focal_px[0]` is NaN, expected a finite number");
    assert_eq!(
        toml("[1675.25, ", "[-1.5, "),
        "camera.toml: `focal_px`: focal length is [-1.5, 1675.5] px, expected two positive numbers"
    );
    assert_eq!(toml("focal_px", "focal"), "camera.toml: `focal_px` is missing");
    assert_eq!(
        toml("0.03]", "\"much\"]"),
        "camera.toml: `distortion[4]` is \"much\", expected a finite number"
    );
    assert_eq!(toml(", 0.03]", "]"), "camera.toml: `distortion` has 4 values, expected 5");
    assert_eq!(
        toml("[1088, ", "[10.5, "),
        "camera.toml: `image_size[0]` is 10.5, expected a whole number of pixels from 1 to 65536"
    );
    assert_eq!(
        toml("0.0, -1.0]", "0.0, inf]"),
        "camera.toml: `rotation[1][2]` is inf, expected a finite number"
    );
    let singular = toml("[0.0, 0.0, -1.0]", "[0.0, 0.0, 0.0]");
    assert!(singular.starts_with("camera.toml: `rotation`: rotation is [[0.0, 1.0, 0.0], "), "{singular}");
    assert!(singular.contains("with determinant 0.000"), "{singular}");
    assert_eq!(toml("name = ", "name "), "camera.toml: is not valid TOML");

    assert_eq!(
        message("a.cal", "1 2 3"),
        "a.cal: has 3 numbers, expected the 22 of fx fy cx cy skew k1 k2 p1 p2 k3 R T"
    );
    assert_eq!(message("a.cal", &CAL.replace("710", "x")), "a.cal: `fy` is \"x\", expected a finite number");
    assert_eq!(message("a.cal", &CAL.replace("240 0", "240 0.5")), "a.cal: `K` has skew 0.5, expected 0");
    assert_eq!(
        message("a.json", r#"{"K": [[7,0,3],[0,7,3],[0,0,1]], "units": "yards", "width": 6, "height": 6}"#),
        "a.json: `units` is \"yards\", expected \"m\" or \"mm\""
    );
    assert_eq!(message("a.yml", &OPENCV_YAML.replace("tvec", "somewhere")), "a.yml: `T` is missing");
    assert_eq!(message("a.yml", "a: [1"), "a.yml: is not valid YAML");
    assert_eq!(message("a.yml", ""), "a.yml: `K` is missing");
    assert_eq!(
        load_camera(Path::new("no/such/camera.toml")).expect_err("no file").to_string(),
        "no/such/camera.toml: cannot read the file"
    );
}

/// The data folder, or `None` after a line that says so.
fn data_folder() -> Option<PathBuf> {
    crate::test_data::folder()
}

#[test]
fn stage_cameras_agree_in_both_formats_and_with_the_stated_centre() {
    let Some(data) = data_folder() else { return };
    // From the `centre` field of the JSON files, millimetres.
    let centres = [
        ("C1", [4134.648, 1504.889, 1510.0]),
        ("C2", [-746.687, -4234.673, 1490.0]),
        ("C3", [-3408.898, 2860.405, 1530.0]),
    ];
    for (name, centre) in centres {
        let folder = data.join("stage/calibration");
        let json = load_camera(&folder.join(format!("{name}.json"))).expect("a good file");
        let cal = load_camera(&folder.join(format!("{name}.cal"))).expect("a good file");
        assert_eq!(json.intrinsics, cal.intrinsics);
        let camera = json.camera().expect("it has a place");
        assert!(camera.centre_world().distance(0.001 * DVec3::from(centre)) < 1e-5);
        assert!(cal.camera().expect("it has a place").centre_world().distance(camera.centre_world()) < 1e-5);
    }
}

#[test]
fn reads_the_camera_of_the_real_clip() {
    let Some(data) = data_folder() else { return };
    let file = load_camera(&data.join("real/balance/camera.toml")).expect("a good file");
    let camera = file.camera().expect("it has a place");
    assert_eq!((camera.intrinsics().width, camera.intrinsics().height), (1088, 1920));
    // -Rᵀ t by numpy.
    assert!(
        camera.centre_world().distance(DVec3::new(-3.76350, -1.40367, 1.86949)) < 1e-4,
        "{}",
        camera.centre_world()
    );
}
