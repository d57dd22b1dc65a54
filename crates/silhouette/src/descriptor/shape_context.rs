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
    let borders = squared_borders(mean_distance(points));
    let share = 1.0 / (points.len().max(2) - 1) as f32;
    let mut contexts = vec![[0.0; CONTEXT_BINS]; points.len()];
    for (index, point) in points.iter().enumerate() {
        for other in index + 1..points.len() {
            let [dx, dy] = [points[other][0] - point[0], points[other][1] - point[1]];
            let squared = dx * dx + dy * dy;
            let ring = borders.iter().filter(|&&border| squared >= border).count();
            if ring < RADIAL_BINS {
                // Seen from there, this point lies the opposite way.
                let [there, back] = opposite_sectors(dx, dy);
                contexts[index][ring * ANGULAR_BINS + there] += share;
                contexts[other][ring * ANGULAR_BINS + back] += share;
            }
        }
    }
    contexts
}

/// Squared distances at which the rings end.
fn squared_borders(mean_distance: f64) -> [f64; RADIAL_BINS] {
    let [first, last] = RADIAL_RANGE;
    std::array::from_fn(|ring| {
        let share = (ring + 1) as f64 / RADIAL_BINS as f64;
        (mean_distance * first * (last / first).powf(share)).powi(2)
    })
}

/// The sectors of a direction and of its opposite. Points that coincide lie in sector 0 of each other.
fn opposite_sectors(dx: f64, dy: f64) -> [usize; 2] {
    let turns = dy.atan2(dx) * (ANGULAR_BINS as f64 / TAU) + 0.5;
    let sector = turns.rem_euclid(ANGULAR_BINS as f64) as usize % ANGULAR_BINS;
    let is_apart = dx != 0.0 || dy != 0.0;
    [sector, if is_apart { (sector + ANGULAR_BINS / 2) % ANGULAR_BINS } else { sector }]
}

/// Mean distance over all pairs of points; 1 when they all coincide.
fn mean_distance(points: &[[f64; 2]]) -> f64 {
    let mut sum = 0.0;
    for (index, a) in points.iter().enumerate() {
        sum += points[index + 1..]
            .iter()
            .map(|b| ((a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)).sqrt())
            .sum::<f64>();
    }
    let n_pairs = points.len() * points.len().saturating_sub(1) / 2;
    if sum > 0.0 { sum / n_pairs as f64 } else { 1.0 }
}
