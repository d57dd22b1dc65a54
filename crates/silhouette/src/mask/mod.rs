//! The bit-packed mask: one bit a pixel, rows padded to whole 64-bit words.

mod resample;
mod rows;
mod text;

pub use rows::RowPrefix;
pub use text::ParseMaskError;

/// Bits in a word of a mask.
pub(crate) const WORD_BITS: usize = u64::BITS as usize;

/// A binary image: 1 is the person, 0 the background.
///
/// Row `y` starts at word `y * words_per_row()`; pixel `x` of that row is bit `x % 64` of its word `x / 64`.
/// The padding bits at the end of each row are zero, always: counts may run over whole words.
/// A mask without any person pixel is an ordinary value.
///
/// ```
/// use silhouette::Mask;
/// let mask: Mask = "..#.
///                   .##.".parse()?;
/// assert_eq!((mask.width(), mask.height(), mask.area()), (4, 2, 3));
/// assert!(mask.get(2, 0) && !mask.get(0, 0));
/// # Ok::<(), silhouette::mask::ParseMaskError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Mask {
    width: u32,
    height: u32,
    words_per_row: usize,
    words: Vec<u64>,
}

/// A rectangle of pixels: columns `x0..x1`, rows `y0..y1`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelRect {
    /// First column.
    pub x0: u32,
    /// First row.
    pub y0: u32,
    /// Column after the last one.
    pub x1: u32,
    /// Row after the last one.
    pub y1: u32,
}

impl PixelRect {
    /// Columns covered, pixels.
    pub fn width(&self) -> u32 {
        self.x1.saturating_sub(self.x0)
    }

    /// Rows covered, pixels.
    pub fn height(&self) -> u32 {
        self.y1.saturating_sub(self.y0)
    }

    /// The rectangle grown by `margin_px` on each side, cut to an image of `width` by `height` pixels.
    #[must_use]
    pub fn grown(&self, margin_px: u32, width: u32, height: u32) -> Self {
        Self {
            x0: self.x0.saturating_sub(margin_px),
            y0: self.y0.saturating_sub(margin_px),
            x1: self.x1.saturating_add(margin_px).min(width),
            y1: self.y1.saturating_add(margin_px).min(height),
        }
    }
}

/// Pixel counts of two masks of one size.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Overlap {
    /// Pixels of the first mask.
    pub first: u64,
    /// Pixels of the second mask.
    pub second: u64,
    /// Pixels of both.
    pub both: u64,
}

impl Overlap {
    /// Pixels of either mask.
    pub fn either(&self) -> u64 {
        self.first + self.second - self.both
    }

    /// Intersection over union, in `[0, 1]`; two empty masks agree fully: 1.
    pub fn iou(&self) -> f64 {
        match self.either() {
            0 => 1.0,
            either => self.both as f64 / either as f64,
        }
    }
}

impl Mask {
    /// An empty mask of `width` by `height` pixels.
    pub fn new(width: u32, height: u32) -> Self {
        let words_per_row = (width as usize).div_ceil(WORD_BITS);
        Self { width, height, words_per_row, words: vec![0; words_per_row * height as usize] }
    }

    /// A mask whose pixel `(x, y)` is `is_person(x, y)`.
    pub fn from_fn(width: u32, height: u32, mut is_person: impl FnMut(u32, u32) -> bool) -> Self {
        let mut mask = Self::new(width, height);
        for y in 0..height {
            let row = mask.row_mut(y);
            for (word, first_x) in row.iter_mut().zip((0..width).step_by(WORD_BITS)) {
                let last_x = (first_x + WORD_BITS as u32).min(width);
                *word =
                    (first_x..last_x).fold(0, |bits, x| bits | u64::from(is_person(x, y)) << (x - first_x));
            }
        }
        mask
    }

    /// A mask from one `bool` a pixel, row after row.
    ///
    /// # Panics
    /// When `pixels` does not hold `width * height` values.
    pub fn from_bools(width: u32, height: u32, pixels: &[bool]) -> Self {
        check_pixel_count(width, height, pixels.len());
        Self::from_fn(width, height, |x, y| pixels[y as usize * width as usize + x as usize])
    }

    /// A mask from an 8-bit grey image, row after row: person where a pixel is `threshold` or more.
    ///
    /// # Panics
    /// When `pixels` does not hold `width * height` values.
    pub fn from_gray8(width: u32, height: u32, pixels: &[u8], threshold: u8) -> Self {
        check_pixel_count(width, height, pixels.len());
        Self::from_fn(width, height, |x, y| pixels[y as usize * width as usize + x as usize] >= threshold)
    }

    /// The mask as an 8-bit grey image, row after row: 255 person, 0 background.
    pub fn to_gray8(&self) -> Vec<u8> {
        let mut pixels = Vec::with_capacity(self.width as usize * self.height as usize);
        for y in 0..self.height {
            pixels.extend((0..self.width).map(|x| if self.get(x, y) { 255 } else { 0 }));
        }
        pixels
    }

    /// A mask from its packed words.
    ///
    /// Padding bits are cleared.
    ///
    /// # Panics
    /// When `words` does not hold `width.div_ceil(64) * height` words.
    pub fn from_words(width: u32, height: u32, words: Vec<u64>) -> Self {
        let words_per_row = (width as usize).div_ceil(WORD_BITS);
        let expected = words_per_row * height as usize;
        assert_eq!(
            words.len(),
            expected,
            "{} words for a mask of {width} x {height}, expected {expected}",
            words.len()
        );
        let mut mask = Self { width, height, words_per_row, words };
        mask.clear_padding();
        mask
    }

    /// Columns, pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows, pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Words from one row to the next.
    pub fn words_per_row(&self) -> usize {
        self.words_per_row
    }

    /// All words, row after row, padding bits zero.
    pub fn words(&self) -> &[u64] {
        &self.words
    }

    /// The words of row `y`.
    ///
    /// # Panics
    /// When the mask has no row `y`.
    pub fn row(&self, y: u32) -> &[u64] {
        let start = y as usize * self.words_per_row;
        &self.words[start..start + self.words_per_row]
    }

    /// The words of row `y`, for writing. The caller keeps padding bits zero.
    pub(crate) fn row_mut(&mut self, y: u32) -> &mut [u64] {
        let start = y as usize * self.words_per_row;
        &mut self.words[start..start + self.words_per_row]
    }

    /// Whether `other` has as many columns and rows.
    pub fn is_same_size(&self, other: &Self) -> bool {
        self.width == other.width && self.height == other.height
    }

    /// Whether pixel `(x, y)` is person.
    ///
    /// # Panics
    /// When the pixel lies outside.
    pub fn get(&self, x: u32, y: u32) -> bool {
        self.check_inside(x, y);
        self.row(y)[x as usize / WORD_BITS] >> (x as usize % WORD_BITS) & 1 == 1
    }

    /// Whether pixel `(x, y)` is person; pixels outside the image are not.
    pub fn get_or_background(&self, x: i64, y: i64) -> bool {
        let inside = (0..i64::from(self.width)).contains(&x) && (0..i64::from(self.height)).contains(&y);
        inside && self.get(x as u32, y as u32)
    }

    /// Makes pixel `(x, y)` person or background.
    ///
    /// # Panics
    /// When the pixel lies outside.
    pub fn set(&mut self, x: u32, y: u32, is_person: bool) {
        self.check_inside(x, y);
        let word = &mut self.row_mut(y)[x as usize / WORD_BITS];
        let bit = 1 << (x as usize % WORD_BITS);
        *word = if is_person { *word | bit } else { *word & !bit };
    }

    /// Number of person pixels.
    pub fn area(&self) -> u64 {
        self.words.iter().map(|word| u64::from(word.count_ones())).sum()
    }

    /// Whether no pixel is person.
    pub fn is_empty(&self) -> bool {
        self.words.iter().all(|&word| word == 0)
    }

    /// The smallest rectangle that holds all person pixels; `None` when there are none.
    pub fn bounding_box(&self) -> Option<PixelRect> {
        let occupied = |y: &u32| self.row(*y).iter().any(|&word| word != 0);
        let y0 = (0..self.height).find(occupied)?;
        let y1 = (0..self.height).rev().find(occupied)? + 1;
        let mut columns = vec![0u64; self.words_per_row];
        for y in y0..y1 {
            columns.iter_mut().zip(self.row(y)).for_each(|(all, word)| *all |= word);
        }
        let first = columns.iter().position(|&word| word != 0)?;
        let last = columns.iter().rposition(|&word| word != 0)?;
        let x0 = (first * WORD_BITS) as u32 + columns[first].trailing_zeros();
        let x1 = ((last + 1) * WORD_BITS) as u32 - columns[last].leading_zeros();
        Some(PixelRect { x0, y0, x1, y1 })
    }

    /// Mean position of the person's pixel centres, `[x, y]`, pixels; `None` when there are none.
    pub fn centroid_px(&self) -> Option<[f64; 2]> {
        let [mut sum_x, mut sum_y, mut count] = [0u64; 3];
        for y in 0..self.height {
            for (index, &word) in self.row(y).iter().enumerate() {
                let ones = u64::from(word.count_ones());
                count += ones;
                sum_y += ones * u64::from(y);
                sum_x += ones * (index * WORD_BITS) as u64;
                sum_x += rows::bits(word).map(u64::from).sum::<u64>();
            }
        }
        let mean = |sum: u64| sum as f64 / count as f64 + 0.5;
        (count > 0).then(|| [mean(sum_x), mean(sum_y)])
    }

    /// Pixel counts of `self` and `other` and of what they share.
    ///
    /// # Panics
    /// When the sizes differ.
    pub fn overlap(&self, other: &Self) -> Overlap {
        self.check_same_size(other);
        let mut counts = Overlap::default();
        for (&a, &b) in self.words.iter().zip(&other.words) {
            counts.first += u64::from(a.count_ones());
            counts.second += u64::from(b.count_ones());
            counts.both += u64::from((a & b).count_ones());
        }
        counts
    }

    /// Intersection over union, in `[0, 1]`; 1 for two empty masks.
    ///
    /// # Panics
    /// When the sizes differ.
    pub fn iou(&self, other: &Self) -> f64 {
        self.overlap(other).iou()
    }

    /// Adds the pixels of `other`.
    ///
    /// # Panics
    /// When the sizes differ.
    pub fn union_with(&mut self, other: &Self) {
        self.check_same_size(other);
        self.words.iter_mut().zip(&other.words).for_each(|(a, b)| *a |= b);
    }

    /// Keeps only the pixels that `other` has too.
    ///
    /// # Panics
    /// When the sizes differ.
    pub fn intersect_with(&mut self, other: &Self) {
        self.check_same_size(other);
        self.words.iter_mut().zip(&other.words).for_each(|(a, b)| *a &= b);
    }

    /// Takes the pixels of `other` away.
    ///
    /// # Panics
    /// When the sizes differ.
    pub fn subtract(&mut self, other: &Self) {
        self.check_same_size(other);
        self.words.iter_mut().zip(&other.words).for_each(|(a, b)| *a &= !b);
    }

    /// Person and background exchanged.
    #[must_use]
    pub fn complement(&self) -> Self {
        let mut inverse = self.clone();
        inverse.words.iter_mut().for_each(|word| *word = !*word);
        inverse.clear_padding();
        inverse
    }

    /// The bits of a row's last word that are pixels.
    fn last_word_pixels(&self) -> u64 {
        match self.width as usize % WORD_BITS {
            0 => u64::MAX,
            used => (1 << used) - 1,
        }
    }

    pub(crate) fn clear_padding(&mut self) {
        let pixels = self.last_word_pixels();
        if self.words_per_row > 0 {
            self.words
                .iter_mut()
                .skip(self.words_per_row - 1)
                .step_by(self.words_per_row)
                .for_each(|w| *w &= pixels);
        }
    }

    fn check_inside(&self, x: u32, y: u32) {
        assert!(
            x < self.width && y < self.height,
            "pixel ({x}, {y}) lies outside a mask of {} x {}",
            self.width,
            self.height
        );
    }

    pub(crate) fn check_same_size(&self, other: &Self) {
        assert!(
            self.is_same_size(other),
            "masks of {} x {} and {} x {} pixels cannot be combined",
            self.width,
            self.height,
            other.width,
            other.height
        );
    }
}

fn check_pixel_count(width: u32, height: u32, count: usize) {
    let expected = width as usize * height as usize;
    assert_eq!(count, expected, "{count} pixels for a mask of {width} x {height}, expected {expected}");
}

#[cfg(test)]
mod tests;
