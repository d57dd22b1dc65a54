//! A clip as the tracker sees it: frame after frame a mask, and the picture it was cut from where there is one.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use silhouette::background::{MixtureConfig, MixtureModel, MixtureParams, StaticModel, TemporalMedian};
use silhouette::{BackgroundModel, Geometry, Mask, RgbView, Segmenter, SegmenterConfig, SegmenterParams};

use crate::input::{MaskFolder, Prefetch, RgbFrame, SourceInfo, open_frames, read_image};

/// Frames that each thread of a reader may be ahead of the next.
const FRAMES_AHEAD: usize = 3;
/// Frames, spread over the clip, from which a background is learned.
const MEDIAN_FRAMES: u64 = 60;

/// Where masks come from.
#[derive(Clone, Debug, PartialEq)]
pub enum ClipInput {
    /// A video or folder of frames, and how the empty scene is known.
    Frames(PathBuf, Background),
    /// A folder of ready masks.
    Masks(PathBuf),
}

/// How the empty scene is known.
#[derive(Clone, Debug, PartialEq)]
pub enum Background {
    /// A picture of it by the same camera.
    Plate(PathBuf),
    /// The median over the clip: right where the person stands for less than half of the time.
    Median,
    /// A running mixture of Gaussians per pixel.
    Mixture,
}

/// One frame.
pub struct ClipFrame {
    /// Number, from 0.
    pub index: u64,
    /// The picture; none where the input is masks.
    pub picture: Option<RgbFrame>,
    /// The person; empty when there is none.
    pub mask: Mask,
}

/// Reads a clip. Decoding and segmenting run ahead of what asks for the frames, each on a thread of its own.
pub struct ClipReader {
    info: SourceInfo,
    frames: Prefetch<ClipFrame>,
}

impl ClipReader {
    /// Opens the input and learns the background where it must be learned.
    ///
    /// # Errors
    /// When a file cannot be read, or the plate has another size than the frames.
    pub fn open(input: &ClipInput) -> anyhow::Result<Self> {
        let mut indices = 0..;
        match input {
            ClipInput::Masks(folder) => {
                let mut masks = MaskFolder::open(folder)?;
                let info = masks.info().clone();
                let frames = Prefetch::new(FRAMES_AHEAD, move || {
                    let Some(mask) = masks.next_mask()? else { return Ok(None) };
                    Ok(indices.next().map(|index| ClipFrame { index, picture: None, mask }))
                });
                Ok(Self { info, frames })
            }
            ClipInput::Frames(path, background) => {
                let mut source = open_frames(path)?;
                let info = source.info().clone();
                let geometry = Geometry::for_frames(info.width, info.height);
                let model: Box<dyn BackgroundModel> = match background {
                    Background::Plate(plate) => Box::new(read_plate(plate, geometry)?),
                    Background::Median => Box::new(learn_median(path, geometry)?),
                    Background::Mixture => {
                        Box::new(MixtureModel::new(MixtureParams::new(MixtureConfig::default())?, geometry))
                    }
                };
                let mut segmenter = Segmenter::new(SegmenterParams::new(SegmenterConfig::default())?, model);
                let mut pictures = Prefetch::new(FRAMES_AHEAD, move || {
                    let mut picture = RgbFrame::default();
                    Ok(source.next_frame(&mut picture)?.then_some(picture))
                });
                let frames = Prefetch::new(FRAMES_AHEAD, move || {
                    let Some(picture) = pictures.next().transpose()? else { return Ok(None) };
                    let view = RgbView::new(picture.width, picture.height, &picture.pixels)?;
                    let mask = segmenter.segment(&view)?.mask;
                    Ok(indices.next().map(|index| ClipFrame { index, picture: Some(picture), mask }))
                });
                Ok(Self { info, frames })
            }
        }
    }

    /// Size, rate and length of the clip.
    pub fn info(&self) -> &SourceInfo {
        &self.info
    }

    /// The next frame; none at the end.
    ///
    /// # Errors
    /// When the source cannot go on; the frames given before stay good.
    pub fn next_frame(&mut self) -> anyhow::Result<Option<ClipFrame>> {
        self.frames.next().transpose()
    }
}

/// The model of a picture of the empty scene.
fn read_plate(path: &Path, geometry: Geometry) -> anyhow::Result<StaticModel> {
    let plate = read_image(path)?;
    if (plate.width, plate.height) != (geometry.width, geometry.height) {
        bail!(
            "{}: the background has {} x {} pixels, expected {} x {} as the frames",
            path.display(),
            plate.width,
            plate.height,
            geometry.width,
            geometry.height
        );
    }
    let view = RgbView::new(plate.width, plate.height, &plate.pixels)?;
    Ok(StaticModel::from_plate(&view, geometry))
}

/// The median of frames spread over the whole clip, which is read once for it.
fn learn_median(path: &Path, geometry: Geometry) -> anyhow::Result<StaticModel> {
    let mut frame = RgbFrame::default();
    let mut source = open_frames(path)?;
    let n_frames = match source.info().n_frames {
        Some(n_frames) => n_frames,
        None => {
            let mut n_frames = 0;
            while source.next_frame(&mut frame).is_ok_and(|is_frame| is_frame) {
                n_frames += 1;
            }
            source = open_frames(path)?;
            n_frames
        }
    };
    let every = n_frames.div_ceil(MEDIAN_FRAMES).max(1);
    let mut median = TemporalMedian::new(geometry);
    let mut index = 0;
    loop {
        match source.next_frame(&mut frame) {
            Ok(true) => {}
            // What can be read of a damaged clip is worth tracking; the reader that follows meets the damage again.
            Err(_) if index > 0 => break,
            Err(error) => return Err(error),
            Ok(false) => break,
        }
        if index % every == 0 {
            median.push(&RgbView::new(frame.width, frame.height, &frame.pixels)?);
        }
        index += 1;
    }
    median.finish().with_context(|| format!("{}: no frames to learn the background from", path.display()))
}
