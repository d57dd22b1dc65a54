//! Folders of numbered images: frames or masks.

use std::cmp::Ordering;
use std::path::{Path, PathBuf};
use std::{fs, vec};

use anyhow::{Context as _, ensure};
use image::{DynamicImage, ImageDecoder as _, ImageReader};
use silhouette::Mask;

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
        Ok(Self { info: describe(folder, &files)?, files: files.into_iter() })
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
        let image = decode(&file)?;
        check_size(&file, &image, &self.info)?;
        *frame = rgb_frame(image);
        Ok(true)
    }
}

/// PNG files of a folder as masks, in the natural order of their names.
///
/// A pixel is person when its grey value is 128 or more; in a file whose largest value is 1, where it is 1.
pub struct MaskFolder {
    info: SourceInfo,
    files: vec::IntoIter<PathBuf>,
}

impl MaskFolder {
    /// Lists the folder and takes the size from its first mask.
    pub fn open(folder: &Path) -> anyhow::Result<Self> {
        let files = list_images(folder, &["png"])?;
        Ok(Self { info: describe(folder, &files)?, files: files.into_iter() })
    }

    /// Size and length.
    pub fn info(&self) -> &SourceInfo {
        &self.info
    }

    /// The next mask; `None` at the end of the folder.
    pub fn next_mask(&mut self) -> anyhow::Result<Option<Mask>> {
        let Some(file) = self.files.next() else { return Ok(None) };
        let image = decode(&file)?;
        check_size(&file, &image, &self.info)?;
        let gray = image.into_luma8();
        let threshold = if gray.iter().max() == Some(&1) { 1 } else { 128 };
        Ok(Some(Mask::from_gray8(gray.width(), gray.height(), &gray, threshold)))
    }
}

/// Reads one PNG or JPEG file.
pub fn read_image(file: &Path) -> anyhow::Result<RgbFrame> {
    Ok(rgb_frame(decode(file)?))
}

fn rgb_frame(image: DynamicImage) -> RgbFrame {
    RgbFrame { width: image.width(), height: image.height(), pixels: image.into_rgb8().into_raw() }
}

fn describe(folder: &Path, files: &[PathBuf]) -> anyhow::Result<SourceInfo> {
    let first = decode(&files[0])?;
    Ok(SourceInfo {
        path: folder.to_owned(),
        width: first.width(),
        height: first.height(),
        fps: None,
        n_frames: Some(files.len() as u64),
        gap: gap(files),
    })
}

/// The first two files in a row whose numbers are further apart than the nearest two are.
fn gap(files: &[PathBuf]) -> Option<[String; 2]> {
    let name = |file: &PathBuf| Some(file.file_stem()?.to_string_lossy().into_owned());
    let number = |file: &PathBuf| -> Option<u64> {
        let name = name(file)?;
        name[name.trim_end_matches(|c: char| c.is_ascii_digit()).len()..].parse().ok()
    };
    let step = |pair: &[PathBuf]| number(&pair[1])?.checked_sub(number(&pair[0])?);
    let usual = files.windows(2).filter_map(step).min()?;
    let pair = files.windows(2).find(|pair| step(pair).is_some_and(|step| step > usual))?;
    Some([name(&pair[0])?, name(&pair[1])?])
}

/// The images of `folder` in natural order; at least one.
fn list_images(folder: &Path, extensions: &[&str]) -> anyhow::Result<Vec<PathBuf>> {
    let unreadable = || format!("{}: cannot list the folder", folder.display());
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).with_context(unreadable)? {
        let path = entry.with_context(unreadable)?.path();
        let extension =
            path.extension().and_then(|extension| extension.to_str()).map(str::to_ascii_lowercase);
        if extension.is_some_and(|extension| extensions.contains(&extension.as_str())) {
            files.push(path);
        }
    }
    let expected = extensions.join(", *.");
    ensure!(!files.is_empty(), "{}: holds 0 frames, expected files *.{expected}", folder.display());
    files.sort_by(|a, b| natural_order(&a.to_string_lossy(), &b.to_string_lossy()));
    Ok(files)
}

fn decode(file: &Path) -> anyhow::Result<DynamicImage> {
    let upright = || -> anyhow::Result<DynamicImage> {
        let mut decoder = ImageReader::open(file)?.with_guessed_format()?.into_decoder()?;
        let orientation = decoder.orientation()?;
        let mut image = DynamicImage::from_decoder(decoder)?;
        image.apply_orientation(orientation);
        Ok(image)
    };
    upright().with_context(|| format!("{}: cannot read the image", file.display()))
}

fn check_size(file: &Path, image: &DynamicImage, info: &SourceInfo) -> anyhow::Result<()> {
    let (width, height) = (image.width(), image.height());
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
            let order = digits_a.len().cmp(&digits_b.len()).then_with(|| digits_a.cmp(digits_b));
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
