//! The observed mask, laid out to answer "how many of its pixels lie left of here in this row?".

use crate::rows::RowStep;
use crate::scorer::MaskView;

/// 32 pixels of a row and how many of the row's pixels lie left of them.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RankWord {
    bits: u32,
    before: u32,
}

impl RankWord {
    /// How many pixels of the row lie left of its column `x`, which is in this word.
    #[inline(always)]
    pub fn before(self, x: u32) -> u32 {
        self.before + (self.bits & !(!0 << (x % 32))).count_ones()
    }
}

/// A mask with counts of its pixels along each row.
#[derive(Clone, Debug, Default)]
pub(crate) struct Target {
    pub width: u32,
    pub height: u32,
    /// Words of a row: the mask's, and one more where the mask fills its words, so that `x == width` has a word too.
    pub words_per_row: usize,
    pub words: Vec<RankWord>,
}

impl Target {
    /// Takes over another mask.
    ///
    /// # Panics
    /// When the mask's words do not fit its size.
    pub fn set(&mut self, mask: &MaskView<'_>) {
        let needed = mask.width.div_ceil(64) as usize;
        let (height, len) = (mask.height as usize, mask.words.len());
        assert!(
            mask.words_per_row >= needed && len == height * mask.words_per_row,
            "a mask of {} x {} px with {} words a row has {len} words",
            mask.width,
            mask.height,
            mask.words_per_row,
        );
        (self.width, self.height) = (mask.width, mask.height);
        self.words_per_row = Self::word_of(mask.width) + 1;
        self.words.clear();
        for row in mask.words.chunks_exact(mask.words_per_row) {
            let mut before = 0;
            let halves = row.iter().flat_map(|&word| [word as u32, (word >> 32) as u32]);
            for (start, bits) in (0..=mask.width).step_by(32).zip(halves.chain([0])) {
                let bits = bits & (1_u64 << (mask.width - start).min(32)).wrapping_sub(1) as u32;
                self.words.push(RankWord { bits, before });
                before += bits.count_ones();
            }
        }
    }

    /// Which word of a row holds column `x`.
    #[inline(always)]
    pub fn word_of(x: u32) -> usize {
        (x / 32) as usize
    }

    /// How many pixels of row `y` lie left of column `x`, which is at most the width.
    pub fn before(&self, x: u32, y: usize) -> u32 {
        self.words[y * self.words_per_row + Self::word_of(x)].before(x)
    }

    /// Pixels of the mask in the scored rows.
    pub fn observed(&self, step: RowStep) -> u32 {
        step.rows(self.height).map(|y| self.before(self.width, y as usize)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_what_lies_left() {
        for width in [1, 63, 64, 65, 128, 200] {
            let words_per_row = 4;
            let words: Vec<u64> =
                (0..2 * words_per_row as u64).map(|i| 0x9e37_79b9_7f4a_7c15 << i ^ i << 7).collect();
            let mut target = Target::default();
            target.set(&MaskView { width, height: 2, words_per_row, words: &words });
            for y in 0..2 {
                let bit = |x: u32| (words[y * words_per_row + x as usize / 64] >> (x % 64) & 1) as u32;
                for x in 0..=width {
                    assert_eq!(target.before(x, y), (0..x).map(bit).sum(), "width {width}, x {x}");
                }
            }
        }
    }

    #[test]
    #[should_panic(expected = "a mask of 65 x 2 px with 1 words a row has 2 words")]
    fn a_mask_with_too_few_words_is_refused() {
        Target::default().set(&MaskView { width: 65, height: 2, words_per_row: 1, words: &[0; 2] });
    }
}
