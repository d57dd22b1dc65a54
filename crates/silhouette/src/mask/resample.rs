//! Cutting, mirroring and changing the size of a mask.

use super::{Mask, PixelRect, WORD_BITS};

impl Mask {
    /// The pixels of `rect` as a mask of their own; what lies outside the image is background.
    #[must_use]
    pub fn crop(&self, rect: PixelRect) -> Self {
        let mut cut = Self::new(rect.width(), rect.height());
        let shift = rect.x0 as usize % WORD_BITS;
        let first = rect.x0 as usize / WORD_BITS;
        for y in rect.y0..rect.y1.min(self.height).max(rect.y0) {
            let source = self.row(y);
            let word_at = |index: usize| source.get(index).copied().unwrap_or(0);
            for (index, word) in cut.row_mut(y - rect.y0).iter_mut().enumerate() {
                let high = if shift == 0 { 0 } else { word_at(first + index + 1) << (WORD_BITS - shift) };
                *word = word_at(first + index) >> shift | high;
            }
        }
        cut.clear_padding();
        cut
    }

    /// Left and right exchanged.
    #[must_use]
    pub fn mirrored(&self) -> Self {
        Self::from_fn(self.width, self.height, |x, y| self.get(self.width - 1 - x, y))
    }

    /// Every pixel becomes a square of `factor` by `factor`.
    #[must_use]
    pub fn enlarged(&self, factor: u32) -> Self {
        let mut large = Self::new(self.width * factor, self.height * factor);
        for y in 0..self.height {
            for (x0, x1) in self.runs(y) {
                (0..factor).for_each(|k| large.fill_run(y * factor + k, x0 * factor, x1 * factor));
            }
        }
        large
    }

    /// Every square of `factor` by `factor` pixels becomes one: person when at least half of it is.
    ///
    /// Squares cut by the right and bottom edges count by what is inside: the size is rounded up.
    ///
    /// # Panics
    /// When `factor` is zero.
    #[must_use]
    pub fn reduced(&self, factor: u32) -> Self {
        assert!(factor > 0, "a mask cannot be reduced by a factor of zero");
        let (width, height) = (self.width.div_ceil(factor), self.height.div_ceil(factor));
        let mut counts = vec![0u32; width as usize];
        let mut reduced = Self::new(width, height);
        for y in 0..height {
            counts.fill(0);
            let rows = y * factor..((y + 1) * factor).min(self.height);
            for (x0, x1) in rows.clone().flat_map(|source_y| self.runs(source_y)) {
                for x in x0 / factor..x1.div_ceil(factor) {
                    counts[x as usize] += x1.min((x + 1) * factor) - x0.max(x * factor);
                }
            }
            let n_rows = rows.len() as u32;
            for (x, &count) in (0u32..).zip(&counts) {
                let columns = ((x + 1) * factor).min(self.width) - x * factor;
                if 2 * count >= columns * n_rows {
                    reduced.set(x, y, true);
                }
            }
        }
        reduced
    }

    /// The mask stretched to `width` by `height` pixels: a pixel is person when at least half of the area that it
    /// covers in `self` is.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let coverage = self.coverage(width, height);
        Self::from_fn(width, height, |x, y| coverage[(y as usize) * width as usize + x as usize] >= 0.5)
    }

    /// Share of person in each pixel of the mask stretched to `width` by `height` pixels, row after row, in `[0, 1]`.
    pub fn coverage(&self, width: u32, height: u32) -> Vec<f32> {
        let (stretch_x, stretch_y) =
            (f64::from(width) / f64::from(self.width), f64::from(height) / f64::from(self.height));
        let mut shares = vec![0f32; width as usize * height as usize];
        let mut row_shares = vec![0f32; width as usize];
        for source_y in 0..self.height {
            row_shares.fill(0.0);
            for (x0, x1) in self.runs(source_y) {
                add_span(&mut row_shares, f64::from(x0) * stretch_x, f64::from(x1) * stretch_x, 1.0);
            }
            let (top, bottom) = (f64::from(source_y) * stretch_y, f64::from(source_y + 1) * stretch_y);
            let last = (bottom.ceil() as usize).min(height as usize);
            for y in top.floor() as usize..last {
                let part = (bottom.min(y as f64 + 1.0) - top.max(y as f64)) as f32;
                let target = &mut shares[y * width as usize..(y + 1) * width as usize];
                target.iter_mut().zip(&row_shares).for_each(|(share, row)| *share += part * row);
            }
        }
        shares
    }
}

/// Adds `weight` times the length that `start..end` has in each unit cell.
fn add_span(cells: &mut [f32], start: f64, end: f64, weight: f64) {
    let last = (end.ceil() as usize).min(cells.len());
    for (x, cell) in cells.iter_mut().enumerate().take(last).skip(start.floor() as usize) {
        *cell += (weight * (end.min(x as f64 + 1.0) - start.max(x as f64))) as f32;
    }
}
