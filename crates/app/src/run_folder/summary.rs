//! `summary.json`, and the text that `umbra info` prints.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use anyhow::{Context as _, bail};
use serde::{Deserialize, Serialize};

use super::journal::read_entries;
use super::record::{Entry, Learned, Status};
use super::run_file::{RunFile, VERSION};
use super::tables::mean_joint_sd_m;
use super::{JOURNAL, PRODUCTS, RUN_FILE, SUMMARY};

/// What a run came to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Version of this file.
    pub version: u32,
    /// Why the run ends before its input, if it does.
    pub cut_short_by: Option<String>,
    /// Number of the first frame.
    pub first_frame: u64,
    /// Frames in the run.
    pub frames: u64,
    /// Frames a second.
    pub fps: f64,
    /// Frames on which the person was seen and explained.
    pub tracked: u64,
    /// Frames bridged without a usable mask.
    pub coasting: u64,
    /// Frames on which the person was lost.
    pub lost: u64,
    /// Intersection over union of body and mask over the tracked frames.
    pub iou_mean: Option<f64>,
    /// Its median.
    pub iou_median: Option<f64>,
    /// Its least value.
    pub iou_worst: Option<f64>,
    /// The frame with the least value.
    pub iou_worst_frame: Option<u64>,
    /// Standard deviation of a joint's position, mean over joints and tracked frames, metres.
    pub joint_sd_mean_m: Option<f64>,
    /// What the predictor learned, where it learned.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub learned: Option<Learned>,
}

impl Summary {
    pub(super) fn of(entries: &[Entry], fps: f64, cut_short_by: Option<&str>) -> Self {
        let count = |status| entries.iter().filter(|entry| entry.record.status == status).count() as u64;
        let tracked: Vec<_> = entries
            .iter()
            .map(|entry| &entry.record)
            .filter(|record| record.status == Status::Tracked)
            .collect();
        let mut ious: Vec<(f64, u64)> = tracked.iter().map(|record| (record.iou, record.frame)).collect();
        ious.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mean = |values: &mut dyn Iterator<Item = f64>| {
            (!tracked.is_empty()).then(|| values.sum::<f64>() / tracked.len() as f64)
        };
        Self {
            version: VERSION,
            cut_short_by: cut_short_by.map(str::to_owned),
            first_frame: entries.first().map_or(0, |entry| entry.record.frame),
            frames: entries.len() as u64,
            fps,
            tracked: count(Status::Tracked),
            coasting: count(Status::Coasting),
            lost: count(Status::Lost),
            iou_mean: mean(&mut tracked.iter().map(|record| record.iou)),
            iou_median: ious.get(ious.len() / 2).map(|&(iou, _)| iou),
            iou_worst: ious.first().map(|&(iou, _)| iou),
            iou_worst_frame: ious.first().map(|&(_, frame)| frame),
            joint_sd_mean_m: mean(&mut tracked.iter().map(|record| mean_joint_sd_m(record))),
            learned: entries.iter().filter_map(|entry| entry.record.learned).reduce(|mut sum, learned| {
                sum += learned;
                sum
            }),
        }
    }
}

/// What a run folder holds, as text for a person.
pub fn describe(folder: &Path) -> anyhow::Result<String> {
    if !folder.join(RUN_FILE).is_file() {
        bail!("{}: holds no {RUN_FILE}, expected a run folder", folder.display());
    }
    let run = RunFile::read(&folder.join(RUN_FILE))?;
    let mut text = String::new();
    fill(&mut text, folder, &run)?;
    Ok(text)
}

fn fill(text: &mut String, folder: &Path, run: &RunFile) -> anyhow::Result<()> {
    writeln!(text, "{}: a run of {}", folder.display(), run.program)?;
    for input in &run.inputs {
        writeln!(
            text,
            "  {:<12} {}  sha256 {}…",
            input.role,
            input.path,
            input.sha256.get(..12).unwrap_or_default()
        )?;
    }
    let camera = &run.camera;
    writeln!(
        text,
        "  {:<12} {} x {} pixels, focal length {:.1} x {:.1} pixels, {:.4} frames/s",
        "camera", camera.width, camera.height, camera.focal_px[0], camera.focal_px[1], run.fps
    )?;
    writeln!(
        text,
        "  {:<12} {:.0} cm tall, {} vertices",
        "body",
        100.0 * run.body.stature_m,
        run.body.vertices
    )?;
    for assumption in &run.assumptions {
        writeln!(text, "  {:<12} {assumption}", "assumed")?;
    }
    if run.redacted {
        writeln!(text, "  {:<12} source frames are left out", "redacted")?;
    }
    writeln!(text, "settings")?;
    for (name, value) in &run.settings {
        writeln!(text, "  {name} = {value}")?;
    }

    let summary_path = folder.join(SUMMARY);
    if !summary_path.is_file() {
        let journal = folder.join(JOURNAL);
        let frames = if journal.is_file() { read_entries(&journal)?.0.len() } else { 0 };
        writeln!(text, "interrupted after {frames} frames: track again with --resume to go on")?;
        return Ok(());
    }
    let name = summary_path.display();
    let json = fs::read_to_string(&summary_path).with_context(|| format!("{name}: cannot read the file"))?;
    let summary: Summary =
        serde_json::from_str(&json).with_context(|| format!("{name}: is not a summary"))?;
    writeln!(text, "result")?;
    writeln!(
        text,
        "  {} frames from frame {}: {} tracked, {} coasting, {} lost",
        summary.frames, summary.first_frame, summary.tracked, summary.coasting, summary.lost
    )?;
    if let (Some(mean), Some(median), Some(worst), Some(frame)) =
        (summary.iou_mean, summary.iou_median, summary.iou_worst, summary.iou_worst_frame)
    {
        writeln!(
            text,
            "  overlap of body and mask: mean {mean:.3}, median {median:.3}, worst {worst:.3} on frame {frame}"
        )?;
    }
    if let Some(sd_m) = summary.joint_sd_mean_m {
        writeln!(text, "  spread of a joint among the particles: {:.1} cm", 100.0 * sd_m)?;
    }
    if let Some(Learned { frames, added, deleted, log_evidence_gain, .. }) = summary.learned {
        writeln!(
            text,
            "  learned from {frames} frames: {added} bases came, {deleted} went, log evidence rose by {log_evidence_gain:.1}"
        )?;
    }
    if let Some(reason) = &summary.cut_short_by {
        writeln!(text, "  cut short: {reason}")?;
        writeln!(text, "  track again with --resume to go on")?;
    }
    writeln!(text, "files")?;
    for (file, what) in PRODUCTS {
        if folder.join(file).exists() {
            writeln!(text, "  {file:<14} {what}")?;
        }
    }
    Ok(())
}
