//! Where the outline of a mesh crosses the lines, as one list a line.

use bytemuck::cast;
use wide::i32x8;

use super::outline::OutlineEdge;
use super::target::Target;
use crate::project::SUBPIXELS;
use crate::rows::ScanLines;

/// The most crossings of a line that are kept here; a mesh with more takes the plain path.
pub(super) const MAX_CROSSINGS: usize = 64;

/// Set in a key where the outline leaves the inside.
pub(super) const LEAVES: i32 = 1 << 15;
/// Bits from this one on hold the column.
pub(super) const COLUMN_SHIFT: u32 = 16;

/// Columns along an edge are fixed-point numbers with so many bits after the point.
///
/// The exact column is a multiple of 1 / (16 dy) with dy < 2^15: an integer, or at least 2^-19 away from one. Start and
/// steps are rounded to the nearest, so that after at most 2^11 lines the walk is less than 2^-21 off: less than
/// [`MARGIN`], which in turn added to it stays below 2^-19. Rounding the walk is therefore exact.
const FRACTION_BITS: u32 = 32;
/// How far below a column an edge may be seen and still be on it.
const MARGIN: i64 = 1 << (FRACTION_BITS - 20);

/// Fills up short lists: sorts behind every crossing.
pub(super) const NONE: i32x8 = i32x8::new([i32::MAX; 8]);

/// Lines are worked on in eights.
const LANES: usize = 8;
/// Room for the crossings of eight lines.
const ROOM: usize = LANES * MAX_CROSSINGS;

/// More crossings in a line than there is room for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct TooManyCrossings;

/// An edge on its way down through the lines that it crosses.
#[derive(Clone, Copy, Debug)]
struct Walk {
    /// The first line it crosses, and the one past the last.
    lines: [u32; 2],
    /// The first column whose centre is right of the edge, at its first line; fixed point, rounded down when used.
    column: i64,
    /// How far the column moves from line to line.
    step: i64,
    /// [`LEAVES`] or 0.
    leaves: i32,
}

/// Lists of crossings; a crossing is `column << 16 | leaves << 15 | pixels of the mask left of the column`, so that
/// sorting orders them for the sweep.
#[derive(Clone, Debug, Default)]
pub(super) struct Crossings {
    walks: Vec<Walk>,
    /// The lists of eight lines lie side by side: crossing i of line l is `keys[l / 8 * ROOM + 8 * i + l % 8]`. A list
    /// that is too long runs on into its neighbours: found out when it is read, before any of them is.
    keys: Vec<i32>,
    /// Where in `keys` the next crossing of each line goes.
    next: Vec<u32>,
}

impl Crossings {
    /// Makes room for so many lines.
    pub fn set_lines(&mut self, n_lines: usize) {
        let n_eights = n_lines.div_ceil(LANES);
        self.keys.resize(n_eights * ROOM, 0);
        self.next.resize(n_eights * LANES, 0);
    }

    /// Forgets all edges.
    pub fn clear(&mut self) {
        self.walks.clear();
    }

    /// Adds an edge of the outline.
    #[inline(always)]
    pub fn add(&mut self, edge: OutlineEdge, lines: &ScanLines, origin_column: i32) {
        let ([x0, y0], [x1, y1]) = (edge.top, edge.bottom);
        let (first, end) = (lines.at_or_below(y0), lines.at_or_below(y1));
        if first == end {
            return;
        }
        let slope = f64::from(x1 - x0) / f64::from(y1 - y0);
        let x_at_first = f64::from(x0) + f64::from(lines.y(first) - y0) * slope;
        // Column c lies right of x if its centre 16 c + 8 does: c >= (x - 8) / 16, rounded up.
        let origin = f64::from(SUBPIXELS * origin_column - SUBPIXELS / 2);
        self.walks.push(Walk {
            lines: [first as u32, end as u32],
            column: fixed_from_subpixels(x_at_first + origin) + (1 << FRACTION_BITS) - MARGIN,
            step: fixed_from_subpixels(slope * f64::from(1 << lines.pitch_log2)),
            leaves: if edge.enters { 0 } else { LEAVES },
        });
    }

    /// Lists the crossings of all edges, which lie in lines `first..end`. In view means that no part of the outline is
    /// left or right of the image.
    pub fn list(
        &mut self,
        lines: &ScanLines,
        target: &Target,
        (first, end): (usize, usize),
        in_view: bool,
    ) -> Result<(), TooManyCrossings> {
        for line in first / LANES * LANES..end.next_multiple_of(LANES) {
            self.next[line] = (line / LANES * ROOM + line % LANES) as u32;
        }
        let Self { walks, keys, next } = self;
        if in_view {
            list::<true>(walks, lines, target, keys, next)
        } else {
            list::<false>(walks, lines, target, keys, next)
        }
    }

    /// The lists of the eight lines from `line` (a multiple of eight) on, as lanes; lists that end earlier than others
    /// are filled up with [`NONE`].
    #[inline(always)]
    pub fn read<'a>(
        &self,
        line: usize,
        slots: &'a mut [i32x8; MAX_CROSSINGS],
    ) -> Result<&'a mut [i32x8], TooManyCrossings> {
        let start = line / LANES * ROOM;
        let next: [u32; LANES] = *self.next[line..].first_chunk().expect("lines are padded to whole eights");
        let length = cast::<_, i32x8>(next) - i32x8::splat(start as i32);
        let longest = length.reduce_max() as usize / LANES;
        let Some(slots) = slots.get_mut(..longest) else {
            return Err(TooManyCrossings);
        };
        let keys = self.keys[start..].chunks_exact(LANES);
        for (i, (slot, keys)) in slots.iter_mut().zip(keys).enumerate() {
            let listed = length.simd_gt(i32x8::splat((LANES * i + LANES - 1) as i32));
            *slot = listed.select(i32x8::new(*keys.first_chunk().expect("chunks of eight")), NONE);
        }
        Ok(slots)
    }
}

/// The inner loop: takes one step of a walk for each crossing.
#[inline(never)] // to have the registers for itself
fn list<const IN_VIEW: bool>(
    walks: &[Walk],
    lines: &ScanLines,
    target: &Target,
    keys: &mut [i32],
    next: &mut [u32],
) -> Result<(), TooManyCrossings> {
    let (words, width) = (target.words.as_slice(), target.width as i32);
    let row_step = lines.row_step * target.words_per_row;
    for walk in walks {
        let [first, end] = walk.lines.map(|line| line as usize);
        let mut row_start = lines.row(first) * target.words_per_row;
        let mut column = walk.column;
        for next in &mut next[first..end] {
            let x = (column >> FRACTION_BITS) as i32;
            let x = if IN_VIEW { x } else { x.clamp(0, width) } as u32;
            let in_mask = words[row_start + Target::word_of(x)].before(x);
            *keys.get_mut(*next as usize).ok_or(TooManyCrossings)? =
                (x << COLUMN_SHIFT | in_mask) as i32 | walk.leaves;
            *next += LANES as u32;
            column = column.wrapping_add(walk.step);
            row_start += row_step;
        }
    }
    Ok(())
}

/// Rounds to a fixed-point number of pixels, for up to 2^18 px; beyond, where no edge takes a second step, the result
/// means nothing. Adding 1.5 x 2^52 leaves the rounded number in the lowest bits of the sum.
#[inline(always)]
fn fixed_from_subpixels(subpixels: f64) -> i64 {
    const SCALE: f64 = (1_i64 << FRACTION_BITS) as f64 / SUBPIXELS as f64;
    const ROUNDER: f64 = 1.5 * (1_i64 << 52) as f64;
    (subpixels * SCALE + ROUNDER).to_bits().wrapping_sub(ROUNDER.to_bits()) as i64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rows::RowStep;

    #[test]
    fn walks_are_exact_on_the_longest_and_flattest_edges() {
        let max = i32::from(i16::MAX) / 2;
        let edges = [
            ([-max, -max], [max, max]),
            ([max, -max], [-max, max - 1]),
            ([-max, 7], [max, 9]),
            ([max, 8], [-max, 9]),
            ([-max, -max], [1 - max, max]),
            ([8, -max], [8, max]),
            ([0, -max], [max - 3, max - 1]),
            ([5, -321], [-77, 1000]),
        ];
        for step in [1, 2, 16] {
            let lines = ScanLines::new(2100, RowStep::new(step).expect("a power of two"), 1050);
            for (top, bottom) in edges {
                let mut crossings = Crossings::default();
                crossings.add(OutlineEdge { top, bottom, enters: true }, &lines, 0);
                let Some(&walk) = crossings.walks.first() else {
                    assert!((top[1]..bottom[1]).all(|y| (0..lines.n).all(|line| lines.y(line) != y)));
                    continue;
                };
                let mut column = walk.column;
                for line in walk.lines[0]..walk.lines[1] {
                    // By exact division: the first c with 16 c + 8 >= x.
                    let (dx, dy) = (i64::from(bottom[0] - top[0]), i64::from(bottom[1] - top[1]));
                    let down = i64::from(lines.y(line as usize) - top[1]);
                    let numerator = i64::from(top[0] - 8) * dy + down * dx;
                    let expected = -(-numerator).div_euclid(16 * dy);
                    assert_eq!(column >> FRACTION_BITS, expected, "from {top:?} to {bottom:?}, line {line}");
                    column = column.wrapping_add(walk.step);
                }
            }
        }
    }
}
