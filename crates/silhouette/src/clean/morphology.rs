//! Erosion, dilation, opening and closing on rows of bits.
//!
//! Outside the image there is nothing to see: a dilation takes it for background, an erosion for person, so that
//! opening never adds a pixel and closing never takes one, at the edges too.

use crate::mask::{Mask, WORD_BITS};

/// The rectangle of pixels about each pixel that an operation looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Pixels to the left.
    pub left: u32,
    /// Pixels to the right.
    pub right: u32,
    /// Pixels above.
    pub up: u32,
    /// Pixels below.
    pub down: u32,
}

impl Window {
    /// The square that reaches `radius` pixels to all sides.
    pub fn radius(radius: u32) -> Self {
        Self { left: radius, right: radius, up: radius, down: radius }
    }

    fn reflected(self) -> Self {
        Self { left: self.right, right: self.left, up: self.down, down: self.up }
    }

    /// A square of `side` pixels whose first pixel is the one it stands for.
    fn square(side: u32) -> Self {
        let reach = side.saturating_sub(1);
        Self { left: 0, right: reach, up: 0, down: reach }
    }
}

impl Mask {
    /// Person wherever the window holds at least one person pixel.
    #[must_use]
    pub fn dilated(&self, window: Window) -> Self {
        let mut wide = self.clone();
        for y in 0..self.height() {
            // A person pixel to the right is one at a higher bit: it comes in by a shift down.
            let reach_right = spread(self.row(y), window.right, shifted_down);
            let reach_left = spread(self.row(y), window.left, shifted_up);
            let row = wide.row_mut(y).iter_mut();
            row.zip(reach_right.iter().zip(&reach_left))
                .for_each(|(word, (right, left))| *word = right | left);
        }
        wide.clear_padding();
        let below = spread_rows(&wide, window.down, |y, step| y.checked_add(step));
        let mut grown = spread_rows(&wide, window.up, |y, step| y.checked_sub(step));
        grown.union_with(&below);
        grown
    }

    /// Person wherever the window holds no background pixel.
    #[must_use]
    pub fn eroded(&self, window: Window) -> Self {
        self.complement().dilated(window).complement()
    }

    /// Keeps what a square of `side` pixels fits into: thinner pieces go.
    #[must_use]
    pub fn opened(&self, side: u32) -> Self {
        let window = Window::square(side);
        self.eroded(window).dilated(window.reflected())
    }

    /// Fills what a square of `side` pixels does not fit into: cracks and notches go.
    #[must_use]
    pub fn closed(&self, side: u32) -> Self {
        let window = Window::square(side);
        self.dilated(window).eroded(window.reflected())
    }
}

/// The union of `row` shifted by 0 to `reach` pixels: each round doubles what is reached.
fn spread(row: &[u64], reach: u32, shifted: fn(&[u64], u32) -> Vec<u64>) -> Vec<u64> {
    let mut union = row.to_vec();
    let mut reached = 0;
    while reached < reach {
        let step = (reached + 1).min(reach - reached);
        let moved = shifted(&union, step);
        union.iter_mut().zip(moved).for_each(|(word, other)| *word |= other);
        reached += step;
    }
    union
}

/// The union of each row with the next `reach` rows on one side; `towards` gives a row's index some steps on.
fn spread_rows(mask: &Mask, reach: u32, towards: impl Fn(u32, u32) -> Option<u32>) -> Mask {
    let mut union = mask.clone();
    let mut reached = 0;
    while reached < reach {
        let step = (reached + 1).min(reach - reached);
        let before = union.clone();
        for y in 0..mask.height() {
            if let Some(other) = towards(y, step).filter(|&other| other < mask.height()) {
                union.row_mut(y).iter_mut().zip(before.row(other)).for_each(|(word, bits)| *word |= bits);
            }
        }
        reached += step;
    }
    union
}

/// Every pixel `by` places to the right.
fn shifted_up(row: &[u64], by: u32) -> Vec<u64> {
    let (words, bits) = (by as usize / WORD_BITS, by % u64::BITS);
    let at = |index: Option<usize>| index.and_then(|index| row.get(index)).copied().unwrap_or(0);
    let word = |index: usize| {
        let low = at(index.checked_sub(words + 1));
        at(index.checked_sub(words)) << bits | if bits == 0 { 0 } else { low >> (u64::BITS - bits) }
    };
    (0..row.len()).map(word).collect()
}

/// Every pixel `by` places to the left.
fn shifted_down(row: &[u64], by: u32) -> Vec<u64> {
    let (words, bits) = (by as usize / WORD_BITS, by % u64::BITS);
    let at = |index: usize| row.get(index).copied().unwrap_or(0);
    let word = |index: usize| {
        let high = at(index + words + 1);
        at(index + words) >> bits | if bits == 0 { 0 } else { high << (u64::BITS - bits) }
    };
    (0..row.len()).map(word).collect()
}
