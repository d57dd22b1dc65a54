//! `umbra eval stage` and `umbra train` on a stage-like folder: what they write, and what they cannot use.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use image::GrayImage;
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::support::{Answer, QUICK, contents, fixtures, umbra};

/// The rotations in `segments.csv`. What they are plays no part here: all are the rest pose's.
const SEGMENTS: [&str; 17] = [
    "pelvis",
    "abdomen",
    "thorax",
    "neck",
    "head",
    "upperLArm",
    "lowerLArm",
    "handL",
    "upperLLeg",
    "lowerLLeg",
    "footL",
    "upperRArm",
    "lowerRArm",
    "handR",
    "upperRLeg",
    "lowerRLeg",
    "footR",
];

/// The bundled synthetic walk of 40 frames, twice over, as a data set: 8 frames test, the others train.
struct Stage {
    folder: TempDir,
}

impl Stage {
    fn new() -> Self {
        let stage = Self { folder: TempDir::new().expect("a folder for a test") };
        let clip = fixtures().join("stage-mini");
        for folder in ["calibration", "S1/Walking_1/C2/observed"] {
            fs::create_dir_all(stage.path(folder)).expect("a folder");
        }
        fs::copy(clip.join("C2.json"), stage.path("calibration/C2.json")).expect("a camera");
        let joints = fs::read_to_string(clip.join("joints.csv")).expect("joints");
        let (header, rows) = joints.split_once('\n').expect("lines");
        stage.write("S1/Walking_1/joints.csv", format!("{header}\n{rows}{rows}"));
        for (index, bytes) in contents(&clip.join("masks")).values().enumerate() {
            for frame in [index, index + 40] {
                let mask = format!("S1/Walking_1/C2/observed/{frame:04}.png");
                fs::write(stage.path(&mask), bytes).expect("a mask");
            }
        }
        let header = SEGMENTS.map(|name| ["w", "x", "y", "z"].map(|axis| format!("{name}_{axis}")).join(","));
        let row = ["1,0,0,0"; SEGMENTS.len()].join(",");
        let rows = (0..80).map(|frame| format!("{frame},{row}\n")).collect::<String>();
        stage.write("S1/Walking_1/segments.csv", format!("frame,{}\n{rows}", header.join(",")));
        stage.write("S1/subject.json", json!({ "sex": "male", "stature_mm": 1830.0 }).to_string());
        let sequence = json!({
            "name": "Walking_1", "subject": "S1", "fps": 60, "cameras": ["C2"],
            "test_range": [0, 7], "train_range": [8, 79],
        });
        stage.write("S1/Walking_1/sequence.json", sequence.to_string());
        stage
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, text: String) {
        fs::write(self.path(name), text).expect("a file can be written");
    }

    /// Nobody on the masks numbered `frames`.
    fn empty_masks(&self, frames: std::ops::Range<usize>) {
        for frame in frames {
            let mask = self.path(&format!("S1/Walking_1/C2/observed/{frame:04}.png"));
            GrayImage::new(640, 480).save(mask).expect("a mask can be written");
        }
    }

    fn eval(&self, out: &str) -> Command {
        let mut eval = umbra();
        eval.args(["eval", "stage", "--data"]).arg(self.folder.path()).args(QUICK);
        eval.args(["--seeds", "2", "--frames", "4", "--out"]).arg(self.path(out));
        eval
    }

    fn train(&self, out: &str) -> Command {
        let mut train = umbra();
        train.args([
            "train",
            "--sequence",
            "S1/Walking_1",
            "--views-per-pose",
            "1",
            "--sectors",
            "2",
            "--stage",
        ]);
        train.arg(self.folder.path()).arg("--out").arg(self.path(out));
        train
    }
}

fn report(folder: &Path) -> Value {
    serde_json::from_slice(&fs::read(folder.join("eval.json")).expect("eval.json")).expect("it is JSON")
}

#[test]
fn an_evaluation_has_a_row_for_each_tracker_and_its_plots() {
    let stage = Stage::new();
    let answer = Answer::of(stage.eval("eval").args(["--methods", "apf,jpf"])).succeeded();
    assert!(answer.stdout.contains("| S1 Walking | C2 | observed | JPF |"), "{}", answer.stdout);
    let report = report(&stage.path("eval"));
    let rows = report["rows"].as_array().expect("rows");
    assert_eq!(
        rows.iter().map(|row| row["method"].as_str().expect("text")).collect::<Vec<_>>(),
        ["apf", "jpf"]
    );
    for row in rows {
        assert_eq!([&row["subject"], &row["activity"], &row["camera"]], ["S1", "Walking", "C2"]);
        assert_eq!(row["masks"], "observed");
        let seeds = row["seeds"].as_array().expect("seeds");
        assert_eq!(seeds.len(), 2);
        for key in ["root_mm", "abs_mm", "aligned_mm", "euler_deg", "geodesic_deg", "lost"] {
            let number = |of: &Value| of[key].as_f64().unwrap_or_else(|| panic!("`{key}` is no number"));
            let values = [number(&seeds[0]), number(&seeds[1])];
            assert!((number(row) - (values[0] + values[1]) / 2.0).abs() < 1e-9, "{key}");
            let spread = (values[0] - values[1]).abs() / 2.0_f64.sqrt();
            assert!((number(&row["spread"]) - spread).abs() < 1e-9, "{key}");
        }
        assert!(row["root_mm"].as_f64().is_some_and(|error| (5.0..400.0).contains(&error)), "{row}");
        assert!(row["aligned_mm"].as_f64() <= row["root_mm"].as_f64());
    }
    for plot in ["coverage.svg", "coverage.png"] {
        assert!(stage.path("eval").join(plot).is_file(), "{plot}");
    }
}

#[test]
fn shipped_models_are_scored_without_training() {
    let stage = Stage::new();
    stage.empty_masks(0..2);
    let answer = Answer::of(stage.eval("eval").args(["--train", "none"])).succeeded();
    assert!(answer.stderr.contains("opf is left out"), "{}", answer.stderr);
    let rows = report(&stage.path("eval"))["rows"].clone();
    let methods: Vec<&str> =
        rows.as_array().expect("rows").iter().map(|row| row["method"].as_str().expect("text")).collect();
    assert_eq!(methods, ["apf", "jpf", "jlm"]);
    assert_eq!(rows[1]["lost"], 2.0, "nobody is seen on the first two frames");
    Answer::of(stage.eval("none").args(["--train", "none", "--methods", "opf"]))
        .failed(1, &["`methods` is opf, expected apf, jpf or jlm"]);

    // A camera above all that the models know: said, and done without them.
    let camera = fs::read_to_string(stage.path("calibration/C2.json")).expect("a camera");
    let mut camera: Value = serde_json::from_str(&camera).expect("JSON");
    for row in 0..3 {
        let t = camera["T"][row].as_f64().expect("a number");
        camera["T"][row] = json!(t * 3.0);
    }
    stage.write("calibration/C2.json", camera.to_string());
    let answer = Answer::of(stage.eval("high").args(["--train", "none", "--methods", "jpf"])).succeeded();
    assert!(
        answer.stderr.contains("S1 Walking: nothing of the pose from a single mask"),
        "{}",
        answer.stderr
    );
}

#[test]
fn training_is_the_same_on_any_number_of_threads_and_goes_on_where_it_stopped() {
    let stage = Stage::new();
    let model = |out: &str| fs::read(stage.path(out).join("S1-Walking_1.bin")).expect("a model");
    for (out, threads) in [("one", "1"), ("two", "2")] {
        Answer::of(stage.train(out).env("RAYON_NUM_THREADS", threads)).succeeded();
    }
    assert!(model("one") == model("two"));
    // A model of `Walking` is one of the activity `walk`.
    let mut track = umbra();
    track
        .arg("track")
        .arg(stage.path("S1/Walking_1/C2/observed"))
        .args(["--masks", "--frames", "0..2"])
        .args(QUICK);
    track.arg("--camera").arg(stage.path("calibration/C2.json")).args(["--activity", "walk", "--predictor"]);
    track.arg(stage.path("one/S1-Walking_1.bin")).arg("--out").arg(stage.path("run"));
    Answer::of(&mut track).succeeded();
    let again = Answer::of(&mut stage.train("one")).succeeded();
    assert!(again.stderr.contains("S1-Walking_1.bin: there already"), "{}", again.stderr);
    assert!(model("one") == model("two"));
    // What was cut short is no model, and what learned from other frames is not this one.
    fs::write(stage.path("one/S1-Walking_1.bin"), &model("two")[..1000]).expect("a file");
    Answer::of(&mut stage.train("one"))
        .failed(1, &["S1-Walking_1.bin: not a predictor of poses: the file has 1000 bytes, expected "]);
    let sequence = fs::read_to_string(stage.path("S1/Walking_1/sequence.json")).expect("a sequence");
    stage.write("S1/Walking_1/sequence.json", sequence.replace("[8,79]", "[10,79]"));
    Answer::of(&mut stage.train("two")).failed(
        1,
        &["S1-Walking_1.bin: `training.notice` is \"frames 8 to 79 of S1 Walking, observed masks of camera C2\", expected \"frames 10 to 79"],
    );
}

#[test]
fn what_cannot_be_trained_on_is_named() {
    let stage = Stage::new();
    stage.empty_masks(0..80);
    Answer::of(&mut stage.train("models"))
        .failed(1, &["S1/Walking_1: no training frame with a person and valid joints, expected some"]);
    Answer::of(stage.eval("eval").args(["--train", "none"]))
        .failed(1, &["S1/Walking_1: nobody on any of 4 masks"]);

    let sequence = fs::read_to_string(stage.path("S1/Walking_1/sequence.json")).expect("a sequence");
    for (from, to, part) in [
        ("\"fps\":60", "\"fps\":0", "sequence.json: `fps` is 0, expected 1 to 1000"),
        (
            "[8,79]",
            "[8,90]",
            "sequence.json: `train_range` is [8, 90], expected first and last of the 80 frames in joints.csv",
        ),
    ] {
        assert!(sequence.contains(from), "{sequence}");
        stage.write("S1/Walking_1/sequence.json", sequence.replace(from, to));
        Answer::of(&mut stage.train("models")).failed(1, &[part]);
    }
    stage.write("S1/Walking_1/sequence.json", sequence);

    let joints = fs::read_to_string(stage.path("S1/Walking_1/joints.csv")).expect("joints");
    let (header, rest) = joints.split_once('\n').expect("lines");
    let damaged = rest.replacen("1327.45", "NaN", 1);
    stage.write("S1/Walking_1/joints.csv", format!("{header}\n{damaged}"));
    let parts = ["joints.csv: line 2: `torsoProximal_x` is \"NaN\", expected a finite number"];
    Answer::of(&mut stage.train("models")).failed(1, &parts);
    Answer::of(&mut stage.eval("eval")).failed(1, &parts);

    let nothing = stage.path("nothing");
    fs::create_dir(&nothing).expect("a folder");
    let mut train = umbra();
    train.args(["train", "--sequence", "S1/Walking_1", "--stage"]).arg(&nothing);
    Answer::of(train.arg("--out").arg(stage.path("models")))
        .failed(1, &["sequence.json: cannot read the file"]);
    let mut train = umbra();
    train.args(["train", "--recordings"]).arg(&nothing);
    Answer::of(train.arg("--out").arg(stage.path("models"))).failed(1, &["nothing/index.csv: "]);
    assert!(!stage.path("models").exists(), "nothing was begun");
}
