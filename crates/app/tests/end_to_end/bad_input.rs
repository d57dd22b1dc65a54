//! Input that cannot be used: one message with file, field, value and what was expected, and a documented exit status.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use image::{GrayImage, RgbImage};

use crate::support::{
    Answer, CAMERA, Clip, HEIGHT, WIDTH, assert_same_contents, contents, fixtures, nobody, table,
    track_assumed, umbra, video,
};

/// The clip with its camera file changed: every `from` becomes `to`.
fn with_camera(from: &str, to: &str) -> Clip {
    let clip = Clip::of_balance(1);
    assert!(CAMERA.contains(from));
    clip.write("camera.toml", CAMERA.replace(from, to));
    clip
}

#[test]
fn exit_statuses_are_documented() {
    let help = Answer::of(umbra().arg("--help")).succeeded();
    for part in ["0 done", "1 the input", "2 the command line", "3 no frame shows a person", "4 the results"]
    {
        assert!(help.stdout.contains(part), "{part:?} is missing:\n{}", help.stdout);
    }
}

#[test]
fn missing_and_unreadable_files() {
    let clip = Clip::of_balance(1);
    let missing = |path: &str| clip.path(path).display().to_string();
    Answer::of(&mut track_assumed(&clip.path("no.mp4"), &clip.path("run")))
        .failed(1, &[&missing("no.mp4"), "cannot open"]);
    Answer::of(&mut clip.track_input("no-folder", "run")).failed(1, &[&missing("no-folder"), "cannot open"]);
    Answer::of(umbra().arg("info").arg(clip.path("no-run")))
        .failed(1, &[&missing("no-run"), "expected a run folder"]);

    let no_camera = ["--camera", &missing("no.toml")];
    let mut track = umbra();
    track
        .arg("track")
        .arg(clip.path("masks"))
        .arg("--masks")
        .args(no_camera)
        .arg("--out")
        .arg(clip.path("run"));
    Answer::of(&mut track).failed(1, &[&missing("no.toml"), "cannot read the file"]);

    clip.paint_frames("png");
    let mut track = clip.track_input("frames", "run");
    track.arg("--background").arg(clip.path("no.png"));
    Answer::of(&mut track).failed(1, &[&missing("no.png"), "cannot read the image"]);
    Answer::of(clip.track("run").args(["--config", &missing("no-settings.toml")]))
        .failed(1, &[&missing("no-settings.toml")]);

    clip.write("frames/0000.png", "no picture");
    Answer::of(&mut track_assumed(&clip.path("frames"), &clip.path("run")))
        .failed(1, &["0000.png", "cannot read the image"]);
    assert!(!clip.path("run").exists(), "nothing was begun");
}

#[test]
fn videos_that_are_none() {
    let clip = Clip::of_balance(0);
    let refused = |name: &str, bytes: &[u8], parts: &[&str]| {
        let file = clip.write(name, bytes);
        let mut track = track_assumed(&file, &clip.path("run"));
        // Without ffmpeg, so that the answer is the same everywhere.
        Answer::of(track.env("PATH", "")).failed(1, &[&[name], parts].concat());
    };
    refused("empty.mp4", b"", &["the file is empty, expected a video"]);
    refused("text.avi", b"these are words", &["ffmpeg"]);
    let whole = fs::read(video("clip.mp4")).expect("a video");
    refused("no-index.mp4", &whole[..500], &["cannot read the MP4 index", "cut off"]);
    // Durations of no frame at all, though there are 12: the parser panics on it.
    let durations = whole.windows(4).position(|name| name == b"stts").expect("the table of durations");
    let mut damaged = whole;
    damaged[durations + 11] = 0;
    refused("damaged.mp4", &damaged, &["cannot read the MP4 index", "contradict"]);
    assert!(!clip.path("run").exists(), "nothing was begun");
}

#[test]
fn a_truncated_video_is_tracked_as_far_as_it_goes() {
    let clip = Clip::of_balance(0);
    let whole = fs::read(video("walker.mp4")).expect("a video");
    let cut = clip.write("cut.mp4", &whole[..whole.len() * 6 / 10]);
    Answer::of(&mut track_assumed(&cut, &clip.path("run")))
        .failed(1, &["frames, which are kept", "cut.mp4: frame ", "the file ends at byte"]);
    let rows = table(&clip.path("run/poses.csv"));
    assert!((3..16).contains(&rows.len()), "{} frames", rows.len());
    let info = Answer::of(umbra().arg("info").arg(clip.path("run"))).succeeded();
    assert!(info.stdout.contains("cut short: ") && info.stdout.contains("cut.mp4"), "{}", info.stdout);
    assert!(clip.path("run/run.mcap").is_file() && clip.path("run/filmstrip.png").is_file());
}

#[test]
fn no_frames() {
    let clip = Clip::of_balance(0);
    fs::create_dir(clip.path("frames")).expect("a folder");
    Answer::of(&mut clip.track("run")).failed(1, &["masks: holds 0 frames, expected files *.png"]);
    Answer::of(&mut clip.track_input("frames", "run"))
        .failed(1, &["frames: holds 0 frames, expected files *.png, *.jpg, *.jpeg"]);
    let clip = Clip::of_balance(2);
    Answer::of(clip.track("run").args(["--frames", "2..9"]))
        .failed(1, &["masks: `frames` begins at 2, expected less than 2"]);
    assert!(!clip.path("run").exists(), "nothing was begun");
}

#[test]
fn frames_of_changing_size_end_a_run_that_is_kept() {
    let clip = Clip::of_balance(6);
    GrayImage::new(WIDTH + 1, HEIGHT).save(clip.path("masks/0004.png")).expect("a mask can be written");
    let expected = ["4 frames, which are kept", "0004.png: is 273x480, expected 272x480 as the first frame"];
    Answer::of(&mut clip.track("run")).failed(1, &expected);
    assert_eq!(table(&clip.path("run/poses.csv")).len(), 4);
}

#[test]
fn a_plate_of_another_size() {
    let clip = Clip::of_balance(1);
    clip.paint_frames("png");
    RgbImage::new(WIDTH, 479).save(clip.path("plate.png")).expect("a plate can be written");
    let mut track = clip.track_input("frames", "run");
    track.arg("--background").arg(clip.path("plate.png"));
    Answer::of(&mut track).failed(1, &["plate.png: the background has 272 x 479 pixels, expected 272 x 480"]);
}

#[test]
fn cameras_that_cannot_be() {
    for (from, to, parts) in [
        ("[272, 480]", "[270, 480]", &["`image_size` is 270 x 480, expected 272 x 480"][..]),
        ("[0.829049219, 0.418270777, -0.371115817]", "[0.0, 0.0, 0.0]", &["`rotation`", "expected"]),
        ("fps = 60.0", "fps = nan", &["`fps`", "NaN", "expected"]),
        ("fps = 60.0", "fps = 0.0", &["`fps` is 0, expected a number above 0"]),
        ("[418.80875, 418.80106]", "[nan, 418.8]", &["`focal_px", "NaN", "expected"]),
        ("[418.80875, 418.80106]", "[-418.8, 418.8]", &["`focal_px`", "-418.8", "expected"]),
        ("translation_m = ", "translation = ", &["translation_m"]),
        ("focal_px = [418.80875, 418.80106]\n", "", &["`focal_px`"]),
        ("image_size = [272, 480]", "image_size = [272, 480", &["is not valid TOML"]),
    ] {
        let clip = with_camera(from, to);
        Answer::of(&mut clip.track("run")).failed(1, &[&["camera.toml: "], parts].concat());
        assert!(!clip.path("run").exists(), "nothing was begun");
    }
    let clip = Clip::of_balance(1);
    for (option, value) in [("--focal-px", "0"), ("--focal-px", "nan"), ("--fov-deg", "180")] {
        let mut track = umbra();
        track
            .arg("track")
            .arg(clip.path("masks"))
            .args(["--masks", option, value])
            .arg("--out")
            .arg(clip.path("run"));
        let shown = if value == "nan" { "NaN" } else { value };
        Answer::of(&mut track).failed(1, &[&format!("`{option}` is {shown}"), "expected"]);
    }
    let mut track = umbra();
    Answer::of(track.arg("track").arg(clip.path("masks")).arg("--masks").arg("--out").arg(clip.path("run")))
        .failed(1, &["no camera", "--camera FILE", "--focal-px", "--fov-deg"]);
}

#[test]
fn results_that_cannot_be_right_come_with_a_warning() {
    let warning = "warning: body and mask hardly agree";
    let aside = with_camera("[134.65155, 240.63257]", "[1e9, 240.63257]");
    let answer = Answer::of(&mut aside.track("run")).succeeded();
    assert!(answer.stderr.contains(warning), "{}", answer.stderr);
    assert!(answer.stderr.contains("tracked 0 of 1 frames"), "{}", answer.stderr);
    let fitting = Answer::of(&mut Clip::of_balance(1).track("run")).succeeded();
    assert!(!fitting.stderr.contains(warning), "{}", fitting.stderr);
    assert!(fitting.stderr.contains("tracked 1 of 1 frames (0 coasting, 0 lost)"), "{}", fitting.stderr);
}

#[test]
fn what_is_odd_about_masks_is_said() {
    let clip = Clip::of_balance(4);
    fs::remove_file(clip.path("masks/0001.png")).expect("a mask");
    let answer = Answer::of(&mut clip.track("gap")).succeeded();
    assert!(
        answer.stderr.contains("assumed: one frame after the other though 0002 follows 0000"),
        "{}",
        answer.stderr
    );
    let mut inverted = crate::support::silhouette(0);
    inverted.pixels_mut().for_each(|pixel| pixel.0[0] = 255 - pixel.0[0]);
    let clip = Clip::of_masks(&[inverted]);
    let answer = Answer::of(&mut clip.track("run")).succeeded();
    assert!(answer.stderr.contains("a person who fills 9"), "{}", answer.stderr);
}

#[test]
fn settings_out_of_range() {
    let clip = Clip::of_balance(1);
    let bad_file = |name: &str, text: &str, parts: &[&str]| {
        let settings = clip.write(name, text);
        Answer::of(clip.track("run").arg("--config").arg(settings)).failed(1, parts);
    };
    bad_file("nan.toml", "sharpness = nan", &["nan.toml: settings: `sharpness` is NaN, expected 1 to 10000"]);
    bad_file("wide.toml", "stature_m = 5.0", &["`stature_m` is 5, expected 1.2 to 2.3 metres"]);
    bad_file("name.toml", "sharpnes = 3.0", &["name.toml", "sharpnes", "sharpness"]);
    bad_file("text.toml", "sharpness", &["text.toml"]);

    let with = |option: &str, value: &str| {
        let mut track = umbra();
        track.arg("track").arg(clip.path("masks")).args(["--masks", "--focal-px", "420", option, value]);
        Answer::of(track.arg("--out").arg(clip.path("run")))
    };
    with("--particles", "1").failed(1, &["`particles` is 1, expected 2 to 100000"]);
    with("--stature-m", "5").failed(1, &["`stature_m` is 5, expected 1.2 to 2.3 metres"]);
    with("--initial-heading-deg", "-361")
        .failed(1, &["`initial_heading_deg` is -361, expected -360 to 360 degrees"]);
    with("--fps", "0").failed(1, &["`fps` is 0, expected a number above 0"]);
    with("--threads", "0").failed(1, &["`--threads` is 0, expected 1 or more"]);
    with("--save-predictor", &clip.path("masks").display().to_string())
        .failed(1, &["masks: is a folder, expected a file"]);
    with("--frames", "5..3").failed(2, &["'5..3'", "--frames", "with A below B"]);
    with("--motion", "dance").failed(2, &["'dance'", "--motion", "any, captured"]);
    with("--activity", "dance").failed(2, &["'dance'", "--activity", "walk, jog, box, any"]);
    with("--method", "opf").failed(1, &["`method` is opf, expected apf, jpf or jlm"]);
    with("--particles", "many").failed(2, &["'many'", "--particles"]);
    Answer::of(umbra().arg("dance")).failed(2, &["'dance'"]);
    assert!(!clip.path("run").exists(), "nothing was begun");
}

#[test]
fn predictors_that_do_not_fit() {
    let clip = Clip::of_balance(1);
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/predict-walk.bin");
    let bytes = fs::read(&shipped).expect("a shipped model");
    let mut later = bytes.clone();
    later[8] = 9;
    for (name, bytes, part) in [
        ("later.bin", later, "`version` is 9, expected 1".to_owned()),
        ("cut.bin", bytes[..5000].to_vec(), format!("the file has 5000 bytes, expected {}", bytes.len())),
        (
            "text.bin",
            b"no model at all".to_vec(),
            "`magic`: the file does not begin with `UMBRAPRE`".to_owned(),
        ),
    ] {
        let file = clip.write(name, bytes);
        let mut track = clip.track("run");
        Answer::of(track.args(["--activity", "walk"]).arg("--predictor").arg(file)).failed(1, &[name, &part]);
    }
    Answer::of(clip.track("run").args(["--method", "apf"]).arg("--predictor").arg(&shipped))
        .failed(1, &["`method` is apf, expected jpf or jlm with a predictor"]);
    let another = "predict-walk.bin: the model is trained for `walk`, not for `box`";
    Answer::of(clip.track("run").args(["--activity", "box"]).arg("--predictor").arg(&shipped))
        .failed(1, &[another]);
    let high =
        with_camera("[0.508860642, 0.033698945, 4.401038164]", "[1.526581926, 0.101096835, 13.203114492]");
    Answer::of(high.track("run").args(["--activity", "walk"]).arg("--predictor").arg(&shipped)).failed(
        1,
        &["predict-walk.bin: the model is trained for cameras 0.8 to 2.2 m above the floor, this one is at 5.6"],
    );
    assert!(!clip.path("run").exists() && !high.path("run").exists(), "nothing was begun");
}

#[test]
fn nobody_on_any_frame() {
    let clip = Clip::of_masks(&[nobody(), nobody(), nobody()]);
    Answer::of(&mut clip.track("run")).failed(3, &["masks: none of the 3 frames shows a person"]);
    assert!(!clip.path("run").exists(), "nothing came of it");
}

#[test]
fn output_folders_in_use() {
    let clip = Clip::of_balance(1);
    fs::create_dir(clip.path("notes")).expect("a folder");
    let note = clip.write("notes/note.txt", "mine");
    for how in [&[][..], &["--force"], &["--resume"]] {
        Answer::of(clip.track("notes").args(how))
            .failed(1, &["notes: holds other files than a run, expected a new or empty folder"]);
    }
    Answer::of(&mut clip.track("masks")).failed(1, &["masks: holds other files"]);
    Answer::of(&mut clip.track("notes/note.txt")).failed(1, &["note.txt: cannot use it as a run folder"]);
    assert_eq!(fs::read_to_string(&note).expect("the note"), "mine");
    assert_eq!(contents(&clip.path("notes")).len(), 1);
}

/// No file may grow past the limit, as on a disk that is full.
#[cfg(unix)]
#[test]
fn a_full_disk_loses_nothing() {
    let clip = Clip::of_balance(14);
    let whole = clip.path("whole");
    Answer::of(&mut clip.track("whole")).succeeded();
    let track = clip.track("run");
    // The least unit of a limit is 512 bytes or 1 KiB, as the shell has it: the journal or an overlay is the first past it.
    let mut limited = Command::new("sh");
    limited
        .args(["-c", "trap '' XFSZ; ulimit -f 64; exec \"$@\"", "sh"])
        .arg(track.get_program())
        .args(track.get_args());
    Answer::of(&mut limited).failed(4, &["run/", ": cannot write the file: "]);
    let kept: Vec<PathBuf> = contents(&clip.path("run")).into_keys().collect();
    assert!(kept.iter().all(|name| !name.to_string_lossy().ends_with(".part")), "{kept:?}");

    let info = Answer::of(umbra().arg("info").arg(clip.path("run"))).succeeded();
    assert!(info.stdout.contains("track again with --resume"), "{}", info.stdout);
    Answer::of(clip.track("run").arg("--resume")).succeeded();
    assert_same_contents(&whole, &clip.path("run"));
}

#[test]
fn training_options_out_of_range() {
    let train =
        |options: &[&str]| Answer::of(umbra().args(["train", "--sequence", "S1/Walking_1"]).args(options));
    train(&["--pose-dim", "53"]).failed(2, &["53", "--pose-dim", "1..=52"]);
    train(&["--experts", "0"]).failed(2, &["--experts", "1..=32"]);
    train(&["--sectors", "100000"]).failed(2, &["--sectors", "1..=64"]);
    Answer::of(umbra().args(["train", "--validate"])).failed(2, &["--sequence"]);
    Answer::of(umbra().args(["eval", "stage", "--method", "jlm"]))
        .failed(1, &["`--method`", "expected `--methods`"]);
    Answer::of(umbra().args(["eval", "stage", "--recovery", "--frames", "3", "--data"]).arg(fixtures()))
        .failed(1, &["`frames` is 3, expected 110 or more for `recovery`"]);
}

#[test]
fn evaluation_without_its_data() {
    let folder = tempfile::tempdir().expect("a folder for a test");
    let eval = |data: &Path| {
        let mut command = umbra();
        command
            .args(["eval", "real", "--seeds", "1", "--data"])
            .arg(data)
            .arg("--out")
            .arg(folder.path().join("eval"));
        Answer::of(&mut command)
    };
    eval(&folder.path().join("none")).failed(1, &["joints3d.csv"]);
    fs::copy(fixtures().join("balance/joints3d.csv"), folder.path().join("joints3d.csv")).expect("a copy");
    eval(folder.path()).failed(1, &["video.mp4"]);
    Answer::of(umbra().args(["eval", "real", "--seeds", "0"])).failed(2, &["--seeds"]);
    // It takes the seeds 1 to N, and must not look as if it took another one.
    Answer::of(umbra().args(["eval", "real", "--seed", "7"])).failed(2, &["'--seed'"]);
}
