//! Masks of real and rendered clips against their reference; needs the data folder and the `ffmpeg` program.

#![expect(clippy::unwrap_used, clippy::print_stdout, reason = "a test panics and prints")]

use std::path::{Path, PathBuf};
use std::process::Command;

use silhouette::background::{MixtureConfig, MixtureModel, MixtureParams, StaticModel, TemporalMedian};
use silhouette::{BackgroundModel, Geometry, Mask, RgbView, Segmenter, SegmenterConfig, SegmenterParams};

/// The data folder, unless it or `ffmpeg` is missing and nobody insists.
fn data_folder() -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let folder = std::env::var_os("UMBRA_DATA").map_or_else(beside, PathBuf::from);
    let has_ffmpeg = Command::new("ffmpeg").arg("-version").output().is_ok();
    let missing = match (folder.is_dir(), has_ffmpeg) {
        (true, true) => return Some(folder),
        (false, _) => "no data folder",
        (true, false) => "no ffmpeg",
    };
    assert!(std::env::var("UMBRA_REQUIRE_DATA").as_deref() != Ok("1"), "{missing}, but UMBRA_REQUIRE_DATA=1");
    println!("SKIPPED: {missing}");
    None
}

/// Every `step`-th frame of a video, picture or numbered pictures, in `pixel_format`.
fn decode(path: &Path, step: usize, pixel_format: &str, bytes_per_frame: usize) -> Vec<Vec<u8>> {
    let select = format!("select=not(mod(n\\,{step}))");
    let output = Command::new("ffmpeg")
        .args(["-v", "error", "-i"])
        .arg(path)
        .args(["-vf", &select, "-fps_mode", "passthrough", "-pix_fmt", pixel_format, "-f", "rawvideo", "-"])
        .output()
        .expect("ffmpeg answered a moment ago");
    assert!(output.status.success(), "{}: {}", path.display(), String::from_utf8_lossy(&output.stderr));
    output.stdout.chunks_exact(bytes_per_frame).map(<[u8]>::to_vec).collect()
}

fn segmenter(model: impl BackgroundModel + 'static) -> Segmenter {
    Segmenter::new(
        SegmenterParams::new(SegmenterConfig::default()).expect("the defaults hold"),
        Box::new(model),
    )
}

#[test]
fn rendered_clip_agrees_with_its_exact_masks() {
    const STEP: usize = 12;
    const SIZE: (u32, u32) = (640, 480);
    let Some(data) = data_folder() else { return };
    let n_pixels = (SIZE.0 * SIZE.1) as usize;
    let sequence = data.join("stage/S1/Walking_1");
    let view = |data: &'static [u8]| RgbView::new(SIZE.0, SIZE.1, data).unwrap();
    let load = |name: &str, step| -> &'static [Vec<u8>] {
        decode(&sequence.join(name), step, "rgb24", 3 * n_pixels).leak()
    };
    let plate = load("rgb/background.png", 1);
    let empty = load("rgb/background.mp4", 2);
    let frames = load("rgb/C2.mp4", STEP);
    let exact: Vec<Mask> = decode(&sequence.join("C2/clean/%04d.png"), STEP, "gray", n_pixels)
        .iter()
        .map(|pixels| Mask::from_gray8(SIZE.0, SIZE.1, pixels, 128))
        .collect();
    let geometry = Geometry::for_frames(SIZE.0, SIZE.1);
    let mean_iou = |mut segmenter: Segmenter| {
        let ious = frames.iter().zip(&exact).map(|(frame, exact)| {
            let mask = segmenter.segment(&view(frame)).unwrap().mask;
            mask.iou(exact)
        });
        ious.sum::<f64>() / frames.len() as f64
    };
    let mut median = TemporalMedian::new(geometry);
    frames.iter().for_each(|frame| median.push(&view(frame)));
    let mut mixture = MixtureModel::new(MixtureParams::new(MixtureConfig::default()).unwrap(), geometry);
    frames.iter().for_each(|frame| mixture.learn_view(&view(frame)));
    let results = [
        ("plate", mean_iou(segmenter(StaticModel::from_plate(&view(&plate[0]), geometry)))),
        ("empty frames", {
            let views = empty.iter().map(|frame| view(frame));
            mean_iou(segmenter(StaticModel::from_empty_frames(views, geometry).unwrap()))
        }),
        ("median of the clip", mean_iou(segmenter(median.finish().unwrap()))),
        ("mixture learned from the clip", mean_iou(segmenter(mixture))),
    ];
    for (model, iou) in results {
        println!("{model}: mean intersection over union {iou:.4}");
        assert!(iou >= 0.95, "{model}: {iou}");
    }
}

#[test]
fn real_clip_holds_the_reference_joints() {
    const STEP: usize = 5;
    const SIZE: (u32, u32) = (1088, 1920);
    let Some(data) = data_folder() else { return };
    let folder = data.join("real/balance");
    let bytes = (3 * SIZE.0 * SIZE.1) as usize;
    let plate = decode(&folder.join("background.png"), 1, "rgb24", bytes).remove(0);
    let frames = decode(&folder.join("video.mp4"), STEP, "rgb24", bytes);
    let joints = projected_joints(&folder);
    let geometry = Geometry::for_frames(SIZE.0, SIZE.1);
    let plate = RgbView::new(SIZE.0, SIZE.1, &plate).unwrap();
    let mut segmenter = segmenter(StaticModel::from_plate(&plate, geometry));
    let (mut n_inside, mut n_joints) = (0, 0);
    for (index, frame) in frames.iter().enumerate() {
        let mask = segmenter.segment(&RgbView::new(SIZE.0, SIZE.1, frame).unwrap()).unwrap().mask;
        for (_, [x, y]) in joints.iter().filter(|(frame, _)| *frame == index * STEP) {
            n_joints += 1;
            n_inside += usize::from(mask.get_or_background(x.floor() as i64, y.floor() as i64));
        }
        // A clean person of this clip covers 6 to 9 % of the picture.
        let share = mask.area() as f64 / f64::from(SIZE.0 * SIZE.1);
        assert!((0.05..0.1).contains(&share), "frame {}: {share}", index * STEP);
    }
    println!("{n_inside} of {n_joints} joints inside");
    assert!(n_joints > 200 && n_inside as f64 >= 0.97 * n_joints as f64, "{n_inside} of {n_joints}");
}

/// The reference joints without the feet: frame and position in the picture, pixels.
fn projected_joints(folder: &Path) -> Vec<(usize, [f64; 2])> {
    let text = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
    let camera: toml::Table = text("camera.toml").parse().unwrap();
    let numbers = |value: &toml::Value| -> Vec<f64> {
        value.as_array().unwrap().iter().map(|number| number.as_float().unwrap()).collect()
    };
    let [focal, center, translation] =
        ["focal_px", "principal_point_px", "translation_m"].map(|key| numbers(&camera[key]));
    let rotation: Vec<Vec<f64>> = camera["rotation"].as_array().unwrap().iter().map(numbers).collect();
    let csv = text("joints3d.csv");
    let rows = csv.lines().skip(1).map(|line| line.split(',').collect::<Vec<_>>());
    rows.filter(|row| !row[2].is_empty() && !["Toe", "Heel"].iter().any(|part| row[1].contains(part)))
        .map(|row| {
            let world: Vec<f64> = row[2..5].iter().map(|number| number.parse().unwrap()).collect();
            let camera: Vec<f64> = (0..3)
                .map(|axis| translation[axis] + (0..3).map(|k| rotation[axis][k] * world[k]).sum::<f64>())
                .collect();
            // The file's pixel centres are at whole numbers.
            let image = [0, 1].map(|axis| focal[axis] * camera[axis] / camera[2] + center[axis] + 0.5);
            (row[0].parse().unwrap(), image)
        })
        .collect()
}
