//! What the tests share: the program, small clips, and run folders read back.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use image::{GrayImage, Luma, Rgb, RgbImage, imageops};
use tempfile::TempDir;

/// Few particles: for tests that are not about accuracy.
pub const QUICK: [&str; 4] = ["--particles", "24", "--layers", "3"];

/// Size of the small clips: a quarter of the balance clip.
pub const WIDTH: u32 = 272;
/// As [`WIDTH`].
pub const HEIGHT: u32 = 480;

/// A colour that stands in no overlay but where the picture shows it, dimmed or not.
const MARK: Rgb<u8> = Rgb([255, 0, 255]);

/// The folder of the bundled clips.
pub fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures")
}

/// A video of this crate's test input.
pub fn video(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)
}

/// The program. A backtrace would show in what it prints, and so in the tests of messages.
pub fn umbra() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_umbra"));
    command.env("RUST_BACKTRACE", "1").stdin(Stdio::null());
    command
}

/// What the program answered.
#[derive(Debug)]
pub struct Answer {
    pub status: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

impl Answer {
    /// Runs the command to its end.
    pub fn of(command: &mut Command) -> Self {
        let output = command.output().expect("the program can be started");
        Self {
            status: output.status.code(),
            stdout: String::from_utf8(output.stdout).expect("it prints text"),
            stderr: String::from_utf8(output.stderr).expect("it prints text"),
        }
    }

    /// Asserts that everything went well.
    #[track_caller]
    pub fn succeeded(self) -> Self {
        assert_eq!(self.status, Some(0), "{}", self.stderr);
        assert!(!self.stderr.contains("error"), "{}", self.stderr);
        self
    }

    /// Asserts this exit status and exactly one message, which has all these parts.
    #[track_caller]
    pub fn failed(&self, status: i32, parts: &[&str]) {
        let text = &self.stderr;
        assert_eq!(self.status, Some(status), "{text}");
        let messages: Vec<usize> = text.match_indices("error: ").map(|(at, _)| at).collect();
        assert_eq!(messages.len(), 1, "expected one message, found {}:\n{text}", messages.len());
        let message = &text[messages[0]..];
        for part in parts {
            assert!(message.contains(part), "{part:?} is missing:\n{text}");
        }
        for noise in ["panicked", "backtrace", "unwrap"] {
            assert!(!text.contains(noise), "{noise:?} is no message for users:\n{text}");
        }
    }
}

/// `umbra track` on a video or a folder of frames, quickly, with the camera assumed for which `walker.mp4` was made.
pub fn track_assumed(input: &Path, out: &Path) -> Command {
    let mut command = umbra();
    command.arg("track").arg(input).args(["--focal-px", "240"]).args(QUICK).arg("--out").arg(out);
    command
}

/// A small clip in a folder of its own, with its camera; runs go beside it.
pub struct Clip {
    folder: TempDir,
}

impl Clip {
    /// A clip of these masks.
    pub fn of_masks<'a>(masks: impl IntoIterator<Item = &'a GrayImage>) -> Self {
        let clip = Self { folder: TempDir::new().expect("a folder for a test") };
        let folder = clip.path("masks");
        fs::create_dir(&folder).expect("a folder for masks");
        for (index, mask) in masks.into_iter().enumerate() {
            mask.save(folder.join(format!("{index:04}.png"))).expect("a mask can be written");
        }
        clip.write("camera.toml", CAMERA);
        clip
    }

    /// The first silhouettes of the balance clip.
    pub fn of_balance(n_frames: u32) -> Self {
        Self::of_masks(&(0..n_frames).map(silhouette).collect::<Vec<_>>())
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        fs::write(&path, content).expect("a file for a test can be written");
        path
    }

    /// `umbra track` on one of the clip's folders or a video, with its camera, quickly, into the folder `out` beside it.
    pub fn track_input(&self, input: impl AsRef<Path>, out: &str) -> Command {
        let mut command = umbra();
        command.arg("track").arg(self.path("").join(input)).args(QUICK);
        command.arg("--camera").arg(self.path("camera.toml")).arg("--out").arg(self.path(out));
        command
    }

    /// The same on its masks.
    pub fn track(&self, out: &str) -> Command {
        let mut command = self.track_input("masks", out);
        command.arg("--masks");
        command
    }

    /// Paints pictures of the clip's masks, beside `plate.png`, a picture of the empty scene.
    pub fn paint_frames(&self, extension: &str) {
        let folder = self.path("frames");
        fs::create_dir(&folder).expect("a folder for frames");
        wall().save(self.path("plate.png")).expect("a plate can be written");
        for entry in fs::read_dir(self.path("masks")).expect("masks were written") {
            let file = entry.expect("a mask").path();
            let mask = image::open(&file).expect("a mask").into_luma8();
            let mut picture = wall();
            for (pixel, mask) in picture.pixels_mut().zip(mask.pixels()) {
                if mask.0[0] == 255 {
                    *pixel = Rgb([60, 70, 90]);
                }
            }
            let name = file.file_stem().expect("a name").to_string_lossy().into_owned();
            picture.save(folder.join(format!("{name}.{extension}"))).expect("a frame can be written");
        }
    }
}

/// A plain wall, lit from below, with a marked stripe at the height of the person's waist.
fn wall() -> RgbImage {
    RgbImage::from_fn(WIDTH, HEIGHT, |x, y| {
        let light = (y / 24) as u8 + (x * 7 + y * 11) as u8 % 4;
        if y / 10 == 23 { MARK } else { Rgb([180 + light, 160 + light, 136 + light]) }
    })
}

/// Whether the stripe on the wall is to be seen.
pub fn shows_mark(picture: &RgbImage) -> bool {
    picture.pixels().any(|pixel| pixel.0[0] > 150 && pixel.0[1] < 60 && pixel.0[2] > 150)
}

/// A silhouette of the balance clip at a quarter of its size.
pub fn silhouette(frame: u32) -> GrayImage {
    let path = fixtures().join(format!("balance/masks/{frame:04}.png"));
    let mask = image::open(&path).expect("a bundled mask").into_luma8();
    let mut small = imageops::thumbnail(&mask, WIDTH, HEIGHT);
    for pixel in small.pixels_mut() {
        pixel.0[0] = if pixel.0[0] >= 128 { 255 } else { 0 };
    }
    small
}

/// The mask moved to the right by so many pixels; what leaves the image is gone.
pub fn shifted(mask: &GrayImage, right_px: i64) -> GrayImage {
    GrayImage::from_fn(WIDTH, HEIGHT, |x, y| {
        let from = i64::from(x) - right_px;
        if (0..i64::from(WIDTH)).contains(&from) { *mask.get_pixel(from as u32, y) } else { Luma([0]) }
    })
}

/// A mask of nobody.
pub fn nobody() -> GrayImage {
    GrayImage::new(WIDTH, HEIGHT)
}

/// The camera of the balance clip at a quarter of its resolution.
pub const CAMERA: &str = "\
image_size = [272, 480]
fps = 60.0
focal_px = [418.80875, 418.80106]
principal_point_px = [134.65155, 240.63257]
distortion = [0.0, 0.0, 0.0, 0.0, 0.0]
rotation = [
  [0.258485225, -0.875184084, -0.408947683],
  [-0.495845522, 0.243109802, -0.833687497],
  [0.829049219, 0.418270777, -0.371115817],
]
translation_m = [0.508860642, 0.033698945, 4.401038164]
";

/// The bytes of every file below a folder.
pub fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(inside) = folders.pop() {
        for entry in fs::read_dir(&inside).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(folder).expect("it lies below").to_owned();
                files.insert(name, fs::read(&path).expect("a file"));
            }
        }
    }
    files
}

/// Asserts that two folders hold the same files with the same bytes.
#[track_caller]
pub fn assert_same_contents(a: &Path, b: &Path) {
    let (in_a, in_b) = (contents(a), contents(b));
    assert_eq!(in_a.keys().collect::<Vec<_>>(), in_b.keys().collect::<Vec<_>>(), "names of files");
    for (name, bytes) in &in_a {
        assert!(*bytes == in_b[name], "{} differs", name.display());
    }
}

/// A table of a run folder: its rows, by the names of its columns.
pub fn table(path: &Path) -> Vec<BTreeMap<String, String>> {
    csv::Reader::from_path(path)
        .expect("a table")
        .deserialize()
        .collect::<Result<_, _>>()
        .expect("rows as long as the header")
}

/// The cells of a column, in order.
pub fn column<'a>(rows: &'a [BTreeMap<String, String>], name: &str) -> Vec<&'a str> {
    rows.iter().map(|row| row[name].as_str()).collect()
}

#[test]
#[should_panic(expected = "b.txt differs")]
fn unequal_files_are_noticed() {
    let folder = TempDir::new().expect("a folder for a test");
    for (name, text) in [("one", "same"), ("two", "sane")] {
        fs::create_dir_all(folder.path().join(name).join("deep")).expect("a folder");
        fs::write(folder.path().join(name).join("a.txt"), "a").expect("a file");
        fs::write(folder.path().join(name).join("deep/b.txt"), text).expect("a file");
    }
    assert_same_contents(&folder.path().join("one"), &folder.path().join("two"));
}

#[test]
#[should_panic(expected = "expected one message, found 2")]
fn a_second_message_is_noticed() {
    let stderr = "error: one\nerror: two\n".to_owned();
    Answer { status: Some(1), stdout: String::new(), stderr }.failed(1, &["one"]);
}
