//! A clip as the tracker sees it: frame after frame a mask, and the picture it was cut from where there is one.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use silhouette::background::{MixtureConfig, MixtureModel, MixtureParams, StaticModel, TemporalMedian};
use silhouette::{BackgroundModel, Geometry, Mask, RgbView, Segmenter, SegmenterConfig, SegmenterParams};

use crate::input::{FrameSource, MaskFolder, Prefetch, RgbFrame, SourceInfo, open_frames, read_image};

/// Frames decoded ahead of the tracker.
const FRAMES_AHEAD: usize = 4;
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

/// Reads a clip.
pub struct ClipReader {
    info: SourceInfo,
    next: u64,
    source: Source,
}

enum Source {
    Frames { frames: Prefetch, segmenter: Box<Segmenter> },
    Masks(MaskFolder),
}

impl ClipReader {
    /// Opens the input and learns the background where it must be learned.
    ///
    /// # Errors
    /// When a file cannot be read, or the plate has another size than the frames.
    pub fn open(input: &ClipInput) -> anyhow::Result<Self> {
        match input {
            ClipInput::Masks(folder) => {
                let masks = MaskFolder::open(folder)?;
                Ok(Self { info: masks.info().clone(), next: 0, source: Source::Masks(masks) })
            }
            ClipInput::Frames(path, background) => {
                let frames = open_frames(path)?;
                let info = frames.info().clone();
                let geometry = Geometry::for_frames(info.width, info.height);
                let model: Box<dyn BackgroundModel> = match background {
                    Background::Plate(plate) => Box::new(read_plate(plate, geometry)?),
                    Background::Median => Box::new(learn_median(path, geometry)?),
                    Background::Mixture => {
                        Box::new(MixtureModel::new(MixtureParams::new(MixtureConfig::default())?, geometry))
                    }
                };
                let params = SegmenterParams::new(SegmenterConfig::default())?;
                let segmenter = Box::new(Segmenter::new(params, model));
                let frames = Prefetch::new(frames, FRAMES_AHEAD);
                Ok(Self { info, next: 0, source: Source::Frames { frames, segmenter } })
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
        let index = self.next;
        let frame = match &mut self.source {
            Source::Masks(masks) => masks.next_mask()?.map(|mask| ClipFrame { index, picture: None, mask }),
            Source::Frames { frames, segmenter } => {
                let mut picture = RgbFrame::default();
                if !frames.next_frame(&mut picture)? {
                    return Ok(None);
                }
                let view = RgbView::new(picture.width, picture.height, &picture.pixels)?;
                let mask = segmenter.segment(&view)?.mask;
                Some(ClipFrame { index, picture: Some(picture), mask })
            }
        };
        self.next += 1;
        Ok(frame)
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
