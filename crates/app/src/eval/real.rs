//! `umbra eval real`: tracks a real clip from its own start and compares it with reference joints.
//!
//! The clip is tracked once a seed with the heading of the first frame given to 45 degrees, and once a seed without
//! any help. Lost frames count like all others, with the pose the tracker holds on them.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::{Context as _, bail};
use serde::Serialize;

use super::joint_error::{JointErrors, largest, mean, median};
use super::reference::{self, JUDGED, ReferenceFrame};
use super::write_json;
use crate::config::{ExecConfig, TrackConfig};
use crate::predict::Activity;
use crate::run_folder::Existing;
use crate::track::{Background, CameraChoice, ClipInput, TrackJob, track_clip};

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
    let report = RealReport {
        data: eval.data.clone(),
        heading_given_deg: given_deg,
        given: start_condition(eval, &frames, Some(given_deg))?,
        without_heading: start_condition(eval, &frames, None)?,
    };
    write_json(&eval.out, &report)?;
    Ok(report)
}

/// One run a seed under one start condition.
fn start_condition(
    eval: &RealEval,
    reference: &BTreeMap<usize, ReferenceFrame>,
    heading_deg: Option<f64>,
) -> anyhow::Result<RealFigures> {
    let seeds = (1..=eval.seeds)
        .map(|seed| run_seed(eval, reference, heading_deg, seed))
        .collect::<anyhow::Result<Vec<_>>>()?;
    let over_seeds = |figure: fn(&SeedFigures) -> f64| mean(seeds.iter().map(figure));
    Ok(RealFigures {
        iou_mean: over_seeds(|s| s.iou_mean),
        iou_worst: seeds.iter().map(|s| s.iou_worst).fold(1.0, f64::min),
        mpjpe_root_mm: over_seeds(|s| s.mpjpe_root_mm),
        image_plane_mm: over_seeds(|s| s.image_plane_mm),
        depth_mm: over_seeds(|s| s.depth_mm),
        pelvis_mm: over_seeds(|s| s.pelvis_mm),
        frames_lost: over_seeds(|s| s.frames_lost as f64),
        fps: over_seeds(|s| s.fps),
        seeds,
    })
}

fn run_seed(
    eval: &RealEval,
    reference: &BTreeMap<usize, ReferenceFrame>,
    heading_deg: Option<f64>,
    seed: u64,
) -> anyhow::Result<SeedFigures> {
    let start = if heading_deg.is_some() { "heading" } else { "no-heading" };
    let masks = eval.data.join("masks");
    let input = if masks.is_dir() {
        ClipInput::Masks(masks)
    } else {
        ClipInput::Frames(eval.data.join("video.mp4"), Background::Plate(eval.data.join("background.png")))
    };
    let camera_path = eval.data.join("camera.toml");
    let job = TrackJob {
        input,
        camera: CameraChoice::File(camera_path),
        out: eval.out.join(format!("{start}-seed-{seed}")),
        config: TrackConfig { seed, initial_heading_deg: heading_deg, ..eval.config.clone() },
        predictor: None,
        save_predictor: None,
        activity: Activity::Any,
        frames: eval.frames.clone(),
        fps: None,
        redact: false,
        existing: Existing::Replace,
    };
    let outcome = track_clip(&job, eval.exec)?;
    let mut errors = JointErrors::default();
    for frame in &outcome.frames {
        if let Some(truth) = reference.get(&(frame.frame as usize)) {
            errors.add(&frame.joints_world, truth, outcome.camera.centre_world());
        }
    }
    if errors.frame_mm.is_empty() {
        bail!("{}: none of the tracked frames has reference hips", eval.data.join("joints3d.csv").display());
    }
    let over_joints = |parts: &[Vec<f64>; JUDGED.len()]| mean(parts.iter().flatten().copied());
    Ok(SeedFigures {
        seed,
        frames: errors.frame_mm.len(),
        iou_mean: mean(outcome.frames.iter().map(|frame| frame.iou)),
        iou_worst: outcome.frames.iter().map(|frame| frame.iou).fold(1.0, f64::min),
        mpjpe_root_mm: over_joints(&errors.root_aligned_mm),
        median_mm: median(&errors.frame_mm),
        worst_mm: largest(&errors.frame_mm),
        image_plane_mm: over_joints(&errors.image_plane_mm),
        depth_mm: over_joints(&errors.depth_mm),
        pelvis_mm: mean(errors.pelvis_mm.iter().copied()),
        frames_lost: outcome.frames.len() - outcome.summary.tracked as usize,
        fps: outcome.fps,
        joints: JUDGED
            .iter()
            .zip(&errors.root_aligned_mm)
            .map(|((name, _), mm)| JointFigures {
                joint: name,
                mean_mm: mean(mm.iter().copied()),
                median_mm: median(mm),
                worst_mm: largest(mm),
            })
            .collect(),
    })
}

/// The report as tables in Markdown.
pub fn table(report: &RealReport) -> String {
    let mut text = format!("{}\n\n", report.data.display());
    text += "| start | seed | mm | median | worst | image plane | depth | pelvis | IoU | worst | lost | frames/s |\n";
    text += "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n";
    let given = format!("heading {}°", report.heading_given_deg.round() as i64);
    for (start, figures) in [(given.as_str(), &report.given), ("no heading", &report.without_heading)] {
        for s in &figures.seeds {
            let _ = writeln!(
                text,
                "| {start} | {} | {:.1} | {:.1} | {:.1} | {:.1} | {:.1} | {:.1} | {:.3} | {:.3} | {} | {:.1} |",
                s.seed,
                s.mpjpe_root_mm,
                s.median_mm,
                s.worst_mm,
                s.image_plane_mm,
                s.depth_mm,
                s.pelvis_mm,
                s.iou_mean,
                s.iou_worst,
                s.frames_lost,
                s.fps
            );
        }
        let _ = writeln!(
            text,
            "| {start} | mean | {:.1} | | | {:.1} | {:.1} | {:.1} | {:.3} | {:.3} | {:.1} | {:.1} |",
            figures.mpjpe_root_mm,
            figures.image_plane_mm,
            figures.depth_mm,
            figures.pelvis_mm,
            figures.iou_mean,
            figures.iou_worst,
            figures.frames_lost,
            figures.fps
        );
    }
    text += "\n| joint | mean mm | median | worst | (heading given, mean over seeds)\n|---|---:|---:|---:|\n";
    for (slot, (name, _)) in JUDGED.iter().enumerate() {
        let over_seeds = |figure: fn(&JointFigures) -> f64| {
            mean(report.given.seeds.iter().map(|seed| figure(&seed.joints[slot])))
        };
        let _ = writeln!(
            text,
            "| {name} | {:.0} | {:.0} | {:.0} |",
            over_seeds(|j| j.mean_mm),
            over_seeds(|j| j.median_mm),
            over_seeds(|j| j.worst_mm)
        );
    }
    text
}
