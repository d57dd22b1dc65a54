use std::ffi::OsStr;
use std::process::Command;

use super::*;
use tempfile::TempDir;

/// 64 x 48, 12 frames; frame N has luma 30 + 12 N, the left half 70 more, the upper half reddish.
const CLIP: &[u8] = include_bytes!("../../fixtures/clip.mp4");

fn file_with(bytes: &[u8]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clip.mp4");
    fs::write(&path, bytes).unwrap();
    (folder, path)
}

fn read_all(source: &mut dyn FrameSource) -> (Vec<RgbFrame>, Option<String>) {
    let (mut frames, mut frame) = (Vec::new(), RgbFrame::default());
    loop {
        match source.next_frame(&mut frame) {
            Ok(true) => frames.push(frame.clone()),
            Ok(false) => return (frames, None),
            Err(error) => return (frames, Some(format!("{error:#}"))),
        }
    }
}

fn error_text<T>(result: anyhow::Result<T>) -> String {
    match result {
        Ok(_) => panic!("expected an error"),
        Err(error) => format!("{error:#}"),
    }
}

/// Red, green and blue of the pixel in the middle of a quarter: 0 and 1 are the upper ones.
fn quarter(frame: &RgbFrame, index: u32) -> [u8; 3] {
    let x = frame.width / 4 * (1 + 2 * (index % 2));
    let y = frame.height / 4 * (1 + 2 * (index / 2));
    let at = 3 * (y * frame.width + x) as usize;
    [frame.pixels[at], frame.pixels[at + 1], frame.pixels[at + 2]]
}

/// What the clip's description makes the grey of a lower quarter, BT.601 limited.
fn grey(frame: usize, is_left: bool) -> u8 {
    let luma = 30 + 12 * frame + if is_left { 70 } else { 0 };
    ((luma - 16) as f64 * 255.0 / 219.0).round() as u8
}

fn check_clip(frames: &[RgbFrame]) {
    for (number, frame) in frames.iter().enumerate() {
        assert_eq!((frame.width, frame.height), (64, 48));
        for (index, is_left) in [(2, true), (3, false)] {
            let [red, green, blue] = quarter(frame, index);
            let expected = grey(number, is_left);
            for value in [red, green, blue] {
                assert!(value.abs_diff(expected) <= 3, "frame {number}: {value}, expected {expected}");
            }
        }
        let [red, _, blue] = quarter(frame, 1);
        assert!(red > blue + 20, "frame {number}: the upper half is reddish");
    }
}

#[test]
fn frames_come_in_the_order_they_are_shown() {
    let (_folder, path) = file_with(CLIP);
    let mut source = open_frames(&path).unwrap();
    let info = SourceInfo { path, width: 64, height: 48, fps: Some(25.0), n_frames: Some(12), gap: None };
    assert_eq!(*source.info(), info);
    let (frames, error) = read_all(&mut *source);
    assert_eq!((frames.len(), error), (12, None));
    check_clip(&frames);
}

#[test]
fn rotated_videos_are_turned_upright() {
    // The matrix of the track header: 0, 1, -1, 0 in 16.16 fixed point turns by a quarter, clockwise.
    const ONE: [u8; 4] = [0, 1, 0, 0];
    const MINUS_ONE: [u8; 4] = [0xff, 0xff, 0, 0];
    let at = CLIP.windows(4).position(|bytes| bytes == b"tkhd").unwrap() + 4 + 40;
    assert_eq!(CLIP[at..at + 4], ONE);
    let mut bytes = CLIP.to_vec();
    for (index, value) in [(0, [0; 4]), (1, ONE), (3, MINUS_ONE), (4, [0; 4])] {
        bytes[at + 4 * index..at + 4 * index + 4].copy_from_slice(&value);
    }
    let (_folder, path) = file_with(&bytes);
    let mut source = open_frames(&path).unwrap();
    assert_eq!((source.info().width, source.info().height), (48, 64));
    let (frames, _) = read_all(&mut *source);
    // What was left is up now, and what was up is right.
    let frame = &frames[0];
    assert!(quarter(frame, 0)[1] > quarter(frame, 2)[1] + 50);
    assert!(quarter(frame, 1)[0] > quarter(frame, 1)[2] + 20);
    assert_eq!(quarter(frame, 0)[0], quarter(frame, 0)[2]);
}

#[test]
fn a_cut_video_gives_the_frames_before_the_cut() {
    let (_folder, path) = file_with(&CLIP[..CLIP.len() - 150]);
    let (frames, error) = read_all(&mut *open_frames(&path).unwrap());
    assert!((1..12).contains(&frames.len()), "{} frames", frames.len());
    check_clip(&frames);
    let error = error.unwrap();
    let expected = format!("{}: frame {}: the file ends at byte", path.display(), frames.len());
    assert!(error.starts_with(&expected), "{error}");

    let (_folder, path) = file_with(&CLIP[..200]);
    let error = error_text(open_frames(&path));
    assert!(error.contains("clip.mp4: cannot read the MP4 index, expected a complete file"), "{error}");
}

/// A byte of a file may be anything: there must be an answer, never a panic or a hang.
#[test]
fn damaged_videos_end_in_an_error_or_in_frames() {
    for at in (0..CLIP.len()).step_by(3) {
        let mut bytes = CLIP.to_vec();
        bytes[at] ^= 0x55;
        let (_folder, path) = file_with(&bytes);
        // Damage may make it another container, which is not for the bundled decoder.
        if let Ok(mp4::Opened::Video(mut video)) = Mp4Video::open(&path) {
            let (frames, _) = read_all(&mut *video);
            assert!(frames.len() <= 12);
        }
    }
}

#[test]
fn inputs_without_frames_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("none.mp4");
    assert!(
        error_text(open_frames(&path)).starts_with(&format!("{}: cannot open the input", path.display()))
    );
    fs::write(&path, []).unwrap();
    assert_eq!(
        error_text(open_frames(&path)),
        format!("{}: the file is empty, expected a video", path.display())
    );

    let empty = folder.path().join("empty");
    fs::create_dir(&empty).unwrap();
    fs::write(empty.join("readme.txt"), "no frame").unwrap();
    let expected = format!("{}: holds 0 frames, expected files *.png, *.jpg, *.jpeg", empty.display());
    assert_eq!(error_text(open_frames(&empty)), expected);
    let expected = format!("{}: holds 0 frames, expected files *.png", empty.display());
    assert_eq!(error_text(MaskFolder::open(&empty)), expected);
}

fn save_grey(path: &Path, width: u32, height: u32, value: u8) {
    image::GrayImage::from_pixel(width, height, image::Luma([value])).save(path).unwrap();
}

#[test]
fn folders_are_read_in_natural_order() {
    let folder = tempfile::tempdir().unwrap();
    for (name, value) in [("f10.png", 30), ("f2.png", 20), ("f1.PNG", 10)] {
        save_grey(&folder.path().join(name), 5, 4, value);
    }
    let mut source = open_frames(folder.path()).unwrap();
    assert_eq!(source.info().n_frames, Some(3));
    let (frames, error) = read_all(&mut *source);
    assert_eq!(error, None);
    assert_eq!(frames.iter().map(|frame| frame.pixels[0]).collect::<Vec<_>>(), [10, 20, 30]);
    assert!(natural_order("a01", "a1").is_lt() && natural_order("a1b", "a1").is_gt());
}

#[test]
fn a_folder_that_turns_bad_names_the_file() {
    let folder = tempfile::tempdir().unwrap();
    save_grey(&folder.path().join("1.png"), 5, 4, 10);
    save_grey(&folder.path().join("2.png"), 4, 5, 10);
    let second = folder.path().join("2.png");
    let (frames, error) = read_all(&mut *open_frames(folder.path()).unwrap());
    assert_eq!(frames.len(), 1);
    assert_eq!(error.unwrap(), format!("{}: is 4x5, expected 5x4 as the first frame", second.display()));

    let whole = fs::read(folder.path().join("1.png")).unwrap();
    fs::write(&second, &whole[..whole.len() / 2]).unwrap();
    let (frames, error) = read_all(&mut *open_frames(folder.path()).unwrap());
    assert_eq!(frames.len(), 1);
    let error = error.unwrap();
    assert!(error.starts_with(&format!("{}: cannot read the image: ", second.display())), "{error}");
}

#[test]
fn masks_of_zeros_and_ones_or_255s() {
    let folder = tempfile::tempdir().unwrap();
    let save = |name: &str, values: [u8; 4]| {
        image::GrayImage::from_raw(2, 2, values.to_vec()).unwrap().save(folder.path().join(name)).unwrap();
    };
    save("1.png", [0, 255, 127, 128]);
    save("2.png", [0, 1, 1, 0]);
    save("3.png", [0, 0, 0, 0]);
    let mut masks = MaskFolder::open(folder.path()).unwrap();
    assert_eq!((masks.info().width, masks.info().n_frames), (2, Some(3)));
    for expected in [".#\n.#", ".#\n#.", "..\n.."] {
        assert_eq!(masks.next_mask().unwrap().unwrap(), expected.parse().unwrap());
    }
    assert_eq!(masks.next_mask().unwrap(), None);
}

#[test]
fn reading_ahead_changes_nothing() {
    let (_folder, path) = file_with(&CLIP[..CLIP.len() - 150]);
    let direct = read_all(&mut *open_frames(&path).unwrap());
    let ahead = |depth| {
        let mut source = open_frames(&path).unwrap();
        Prefetch::new(depth, move || {
            let mut frame = RgbFrame::default();
            Ok(source.next_frame(&mut frame)?.then_some(frame))
        })
    };
    let mut frames = ahead(2);
    for frame in direct.0 {
        assert_eq!(frames.next().unwrap().unwrap(), frame);
    }
    assert_eq!(error_text(frames.next().unwrap()), direct.1.unwrap());
    assert!(frames.next().is_none(), "after an error there is an end");
    // Dropped with frames waiting, it must not hang.
    drop(ahead(1));
}

#[test]
fn without_ffmpeg_the_message_says_what_to_do() {
    let (_folder, path) = file_with(b"RIFF....AVI ");
    let error = error_text(FfmpegPipe::open_with(OsStr::new("no-such-ffmpeg"), &path));
    let expected =
        format!("{}: cannot run the program `no-such-ffmpeg`: install it, or convert", path.display());
    assert!(error.starts_with(&expected), "{error}");
}

fn has_ffmpeg() -> bool {
    let found = Command::new("ffmpeg").arg("-version").output().is_ok();
    if !found {
        eprintln!("SKIPPED: no ffmpeg");
    }
    found
}

#[test]
fn the_pipe_gives_the_same_frames() {
    if !has_ffmpeg() {
        return;
    }
    let (folder, path) = file_with(CLIP);
    let mut pipe = FfmpegPipe::open(&path).unwrap();
    assert_eq!((pipe.info().width, pipe.info().height, pipe.info().fps), (64, 48, Some(25.0)));
    let (frames, error) = read_all(&mut pipe);
    assert_eq!((frames.len(), error), (12, None));
    check_clip(&frames);

    let not_a_video = folder.path().join("notes.avi");
    fs::write(&not_a_video, "this is no video").unwrap();
    let error = error_text(open_frames(&not_a_video));
    assert!(error.contains("notes.avi: frame 0: ffmpeg stopped: "), "{error}");
}

/// A folder of recordings, where one is given.
fn data(relative: &str) -> Option<PathBuf> {
    let default = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let path = std::env::var_os("UMBRA_DATA").map_or(default, PathBuf::from).join(relative);
    let found = path.exists();
    assert!(found || std::env::var_os("UMBRA_REQUIRE_DATA").is_none(), "{} is required", path.display());
    if !found {
        eprintln!("SKIPPED: no data folder");
    }
    found.then_some(path)
}

/// ffmpeg's planes and the formula of BT.601 in floating point are the oracle.
#[test]
fn real_recordings_decode_as_by_ffmpeg() {
    const FRAMES: usize = 16;
    for clip in ["real/balance/video.mp4", "stage/S1/Walking_1/rgb/C2.mp4"] {
        let Some(path) = data(clip).filter(|_| has_ffmpeg()) else { return };
        let raw = Command::new("ffmpeg")
            .args(["-v", "error", "-i"])
            .arg(&path)
            .args(["-frames:v", &FRAMES.to_string(), "-pix_fmt", "yuv420p", "-f", "rawvideo", "-"])
            .output()
            .unwrap()
            .stdout;
        let mut source = open_frames(&path).unwrap();
        let (width, height) = (source.info().width as usize, source.info().height as usize);
        let pictures = raw.chunks_exact(width * height * 3 / 2);
        assert_eq!(pictures.len(), FRAMES);
        let mut frame = RgbFrame::default();
        for picture in pictures {
            assert!(source.next_frame(&mut frame).unwrap());
            let (luma, chroma) = picture.split_at(width * height);
            let (u, v) = chroma.split_at(chroma.len() / 2);
            for (at, rgb) in frame.pixels.chunks_exact(3).enumerate().step_by(7) {
                let chroma_at = at / width / 2 * (width / 2) + at % width / 2;
                let y = 255.0 / 219.0 * (f64::from(luma[at]) - 16.0);
                let (cb, cr) = (f64::from(u[chroma_at]) - 128.0, f64::from(v[chroma_at]) - 128.0);
                let expected = [
                    y + 255.0 / 112.0 * 0.701 * cr,
                    y - 255.0 / 112.0 * (0.886 * 0.114 * cb + 0.701 * 0.299 * cr) / 0.587,
                    y + 255.0 / 112.0 * 0.886 * cb,
                ];
                for (value, expected) in rgb.iter().zip(expected) {
                    assert!(
                        (f64::from(*value) - expected.clamp(0.0, 255.0)).abs() < 1.0,
                        "{clip}: pixel {at}"
                    );
                }
            }
        }
    }
}
