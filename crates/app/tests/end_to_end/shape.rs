//! `umbra shape`: the body of a run.

use std::fs;

use serde_json::Value;

use crate::support::{Answer, QUICK, fixtures, umbra};

/// A quick run over `frames` of the bundled walk.
fn tracked(out: &std::path::Path, frames: &str, more: &[&str]) -> Answer {
    let clip = fixtures().join("stage-mini");
    let mut track = umbra();
    track.arg("track").arg(clip.join("masks")).arg("--masks").arg("--camera").arg(clip.join("C2.json"));
    track.args(["--frames", frames]).args(QUICK).args(more).arg("--out").arg(out);
    Answer::of(&mut track)
}

fn read(path: &std::path::Path) -> Value {
    serde_json::from_slice(&fs::read(path).expect("the file was written")).expect("it is JSON")
}

#[test]
fn a_run_gets_a_body_with_intervals() {
    let folder = tempfile::tempdir().expect("a folder for a test");
    let out = folder.path().join("run");
    let answer = tracked(&out, "0..12", &["--shape", "--per-frame"]).succeeded();
    assert!(answer.stderr.contains("stature"), "{}", answer.stderr);
    let found = read(&out.join("biosignatures.json"));
    let measurements = found["measurements"].as_array().expect("a list");
    let names: Vec<&str> = measurements.iter().map(|m| m["name"].as_str().expect("a name")).collect();
    assert_eq!(names, ["chest", "waist", "hips", "thigh", "calf", "stature", "weight"]);
    for measured in measurements {
        let value = measured["value"].as_f64().expect("a number");
        let [low, high] = [0, 1].map(|end| measured["interval90"][end].as_f64().expect("a number"));
        assert!(0.0 < low && low < value && value < high, "{measured}");
        assert!(measured["definition"].as_str().is_some_and(|text| text.len() > 10));
    }
    // A man of 1.83 m and 97 kg.
    let stature_m = measurements[5]["value"].as_f64().expect("a number");
    assert!((1.70..1.95).contains(&stature_m), "{stature_m}");
    // Twelve frames at 60 Hz show one side: too little to be sure of anything.
    assert!(found["male_probability"].as_f64().is_some_and(|p| (0.01..0.99).contains(&p)), "{found}");
    assert!(found["warnings"].as_array().expect("a list").iter().any(|w| w.to_string().contains("one side")));
    assert_eq!(&fs::read(out.join("body.glb")).expect("body.glb")[..4], b"glTF");
    assert!(fs::read_to_string(out.join("body.obj")).expect("body.obj").starts_with("v "));
    assert_eq!(&fs::read(out.join("body.png")).expect("body.png")[1..4], b"PNG");
    let table = fs::read_to_string(out.join("shape_per_frame.csv")).expect("the table");
    assert!(table.lines().count() > 6, "{table}");

    // What is known tightens the rest.
    let mut again = umbra();
    again.arg("shape").arg(&out).args(["--stature-m", "1.83", "--weight-kg", "96.9"]);
    Answer::of(&mut again).succeeded();
    let known = read(&out.join("biosignatures.json"));
    assert!((known["measurements"][5]["value"].as_f64().expect("a number") - 1.83).abs() < 0.015);
    let sd = |found: &Value, k: usize| found["measurements"][k]["sd"].as_f64().expect("a number");
    assert!(sd(&known, 6) < sd(&found, 6));
}

#[test]
fn a_clip_of_two_frames_has_no_shape_and_says_so() {
    let folder = tempfile::tempdir().expect("a folder for a test");
    let out = folder.path().join("run");
    let answer = tracked(&out, "0..2", &["--shape"]).succeeded();
    assert!(answer.stderr.contains("2 frames show a whole person, expected 4 at least"), "{}", answer.stderr);
    let found = read(&out.join("biosignatures.json"));
    assert_eq!(found["measurements"].as_array().map(Vec::len), Some(0));
    assert!(!out.join("body.obj").exists());
}

#[test]
fn what_is_no_finished_run_is_refused() {
    let folder = tempfile::tempdir().expect("a folder for a test");
    let mut shape = umbra();
    shape.arg("shape").arg(folder.path());
    Answer::of(&mut shape).failed(1, &["holds no run.toml, expected a run folder"]);
    let mut shape = umbra();
    shape.arg("shape").arg(folder.path()).args(["--stature-m", "178"]);
    let answer = Answer::of(&mut shape);
    assert_eq!(answer.status, Some(2));
    assert!(answer.stderr.contains("expected a number from 1.2 to 2.3"), "{}", answer.stderr);
}
