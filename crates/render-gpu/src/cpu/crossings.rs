//! Where the outline of a mesh crosses the lines, as one list a line.

use bytemuck::cast;
use wide::i32x8;

use super::outline::OutlineEdge;
use super::target::{Target, pixels_before};
use crate::project::{SUBPIXELS, Snapped};
use crate::rows::ScanLines;

/// The most crossings of a line that are kept here; a mesh with more takes the plain path.
pub(super) const MAX_CROSSINGS: usize = 32;

/// Set in a key where the outline leaves the inside.
pub(super) const LEAVES: i32 = 1 << 15;
/// Bits above this one hold the column.
pub(super) const COLUMN_SHIFT: u32 = 16;

/// Columns in an edge's walk are fixed-point numbers with so many bits after the point.
///
/// The exact column is a multiple of 1 / (16 dy), dy < 2^15, hence an integer or at least 2^-19 away from one. A walk
/// over at most 2^11 lines, each step wrong by less than 2^-39, stays within 2^-28 of it: less than [`BIAS`].
const FRACTION_BITS: u32 = 40;
/// Turns "round down" into "round up", less a margin for inexact steps.
const BIAS: i64 = (1 << FRACTION_BITS) - (1 << (FRACTION_BITS - 22));

/// Fills up short lists: sorts behind every crossing.
pub(super) const NONE: i32x8 = i32x8::new([i32::MAX; 8]);

/// More crossings in a line than there is room for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct TooManyCrossings;

/// Lists of crossings; a crossing is `column << 16 | leaves << 15 | pixels of the mask left of the column`, so that
/// sorting orders them for the sweep.
#[derive(Clone, Debug, Default)]
pub(super) struct Crossings {
    /// `keys[slot * stride + line]`: lists stand upright, so that eight lines are read in one go.
    keys: Vec<i32>,
    /// Where in `keys` the next crossing of each line goes.
    next: Vec<u32>,
    stride: usize,
}

impl Crossings {
    /// Makes room for so many lines.
    pub fn set_lines(&mut self, n_lines: usize) {
        // Lines are read in eights; an odd number of cache lines keeps slots of a line out of each other's way.
        let stride = ((n_lines + 8).div_ceil(16) | 1) * 16;
        if stride != self.stride {
            self.stride = stride;
            self.keys.resize(stride * MAX_CROSSINGS, 0);
            self.next.resize(stride, 0);
        }
    }

    /// Empties the lists of lines `first..end`, and a few more.
    pub fn clear(&mut self, first: usize, end: usize) {
        for (line, next) in self.next.iter_mut().enumerate().take(end + 8).skip(first) {
            *next = line as u32;
        }
    }

    /// Adds the crossings of an edge.
    #[inline(always)]
    pub fn add(
        &mut self,
        edge: OutlineEdge,
        lines: &ScanLines,
        origin_column: i32,
        target: &Target,
    ) -> Result<(), TooManyCrossings> {
        // The inside is on the left: going down the screen the edge enters it, seen from left to right.
        let down = edge.to[1] > edge.from[1];
        let ([x0, y0], [x1, y1]): (Snapped, Snapped) = if down {
            (edge.from, edge.to)
        } else {
            (edge.to, edge.from)
        };
        let leaves = if down { 0 } else { LEAVES };
        let (first, end) = (lines.at_or_below(y0), lines.at_or_below(y1));
        if first == end {
            return Ok(());
        }
        let unit = (1_i64 << FRACTION_BITS) as f64 / f64::from(SUBPIXELS);
        let slope = f64::from(x1 - x0) / f64::from(y1 - y0);
        let start = f64::from(x0 - SUBPIXELS / 2 + SUBPIXELS * origin_column)
            + f64::from(lines.y(first) - y0) * slope;
        let mut column = (start * unit) as i64 + BIAS;
        let step = (slope * f64::from(1 << lines.pitch_log2) * unit) as i64;
        for (next, line) in self.next[first..end].iter_mut().zip(first..) {
            let x = (column >> FRACTION_BITS).clamp(0, i64::from(target.width)) as u32;
            let key =
                (x << COLUMN_SHIFT) as i32 | leaves | pixels_before(target.row(lines.row(line)), x) as i32;
            *self.keys.get_mut(*next as usize).ok_or(TooManyCrossings)? = key;
            *next += self.stride as u32;
            column += step;
        }
        Ok(())
    }

    /// Lines `line..line + 8` as lanes, slot by slot until all eight lists have ended; lists that end earlier are
    /// filled up with [`NONE`]. Returns how many slots were written to `slots`.
    #[inline(always)]
    pub fn read(&self, line: usize, slots: &mut [i32x8; MAX_CROSSINGS]) -> usize {
        let eight =
            |values: &[i32]| i32x8::new(*values.first_chunk().expect("lines are padded to whole eights"));
        let next: i32x8 = cast(
            *self.next[line..]
                .first_chunk::<8>()
                .expect("lines are padded to whole eights"),
        );
        let ahead = next - i32x8::new([0, 1, 2, 3, 4, 5, 6, 7]);
        for (slot, keys) in slots.iter_mut().enumerate() {
            let at = slot * self.stride + line;
            let listed = ahead.simd_gt(i32x8::splat(at as i32));
            if !listed.any() {
                return slot;
            }
            *keys = listed.select(eight(&self.keys[at..]), NONE);
        }
        MAX_CROSSINGS
    }
}
