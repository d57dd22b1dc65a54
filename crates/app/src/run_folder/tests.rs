use std::collections::BTreeMap;
use std::io::Write as _;

use body::{BodyModel, Intrinsics, JointId, N_DOF, Pose};
use glam::DVec3;
use prost::Message as _;
use tempfile::TempDir;

use super::*;
use crate::run_folder::foxglove::{CompressedImage, FrameTransforms, PosesInFrame};

const FRAMES: u64 = 9;

fn header(seed: i64, redact: bool) -> RunHeader {
    let intrinsics = Intrinsics::from_focal(96, 128, 150.0).unwrap();
    let mut settings = toml::Table::new();
    settings.insert("seed".to_owned(), seed.into());
    RunHeader {
        inputs: Vec::new(),
        settings,
        assumptions: vec!["a level camera".to_owned()],
        fps: 30.0,
        redact,
        camera: Camera::upright(intrinsics, 1.2, 0.0).unwrap(),
        body: Arc::new(BodyModel::builtin().mean()),
    }
}

/// Some walk away from the camera, which looks along +y.
fn record(frame: u64) -> FrameRecord {
    let mut pose = Pose::upright(DVec3::new(0.02 * frame as f64, 3.5, 0.95), -1.2);
    pose.angles[3] = 0.01 * frame as f64;
    FrameRecord {
        frame,
        status: if frame == 4 { Status::Coasting } else { Status::Tracked },
        joints_world: BodyModel::builtin().mean().joints_world(&pose),
        pose,
        joint_sd_m: [0.01; 30],
        iou: if frame == 4 { 0.0 } else { 0.8 + 0.01 * frame as f64 },
        effective_sample_size: 50.0,
        unique_ancestors: 20,
        log_evidence: if frame == 4 { f64::NEG_INFINITY } else { -12.5 },
        learned: None,
    }
}

fn mask() -> Mask {
    Mask::from_fn(96, 128, |x, y| (30..60).contains(&x) && (20..110).contains(&y))
}

fn green() -> RgbFrame {
    RgbFrame { width: 96, height: 128, pixels: [0, 255, 0].repeat(96 * 128) }
}

fn push(run: &mut RunWriter, frames: std::ops::Range<u64>) -> Result<(), WriteRunError> {
    for frame in frames {
        let checkpoint = (frame % 3 == 2).then(|| vec![frame as u8; 5]);
        run.push(&record(frame), Some(&green()), &mask(), checkpoint.as_deref())?;
    }
    Ok(())
}

fn whole_run(folder: &Path, header: RunHeader) -> Summary {
    let (mut run, resumed) = RunWriter::open(folder, Existing::Refuse, header).unwrap();
    assert!(resumed.is_none());
    push(&mut run, 0..FRAMES).unwrap();
    run.finish(None).unwrap()
}

fn space() -> (TempDir, PathBuf) {
    let space = tempfile::tempdir().unwrap();
    let folder = space.path().join("run");
    (space, folder)
}

/// Names and bytes of all files below a folder.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(
                contents(&path).into_iter().map(|(name, bytes)| (Path::new(OVERLAY).join(name), bytes)),
            );
        } else {
            files.insert(path.strip_prefix(folder).unwrap().to_owned(), fs::read(&path).unwrap());
        }
    }
    files
}

fn refusal(folder: &Path, existing: Existing, header: RunHeader) -> String {
    match RunWriter::open(folder, existing, header) {
        Ok(_) => panic!("expected an error"),
        Err(error) => format!("{error:#}"),
    }
}

#[test]
fn a_run_holds_every_product_and_nothing_else() {
    let (_space, folder) = space();
    let summary = whole_run(&folder, header(1, false));
    let names: Vec<String> = contents(&folder).keys().map(|name| name.display().to_string()).collect();
    let mut expected: Vec<String> = (0..FRAMES).map(|frame| format!("overlay/{frame:06}.jpg")).collect();
    expected.extend([FILMSTRIP, JOINTS, POSES, LOG, RUN_FILE, SUMMARY].map(str::to_owned));
    expected.sort();
    assert_eq!(names, expected);
    assert_eq!((summary.frames, summary.tracked, summary.coasting, summary.lost), (9, 8, 1, 0));
    assert_eq!((summary.iou_worst, summary.iou_worst_frame), (Some(0.8), Some(0)));
    // 0.80 to 0.88 without 0.84.
    assert!((summary.iou_mean.unwrap() - 0.84).abs() < 1e-12);
}

#[cfg(unix)]
#[test]
fn only_the_owner_reads_a_run() {
    use std::os::unix::fs::PermissionsExt as _;
    let (_space, folder) = space();
    whole_run(&folder, header(1, false));
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
    assert_eq!((mode(&folder), mode(&folder.join(OVERLAY))), (0o700, 0o700));
    for name in contents(&folder).keys() {
        assert_eq!(mode(&folder.join(name)), 0o600, "{}", name.display());
    }
}

#[test]
fn equal_runs_have_equal_bytes() {
    let ((_a, first), (_b, second)) = (space(), space());
    whole_run(&first, header(1, false));
    whole_run(&second, header(1, false));
    assert_eq!(contents(&first), contents(&second));
}

#[test]
fn a_resumed_run_ends_with_the_same_bytes() {
    let (_a, uninterrupted) = space();
    whole_run(&uninterrupted, header(1, false));
    for (interrupted_after, kept) in [(1, 0), (3, 3), (7, 6), (FRAMES, FRAMES)] {
        let (_b, folder) = space();
        let (mut run, _) = RunWriter::open(&folder, Existing::Refuse, header(1, false)).unwrap();
        push(&mut run, 0..interrupted_after).unwrap();
        drop(run);
        // A crash in the middle of a write leaves a torn entry.
        let mut journal = fs::OpenOptions::new().append(true).open(folder.join(JOURNAL)).unwrap();
        journal.write_all(&[200, 0, 0, 0, 1, 2, 3, 4, 5]).unwrap();

        let (mut run, resumed) = RunWriter::open(&folder, Existing::Resume, header(1, false)).unwrap();
        let frames = resumed.as_ref().map_or(0, |resumed| resumed.frames.len() as u64);
        assert_eq!(frames, kept);
        if let Some(resumed) = resumed {
            assert_eq!(resumed.frames, (0..kept).map(record).collect::<Vec<_>>());
            assert_eq!(resumed.checkpoint, vec![kept as u8 - 1; 5]);
        }
        push(&mut run, kept..FRAMES).unwrap();
        run.finish(None).unwrap();
        assert_eq!(contents(&folder), contents(&uninterrupted), "interrupted after {interrupted_after}");
    }
}

#[test]
fn a_journal_survives_being_cut_anywhere() {
    let (_space, folder) = space();
    let (mut run, _) = RunWriter::open(&folder, Existing::Refuse, header(1, false)).unwrap();
    push(&mut run, 0..3).unwrap();
    drop(run);
    let path = folder.join(JOURNAL);
    let whole = fs::read(&path).unwrap();
    let (_, ends) = journal::read_entries(&path).unwrap();
    for length in (0..=whole.len()).rev().step_by(7) {
        fs::write(&path, &whole[..length]).unwrap();
        let (entries, _) = journal::read_entries(&path).unwrap();
        assert_eq!(
            entries.len(),
            ends.iter().filter(|&&end| end <= length as u64).count(),
            "cut at {length}"
        );
    }
    let mut damaged = whole.clone();
    damaged[ends[0] as usize + 20] ^= 1;
    fs::write(&path, damaged).unwrap();
    assert_eq!(journal::read_entries(&path).unwrap().0.len(), 1, "what follows damage is not trusted");
    fs::write(&path, "something else").unwrap();
    let error = format!("{:#}", journal::read_entries(&path).unwrap_err());
    assert!(error.contains("journal.bin: is not a journal that this version can read"), "{error}");
}

#[test]
fn a_run_in_the_way_is_refused() {
    let (_space, folder) = space();
    whole_run(&folder, header(1, false));
    let before = contents(&folder);
    let name = folder.display();
    assert_eq!(
        refusal(&folder, Existing::Refuse, header(1, false)),
        format!("{name}: holds a finished run, expected a new folder or --force to replace it")
    );
    assert_eq!(
        refusal(&folder, Existing::Resume, header(1, false)),
        format!(
            "{name}: holds a finished run, expected an interrupted one to resume, or --force to replace it"
        )
    );
    assert_eq!(contents(&folder), before);

    let (_other, foreign) = space();
    fs::create_dir(&foreign).unwrap();
    fs::write(foreign.join("thesis.tex"), "five years").unwrap();
    for existing in [Existing::Refuse, Existing::Replace, Existing::Resume] {
        let expected =
            format!("{}: holds other files than a run, expected a new or empty folder", foreign.display());
        assert_eq!(refusal(&foreign, existing, header(1, false)), expected);
    }
    let file = foreign.join("thesis.tex");
    assert!(refusal(&file, Existing::Replace, header(1, false)).contains("cannot use it as a run folder"));
}

#[test]
fn replacing_a_run_leaves_other_files_alone() {
    let (_space, folder) = space();
    whole_run(&folder, header(1, false));
    fs::write(folder.join("notes.txt"), "mine").unwrap();
    fs::write(folder.join(OVERLAY).join("best.jpg"), "mine").unwrap();
    let (mut run, resumed) = RunWriter::open(&folder, Existing::Replace, header(2, false)).unwrap();
    assert!(resumed.is_none());
    push(&mut run, 0..2).unwrap();
    run.finish(None).unwrap();
    let names: Vec<PathBuf> = contents(&folder).into_keys().collect();
    for name in ["notes.txt", "overlay/best.jpg", "overlay/000001.jpg"] {
        assert!(names.contains(&PathBuf::from(name)), "{name}");
    }
    assert!(!names.contains(&PathBuf::from("overlay/000002.jpg")), "a picture of the replaced run");
}

#[test]
fn another_run_cannot_be_resumed() {
    let (space, folder) = space();
    let input = space.path().join("video.mp4");
    fs::write(&input, "first").unwrap();
    let with_input = |seed| RunHeader {
        inputs: vec![RunInput { role: "video", path: input.clone() }],
        ..header(seed, false)
    };
    let (run, _) = RunWriter::open(&folder, Existing::Resume, with_input(1)).unwrap();
    drop(run);
    let error = refusal(&folder, Existing::Resume, with_input(2));
    let start = format!("{}: `settings.seed` is 1, now it is 2", folder.join(RUN_FILE).display());
    assert!(error.starts_with(&start), "{error}");
    fs::write(&input, "second").unwrap();
    let error = refusal(&folder, Existing::Resume, with_input(1));
    assert!(error.contains("`inputs[0].sha256` is "), "{error}");
    // SHA-256 of "second", by sha256sum.
    assert!(error.contains("16367aacb67a4a017c8da8ab95682ccb390863780f7114dda0a0e0c55644c7c4"), "{error}");
}

/// `/dev/full` answers every write with "no space left on device".
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_ends_in_one_message_and_loses_nothing() {
    let (_a, uninterrupted) = space();
    whole_run(&uninterrupted, header(1, false));
    for file in ["overlay/000005.jpg", POSES, LOG, FILMSTRIP, SUMMARY] {
        let (_b, folder) = space();
        let (mut run, _) = RunWriter::open(&folder, Existing::Refuse, header(1, false)).unwrap();
        let full = folder.join(format!("{file}.part"));
        std::os::unix::fs::symlink("/dev/full", &full).unwrap();
        let result = push(&mut run, 0..FRAMES).map_err(anyhow::Error::from).and_then(|()| run.finish(None));
        let error = result.unwrap_err();
        assert!(error.downcast_ref::<WriteRunError>().is_some());
        let expected = format!(
            "{}: cannot write the file: No space left on device (os error 28)",
            folder.join(file).display()
        );
        assert_eq!(format!("{error:#}"), expected);
        assert!(!folder.join(file).exists(), "{file} is there although it is not whole");
        assert!(!full.exists(), "the temporary file is removed");

        let (mut run, resumed) = RunWriter::open(&folder, Existing::Resume, header(1, false)).unwrap();
        push(&mut run, resumed.unwrap().frames.len() as u64..FRAMES).unwrap();
        run.finish(None).unwrap();
        assert_eq!(contents(&folder), contents(&uninterrupted), "{file}");
    }
    let error = Journal::create(Path::new("/dev/full")).err().unwrap();
    assert_eq!(error.to_string(), "/dev/full: cannot write the file");
}

#[test]
fn a_run_cut_short_has_its_products_and_can_go_on() {
    let (_a, uninterrupted) = space();
    whole_run(&uninterrupted, header(1, false));
    let (_b, folder) = space();
    let (mut run, _) = RunWriter::open(&folder, Existing::Refuse, header(1, false)).unwrap();
    push(&mut run, 0..7).unwrap();
    let summary = run.finish(Some("clip.mp4: frame 7: it is cut off")).unwrap();
    assert_eq!((summary.frames, summary.cut_short_by.is_some()), (7, true));
    assert_eq!(fs::read_to_string(folder.join(POSES)).unwrap().lines().count(), 1 + 7);
    let text = describe(&folder).unwrap();
    assert!(text.contains("cut short: clip.mp4: frame 7: it is cut off"), "{text}");
    let (mut run, resumed) = RunWriter::open(&folder, Existing::Resume, header(1, false)).unwrap();
    push(&mut run, resumed.unwrap().frames.len() as u64..FRAMES).unwrap();
    run.finish(None).unwrap();
    assert_eq!(contents(&folder), contents(&uninterrupted));
}

#[test]
fn tables_have_units_and_no_nan() {
    let (_space, folder) = space();
    whole_run(&folder, header(1, false));
    for (name, columns) in [(POSES, 3 + 7 + N_DOF + 5), (JOINTS, 3 + 4 * 30)] {
        let text = fs::read_to_string(folder.join(name)).unwrap();
        let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
        assert_eq!(rows.len(), 1 + FRAMES as usize);
        assert!(rows.iter().all(|row| row.len() == columns), "{name}");
        assert!(!text.to_lowercase().contains("nan") && !text.contains("inf"));
        assert_eq!(rows[1][..3], ["0", "0.000000", "tracked"]);
        assert_eq!(rows[5][..3], ["4", "0.133333", "coasting"]);
    }
    let text = fs::read_to_string(folder.join(POSES)).unwrap();
    let mut lines = text.lines();
    let header = lines.next().unwrap();
    assert!(header.starts_with("frame,time_s,status,root_x_m,root_y_m,root_z_m,root_qw,"));
    let last: Vec<&str> = lines.last().unwrap().split(',').collect();
    assert_eq!(last[3..6], ["0.160000", "3.500000", "0.950000"]);
    assert_eq!((last[10 + 3], last[10 + N_DOF]), ("0.080000", "0.880000"), "an angle, and the overlap");
}

fn messages(folder: &Path, topic: &str) -> Vec<(u64, Vec<u8>)> {
    let bytes = fs::read(folder.join(LOG)).unwrap();
    let stream = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap);
    stream
        .filter(|message| message.channel.topic == topic)
        .map(|message| (message.log_time, message.data.to_vec()))
        .collect()
}

#[test]
fn the_log_holds_every_frame_of_every_topic() {
    let (_space, folder) = space();
    whole_run(&folder, header(1, false));
    for topic in [
        "/tf",
        "/camera/calibration",
        "/camera/overlay",
        "/camera/annotations",
        "/body/joints",
        "/body/points",
        "/body/scene",
    ] {
        let times: Vec<u64> = messages(&folder, topic).iter().map(|(time, _)| *time).collect();
        let expected: Vec<u64> = (0..FRAMES).map(|n| (n as f64 / 30.0 * 1e9).round() as u64).collect();
        assert_eq!(times, expected, "{topic}");
    }
    let joints = PosesInFrame::decode(&*messages(&folder, "/body/joints")[7].1).unwrap();
    let transforms = FrameTransforms::decode(&*messages(&folder, "/tf")[7].1).unwrap().transforms;
    assert_eq!(transforms.len(), 1 + 30);
    // The chain of transforms leads to the joints of the table.
    for joint in JointId::all() {
        let expected = record(7).joints_world[joint.index()];
        let placed = joints.poses[joint.index()].position.unwrap();
        assert!(DVec3::new(placed.x, placed.y, placed.z).distance(expected) < 1e-9);
        let (mut name, mut point) = (joint.name().to_owned(), DVec3::ZERO);
        while name != "world" {
            let link = transforms.iter().find(|link| link.child_frame_id == name).unwrap();
            let (t, q) = (link.translation.unwrap(), link.rotation.unwrap());
            point = glam::DQuat::from_xyzw(q.x, q.y, q.z, q.w) * point + DVec3::new(t.x, t.y, t.z);
            name.clone_from(&link.parent_frame_id);
        }
        assert!(point.distance(expected) < 1e-9, "{}", joint.name());
    }
}

/// The frames are green all over; the body, the lines and the neutral background are not.
#[test]
fn a_redacted_run_shows_no_source_frame() {
    let greens = |jpeg: &[u8]| {
        let picture = image::load_from_memory(jpeg).unwrap().into_rgb8();
        picture.pixels().filter(|pixel| pixel[1] > 200 && pixel[0] < 80 && pixel[2] < 80).count()
    };
    for (redact, shows_green) in [(false, true), (true, false)] {
        let (_space, folder) = space();
        whole_run(&folder, header(1, redact));
        let overlay = fs::read(overlay_path(&folder, 3)).unwrap();
        assert_eq!(greens(&overlay) > 1000, shows_green);
        assert_eq!(greens(&overlay) > 0, shows_green);
        let logged = CompressedImage::decode(&*messages(&folder, "/camera/overlay")[3].1).unwrap();
        assert_eq!(logged.data, overlay);
        assert_eq!(greens(&fs::read(folder.join(FILMSTRIP)).unwrap()) > 0, shows_green);
    }
}

#[test]
fn info_tells_settings_results_and_what_to_do() {
    let (_space, folder) = space();
    let (mut run, _) = RunWriter::open(&folder, Existing::Refuse, header(7, true)).unwrap();
    push(&mut run, 0..4).unwrap();
    let text = describe(&folder).unwrap();
    assert!(text.contains("interrupted after 4 frames: track again with --resume to go on"), "{text}");
    run.finish(None).unwrap();
    let text = describe(&folder).unwrap();
    for part in [
        "a run of umbra 0.1.0",
        "seed = 7",
        "96 x 128 pixels",
        "a level camera",
        "source frames are left out",
        "4 frames from frame 0: 4 tracked, 0 coasting, 0 lost",
        "mean 0.815, median 0.820, worst 0.800 on frame 0",
        "run.mcap",
    ] {
        assert!(text.contains(part), "{part:?} is not in\n{text}");
    }
    fs::write(folder.join(RUN_FILE), "version = 99").unwrap();
    let error = format!("{:#}", describe(&folder).unwrap_err());
    assert_eq!(error, format!("{}: `version` is 99, expected 1", folder.join(RUN_FILE).display()));
    let error = format!("{:#}", describe(&folder.join(OVERLAY)).unwrap_err());
    assert!(error.ends_with("holds no run.toml, expected a run folder"), "{error}");
}
