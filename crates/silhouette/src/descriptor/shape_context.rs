//! Shape contexts `[Belongie2002]`: how the other points of a contour lie about each of its points.

use std::f64::consts::TAU;

use crate::contour::Contour;
use crate::mask::Mask;

/// Points taken at equal distances along the outer contour.
pub const CONTOUR_POINTS: usize = 100;
/// Rings of a shape context.
pub const RADIAL_BINS: usize = 5;
/// Sectors of a shape context.
pub const ANGULAR_BINS: usize = 12;
/// Cells of a shape context: ring after ring.
pub const CONTEXT_BINS: usize = RADIAL_BINS * ANGULAR_BINS;
/// Where the rings begin and end, in mean distances between points.
const RADIAL_RANGE: [f64; 2] = [0.125, 3.0];

/// Shares of the other points in the cells about one point, `[ring * ANGULAR_BINS + sector]`.
///
/// The rings are of equal width in the logarithm. Sector 0 lies about the direction of +x, the others follow towards
/// +y: horizontal and vertical stretches of contour fall into the middle of sectors, not onto their borders.
pub type ShapeContext = [f32; CONTEXT_BINS];

/// The shape contexts of [`CONTOUR_POINTS`] points along the outer contour of `mask`; `None` when it is empty.
pub fn contour_contexts(mask: &Mask) -> Option<Vec<ShapeContext>> {
    // Cut out first, so that the place in the image changes no bit of the answer.
    let person = mask.crop(mask.bounding_box()?);
    Some(shape_contexts(&Contour::outer(&person)?.resampled(CONTOUR_POINTS)))
}

/// The shape context of each of `points` (pixels).
///
/// Points nearer than the first ring count as in it (their direction is still known); points beyond the last ring do
/// not count. Distances are measured in the mean distance of all pairs, so that size does not matter.
pub fn shape_contexts(points: &[[f64; 2]]) -> Vec<ShapeContext> {
    let mean_distance = mean_distance(points);
    let scale = 1.0 / (mean_distance * RADIAL_RANGE[0]);
    let rings_per_log = RADIAL_BINS as f64 / (RADIAL_RANGE[1] / RADIAL_RANGE[0]).ln();
    let sectors_per_radian = ANGULAR_BINS as f64 / TAU;
    let share = 1.0 / (points.len().max(2) - 1) as f32;
    points
        .iter()
        .enumerate()
        .map(|(index, center)| {
            let mut context = [0.0; CONTEXT_BINS];
            for (_, point) in points.iter().enumerate().filter(|(other, _)| *other != index) {
                let [dx, dy] = [point[0] - center[0], point[1] - center[1]];
                let ring = ((dx.hypot(dy) * scale).ln() * rings_per_log).max(0.0) as usize;
                if ring < RADIAL_BINS {
                    let turns = dy.atan2(dx) * sectors_per_radian + 0.5;
                    let sector = turns.rem_euclid(ANGULAR_BINS as f64) as usize % ANGULAR_BINS;
                    context[ring * ANGULAR_BINS + sector] += share;
                }
            }
            context
        })
        .collect()
}

/// Mean distance over all pairs of points; 1 when they all coincide.
fn mean_distance(points: &[[f64; 2]]) -> f64 {
    let mut sum = 0.0;
    for (index, a) in points.iter().enumerate() {
        sum += points[index + 1..].iter().map(|b| (a[0] - b[0]).hypot(a[1] - b[1])).sum::<f64>();
    }
    let n_pairs = points.len() * points.len().saturating_sub(1) / 2;
    if sum > 0.0 { sum / n_pairs as f64 } else { 1.0 }
}
