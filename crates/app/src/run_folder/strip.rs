//! `filmstrip.png`: frames spread over the run, cut to where the person is.

use std::path::PathBuf;

use anyhow::Context as _;
use image::ImageEncoder as _;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};

use super::record::Entry;
use super::scene::Scene;
use super::summary::Summary;
use super::tables::time_s;
use crate::draw::{Filmstrip, StripFrame};
use crate::input::read_image;

/// Frames in a strip.
const FRAMES: usize = 8;
/// Height of a frame, pixels.
const HEIGHT: u32 = 440;
/// Room left around the person, as a share of the person's height.
const MARGIN: f32 = 0.08;

/// Paints the strip as a PNG; `None` when the run has no frames.
pub(super) fn paint(
    scene: &Scene,
    fps: f64,
    entries: &[Entry],
    summary: &Summary,
    overlay_of: impl Fn(u64) -> PathBuf,
) -> anyhow::Result<Option<Vec<u8>>> {
    let Some(last) = entries.len().checked_sub(1) else { return Ok(None) };
    let count = FRAMES.min(entries.len());
    let shown: Vec<&Entry> = (0..count).map(|i| &entries[i * last / (count - 1).max(1)]).collect();
    let mut frames = Vec::with_capacity(count);
    for entry in &shown {
        let frame = entry.record.frame;
        frames.push(StripFrame {
            picture: read_image(&overlay_of(frame))?,
            caption: format!("{:.2} s", time_s(frame, fps)),
        });
    }
    let overlap =
        summary.iou_mean.map_or_else(String::new, |iou| format!(", overlap of body and mask {iou:.2}"));
    let title = format!("{} of {} frames tracked{overlap}", summary.tracked, summary.frames);
    let strip = Filmstrip { title, crop: crop(scene.size(), &shown), frame_height: HEIGHT }.paint(&frames);
    let mut png = Vec::new();
    PngEncoder::new_with_quality(&mut png, CompressionType::Fast, FilterType::Adaptive)
        .write_image(&strip.pixels, strip.width, strip.height, image::ExtendedColorType::Rgb8)
        .context("filmstrip.png: cannot encode the picture")?;
    Ok(Some(png))
}

/// The least rectangle that shows every outline with some room around; the whole picture when there is none.
fn crop([width, height]: [u32; 2], entries: &[&Entry]) -> [u32; 4] {
    let outlines = entries.iter().flat_map(|entry| entry.outlines.mask.iter().chain(&entry.outlines.body));
    let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
    for point in outlines.flatten() {
        for axis in 0..2 {
            low[axis] = low[axis].min(point[axis]);
            high[axis] = high[axis].max(point[axis]);
        }
    }
    if low[0] >= high[0] || low[1] >= high[1] {
        return [0, 0, width, height];
    }
    let margin = MARGIN * (high[1] - low[1]);
    let first = |axis: usize, size: u32| (low[axis] - margin).floor().clamp(0.0, size as f32 - 1.0) as u32;
    let end = |axis: usize, size: u32| (high[axis] + margin).ceil().clamp(1.0, size as f32) as u32;
    let (x, y) = (first(0, width), first(1, height));
    [x, y, (end(0, width).max(x + 1)) - x, (end(1, height).max(y + 1)) - y]
}
