//! `umbra eval real`: tracks a real clip from its own start and compares it with reference joints.
//!
//! The clip is tracked once a seed with the heading of the first frame given to 45 degrees, and once a seed without
//! any help. Lost frames count like all others, with the pose the tracker holds on them.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use body::JointId;
use serde::Serialize;

use super::joint_error::{JointErrors, largest, mean, median};
use super::reference::{self, JUDGED};
use crate::config::{ExecConfig, TrackConfig, TrackParams};
use crate::run_folder::{FrameRecord, Status};
use crate::track::{CameraChoice, Clip, ClipInput, MaskMaker, TrackJob, track_clip};

/// What to evaluate.
#[derive(Clone, Debug)]
pub struct RealEval {
    /// Folder with `video.mp4` and `background.png` (or ready `masks/`), `camera.toml` and `joints3d.csv`.
    pub data: PathBuf,
    /// First frame and the one after the last; all when absent.
    pub frames: Option<std::ops::Range<u64>>,
    /// Number of seeds, 1, 2, and so on.
    pub seeds: u64,
    /// Where `eval.json` and the run folders go.
    pub out: PathBuf,
    /// Settings of every run, but for the seed and the initial heading.
    pub config: TrackConfig,
    /// Threads.
    pub exec: ExecConfig,
}

/// The figures of one start condition: means over seeds, then each seed.
#[derive(Clone, Debug, Serialize)]
pub struct RealFigures {
    /// Mean intersection over union of body and mask.
    pub iou_mean: f64,
    /// Its least value over frames and seeds.
    pub iou_worst: f64,
    /// Mean error of the 12 joints, midpoints of the hips put on each other, mm.
    pub mpjpe_root_mm: f64,
    /// Its part across the line of sight, mm.
    pub image_plane_mm: f64,
    /// Its part along the line of sight, mm.
    pub depth_mm: f64,
    /// Mean distance of the midpoints of the hips, mm.
    pub pelvis_mm: f64,
    /// Frames on which the person was lost or not seen, mean over seeds.
    pub frames_lost: f64,
    /// Frames a second, decoding and run folder included.
    pub fps: f64,
    /// The runs.
    pub seeds: Vec<SeedFigures>,
}

/// The figures of one run.
#[derive(Clone, Debug, Serialize)]
pub struct SeedFigures {
    /// Its seed.
    pub seed: u64,
    /// Frames compared.
    pub frames: usize,
    /// As in [`RealFigures`].
    pub iou_mean: f64,
    /// As in [`RealFigures`].
    pub iou_worst: f64,
    /// As in [`RealFigures`].
    pub mpjpe_root_mm: f64,
    /// Median over frames of the frame's mean error, mm.
    pub median_mm: f64,
    /// Worst frame's mean error, mm.
    pub worst_mm: f64,
    /// As in [`RealFigures`].
    pub image_plane_mm: f64,
    /// As in [`RealFigures`].
    pub depth_mm: f64,
    /// As in [`RealFigures`].
    pub pelvis_mm: f64,
    /// Frames lost or not seen.
    pub frames_lost: usize,
    /// As in [`RealFigures`].
    pub fps: f64,
    /// Mean, median and worst error of each joint, mm.
    pub joints: Vec<JointFigures>,
}

/// Errors of one joint over a run, root aligned.
#[derive(Clone, Debug, Serialize)]
pub struct JointFigures {
    /// Its name in the reference.
    pub joint: &'static str,
    /// Mean over frames, mm.
    pub mean_mm: f64,
    /// Median over frames, mm.
    pub median_mm: f64,
    /// Worst frame, mm.
    pub worst_mm: f64,
}

/// What `eval.json` holds: the figures with the heading given, and beside them those without.
#[derive(Clone, Debug, Serialize)]
pub struct RealReport {
    /// The data folder.
    pub data: PathBuf,
    /// The heading given, degrees, a multiple of 45.
    pub heading_given_deg: f64,
    /// With the heading given.
    #[serde(flatten)]
    pub given: RealFigures,
    /// Without any help.
    pub without_heading: RealFigures,
}

/// Runs the evaluation, writes `eval.json` and returns the report.
///
/// # Errors
/// When the data cannot be read, a run fails, or the results cannot be written.
pub fn evaluate(eval: &RealEval) -> anyhow::Result<RealReport> {
    let reference_path = eval.data.join("joints3d.csv");
    let frames = reference::read_reference(&reference_path)?;
    let first = eval.frames.as_ref().map_or(0, |range| range.start as usize);
    let heading = frames
        .range(first..)
        .find_map(|(_, frame)| reference::heading_rad(frame))
        .with_context(|| format!("{}: no frame shows both hips, expected one", reference_path.display()))?;
    let given_deg = 45.0 * (heading.to_degrees() / 45.0).round();
    fs::create_dir_all(&eval.out).with_context(|| format!("{}: cannot make the folder", eval.out.display()))?;
    let report = RealReport {
        data: eval.data.clone(),
        heading_given_deg: given_deg,
        given: start_condition(eval, &frames, Some(given_deg))?,
        without_heading: start_condition(eval, &frames, None)?,
    };
    let path = eval.out.join("eval.json");
    let json = serde_json::to_string_pretty(&report).context("the report as JSON")?;
    fs::write(&path, json + "\n").with_context(|| format!("{}: cannot write", path.display()))?;
    Ok(report)
}
