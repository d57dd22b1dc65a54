//! The outer contour of the person.
//!
//! The contour runs through the middles of the pixel edges between person and background, so that a step along a row
//! or column is one pixel long and a diagonal one √2: lengths do not depend on direction as they would along the pixel
//! corners. For the same reason the polygon of a piece without holes has an area of exactly its pixels less one half.

use crate::clean::{Components, Connectivity};
use crate::mask::Mask;

/// A closed outline: the last point joins the first.
///
/// Points are in image pixels (pixel centres at +0.5). On the screen the contour runs clockwise, the person on its
/// right-hand side.
///
/// ```
/// use silhouette::{Contour, Mask};
/// let mask = Mask::from_fn(30, 30, |x, y| (10..20).contains(&x) && (5..25).contains(&y));
/// let contour = Contour::outer(&mask).expect("the mask is not empty");
/// assert_eq!(contour.area_px(), 200.0 - 0.5);
/// assert_eq!(contour.resampled(100).len(), 100);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Contour {
    points_px: Vec<[f64; 2]>,
}

/// The four directions along pixel edges, clockwise on the screen, as steps from corner to corner.
const STEPS: [[i64; 2]; 4] = [[1, 0], [0, 1], [-1, 0], [0, -1]];

impl Contour {
    /// The outer contour of the largest 8-connected component; `None` for an empty mask.
    pub fn outer(mask: &Mask) -> Option<Self> {
        let components = Components::of(mask, Connectivity::Eight);
        let largest = components.largest()?;
        let piece = components.select(|index| index == largest);
        let start_y = components.all()[largest].bounding_box.y0;
        let (start_x, _) = piece.runs(start_y).next()?;
        Some(Self { points_px: trace(&piece, [i64::from(start_x), i64::from(start_y)]) })
    }

    /// The points in order, `[x, y]`, pixels.
    pub fn points_px(&self) -> &[[f64; 2]] {
        &self.points_px
    }

    /// Length around, pixels.
    pub fn length_px(&self) -> f64 {
        self.segments().map(|[from, to]| distance(from, to)).sum()
    }

    /// Area inside, square pixels.
    pub fn area_px(&self) -> f64 {
        0.5 * self.segments().map(|[a, b]| a[0] * b[1] - b[0] * a[1]).sum::<f64>()
    }

    /// `count` points at equal distances along the contour, from its first point on, `[count][x, y]`, pixels.
    pub fn resampled(&self, count: usize) -> Vec<[f64; 2]> {
        let step = self.length_px() / count as f64;
        let mut points = Vec::with_capacity(count);
        let mut start = 0.0;
        for [from, to] in self.segments() {
            let length = distance(from, to);
            while points.len() < count && points.len() as f64 * step < start + length {
                let part = (points.len() as f64 * step - start) / length;
                points.push([from[0] + part * (to[0] - from[0]), from[1] + part * (to[1] - from[1])]);
            }
            start += length;
        }
        // Rounding may put the last point just past the end, which is the beginning.
        points.resize(count, self.points_px[0]);
        points
    }

    fn segments(&self) -> impl Iterator<Item = [[f64; 2]; 2]> {
        let next = self.points_px.iter().cycle().skip(1);
        self.points_px.iter().zip(next).map(|(&from, &to)| [from, to])
    }
}

/// Walks the pixel edges about the component that holds the pixel right below the corner `start`, its topmost row's
/// first pixel, and notes the middle of each edge.
fn trace(piece: &Mask, start: [i64; 2]) -> Vec<[f64; 2]> {
    let mut points = Vec::new();
    let (mut corner, mut direction) = (start, 0);
    loop {
        let [dx, dy] = STEPS[direction];
        points.push([corner[0] as f64 + 0.5 * dx as f64, corner[1] as f64 + 0.5 * dy as f64]);
        corner = [corner[0] + dx, corner[1] + dy];
        // The pixels ahead, to the left and to the right of the way. Corners join pixels: with the left one the way
        // turns left, whatever the right one is.
        let ahead = |side: [i64; 2]| {
            let x = corner[0] + (dx + side[0] - 1) / 2;
            let y = corner[1] + (dy + side[1] - 1) / 2;
            piece.get_or_background(x, y)
        };
        if ahead([dy, -dx]) {
            direction = (direction + 3) % 4;
        } else if !ahead([-dy, dx]) {
            direction = (direction + 1) % 4;
        }
        if corner == start && direction == 0 {
            return points;
        }
    }
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn blobs() -> impl Strategy<Value = Mask> {
        prop::collection::vec((0u32..60, 0u32..40, 1u32..20, 1u32..15), 1..8).prop_map(|boxes| {
            Mask::from_fn(64, 48, |x, y| {
                boxes.iter().any(|&(x0, y0, w, h)| (x0..x0 + w).contains(&x) && (y0..y0 + h).contains(&y))
            })
        })
    }

    #[test]
    fn single_pixel_is_a_diamond() {
        let contour = Contour::outer(&"...\n.#.\n...".parse().unwrap()).unwrap();
        assert_eq!(contour.points_px(), [[1.5, 1.0], [2.0, 1.5], [1.5, 2.0], [1.0, 1.5]]);
        assert_eq!(contour.area_px(), 0.5);
    }

    #[test]
    fn empty_mask_has_no_contour() {
        assert_eq!(Contour::outer(&Mask::new(7, 3)), None);
    }

    #[test]
    fn pixels_joined_by_a_corner_are_one_contour() {
        let contour = Contour::outer(&"#.\n.#".parse().unwrap()).unwrap();
        assert_eq!(contour.points_px().len(), 8);
        let other = Contour::outer(&".#\n#.".parse().unwrap()).unwrap();
        assert_eq!(other.points_px().len(), 8);
    }

    #[test]
    fn disc_has_the_length_of_a_circle() {
        let radius = 200.0f64;
        let disc = Mask::from_fn(512, 512, |x, y| {
            (f64::from(x) + 0.5 - 256.0).hypot(f64::from(y) + 0.5 - 256.0) <= radius
        });
        let contour = Contour::outer(&disc).unwrap();
        let points = contour.resampled(100);
        let polygon: f64 = (0..100).map(|i| distance(points[i], points[(i + 1) % 100])).sum();
        assert!((polygon / (std::f64::consts::TAU * radius) - 1.0).abs() < 0.01, "{polygon}");
        for point in points {
            assert!((distance(point, [256.0, 256.0]) - radius).abs() < 1.0);
        }
    }

    proptest! {
        #[test]
        fn area_is_that_of_the_filled_piece(mask in blobs()) {
            let contour = Contour::outer(&mask).unwrap();
            let components = Components::of(&mask, Connectivity::Eight);
            let largest = components.largest().unwrap();
            let filled = components.select(|index| index == largest).with_holes_filled(u64::MAX);
            // Joints by a corner alone make the two turns there equal: the area stays pixels less one half
            // for pieces that hang together by edges.
            prop_assume!(Components::of(&filled, Connectivity::Four).all().len() == 1);
            let crossed = (1..64).any(|x| (1..48).any(|y| {
                let at = |dx: u32, dy: u32| filled.get(x - dx, y - dy);
                at(0, 0) == at(1, 1) && at(1, 0) == at(0, 1) && at(0, 0) != at(1, 0)
            }));
            prop_assume!(!crossed);
            prop_assert_eq!(contour.area_px(), filled.area() as f64 - 0.5);
        }

        #[test]
        fn samples_lie_at_equal_distances(mask in blobs(), count in 3usize..200) {
            let contour = Contour::outer(&mask).unwrap();
            let points = contour.resampled(count);
            prop_assert_eq!(points.len(), count);
            prop_assert_eq!(points[0], contour.points_px()[0]);
            // No chord is longer than the way along the contour.
            let step = contour.length_px() / count as f64;
            for i in 0..count {
                prop_assert!(distance(points[i], points[(i + 1) % count]) <= step * (1.0 + 1e-9));
            }
            // Twice as many points hold the same ones.
            for (point, twin) in points.iter().zip(contour.resampled(2 * count).iter().step_by(2)) {
                prop_assert!(distance(*point, *twin) < 1e-9);
            }
        }
    }
}
