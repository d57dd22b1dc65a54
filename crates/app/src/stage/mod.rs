//! Sequences of a stage-like data set: several subjects and activities before calibrated cameras, with true joints.
//!
//! The layout is that of a folder with `calibration/CAMERA.json` and, for each subject, `subject.json` and one folder a
//! sequence with `sequence.json`, `joints.csv`, `segments.csv` and `CAMERA/observed/` and `CAMERA/clean/` masks. Lengths
//! in the files are millimetres; here everything is in metres.

mod skeleton_fit;

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use body::{Camera, Sex};
use glam::{DQuat, DVec3};
use serde::Deserialize;

pub use skeleton_fit::{FittedSequence, fit_sequence, markers_of, personal_joints, rotations_of};

/// Ends of the body's segments, in the order of `joints.csv`.
pub const MARKERS: [&str; 20] = [
    "torsoProximal",
    "torsoDistal",
    "upperLArmProximal",
    "upperLArmDistal",
    "lowerLArmProximal",
    "lowerLArmDistal",
    "upperRArmProximal",
    "upperRArmDistal",
    "lowerRArmProximal",
    "lowerRArmDistal",
    "upperLLegProximal",
    "upperLLegDistal",
    "lowerLLegProximal",
    "lowerLLegDistal",
    "upperRLegProximal",
    "upperRLegDistal",
    "lowerRLegProximal",
    "lowerRLegDistal",
    "headProximal",
    "headDistal",
];

/// Segments with a true rotation, in the order of `segments.csv`, each with the index of its parent.
pub const SEGMENTS: [(&str, Option<usize>); 17] = [
    ("pelvis", None),
    ("abdomen", Some(0)),
    ("thorax", Some(1)),
    ("neck", Some(2)),
    ("head", Some(3)),
    ("upperLArm", Some(2)),
    ("lowerLArm", Some(5)),
    ("handL", Some(6)),
    ("upperLLeg", Some(0)),
    ("lowerLLeg", Some(8)),
    ("footL", Some(9)),
    ("upperRArm", Some(2)),
    ("lowerRArm", Some(11)),
    ("handR", Some(12)),
    ("upperRLeg", Some(0)),
    ("lowerRLeg", Some(14)),
    ("footR", Some(15)),
];

/// True positions of the [`MARKERS`] on one frame, metres, world.
pub type Markers = [DVec3; MARKERS.len()];

/// Rotations of the [`SEGMENTS`] since the rest pose, world.
pub type Rotations = [DQuat; SEGMENTS.len()];

/// A sequence with its truth.
#[derive(Clone, Debug)]
pub struct Sequence {
    /// Its folder.
    pub folder: PathBuf,
    /// The subject's name, as `S1`.
    pub subject: String,
    /// Sex of the subject, if known.
    pub sex: Option<Sex>,
    /// Stature of the subject, metres.
    pub stature_m: f64,
    /// What the subject does: the name of the sequence up to the underscore.
    pub activity: String,
    /// Frames a second.
    pub fps: f64,
    /// Cameras with masks.
    pub cameras: Vec<String>,
    /// Frames for testing.
    pub test: Range<usize>,
    /// Frames for training.
    pub train: Range<usize>,
    /// The recorded people whose motion it is, as `35`.
    pub performers: Vec<String>,
    /// True joints by frame; none where they are not valid.
    pub markers: Vec<Option<Markers>>,
    /// True rotations by frame.
    pub rotations: Vec<Rotations>,
}

#[derive(Deserialize)]
struct SequenceFile {
    name: String,
    subject: String,
    fps: f64,
    cameras: Vec<String>,
    test_range: [usize; 2],
    train_range: [usize; 2],
    #[serde(default)]
    source_clips: Vec<SourceClip>,
}

#[derive(Deserialize)]
struct SourceClip {
    clip: String,
}

#[derive(Deserialize)]
struct SubjectFile {
    sex: Option<String>,
    stature_mm: f64,
}

/// One of so many parts of the training frames validates, and
const VALIDATION_PART: usize = 3;
/// so many frames before it are left out: neighbours are nearly equal.
const VALIDATION_GAP: usize = 10;

/// Frame rates that a sequence may have.
const FRAME_RATES_HZ: std::ops::RangeInclusive<f64> = 1.0..=1000.0;
/// A quaternion shorter than this is no rotation.
const LEAST_NORM: f64 = 0.5;

impl Sequence {
    /// Reads the sequence in `folder`.
    ///
    /// # Errors
    /// When a file is missing or holds what no sequence has; the message names it.
    pub fn read(folder: &Path) -> anyhow::Result<Self> {
        let path = folder.join("sequence.json");
        let file: SequenceFile = read_json(&path)?;
        let subject: SubjectFile = read_json(&folder.join("../subject.json"))?;
        ensure!(
            (1.0..2.5).contains(&(subject.stature_m())),
            "{}: `stature_mm` is {}, expected 1000 to 2500",
            folder.join("../subject.json").display(),
            subject.stature_mm
        );
        ensure!(
            FRAME_RATES_HZ.contains(&file.fps),
            "{}: `fps` is {}, expected {} to {}",
            path.display(),
            file.fps,
            FRAME_RATES_HZ.start(),
            FRAME_RATES_HZ.end()
        );
        let markers = read_markers(&folder.join("joints.csv"))?;
        let rotations = read_rotations(&folder.join("segments.csv"))?;
        let [test, train] = [file.test_range, file.train_range].map(|[first, last]| first..last + 1);
        let n_frames = markers.len().min(rotations.len());
        for (field, range) in [("test_range", &test), ("train_range", &train)] {
            if range.is_empty() || range.end > n_frames {
                bail!(
                    "{}: `{field}` is [{}, {}], expected first and last of the {n_frames} frames in joints.csv and segments.csv",
                    path.display(),
                    range.start,
                    range.end - 1,
                );
            }
        }
        let mut performers: Vec<String> = file
            .source_clips
            .iter()
            .filter_map(|source| Some(source.clip.split_whitespace().last()?.split('_').next()?.to_owned()))
            .collect();
        performers.sort();
        performers.dedup();
        Ok(Self {
            folder: folder.to_owned(),
            subject: file.subject,
            sex: match subject.sex.as_deref() {
                Some("male") => Some(Sex::Male),
                Some("female") => Some(Sex::Female),
                _ => None,
            },
            stature_m: subject.stature_m(),
            activity: file.name.split('_').next().unwrap_or_default().to_owned(),
            fps: file.fps,
            cameras: file.cameras,
            test,
            train,
            performers,
            markers,
            rotations,
        })
    }

    /// The sequence with the last of its training frames in place of the test frames, and those before them to train on.
    #[must_use]
    pub fn for_validation(mut self) -> Self {
        let start = self.train.end - (self.train.len() / VALIDATION_PART).max(1);
        self.test = start..self.train.end;
        self.train.end = start.saturating_sub(VALIDATION_GAP).max(self.train.start + 1);
        self
    }

    /// The name of a file with what was learned from the sequence, as `S1-Walking_1.bin`.
    pub fn model_file_name(&self) -> String {
        let name = self.folder.file_name().unwrap_or_default().to_string_lossy();
        format!("{}-{name}.bin", self.subject)
    }

    /// All sequences of the data set in `data`, sorted by subject and name.
    ///
    /// # Errors
    /// When there are none, or one cannot be read.
    pub fn read_all(data: &Path) -> anyhow::Result<Vec<Self>> {
        let mut sequences = Vec::new();
        for subject in sorted_folders(data)? {
            for folder in sorted_folders(&subject)? {
                if folder.join("sequence.json").is_file() {
                    sequences.push(Self::read(&folder)?);
                }
            }
        }
        ensure!(
            !sequences.is_empty(),
            "{}: no SUBJECT/SEQUENCE/sequence.json in it, expected a stage-like data set",
            data.display()
        );
        Ok(sequences)
    }

    /// Subject and activity, as `S1 Walking`.
    pub fn title(&self) -> String {
        format!("{} {}", self.subject, self.activity)
    }

    /// The file of a camera.
    pub fn camera_path(&self, camera: &str) -> PathBuf {
        self.folder.join("../../calibration").join(format!("{camera}.json"))
    }

    /// A camera.
    ///
    /// # Errors
    /// When its file cannot be read or lacks the pose of the camera.
    pub fn camera(&self, camera: &str) -> anyhow::Result<Camera> {
        let path = self.camera_path(camera);
        let file = body::io::load_camera(&path)?;
        file.camera().with_context(|| format!("{}: has no pose of the camera", path.display()))
    }

    /// The folder of a camera's masks: `kind` is `observed` or `clean`.
    pub fn masks_path(&self, camera: &str, kind: &str) -> PathBuf {
        self.folder.join(camera).join(kind)
    }
}

impl SubjectFile {
    fn stature_m(&self) -> f64 {
        self.stature_mm / 1000.0
    }
}

fn read_json<T: for<'de> Deserialize<'de>>(path: &Path) -> anyhow::Result<T> {
    let text =
        fs::read_to_string(path).with_context(|| format!("{}: cannot read the file", path.display()))?;
    serde_json::from_str(&text).with_context(|| format!("{}: not as expected", path.display()))
}

fn sorted_folders(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let entries =
        fs::read_dir(folder).with_context(|| format!("{}: cannot read the folder", folder.display()))?;
    let mut folders = Vec::new();
    for entry in entries {
        let path = entry.with_context(|| format!("{}: cannot read the folder", folder.display()))?.path();
        if path.is_dir() {
            folders.push(path);
        }
    }
    folders.sort();
    Ok(folders)
}

/// A table of numbers by column name.
struct Table {
    path: PathBuf,
    header: csv::StringRecord,
    rows: Vec<Vec<f64>>,
}

impl Table {
    fn read(path: &Path) -> anyhow::Result<Self> {
        let context = || format!("{}: cannot read the table", path.display());
        let mut reader = csv::Reader::from_path(path).with_context(context)?;
        let header = reader.headers().with_context(context)?.clone();
        let mut rows = Vec::new();
        for (index, record) in reader.records().enumerate() {
            let record = record.with_context(context)?;
            let row = record.iter().zip(&header).map(|(cell, column)| match cell.parse::<f64>() {
                Ok(number) if number.is_finite() => Ok(number),
                _ => bail!(
                    "{}: line {}: `{column}` is {cell:?}, expected a finite number",
                    path.display(),
                    index + 2
                ),
            });
            rows.push(row.collect::<anyhow::Result<_>>()?);
        }
        ensure!(!rows.is_empty(), "{}: holds no frames", path.display());
        Ok(Self { path: path.to_owned(), header, rows })
    }

    fn column(&self, name: &str) -> anyhow::Result<usize> {
        self.header
            .iter()
            .position(|column| column == name)
            .with_context(|| format!("{}: has no column `{name}`", self.path.display()))
    }

    /// The columns `NAME_a`, `NAME_b` and so on, for each name.
    fn columns<const N: usize, const M: usize>(
        &self,
        names: [&str; N],
        axes: [&str; M],
    ) -> anyhow::Result<[[usize; M]; N]> {
        let mut columns = [[0; M]; N];
        for (columns, name) in columns.iter_mut().zip(names) {
            for (column, axis) in columns.iter_mut().zip(axes) {
                *column = self.column(&format!("{name}_{axis}"))?;
            }
        }
        Ok(columns)
    }
}

fn read_markers(path: &Path) -> anyhow::Result<Vec<Option<Markers>>> {
    let table = Table::read(path)?;
    let valid = table.column("valid")?;
    let columns = table.columns(MARKERS, ["x", "y", "z"])?;
    let frame = |row: &Vec<f64>| {
        let marker = |at: [usize; 3]| DVec3::from_array(at.map(|column| row[column])) / 1000.0;
        (row[valid] > 0.0).then(|| columns.map(marker))
    };
    Ok(table.rows.iter().map(frame).collect())
}

fn read_rotations(path: &Path) -> anyhow::Result<Vec<Rotations>> {
    let table = Table::read(path)?;
    let names = SEGMENTS.map(|(name, _)| name);
    let columns = table.columns(names, ["x", "y", "z", "w"])?;
    let mut frames = Vec::with_capacity(table.rows.len());
    for (index, row) in table.rows.iter().enumerate() {
        let rotations = columns.map(|at| DQuat::from_array(at.map(|column| row[column])));
        if let Some(segment) = rotations.iter().position(|rotation| rotation.length() < LEAST_NORM) {
            bail!(
                "{}: line {}: the rotation of `{}` has length {}, expected 1",
                path.display(),
                index + 2,
                names[segment],
                rotations[segment].length()
            );
        }
        frames.push(rotations.map(DQuat::normalize));
    }
    Ok(frames)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_label_that_is_no_number_is_named() {
        let folder = tempfile::tempdir().expect("a folder for a test");
        let path = folder.path().join("joints.csv");
        fs::write(&path, "frame,valid,torsoProximal_x\n0,1,5.0\n1,1,NaN\n").expect("it can be written");
        let error = read_markers(&path).expect_err("NaN is no label");
        let message = format!("{error:#}");
        assert!(message.contains("joints.csv: line 3: `torsoProximal_x` is \"NaN\""), "{message}");
    }

    #[test]
    fn a_rotation_that_is_none_is_named() {
        let folder = tempfile::tempdir().expect("a folder for a test");
        let path = folder.path().join("segments.csv");
        let columns =
            SEGMENTS.map(|(name, _)| ["w", "x", "y", "z"].map(|axis| format!("{name}_{axis}")).join(","));
        let write = |last: &str| {
            let rows = [columns.join(","), vec!["1,0,0,0"; SEGMENTS.len() - 1].join(",") + "," + last];
            fs::write(&path, rows.join("\n")).expect("it can be written");
            read_rotations(&path)
        };
        assert_eq!(
            write("0,0,2,0").expect("any length")[0][SEGMENTS.len() - 1],
            DQuat::from_xyzw(0.0, 1.0, 0.0, 0.0)
        );
        let message = format!("{:#}", write("0,0,0,0").expect_err("no rotation"));
        assert!(
            message.contains("segments.csv: line 2: the rotation of `footR` has length 0, expected 1"),
            "{message}"
        );
    }

    #[test]
    fn a_missing_column_and_an_empty_table_are_named() {
        let folder = tempfile::tempdir().expect("a folder for a test");
        let path = folder.path().join("joints.csv");
        fs::write(&path, "frame,valid\n0,1\n").expect("it can be written");
        assert!(
            format!("{:#}", read_markers(&path).expect_err("no markers"))
                .contains("no column `torsoProximal_x`")
        );
        fs::write(&path, "frame,valid,torsoProximal_x\n0,1,5.0\n").expect("it can be written");
        assert!(
            format!("{:#}", read_markers(&path).expect_err("half a marker"))
                .contains("no column `torsoProximal_y`")
        );
        fs::write(&path, "frame,valid\n").expect("it can be written");
        assert!(format!("{:#}", read_markers(&path).expect_err("no rows")).contains("holds no frames"));
    }
}
