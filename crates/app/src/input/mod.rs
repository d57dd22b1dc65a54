//! Frames and masks from video files and folders, in presentation order and one size throughout.
//!
//! [`open_frames`] takes whatever the user named: an MP4 file with H.264 is decoded by the bundled decoder, a folder
//! is read as numbered images, and every other container goes through the `ffmpeg` program when there is one.

mod ffmpeg;
mod folder;
mod h264;
mod mp4;
mod prefetch;
mod yuv;

use std::fs;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use ffmpeg::FfmpegPipe;
use folder::ImageFolder;
use mp4::Mp4Video;

pub use folder::{MaskFolder, natural_order, read_image};
pub use mp4::hide_panics_that_become_errors;
pub use prefetch::Prefetch;

/// One colour picture: 8-bit RGB, row by row from the top, `[height][width][3]`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RgbFrame {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Red, green and blue of each pixel, `3 * width * height` bytes.
    pub pixels: Vec<u8>,
}

impl RgbFrame {
    /// Gives the frame a size, keeping its buffer; the content is whatever was there.
    pub fn resize(&mut self, width: u32, height: u32) {
        self.width = width;
        self.height = height;
        let n_bytes = 3 * width as usize * height as usize;
        if self.pixels.capacity() < n_bytes {
            self.pixels = vec![0; n_bytes]; // pages that the system gives out are zero already
        }
        self.pixels.resize(n_bytes, 0);
    }
}

/// What is known of a source before its frames are read.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceInfo {
    /// The file or folder, as the user named it.
    pub path: PathBuf,
    /// Columns of every frame.
    pub width: u32,
    /// Rows of every frame.
    pub height: u32,
    /// Mean rate in frames a second; a folder has none.
    pub fps: Option<f64>,
    /// Number of frames by the file's index; a pipe has none.
    pub n_frames: Option<u64>,
    /// The names of two files between which numbers are missing, the first such.
    pub gap: Option<[String; 2]>,
}

/// Gives frames in presentation order, all of the size in [`info`](FrameSource::info).
///
/// A source that cannot go on returns one error that names its file and the frame it reached; the frames given
/// before stay good.
pub trait FrameSource: Send {
    /// Size, rate and length.
    fn info(&self) -> &SourceInfo;

    /// Reads the next frame into `frame`, reusing its buffer; `false` at the end of the source.
    fn next_frame(&mut self, frame: &mut RgbFrame) -> anyhow::Result<bool>;
}

/// Opens a video file or a folder of images.
pub fn open_frames(path: &Path) -> anyhow::Result<Box<dyn FrameSource>> {
    let kind = fs::metadata(path).with_context(|| format!("{}: cannot open the input", path.display()))?;
    if kind.is_dir() {
        return Ok(Box::new(ImageFolder::open(path)?));
    }
    if !is_mp4(path)? {
        return Ok(Box::new(FfmpegPipe::open(path).context("not an MP4 file, so ffmpeg must decode it")?));
    }
    match Mp4Video::open(path)? {
        mp4::Opened::Video(video) => Ok(video),
        mp4::Opened::Unsupported(reason) => {
            let pipe =
                FfmpegPipe::open(path).with_context(|| format!("{reason}, so ffmpeg must decode it"))?;
            Ok(Box::new(pipe))
        }
    }
}

/// Whether the file starts as ISO base media files (MP4, MOV, M4V) do.
fn is_mp4(path: &Path) -> anyhow::Result<bool> {
    let mut start = Vec::new();
    fs::File::open(path)
        .and_then(|file| file.take(8).read_to_end(&mut start))
        .with_context(|| format!("{}: cannot read the file", path.display()))?;
    if start.is_empty() {
        bail!("{}: the file is empty, expected a video", path.display());
    }
    Ok(start.get(4..8) == Some(b"ftyp"))
}

#[cfg(test)]
mod tests;
