//! Which rows of an image are scored, and which of them an edge crosses.

use crate::project::SUBPIXELS;

/// Score every n-th row, n a power of two: early annealing layers need no more.
///
/// Row `y` is scored when `y % n == n / 2`. With a person 350 px tall the intersection over union then differs from
/// the exact one by about 0.0003 (n = 2), 0.0008 (n = 4) and 0.002 (n = 8), root mean square.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RowStep {
    log2: u32,
}

/// A row step that is no power of two, or too large.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the row step is {0}, expected a power of two from 1 to {max}", max = RowStep::MAX)]
pub struct BadRowStep(pub u32);

impl RowStep {
    /// All rows.
    pub const EVERY: Self = Self { log2: 0 };
    /// The largest step.
    pub const MAX: u32 = 64;

    /// Every `n`-th row.
    pub fn new(n: u32) -> Result<Self, BadRowStep> {
        if n.is_power_of_two() && n <= Self::MAX { Ok(Self { log2: n.ilog2() }) } else { Err(BadRowStep(n)) }
    }

    /// The distance from one scored row to the next.
    pub fn get(self) -> u32 {
        1 << self.log2
    }

    /// The scored rows of an image of `height` rows, top down.
    pub fn rows(self, height: u32) -> impl ExactSizeIterator<Item = u32> + Clone {
        let (step, first) = (self.get(), self.get() / 2);
        (0..height.saturating_sub(first).div_ceil(step)).map(move |line| first + line * step)
    }
}

/// The scored rows as horizontal lines through pixel centres, in snapped coordinates.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ScanLines {
    /// How many lines there are.
    pub n: usize,
    /// Snapped y of line 0.
    pub first_y: i32,
    /// log2 of the distance between two lines.
    pub pitch_log2: u32,
    first_row: usize,
    /// The distance between two lines, rows.
    pub row_step: usize,
}

impl ScanLines {
    /// The lines of an image of `height` rows whose snapped coordinates count from row `origin_row`.
    pub fn new(height: u32, step: RowStep, origin_row: i32) -> Self {
        Self {
            n: step.rows(height).len(),
            first_y: SUBPIXELS * (step.get() as i32 / 2 - origin_row) + SUBPIXELS / 2,
            pitch_log2: SUBPIXELS.ilog2() + step.log2,
            first_row: step.get() as usize / 2,
            row_step: step.get() as usize,
        }
    }

    /// The first line at or below `y`, from 0 to `n`. An edge from `y0` down to `y1` crosses the lines
    /// `at_or_below(y0)..at_or_below(y1)`: the upper end counts, the lower one does not.
    #[inline]
    pub fn at_or_below(&self, y: i32) -> usize {
        let line = (y - self.first_y + (1 << self.pitch_log2) - 1) >> self.pitch_log2;
        line.clamp(0, self.n as i32) as usize
    }

    /// The image row of a line.
    #[inline]
    pub fn row(&self, line: usize) -> usize {
        self.first_row + line * self.row_step
    }

    /// Snapped y of a line.
    #[inline]
    pub fn y(&self, line: usize) -> i32 {
        self.first_y + ((line as i32) << self.pitch_log2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_centred_in_their_step() {
        let rows = |n, height| RowStep::new(n).expect("a power of two").rows(height).collect::<Vec<_>>();
        assert_eq!(rows(1, 3), [0, 1, 2]);
        assert_eq!(rows(2, 5), [1, 3]);
        assert_eq!(rows(4, 11), [2, 6, 10]);
        assert_eq!(rows(8, 4), [0; 0]);
    }

    #[test]
    fn lines_pass_through_pixel_centres() {
        let lines = ScanLines::new(10, RowStep::new(2).expect("a power of two"), 4);
        // Row 1 is the first: its centre is 2.5 rows above row 4, that is 40 sixteenths.
        assert_eq!((lines.n, lines.y(0), lines.y(1)), (5, -40, -8));
        assert_eq!([-41, -40, -39, -8, -7, 1000].map(|y| lines.at_or_below(y)), [0, 0, 1, 1, 2, 5]);
    }

    #[test]
    fn a_step_must_be_a_power_of_two() {
        assert_eq!(
            RowStep::new(3).expect_err("three").to_string(),
            "the row step is 3, expected a power of two from 1 to 64"
        );
        assert!(RowStep::new(0).is_err() && RowStep::new(128).is_err());
    }
}
