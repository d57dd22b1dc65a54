//! `umbra track`, `umbra info`: what a run writes, and that it can be repeated, interrupted and resumed.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Child;
use std::time::{Duration, Instant};

use image::{GrayImage, RgbImage};

use crate::support::{
    Answer, Clip, QUICK, assert_same_contents, column, contents, fixtures, nobody, shifted, shows_mark, silhouette,
    table, umbra, video,
};

#[test]
fn equal_seeds_give_equal_bytes_on_any_number_of_threads() {
    let clip = Clip::of_balance(12);
    for (out, threads, seed) in [("one", "1", "1"), ("two", "2", "1"), ("seven", "7", "1"), ("other", "2", "2")] {
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

    let mut running = clip.track("killed").args(["--threads", "1"]).stderr(std::process::Stdio::null()).spawn().expect("it starts");
    kill_after_frames(&mut running, &clip.path("killed/journal.bin"), 11);
    let before = contents(&clip.path("killed"));
    assert!(!before.contains_key(Path::new("summary.json")), "it was killed before its end");

    let info = Answer::of(umbra().arg("info").arg(clip.path("killed"))).succeeded();
    assert!(info.stdout.contains("interrupted after"), "{}", info.stdout);
    Answer::of(&mut clip.track("killed")).failed(1, &["killed: holds an interrupted run", "--resume", "--force"]);
    Answer::of(clip.track("killed").args(["--resume", "--seed", "2"]))
        .failed(1, &["run.toml: `settings.seed` is 1, now it is 2", "expected the same run to resume"]);
    assert!(contents(&clip.path("killed")) == before, "a refusal leaves everything as it was");

    // Killed in the middle of a write, too.
    let journal = fs::OpenOptions::new().write(true).open(clip.path("killed/journal.bin")).expect("a journal");
    journal.set_len(before[Path::new("journal.bin")].len() as u64 - 100).expect("it can be cut");
    Answer::of(clip.track("killed").arg("--resume")).succeeded();
    assert_same_contents(&clip.path("whole"), &clip.path("killed"));

    Answer::of(clip.track("killed").arg("--resume")).failed(1, &["holds a finished run"]);
    Answer::of(&mut clip.track("killed")).failed(1, &["holds a finished run", "--force"]);
    Answer::of(clip.track("killed").args(["--force", "--frames", "0..5"])).succeeded();
    assert_eq!(table(&clip.path("killed/poses.csv")).len(), 5, "nothing of the earlier run is left");
    assert_eq!(fs::read_dir(clip.path("killed/overlay")).expect("overlays").count(), 5);
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
fn what_is_assumed_is_said_and_written_down() {
    let clip = Clip::of_balance(3);
    let mut track = umbra();
    track.arg("track").arg(clip.path("masks")).args(["--masks", "--focal-px", "420"]).args(QUICK);
    let answer = Answer::of(track.arg("--out").arg(clip.path("run"))).succeeded();
    let info = Answer::of(umbra().arg("info").arg(clip.path("run"))).succeeded();
    let run: toml::Table = fs::read_to_string(clip.path("run/run.toml")).expect("run.toml").parse().expect("it is TOML");
    let written: Vec<&str> =
        run["assumptions"].as_array().expect("a list").iter().map(|line| line.as_str().expect("text")).collect();
    assert_eq!(written.len(), 2);
    for (line, part) in written.iter().zip(["level, upright camera 1.5 m above the floor, focal length 420 px", "1.78 m tall"]) {
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
    assert!(rows.iter().filter(|row| row["status"] == "tracked").count() == 11, "{:?}", column(&rows, "status"));
    let info = Answer::of(umbra().arg("info").arg(clip.path("run"))).succeeded();
    assert!(info.stdout.contains("14 frames from frame 2: 11 tracked, 3 coasting, 0 lost"), "{}", info.stdout);
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
