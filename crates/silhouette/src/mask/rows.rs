//! Reading rows: runs of person pixels and prefix counts.

use super::{Mask, WORD_BITS};

/// Positions of the ones in `word`, lowest first.
pub(crate) fn bits(word: u64) -> impl Iterator<Item = u32> {
    let mut rest = word;
    std::iter::from_fn(move || {
        let bit = (rest != 0).then(|| rest.trailing_zeros())?;
        rest &= rest - 1;
        Some(bit)
    })
}

/// Person pixels left of each column, for every row: the number in `x0..x1` of a row is one subtraction.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RowPrefix {
    stride: usize,
    counts: Vec<u32>,
}

impl RowPrefix {
    /// Prefix counts of row `y`, `[width + 1]`: entry `x` is the number of person pixels in columns `0..x`.
    ///
    /// # Panics
    /// When there is no row `y`.
    pub fn row(&self, y: u32) -> &[u32] {
        let start = y as usize * self.stride;
        &self.counts[start..start + self.stride]
    }

    /// Person pixels in columns `x0..x1` of row `y`.
    ///
    /// # Panics
    /// When the span is reversed or lies outside.
    pub fn count(&self, y: u32, x0: u32, x1: u32) -> u32 {
        assert!(x0 <= x1, "span {x0}..{x1} is reversed");
        let row = self.row(y);
        row[x1 as usize] - row[x0 as usize]
    }
}

impl Mask {
    /// Prefix counts of every row.
    pub fn row_prefix(&self) -> RowPrefix {
        let stride = self.width as usize + 1;
        let mut counts = Vec::with_capacity(stride * self.height as usize);
        for y in 0..self.height {
            let row = self.row(y);
            let mut count = 0;
            counts.push(count);
            counts.extend((0..self.width as usize).map(|x| {
                count += (row[x / WORD_BITS] >> (x % WORD_BITS) & 1) as u32;
                count
            }));
        }
        RowPrefix { stride, counts }
    }

    /// The runs of person pixels of row `y` from left to right, each as first column and column after the last.
    ///
    /// # Panics
    /// When the mask has no row `y`.
    pub fn runs(&self, y: u32) -> impl Iterator<Item = (u32, u32)> {
        let row = self.row(y);
        let width = self.width;
        let mut x = 0;
        std::iter::from_fn(move || {
            let start = next_bit(row, x, 0).filter(|&start| start < width)?;
            let end = next_bit(row, start, u64::MAX).map_or(width, |end| end.min(width));
            x = end;
            Some((start, end))
        })
    }
}

impl Mask {
    /// Makes columns `x0..x1` of row `y` person.
    pub(crate) fn fill_run(&mut self, y: u32, x0: u32, x1: u32) {
        for_each_word_of_run(x0, x1, |index, bits| self.row_mut(y)[index] |= bits);
    }

    /// Person pixels in columns `x0..x1` of row `y`.
    pub(crate) fn count_run(&self, y: u32, x0: u32, x1: u32) -> u64 {
        let row = self.row(y);
        let mut count = 0;
        for_each_word_of_run(x0, x1, |index, bits| count += u64::from((row[index] & bits).count_ones()));
        count
    }
}

/// Calls `visit` with the index of each word that columns `x0..x1` touch and the bits of the run in it.
fn for_each_word_of_run(x0: u32, x1: u32, mut visit: impl FnMut(usize, u64)) {
    let mut x = x0 as usize;
    while x < x1 as usize {
        let index = x / WORD_BITS;
        let end = ((index + 1) * WORD_BITS).min(x1 as usize);
        let ones = u64::MAX >> (WORD_BITS - (end - x));
        visit(index, ones << (x % WORD_BITS));
        x = end;
    }
}

/// The first bit at or after `from` that is set in `row ^ flip`.
fn next_bit(row: &[u64], from: u32, flip: u64) -> Option<u32> {
    let first = from as usize / WORD_BITS;
    let mut ignore = (1 << (from as usize % WORD_BITS)) - 1;
    for (index, &word) in row.iter().enumerate().skip(first) {
        let candidates = (word ^ flip) & !ignore;
        if candidates != 0 {
            return Some((index * WORD_BITS) as u32 + candidates.trailing_zeros());
        }
        ignore = 0;
    }
    None
}
