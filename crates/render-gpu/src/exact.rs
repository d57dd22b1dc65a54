//! The silhouette of any triangles as spans of pixels: the plain path for what the contour kernel does not take.

use crate::clip::{Clipper, NotFinite};
use crate::project::{Projector, SUBPIXELS, Snapped};
use crate::rows::ScanLines;

/// A run of pixels of one line that lie inside the silhouette.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Span {
    /// Which scored row.
    pub line: usize,
    /// First column.
    pub start: u32,
    /// One past the last column.
    pub end: u32,
}

/// Where the outline of a triangle crosses a line. The order is that of a sweep over the image: by line, by column,
/// entering before leaving.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Crossing {
    line: u32,
    /// The first pixel column whose centre is at or right of the crossing, from 0 to the width.
    column: u32,
    leaves: bool,
}

/// Fills triangles; keeps its memory between meshes.
///
/// Each line is swept from left to right and counts how many triangles it is inside of. Unlike the contour kernel
/// this needs no closed mesh (the near plane cuts holes), no range of coordinates and no limit of crossings.
#[derive(Clone, Debug, Default)]
pub(crate) struct SpanFiller {
    clipper: Clipper,
    crossings: Vec<Crossing>,
}

impl SpanFiller {
    /// Calls `emit` for each span of the silhouette, line by line, from left to right; spans may touch.
    pub fn spans(
        &mut self,
        projector: &Projector,
        lines: &ScanLines,
        width: u32,
        positions: &[[f32; 3]],
        triangles: &[[u32; 3]],
        mut emit: impl FnMut(Span),
    ) -> Result<(), NotFinite> {
        let Self { clipper, crossings } = self;
        crossings.clear();
        clipper.triangles(projector, positions, triangles, |[a, b, c]| {
            let [a, b, c] = match turn([a, b, c]) {
                0 => return,
                1.. => [a, b, c],
                _ => [a, c, b],
            };
            for (from, to) in [(a, b), (b, c), (c, a)] {
                cross_lines(from, to, lines, projector.origin[0], width, crossings);
            }
        })?;
        crossings.sort_unstable();
        let (mut inside, mut start) = (0, 0);
        for &Crossing { line, column, leaves } in &*crossings {
            if leaves {
                inside -= 1;
                if inside == 0 && start < column {
                    emit(Span { line: line as usize, start, end: column });
                }
            } else {
                if inside == 0 {
                    start = column;
                }
                inside += 1;
            }
        }
        Ok(())
    }
}

/// Twice the signed area of a triangle; positive when it turns from x towards y, its inside right of each edge.
pub(crate) fn turn([a, b, c]: [Snapped; 3]) -> i64 {
    let difference = |p: Snapped, axis: usize| i64::from(p[axis] - a[axis]);
    difference(b, 0) * difference(c, 1) - difference(b, 1) * difference(c, 0)
}

/// Lists where an edge of a triangle with positive turn crosses the lines: upwards it enters, downwards it leaves.
fn cross_lines(
    from: Snapped,
    to: Snapped,
    lines: &ScanLines,
    origin_column: i32,
    width: u32,
    crossings: &mut Vec<Crossing>,
) {
    let leaves = to[1] > from[1];
    let ([x0, y0], [x1, y1]) = if leaves { (from, to) } else { (to, from) };
    let (dx, dy) = (i64::from(x1 - x0), i64::from(y1 - y0));
    for line in lines.at_or_below(y0)..lines.at_or_below(y1) {
        // The edge is at x0 + down dx / dy here; the centre of column c is at 16 c + 8: the first c that is not left of it.
        let down = i64::from(lines.y(line) - y0);
        let numerator = i64::from(x0 - SUBPIXELS / 2) * dy + down * dx;
        let column = -(-numerator).div_euclid(i64::from(SUBPIXELS) * dy) + i64::from(origin_column);
        crossings.push(Crossing {
            line: line as u32,
            column: column.clamp(0, i64::from(width)) as u32,
            leaves,
        });
    }
}
