//! `umbra eval stage-masks`: masks cut from rendered colour clips against the clean silhouettes they were rendered from.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use serde::Serialize;

use super::joint_error::mean;
use super::write_json;
use crate::input::MaskFolder;
use crate::track::{Background, ClipInput, ClipReader};

/// Agreement on one clip under one background model.
#[derive(Clone, Debug, Serialize)]
pub struct ClipFigures {
    /// The colour clip.
    pub clip: PathBuf,
    /// `plate` (a picture of the empty scene), `median` or `mixture` (learned from the clip itself).
    pub background: &'static str,
    /// Frames compared.
    pub frames: usize,
    /// Mean intersection over union.
    pub iou_mean: f64,
    /// Its least value.
    pub iou_worst: f64,
    /// Frame with the least value.
    pub worst_frame: usize,
}

/// What `eval.json` holds.
#[derive(Clone, Debug, Serialize)]
pub struct MaskReport {
    /// The data folder.
    pub data: PathBuf,
    /// Mean over clips of the mean intersection over union, with the plate.
    pub iou_mean: f64,
    /// Least intersection over union of any frame, with the plate.
    pub iou_worst: f64,
    /// Each clip under each background model.
    pub clips: Vec<ClipFigures>,
}

/// Compares every colour clip below `data`, writes `eval.json` to `out` and returns the report.
///
/// A clip is `rgb/CAMERA.mp4` with `rgb/background.png` in a sequence folder that also has `CAMERA/clean/`.
///
/// # Errors
/// When no clip is found, a file cannot be read, or the report cannot be written.
pub fn evaluate(data: &Path, out: &Path) -> anyhow::Result<MaskReport> {
    let mut sequences = Vec::new();
    find_sequences(data, &mut sequences)?;
    let mut clips = Vec::new();
    for sequence in sequences {
        for (clip, clean) in colour_clips(&sequence)? {
            let plate = Background::Plate(sequence.join("rgb/background.png"));
            for (name, background) in
                [("plate", plate), ("median", Background::Median), ("mixture", Background::Mixture)]
            {
                clips.push(compare(&clip, name, background, &clean)?);
            }
        }
    }
    if clips.is_empty() {
        bail!(
            "{}: no `rgb/CAMERA.mp4` beside `CAMERA/clean/` in it or below, expected a sequence with a colour clip",
            data.display()
        );
    }
    let with_plate = || clips.iter().filter(|figures| figures.background == "plate");
    let report = MaskReport {
        data: data.to_owned(),
        iou_mean: mean(with_plate().map(|figures| figures.iou_mean)),
        iou_worst: with_plate().map(|figures| figures.iou_worst).fold(1.0, f64::min),
        clips,
    };
    write_json(out, &report)?;
    Ok(report)
}

/// The folders in `folder` and below, itself included, that have an `rgb` folder; sorted.
fn find_sequences(folder: &Path, found: &mut Vec<PathBuf>) -> anyhow::Result<()> {
    if folder.join("rgb").is_dir() {
        found.push(folder.to_owned());
        return Ok(());
    }
    for path in entries(folder)? {
        if path.is_dir() {
            find_sequences(&path, found)?;
        }
    }
    Ok(())
}

/// Each colour clip of a sequence with its folder of clean masks.
fn colour_clips(sequence: &Path) -> anyhow::Result<Vec<(PathBuf, PathBuf)>> {
    let clips = entries(&sequence.join("rgb"))?.into_iter().filter_map(|clip| {
        let camera = clip.file_stem()?.to_str()?.to_owned();
        let clean = sequence.join(camera).join("clean");
        (clip.extension()? == "mp4" && clean.is_dir()).then_some((clip, clean))
    });
    Ok(clips.collect())
}

/// What a folder holds, sorted by name.
fn entries(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let read = || -> std::io::Result<Vec<PathBuf>> {
        fs::read_dir(folder)?.map(|entry| entry.map(|entry| entry.path())).collect()
    };
    let mut paths = read().with_context(|| format!("{}: cannot read the folder", folder.display()))?;
    paths.sort();
    Ok(paths)
}

fn compare(
    clip: &Path,
    name: &'static str,
    background: Background,
    clean: &Path,
) -> anyhow::Result<ClipFigures> {
    let mut reader = ClipReader::open(&ClipInput::Frames(clip.to_owned(), background))?;
    let mut truth = MaskFolder::open(clean)?;
    let mut ious = Vec::new();
    while let Some(frame) = reader.next_frame()? {
        let Some(clean_mask) = truth.next_mask()? else {
            bail!(
                "{}: {} masks, expected one for each frame of {}",
                clean.display(),
                ious.len(),
                clip.display()
            );
        };
        if !clean_mask.is_same_size(&frame.mask) {
            bail!("{}: masks of another size than the frames of {}", clean.display(), clip.display());
        }
        ious.push(frame.mask.iou(&clean_mask));
    }
    let worst_frame =
        (0..ious.len()).min_by(|&a, &b| ious[a].total_cmp(&ious[b])).context("a clip without frames")?;
    Ok(ClipFigures {
        clip: clip.to_owned(),
        background: name,
        frames: ious.len(),
        iou_mean: mean(ious.iter().copied()),
        iou_worst: ious[worst_frame],
        worst_frame,
    })
}
