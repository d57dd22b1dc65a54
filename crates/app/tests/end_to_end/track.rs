//! `umbra track`, `umbra info`: what a run writes, and that it can be repeated, interrupted and resumed.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Child;
use std::time::{Duration, Instant};

use image::{GrayImage, RgbImage};

use crate::support::{
    Answer, Clip, QUICK, assert_same_contents, column, contents, fixtures, nobody, shifted, shows_mark,
    silhouette, table, track_assumed, umbra, video,
};

#[test]
fn a_run_writes_every_file_readable() {
    let folder = tempfile::tempdir().expect("a folder for a test");
    let out = folder.path().join("runs/first");
    let balance = fixtures().join("balance");
    let mut track = umbra();
    track
        .arg("track")
        .arg(balance.join("masks"))
        .args(["--masks", "--frames", "2..18", "--seed", "7"])
        .args(QUICK);
    let answer =
        Answer::of(track.arg("--camera").arg(balance.join("camera.toml")).arg("--out").arg(&out)).succeeded();
    assert!(answer.stderr.contains("tracked 16 of 16 frames"), "{}", answer.stderr);
    assert!(answer.stderr.contains(&format!("umbra info {}", out.display())), "{}", answer.stderr);

    let run: toml::Table =
        fs::read_to_string(out.join("run.toml")).expect("run.toml").parse().expect("it is TOML");
    assert_eq!(run["settings"]["seed"].as_integer(), Some(7));
    assert_eq!(run["settings"]["particles"].as_integer(), Some(24));
    assert_eq!(run["settings"]["frames"].as_str(), Some("2..18"));
    let inputs = run["inputs"].as_array().expect("a list of inputs");
    let roles: Vec<_> = inputs.iter().map(|input| input["role"].as_str().expect("text")).collect();
    assert_eq!(roles, ["masks", "camera"]);
    // sha256sum fixtures/balance/camera.toml
    let camera_hash = "96616b7a6b2524d22131475ce120ec6d2395100929fd4a1f5c870724a17a0f84";
    assert_eq!(inputs[1]["sha256"].as_str(), Some(camera_hash));

    let summary: serde_json::Value =
        serde_json::from_slice(&fs::read(out.join("summary.json")).expect("summary.json"))
            .expect("it is JSON");
    assert_eq!(summary["first_frame"], 2);
    assert_eq!(summary["frames"], 16);
    assert_eq!(summary["tracked"], 16);

    let frames: Vec<String> = (2..18).map(|frame: u32| frame.to_string()).collect();
    for (name, n_columns) in [("poses.csv", 3 + 7 + 49 + 5), ("joints.csv", 3 + 4 * 30)] {
        let rows = table(&out.join(name));
        assert_eq!(column(&rows, "frame"), frames, "{name}");
        for row in &rows {
            assert_eq!(row.len(), n_columns, "{name}");
            let is_number = |cell: &String| cell.parse().is_ok_and(|number: f64| number.is_finite());
            let bad = row.iter().find(|(column, cell)| *column != "status" && !is_number(cell));
            assert_eq!(bad, None, "{name}");
        }
    }
    // Frame 2 at the 60 frames a second of the camera file.
    assert_eq!(table(&out.join("poses.csv"))[0]["time_s"], "0.033333");

    for frame in 2..18 {
        let overlay = image::open(out.join(format!("overlay/{frame:06}.jpg"))).expect("an overlay");
        let shape = f64::from(overlay.width()) / f64::from(overlay.height());
        assert!((shape - 1088.0 / 1920.0).abs() < 0.002, "{} x {}", overlay.width(), overlay.height());
    }
    image::open(out.join("filmstrip.png")).expect("a filmstrip");

    let messages = messages(&out.join("run.mcap"));
    let topics: Vec<&str> = messages.keys().map(String::as_str).collect();
    let expected = [
        "/body/joints",
        "/body/points",
        "/body/scene",
        "/camera/annotations",
        "/camera/calibration",
        "/camera/overlay",
        "/tf",
    ];
    assert_eq!(topics, expected);
    for (topic, data) in &messages {
        assert_eq!(data.len(), 16, "{topic}");
    }

    let entries = fs::read_dir(&out).expect("a run folder");
    let mut names: Vec<_> = entries.map(|entry| entry.expect("an entry").file_name()).collect();
    names.sort();
    let expected =
        ["filmstrip.png", "joints.csv", "overlay", "poses.csv", "run.mcap", "run.toml", "summary.json"];
    assert_eq!(names, expected);
    #[cfg(unix)]
    for file in contents(&out).into_keys() {
        use std::os::unix::fs::PermissionsExt as _;
        let mode = fs::metadata(out.join(&file)).expect("a file").permissions().mode();
        assert_eq!(mode & 0o077, 0, "{} is for its owner only", file.display());
    }

    let info = Answer::of(umbra().arg("info").arg(&out)).succeeded();
    for part in expected.into_iter().chain(["16 frames from frame 2: 16 tracked", "seed = 7", "177 cm tall"])
    {
        assert!(info.stdout.contains(part), "{part:?} is missing:\n{}", info.stdout);
    }
}

#[test]
fn equal_seeds_give_equal_bytes_on_any_number_of_threads() {
    let clip = Clip::of_balance(12);
    for (out, threads, seed) in
        [("one", "1", "1"), ("two", "2", "1"), ("seven", "7", "1"), ("other", "2", "2")]
    {
        Answer::of(clip.track(out).args(["--threads", threads, "--seed", seed])).succeeded();
    }
    assert_same_contents(&clip.path("one"), &clip.path("two"));
    assert_same_contents(&clip.path("one"), &clip.path("seven"));
    let poses = |out| fs::read(clip.path(out).join("poses.csv")).expect("poses");
    assert_ne!(poses("one"), poses("other"), "another seed draws other numbers");
}

#[test]
fn a_killed_run_is_resumed_to_the_same_bytes() {
    let clip = Clip::of_balance(40);
    Answer::of(&mut clip.track("whole")).succeeded();

    let mut running = clip
        .track("killed")
        .args(["--threads", "1"])
        .stderr(std::process::Stdio::null())
        .spawn()
        .expect("it starts");
    kill_after_frames(&mut running, &clip.path("killed/journal.bin"), 11);
    let before = contents(&clip.path("killed"));
    assert!(!before.contains_key(Path::new("summary.json")), "it was killed before its end");

    let info = Answer::of(umbra().arg("info").arg(clip.path("killed"))).succeeded();
    assert!(info.stdout.contains("interrupted after"), "{}", info.stdout);
    Answer::of(&mut clip.track("killed"))
        .failed(1, &["killed: holds an interrupted run", "--resume", "--force"]);
    Answer::of(clip.track("killed").args(["--resume", "--seed", "2"]))
        .failed(1, &["run.toml: `settings.seed` is 1, now it is 2", "expected the same run to resume"]);
    assert!(contents(&clip.path("killed")) == before, "a refusal leaves everything as it was");

    // Killed in the middle of a write, too.
    let journal =
        fs::OpenOptions::new().write(true).open(clip.path("killed/journal.bin")).expect("a journal");
    journal.set_len(before[Path::new("journal.bin")].len() as u64 - 100).expect("it can be cut");
    Answer::of(clip.track("killed").arg("--resume")).succeeded();
    assert_same_contents(&clip.path("whole"), &clip.path("killed"));

    Answer::of(clip.track("killed").arg("--resume")).failed(1, &["holds a finished run"]);
    Answer::of(&mut clip.track("killed")).failed(1, &["holds a finished run", "--force"]);
    Answer::of(clip.track("killed").args(["--force", "--frames", "0..5"])).succeeded();
    assert_eq!(table(&clip.path("killed/poses.csv")).len(), 5, "nothing of the earlier run is left");
    assert_eq!(fs::read_dir(clip.path("killed/overlay")).expect("overlays").count(), 5);
}

#[test]
fn a_run_that_learns_says_what_and_keeps_it() {
    let clip = Clip::of_balance(14);
    let track = |out: &str, threads: &str| {
        let mut track = clip.track(out);
        track.args(["--adapt", "4", "--threads", threads]);
        track
    };
    Answer::of(track("one", "1").arg("--save-predictor").arg(clip.path("learned.bin"))).succeeded();
    Answer::of(track("two", "2").arg("--save-predictor").arg(clip.path("learned-two.bin"))).succeeded();
    assert_same_contents(&clip.path("one"), &clip.path("two"));
    let predictor = |name: &str| fs::read(clip.path(name)).expect("a predictor");
    assert_eq!(predictor("learned.bin"), predictor("learned-two.bin"));

    let rows = table(&clip.path("one/poses.csv"));
    assert_eq!(rows[0].len(), 3 + 7 + 49 + 5 + 4);
    let taught: Vec<_> = rows.iter().filter(|row| !row["log_evidence_gain"].is_empty()).collect();
    assert!(taught.len() > 3, "{} of {} frames", taught.len(), rows.len());
    let summary: serde_json::Value =
        serde_json::from_slice(&fs::read(clip.path("one/summary.json")).expect("summary.json"))
            .expect("JSON");
    assert_eq!(summary["learned"]["frames"], taught.len());
    let info = Answer::of(umbra().arg("info").arg(clip.path("one"))).succeeded();
    assert!(info.stdout.contains(&format!("learned from {} frames", taught.len())), "{}", info.stdout);

    // What it learned is used by the next run, and changes it.
    Answer::of(&mut clip.track("plain")).succeeded();
    Answer::of(clip.track("taught").arg("--predictor").arg(clip.path("learned.bin"))).succeeded();
    let poses = |out: &str| fs::read(clip.path(out).join("poses.csv")).expect("poses");
    assert_ne!(poses("plain"), poses("taught"));

    Answer::of(clip.track("apf").args(["--adapt", "4", "--method", "apf"]))
        .failed(1, &["settings: `adapt` is 4, expected 0", "the method is APF"]);
    Answer::of(clip.track("many").args(["--adapt", "1000"])).failed(1, &["`adapt` is 1000, expected 0 to"]);
}

#[test]
fn a_killed_run_that_learns_begins_anew() {
    let clip = Clip::of_balance(24);
    let track = |out: &str| {
        let mut track = clip.track(out);
        track.args(["--adapt", "2"]);
        track
    };
    Answer::of(&mut track("whole")).succeeded();
    let mut running = track("killed").stderr(std::process::Stdio::null()).spawn().expect("it starts");
    kill_after_frames(&mut running, &clip.path("killed/journal.bin"), 11);
    Answer::of(track("killed").arg("--resume")).succeeded();
    assert_same_contents(&clip.path("whole"), &clip.path("killed"));
}

#[test]
fn a_smoothed_run_has_every_frame_in_order_and_moves_more_evenly() {
    let clip = Clip::of_balance(14);
    Answer::of(&mut clip.track("plain")).succeeded();
    Answer::of(clip.track("smooth").args(["--smooth", "4"])).succeeded();
    let rows = |out: &str| table(&clip.path(out).join("poses.csv"));
    let numbers = |out: &str| rows(out).iter().map(|row| row["frame"].clone()).collect::<Vec<_>>();
    assert_eq!(numbers("plain"), numbers("smooth"));
    // Mean second difference of the pelvis's height, metres a frame².
    let jerk = |out: &str| {
        let z: Vec<f64> = rows(out).iter().map(|row| row["root_z_m"].parse().expect("a number")).collect();
        z.windows(3).map(|z| (z[0] - 2.0 * z[1] + z[2]).abs()).sum::<f64>()
    };
    assert!(jerk("smooth") < 0.7 * jerk("plain"), "{} {}", jerk("smooth"), jerk("plain"));
    let worst = |out: &str| {
        let iou =
            rows(out).iter().map(|row| row["iou"].parse::<f64>().expect("a number")).collect::<Vec<_>>();
        iou.into_iter().fold(1.0, f64::min)
    };
    assert!(worst("smooth") > worst("plain") - 0.1, "{} {}", worst("smooth"), worst("plain"));

    Answer::of(clip.track("late").args(["--smooth", "5000"])).failed(1, &["`smooth` is 5000, expected 0 to"]);
}

/// Kills the program as soon as its journal holds so many frames.
fn kill_after_frames(running: &mut Child, journal: &Path, n_frames: usize) {
    let deadline = Instant::now() + Duration::from_secs(300);
    while frames_in_journal(journal) < n_frames {
        assert!(Instant::now() < deadline, "no {n_frames} frames in 5 minutes");
        assert!(running.try_wait().expect("a child").is_none(), "it ended before it could be killed");
        std::thread::sleep(Duration::from_millis(3));
    }
    running.kill().expect("it runs");
    running.wait().expect("a child");
}

/// Complete frames: after a line of text each is its length (4 bytes), a checksum (4 bytes) and its bytes.
fn frames_in_journal(path: &Path) -> usize {
    let bytes = fs::read(path).unwrap_or_default();
    let mut rest = bytes.iter().position(|byte| *byte == b'\n').map_or(&[][..], |end| &bytes[end + 1..]);
    let mut n_frames = 0;
    while let Some(length) = rest.first_chunk().map(|length| u32::from_le_bytes(*length) as usize)
        && let Some(after) = rest.get(8 + length..)
    {
        rest = after;
        n_frames += 1;
    }
    n_frames
}

#[test]
fn pictures_are_cut_out_before_a_plate_and_redacted_on_request() {
    let clip = Clip::of_balance(8);
    clip.paint_frames("png");
    let track = |out: &str| {
        let mut track = clip.track_input("frames", out);
        track.arg("--background").arg(clip.path("plate.png"));
        track
    };
    Answer::of(&mut track("open")).succeeded();
    Answer::of(&mut clip.track("masks-only")).succeeded();
    // Silhouettes cut from clean pictures are nearly those that were painted, so the body lies nearly as well on them.
    let iou = |out: &str| mean_iou(&clip.path(out));
    assert!((iou("open") - iou("masks-only")).abs() < 0.1, "{} and {}", iou("open"), iou("masks-only"));
    let n_marked = |out: &str| pictures(&clip.path(out)).iter().filter(|picture| shows_mark(picture)).count();
    let n_pictures = 8 + 8 + 1;
    assert_eq!(
        n_marked("open"),
        n_pictures,
        "overlays, the same in the log, and the filmstrip show the picture"
    );

    Answer::of(track("closed").arg("--redact")).succeeded();
    assert_eq!(pictures(&clip.path("closed")).len(), n_pictures);
    assert_eq!(n_marked("closed"), 0, "nothing of the picture is left");
    let info = Answer::of(umbra().arg("info").arg(clip.path("closed"))).succeeded();
    assert!(info.stdout.contains("source frames are left out"), "{}", info.stdout);
    for table in ["poses.csv", "joints.csv"] {
        let bytes = |out: &str| fs::read(clip.path(out).join(table)).expect("a table");
        assert!(bytes("open") == bytes("closed"), "{table} does not depend on what is shown");
    }
}

#[test]
fn a_background_is_learned_from_jpeg_frames_and_from_video() {
    // Long enough that the person stands at no place for half of the clip, as the median asks.
    let walk: Vec<GrayImage> =
        (0..28).map(|frame| shifted(&silhouette(frame), 8 * i64::from(frame) - 108)).collect();
    let clip = Clip::of_masks(&walk);
    clip.paint_frames("jpg");
    Answer::of(&mut clip.track_input("frames", "frames-run")).succeeded();
    Answer::of(&mut track_assumed(&video("walker.mp4"), &clip.path("video-run"))).succeeded();
    Answer::of(&mut clip.track("masks-run")).succeeded();
    let iou = |run: &str| mean_iou(&clip.path(run));
    println!("overlap: {} masks, {} frames, {} video", iou("masks-run"), iou("frames-run"), iou("video-run"));
    // Whatever is cut out wrongly, a body cannot explain. So few particles lie badly on the right masks of so fast a
    // person, too: those are the measure.
    assert!(
        (iou("frames-run") - iou("masks-run")).abs() < 0.1,
        "{} and {}",
        iou("frames-run"),
        iou("masks-run")
    );
    assert!(iou("video-run") > 0.5, "{}", iou("video-run"));
    for (run, n_frames) in [("frames-run", 28), ("video-run", 16)] {
        let run = clip.path(run);
        assert_eq!(table(&run.join("poses.csv")).len(), n_frames);
        let text = fs::read_to_string(run.join("run.toml")).expect("run.toml");
        assert!(text.contains("learned_background = \"median\""), "{text}");
    }
}

#[test]
fn what_is_assumed_is_said_and_written_down() {
    let clip = Clip::of_balance(3);
    let mut track = umbra();
    track.arg("track").arg(clip.path("masks")).args(["--masks", "--focal-px", "420"]).args(QUICK);
    let answer = Answer::of(track.arg("--out").arg(clip.path("run"))).succeeded();
    let info = Answer::of(umbra().arg("info").arg(clip.path("run"))).succeeded();
    let run: toml::Table =
        fs::read_to_string(clip.path("run/run.toml")).expect("run.toml").parse().expect("it is TOML");
    let written: Vec<&str> = run["assumptions"]
        .as_array()
        .expect("a list")
        .iter()
        .map(|line| line.as_str().expect("text"))
        .collect();
    assert_eq!(written.len(), 2);
    for (line, part) in written
        .iter()
        .zip(["level, upright camera 1.5 m above the floor, focal length 420 px", "1.78 m tall"])
    {
        assert!(line.contains(part), "{line}");
        assert!(answer.stderr.contains(&format!("assumed: {line}")), "{}", answer.stderr);
        assert!(info.stdout.contains(line), "{}", info.stdout);
    }

    let known = Answer::of(clip.track("known").args(["--stature-m", "1.7"])).succeeded();
    assert!(!known.stderr.contains("assumed"), "nothing is assumed:\n{}", known.stderr);
}

#[test]
fn frames_without_a_person_are_bridged() {
    let mut masks: Vec<GrayImage> = (0..16).map(silhouette).collect();
    for frame in [0, 1, 6, 7, 8] {
        masks[frame] = nobody();
    }
    let clip = Clip::of_masks(&masks);
    Answer::of(&mut clip.track("run")).succeeded();
    let rows = table(&clip.path("run/poses.csv"));
    assert_eq!(rows[0]["frame"], "2", "nobody was seen before");
    let coasting: Vec<&str> =
        rows.iter().filter(|row| row["status"] == "coasting").map(|row| row["frame"].as_str()).collect();
    assert_eq!(coasting, ["6", "7", "8"]);
    assert!(
        rows.iter().filter(|row| row["status"] == "tracked").count() == 11,
        "{:?}",
        column(&rows, "status")
    );
    let info = Answer::of(umbra().arg("info").arg(clip.path("run"))).succeeded();
    assert!(
        info.stdout.contains("14 frames from frame 2: 11 tracked, 3 coasting, 0 lost"),
        "{}",
        info.stdout
    );
}

#[test]
fn a_lost_person_who_comes_back_is_found_within_ten_frames() {
    let masks: Vec<GrayImage> =
        (0..26).map(|frame| if (6..14).contains(&frame) { nobody() } else { silhouette(frame) }).collect();
    let clip = Clip::of_masks(&masks);
    let settings = clip.write("settings.toml", "coast_frames = 4\n");
    Answer::of(clip.track("run").arg("--config").arg(settings)).succeeded();
    let rows = table(&clip.path("run/poses.csv"));
    let status = column(&rows, "status");
    assert_eq!(status[10..14], ["lost"; 4]);
    assert_eq!(status[23..], ["tracked"; 3], "{status:?}");
    let iou = column(&rows, "iou")[23..].iter().map(|iou| iou.parse().expect("a number")).fold(1.0, f64::min);
    assert!(iou > 0.6, "{iou}");
}

#[test]
fn a_clip_of_one_frame_is_tracked() {
    let clip = Clip::of_balance(1);
    for (out, options) in [("plain", &[][..]), ("smooth", &["--smooth", "4"]), ("learns", &["--adapt", "4"])]
    {
        Answer::of(clip.track(out).args(options)).succeeded();
        assert_eq!(column(&table(&clip.path(out).join("poses.csv")), "status"), ["tracked"], "{out}");
    }
}

#[test]
fn a_person_who_leaves_the_view_is_lost_and_the_run_goes_on() {
    let masks: Vec<GrayImage> = (0..16)
        .map(|frame| if frame < 10 { shifted(&silhouette(frame), 26 * i64::from(frame)) } else { nobody() })
        .collect();
    let clip = Clip::of_masks(&masks);
    let settings = clip.write("settings.toml", "coast_frames = 4\n");
    Answer::of(clip.track("run").arg("--config").arg(settings)).succeeded();
    let rows = table(&clip.path("run/poses.csv"));
    assert_eq!(rows.len(), 16);
    let status = column(&rows, "status");
    assert_eq!(status[..2], ["tracked"; 2]);
    assert_eq!(status[14..], ["lost"; 2], "more than four frames without a person");
    assert!(!status[10..14].contains(&"tracked"), "{status:?}");
}

/// Mean overlap of body and mask over a run.
fn mean_iou(run: &Path) -> f64 {
    let rows = table(&run.join("poses.csv"));
    let ious: Vec<f64> = column(&rows, "iou").iter().map(|iou| iou.parse().expect("a number")).collect();
    ious.iter().sum::<f64>() / ious.len() as f64
}

/// The data of each message of a log, by topic.
fn messages(path: &Path) -> BTreeMap<String, Vec<Vec<u8>>> {
    let bytes = fs::read(path).expect("a log");
    let mut topics = BTreeMap::<String, Vec<Vec<u8>>>::new();
    for message in mcap::MessageStream::new(&bytes).expect("a log") {
        let message = message.expect("a message");
        topics.entry(message.channel.topic.clone()).or_default().push(message.data.to_vec());
    }
    topics
}

/// Every picture of a run folder: overlays, those in the log, the filmstrip.
fn pictures(run: &Path) -> Vec<RgbImage> {
    const JPEG_START: [u8; 3] = [0xff, 0xd8, 0xff];
    let files = contents(run).into_iter().filter(|(name, _)| {
        name.extension().is_some_and(|extension| extension == "jpg" || extension == "png")
    });
    let logged = messages(&run.join("run.mcap")).remove("/camera/overlay").expect("overlays are in the log");
    let logged = logged.into_iter().map(|message| {
        let start = message.windows(3).position(|bytes| bytes == JPEG_START).expect("a JPEG file");
        message[start..].to_vec()
    });
    files
        .map(|(_, bytes)| bytes)
        .chain(logged)
        .map(|bytes| image::load_from_memory(&bytes).expect("a picture").into_rgb8())
        .collect()
}
