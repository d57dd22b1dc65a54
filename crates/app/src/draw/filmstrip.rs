//! Several frames side by side under a title.

use super::canvas::{Canvas, TEXT_HEIGHT};
use crate::input::RgbFrame;

/// Space around texts and between frames, pixels.
const GAP: u32 = 8;
const BACKGROUND: [u8; 3] = [24, 26, 32];
const TITLE_COLOR: [u8; 3] = [240, 240, 240];
const CAPTION_COLOR: [u8; 3] = [190, 196, 206];

/// One frame of a strip.
#[derive(Clone, Debug)]
pub struct StripFrame {
    /// The picture; all of a strip have one size.
    pub picture: RgbFrame,
    /// Text below it.
    pub caption: String,
}

/// A strip to be painted.
#[derive(Clone, Debug)]
pub struct Filmstrip {
    /// Text above the frames.
    pub title: String,
    /// The part of each picture that is shown: columns and rows of its first pixel, then its size.
    pub crop: [u32; 4],
    /// Height of a frame in the strip, pixels.
    pub frame_height: u32,
}

impl Filmstrip {
    /// Paints the strip.
    ///
    /// # Panics
    /// When there are no frames or the crop does not lie inside them.
    pub fn paint(&self, frames: &[StripFrame]) -> RgbFrame {
        assert!(!frames.is_empty(), "a filmstrip of 0 frames");
        let [x, y, width, height] = self.crop;
        let frame_height = self.frame_height.min(height);
        let frame_width = (u64::from(width) * u64::from(frame_height) / u64::from(height)).max(1) as u32;
        let n_frames = frames.len() as u32;
        let strip_width = GAP + n_frames * (frame_width + GAP);
        let top = TEXT_HEIGHT + 2 * GAP;
        let strip_height = top + frame_height + TEXT_HEIGHT + 2 * GAP;
        let mut strip = Canvas::filled(strip_width, strip_height, BACKGROUND);
        strip.text(i64::from(GAP), i64::from(GAP), &self.title, TITLE_COLOR);
        for (index, frame) in frames.iter().enumerate() {
            let mut part = Canvas::filled(width, height, BACKGROUND);
            part.copy_part(&frame.picture, [x, y], [width, height], [0, 0]);
            let small = Canvas::shrunk(&part.into_frame(), frame_width, frame_height).into_frame();
            let left = GAP + index as u32 * (frame_width + GAP);
            strip.copy_part(&small, [0, 0], [frame_width, frame_height], [left, top]);
            let inset = frame_width.saturating_sub(Canvas::text_width(&frame.caption)) / 2;
            let below = top + frame_height + GAP;
            strip.text(i64::from(left + inset), i64::from(below), &frame.caption, CAPTION_COLOR);
        }
        strip.into_frame()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_stand_side_by_side() {
        let frame = |value: u8| {
            let mut picture = RgbFrame::default();
            picture.resize(100, 80);
            picture.pixels.fill(value);
            StripFrame { picture, caption: value.to_string() }
        };
        let strip = Filmstrip { title: "title".to_owned(), crop: [10, 0, 60, 80], frame_height: 40 };
        let painted = strip.paint(&[frame(50), frame(200)]);
        assert_eq!((painted.width, painted.height), (8 + 2 * (30 + 8), 36 + 40 + 36));
        let value = |x: u32, y: u32| painted.pixels[3 * (y * painted.width + x) as usize];
        assert_eq!([value(8, 36), value(37, 75), value(46, 36)], [50, 50, 200]);
        assert_eq!(value(40, 50), BACKGROUND[0]);
    }
}
