//! Blending, lines and text on an RGB picture.

use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};

use crate::input::RgbFrame;

/// Height of a line of text, pixels.
pub(super) const TEXT_HEIGHT: u32 = 20;
const FONT: RasterHeight = RasterHeight::Size20;

/// A picture that is drawn on. Coordinates are pixels with the origin at the top-left corner; parts outside are cut off.
#[derive(Clone, Debug)]
pub struct Canvas {
    frame: RgbFrame,
}

impl Canvas {
    /// A canvas of one colour.
    pub fn filled(width: u32, height: u32, color: [u8; 3]) -> Self {
        let pixels = color.repeat(width as usize * height as usize);
        Self { frame: RgbFrame { width, height, pixels } }
    }

    /// `picture` scaled down to `width` by `height`: every pixel is the mean over the area it covers.
    pub fn shrunk(picture: &RgbFrame, width: u32, height: u32) -> Self {
        if (width, height) == (picture.width, picture.height) {
            return Self { frame: picture.clone() };
        }
        let row_bytes = 3 * picture.width as usize;
        let mut canvas = Self::filled(width, height, [0; 3]);
        let columns: Vec<_> = (0..width).map(|x| source_range(x, width, picture.width)).collect();
        let mut sums = vec![0_u32; row_bytes];
        let mut running = vec![[0_u32; 3]; picture.width as usize + 1];
        for (y, row) in canvas.frame.pixels.chunks_exact_mut(3 * width as usize).enumerate() {
            let rows = source_range(y as u32, height, picture.height);
            sums.fill(0);
            for source in rows.clone() {
                let source = &picture.pixels[source * row_bytes..][..row_bytes];
                sums.iter_mut().zip(source).for_each(|(sum, &value)| *sum += u32::from(value));
            }
            // The sum over any columns is a difference of two running sums.
            let mut before = [0_u32; 3];
            for (running, [red, green, blue]) in running[1..].iter_mut().zip(sums.as_chunks::<3>().0) {
                before = [before[0] + red, before[1] + green, before[2] + blue];
                *running = before;
            }
            for (pixel, columns) in row.as_chunks_mut::<3>().0.iter_mut().zip(&columns) {
                let share = 1.0 / (columns.len() * rows.len()) as f32;
                let (start, end) = (running[columns.start], running[columns.end]);
                for (channel, value) in pixel.iter_mut().enumerate() {
                    *value = ((end[channel] - start[channel]) as f32 * share + 0.5) as u8;
                }
            }
        }
        canvas
    }

    /// Columns.
    pub fn width(&self) -> u32 {
        self.frame.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.frame.height
    }

    /// The finished picture.
    pub fn into_frame(self) -> RgbFrame {
        self.frame
    }

    /// Lays `color` over a pixel; `opacity` 0 leaves it, 1 replaces it.
    pub fn blend(&mut self, x: i64, y: i64, color: [u8; 3], opacity: f32) {
        let (width, height) = (i64::from(self.frame.width), i64::from(self.frame.height));
        if !(0..width).contains(&x) || !(0..height).contains(&y) {
            return;
        }
        let pixels: &mut [[u8; 3]] = self.frame.pixels.as_chunks_mut().0;
        for (value, color) in pixels[(y * width + x) as usize].iter_mut().zip(color) {
            let (below, above) = (f32::from(*value), f32::from(color));
            *value = (below + (above - below) * opacity + 0.5) as u8;
        }
    }

    /// A line with round ends from `a` to `b`, `thickness` pixels wide, with soft edges.
    pub fn line(&mut self, a: [f32; 2], b: [f32; 2], thickness: f32, color: [u8; 3]) {
        let reach = 0.5 * thickness + 0.5;
        let (ab_x, ab_y) = (b[0] - a[0], b[1] - a[1]);
        let length2 = ab_x * ab_x + ab_y * ab_y;
        for y in pixels_between(a[1].min(b[1]) - reach, a[1].max(b[1]) + reach, self.frame.height) {
            let py = y as f32 + 0.5 - a[1];
            // Only the part of the line within reach of this row can touch it.
            let part = |edge: f32| if ab_y == 0.0 { edge.signum() } else { (py + edge) / ab_y };
            let (x0, x1) =
                (a[0] + part(-reach).clamp(0.0, 1.0) * ab_x, a[0] + part(reach).clamp(0.0, 1.0) * ab_x);
            for x in pixels_between(x0.min(x1) - reach, x0.max(x1) + reach, self.frame.width) {
                let px = x as f32 + 0.5 - a[0];
                let along =
                    if length2 > 0.0 { ((px * ab_x + py * ab_y) / length2).clamp(0.0, 1.0) } else { 0.0 };
                let (away_x, away_y) = (px - along * ab_x, py - along * ab_y);
                let coverage = (reach - (away_x * away_x + away_y * away_y).sqrt()).clamp(0.0, 1.0);
                if coverage > 0.0 {
                    self.blend(x, y, color, coverage);
                }
            }
        }
    }

    /// A filled disc.
    pub fn disc(&mut self, centre: [f32; 2], radius: f32, color: [u8; 3]) {
        self.line(centre, centre, 2.0 * radius, color);
    }

    /// A closed polygon's edges.
    pub fn closed_line(&mut self, points: &[[f32; 2]], thickness: f32, color: [u8; 3]) {
        for (a, b) in points.iter().zip(points.iter().cycle().skip(1)) {
            self.line(*a, *b, thickness, color);
        }
    }

    /// Text whose top-left corner is at (`x`, `y`); letters that the font lacks become `?`.
    pub fn text(&mut self, x: i64, y: i64, text: &str, color: [u8; 3]) {
        let mut left = x;
        for letter in text.chars() {
            let raster = get_raster(letter, FontWeight::Regular, FONT)
                .or_else(|| get_raster('?', FontWeight::Regular, FONT))
                .expect("the font has a question mark");
            for (row, values) in raster.raster().iter().enumerate() {
                for (column, &value) in values.iter().enumerate() {
                    self.blend(left + column as i64, y + row as i64, color, f32::from(value) / 255.0);
                }
            }
            left += raster.width() as i64;
        }
    }

    /// Width of a text, pixels.
    pub fn text_width(text: &str) -> u32 {
        (text.chars().count() * get_raster_width(FontWeight::Regular, FONT)) as u32
    }

    /// Copies the part of `from` that starts at (`from_x`, `from_y`) and is `width` by `height` to (`x`, `y`).
    ///
    /// # Panics
    /// When the part does not lie inside both pictures.
    pub fn copy_part(&mut self, from: &RgbFrame, from_at: [u32; 2], size: [u32; 2], at: [u32; 2]) {
        let bytes = 3 * size[0] as usize;
        for row in 0..size[1] {
            let source = 3 * ((from_at[1] + row) as usize * from.width as usize + from_at[0] as usize);
            let target = 3 * ((at[1] + row) as usize * self.frame.width as usize + at[0] as usize);
            self.frame.pixels[target..target + bytes].copy_from_slice(&from.pixels[source..source + bytes]);
        }
    }
}

/// The pixels of an axis of `size` that lie between two coordinates; none when one is NaN.
fn pixels_between(low: f32, high: f32, size: u32) -> std::ops::Range<i64> {
    let edge = |value: f32| value.clamp(0.0, size as f32) as i64;
    edge(low.floor())..edge(high.ceil())
}

/// The source pixels that pixel `index` of `count` stands for.
fn source_range(index: u32, count: u32, source_count: u32) -> std::ops::Range<usize> {
    let edge = |index: u32| (u64::from(index) * u64::from(source_count) / u64::from(count)) as usize;
    let (start, end) = (edge(index), edge(index + 1));
    start..end.max(start + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shrinking_keeps_the_mean() {
        let pixels = (0..8 * 4).flat_map(|i| [i * 7, 255 - i * 7, 100]).collect();
        let picture = RgbFrame { width: 8, height: 4, pixels };
        let small = Canvas::shrunk(&picture, 4, 2).into_frame();
        let mean = |frame: &RgbFrame, channel: usize| {
            let values = frame.pixels.iter().skip(channel).step_by(3).map(|&v| f64::from(v));
            values.sum::<f64>() / f64::from(frame.width * frame.height)
        };
        for channel in 0..3 {
            assert!((mean(&small, channel) - mean(&picture, channel)).abs() <= 0.5);
        }
        assert_eq!(&small.pixels[..3], [32, 224, 100], "mean of pixels 0, 1, 8 and 9: 4.5 * 7");
    }

    #[test]
    fn a_line_covers_length_times_thickness() {
        for (a, b) in [([5.0, 8.0], [35.0, 8.0]), ([5.0, 5.0], [35.0, 29.0])] {
            let mut canvas = Canvas::filled(40, 40, [0; 3]);
            canvas.line(a, b, 4.0, [255; 3]);
            let area: f64 = canvas.into_frame().pixels.iter().step_by(3).map(|&v| f64::from(v) / 255.0).sum();
            let length = f64::from((b[0] - a[0]).hypot(b[1] - a[1]));
            let expected = length * 4.0 + std::f64::consts::PI * 4.0;
            assert!((area / expected - 1.0).abs() < 0.02, "{area} against {expected}");
        }
    }

    #[test]
    fn drawing_outside_is_cut_off() {
        let mut canvas = Canvas::filled(4, 4, [9; 3]);
        canvas.line([-100.0, -50.0], [-10.0, 1e9], 3.0, [255; 3]);
        canvas.disc([f32::NAN, 2.0], 3.0, [255; 3]);
        canvas.text(-500, 2, "away", [255; 3]);
        assert!(canvas.into_frame().pixels.iter().all(|&value| value == 9));
    }
}
