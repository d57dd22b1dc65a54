//! Folders of numbered images.

use std::cmp::Ordering;
use std::path::{Path, PathBuf};
use std::{fs, vec};

use anyhow::{Context as _, ensure};
use image::{DynamicImage, ImageDecoder as _, ImageReader};

use super::{FrameSource, RgbFrame, SourceInfo};

/// PNG and JPEG files of a folder as frames, in the natural order of their names (`frame2` before `frame10`).
pub(super) struct ImageFolder {
    info: SourceInfo,
    files: vec::IntoIter<PathBuf>,
}

impl ImageFolder {
    /// Lists the folder and takes the size from its first image.
    pub fn open(folder: &Path) -> anyhow::Result<Self> {
        let files = list_images(folder, &["png", "jpg", "jpeg"])?;
        let first = read_image(&files[0])?;
        let info = SourceInfo {
            path: folder.to_owned(),
            width: first.width(),
            height: first.height(),
            fps: None,
            n_frames: Some(files.len() as u64),
        };
        Ok(Self {
            info,
            files: files.into_iter(),
        })
    }
}

impl FrameSource for ImageFolder {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn next_frame(&mut self, frame: &mut RgbFrame) -> anyhow::Result<bool> {
        let Some(file) = self.files.next() else {
            return Ok(false);
        };
        let image = read_image(&file)?;
        check_size(&file, (image.width(), image.height()), &self.info)?;
        frame.width = image.width();
        frame.height = image.height();
        frame.pixels = image.into_rgb8().into_raw();
        Ok(true)
    }
}

/// The images of `folder` in natural order; at least one.
pub(super) fn list_images(folder: &Path, extensions: &[&str]) -> anyhow::Result<Vec<PathBuf>> {
    let unreadable = || format!("{}: cannot list the folder", folder.display());
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).with_context(unreadable)? {
        let path = entry.with_context(unreadable)?.path();
        let extension = path
            .extension()
            .and_then(|extension| extension.to_str())
            .map(str::to_ascii_lowercase);
        if extension.is_some_and(|extension| extensions.contains(&extension.as_str())) {
            files.push(path);
        }
    }
    let expected = extensions.join(", *.");
    ensure!(
        !files.is_empty(),
        "{}: holds 0 frames, expected files *.{expected}",
        folder.display()
    );
    files.sort_by(|a, b| natural_order(&a.to_string_lossy(), &b.to_string_lossy()));
    Ok(files)
}

pub(super) fn read_image(file: &Path) -> anyhow::Result<DynamicImage> {
    let decode = || -> anyhow::Result<DynamicImage> {
        let mut decoder = ImageReader::open(file)?.with_guessed_format()?.into_decoder()?;
        let orientation = decoder.orientation()?;
        let mut image = DynamicImage::from_decoder(decoder)?;
        image.apply_orientation(orientation);
        Ok(image)
    };
    decode().with_context(|| format!("{}: cannot read the image", file.display()))
}

pub(super) fn check_size(file: &Path, (width, height): (u32, u32), info: &SourceInfo) -> anyhow::Result<()> {
    ensure!(
        (width, height) == (info.width, info.height),
        "{}: is {width}x{height}, expected {}x{} as the first frame",
        file.display(),
        info.width,
        info.height,
    );
    Ok(())
}

/// Compares names so that runs of digits count as numbers.
///
/// ```
/// use std::cmp::Ordering;
/// assert_eq!(app::input::natural_order("frame2.png", "frame10.png"), Ordering::Less);
/// ```
pub fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut rest_a, mut rest_b) = (a, b);
    loop {
        let (number_a, after_a) = split_digits(rest_a);
        let (number_b, after_b) = split_digits(rest_b);
        if !number_a.is_empty() && !number_b.is_empty() {
            let (digits_a, digits_b) = (number_a.trim_start_matches('0'), number_b.trim_start_matches('0'));
            let order = digits_a
                .len()
                .cmp(&digits_b.len())
                .then_with(|| digits_a.cmp(digits_b));
            if order.is_ne() {
                return order;
            }
            (rest_a, rest_b) = (after_a, after_b);
            continue;
        }
        let (mut chars_a, mut chars_b) = (rest_a.chars(), rest_b.chars());
        match (chars_a.next(), chars_b.next()) {
            // Names that differ in leading zeros only still need an order.
            (None, None) => return a.cmp(b),
            (char_a, char_b) if char_a == char_b => (rest_a, rest_b) = (chars_a.as_str(), chars_b.as_str()),
            (char_a, char_b) => return char_a.cmp(&char_b),
        }
    }
}

fn split_digits(text: &str) -> (&str, &str) {
    text.split_at(text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len()))
}
