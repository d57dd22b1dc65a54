//! Signed distance of every pixel from the outline of a mask.

use crate::mask::{Mask, PixelRect};

/// Distances to the outline of a mask in a rectangle of its image, pixels: positive outside the person, negative inside.
///
/// The outline lies halfway between the centres of a person's and a background pixel, which is where a distance to the
/// nearest pixel centre of the other kind, less one half, is zero. Exact distances, `[Felzenszwalb2012]`.
///
/// ```
/// use silhouette::{DistanceField, Mask};
/// let mask = Mask::from_fn(40, 40, |x, _| (10..20).contains(&x));
/// let field = DistanceField::of(&mask, 8).expect("the mask is not empty");
/// assert_eq!(field.at([5.5, 20.5]), 4.5);
/// assert_eq!(field.at([12.5, 20.5]), -2.5);
/// assert!(field.at([10.0, 20.5]).abs() < 1e-6);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct DistanceField {
    rect: PixelRect,
    /// Row after row of `rect`.
    values: Vec<f32>,
}

impl DistanceField {
    /// The field about the person, up to `margin_px` beyond their bounding box; `None` for an empty mask.
    pub fn of(mask: &Mask, margin_px: u32) -> Option<Self> {
        let rect = mask.bounding_box()?.grown(margin_px, mask.width(), mask.height());
        let to_person = squared_distances(mask, &rect, true);
        let to_background = squared_distances(mask, &rect, false);
        let signed =
            |(out, inside): (&f32, &f32)| if *out > 0.0 { out.sqrt() - 0.5 } else { 0.5 - inside.sqrt() };
        let values = to_person.iter().zip(&to_background).map(signed).collect();
        Some(Self { rect, values })
    }

    /// Where the field is known.
    pub fn rect(&self) -> PixelRect {
        self.rect
    }

    /// The distance at the centre of pixel `(x, y)`.
    ///
    /// # Panics
    /// When the pixel is outside [`rect`](Self::rect).
    pub fn at_pixel(&self, x: u32, y: u32) -> f32 {
        let PixelRect { x0, y0, x1, y1 } = self.rect;
        assert!(
            (x0..x1).contains(&x) && (y0..y1).contains(&y),
            "pixel ({x}, {y}) is outside {:?}",
            self.rect
        );
        self.values[(y - y0) as usize * self.rect.width() as usize + (x - x0) as usize]
    }

    /// The distance at a point of the image, between pixel centres interpolated; beyond the rectangle, its value at the
    /// nearest edge plus the way there.
    pub fn at(&self, point_px: [f64; 2]) -> f64 {
        self.with_gradient(point_px).0
    }

    /// The distance at a point, and how it grows along x and y.
    pub fn with_gradient(&self, point_px: [f64; 2]) -> (f64, [f64; 2]) {
        let (width, height) = (self.rect.width() as usize, self.rect.height() as usize);
        let place = |value: f64, first: u32, count: usize| {
            let at = value - 0.5 - f64::from(first);
            let inside = at.clamp(0.0, (count - 1) as f64);
            let cell = (inside as usize).min(count.saturating_sub(2));
            (cell, inside - cell as f64, at - inside)
        };
        let (x, along_x, beyond_x) = place(point_px[0], self.rect.x0, width);
        let (y, along_y, beyond_y) = place(point_px[1], self.rect.y0, height);
        let corner = |dx: usize, dy: usize| {
            f64::from(self.values[(y + dy).min(height - 1) * width + (x + dx).min(width - 1)])
        };
        let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
        let (top, bottom) = (a + along_x * (b - a), c + along_x * (d - c));
        let value = top + along_y * (bottom - top);
        let gradient = [(b - a) + along_y * ((d - c) - (b - a)), bottom - top];
        let beyond = beyond_x.hypot(beyond_y);
        if beyond > 0.0 {
            return (value + beyond, [beyond_x / beyond, beyond_y / beyond]);
        }
        (value, gradient)
    }
}

/// Squared distance from each pixel of `rect`, which holds the whole person, to the nearest one of the person or of the
/// background, between centres; 0 at those.
fn squared_distances(mask: &Mask, rect: &PixelRect, to_person: bool) -> Vec<f32> {
    // Larger than any square in an image, small enough that sums stay exact.
    const FAR: f32 = 1e9;
    let width = rect.width() as usize;
    let (at_person, at_background) = if to_person { (0.0, f32::INFINITY) } else { (f32::INFINITY, 0.0) };
    let mut values = vec![at_background; width * rect.height() as usize];
    for (row, y) in values.chunks_exact_mut(width).zip(rect.y0..) {
        for (x0, x1) in mask.runs(y) {
            row[(x0 - rect.x0) as usize..(x1 - rect.x0) as usize].fill(at_person);
        }
    }
    // Along columns, all of them at once: the way to the nearest goal above, then to that below.
    let rows: &mut Vec<&mut [f32]> = &mut values.chunks_exact_mut(width).collect();
    for _ in 0..2 {
        for y in 1..rows.len() {
            let (before, row) = rows.split_at_mut(y);
            row[0].iter_mut().zip(&*before[y - 1]).for_each(|(value, near)| *value = value.min(near + 1.0));
        }
        rows.reverse();
    }
    let mut envelope = Envelope::default();
    let mut line = vec![0.0; width];
    for row in rows {
        line.iter_mut().zip(&**row).for_each(|(square, way)| *square = (way * way).min(FAR));
        envelope.transform(&line, |column, value| row[column] = value);
    }
    values
}

/// Lower envelope of parabolas, one standing on each place of a line.
#[derive(Default)]
struct Envelope {
    places: Vec<usize>,
    /// Where each parabola of the envelope begins to be the lowest.
    starts: Vec<f32>,
}

impl Envelope {
    /// Gives out, for each place p, the least of (p - q)² + line[q] over q.
    fn transform(&mut self, line: &[f32], mut out: impl FnMut(usize, f32)) {
        self.places.clear();
        self.starts.clear();
        for q in 0..line.len() {
            let start = loop {
                let Some(&p) = self.places.last() else { break f32::NEG_INFINITY };
                let (pf, qf) = (p as f32, q as f32);
                let crossing = ((line[q] + qf * qf) - (line[p] + pf * pf)) / (2.0 * (qf - pf));
                if crossing > self.starts[self.starts.len() - 1] {
                    break crossing;
                }
                self.places.pop();
                self.starts.pop();
            };
            self.places.push(q);
            self.starts.push(start);
        }
        let mut k = 0;
        for p in 0..line.len() {
            while k + 1 < self.places.len() && self.starts[k + 1] < p as f32 {
                k += 1;
            }
            let q = self.places[k];
            let step = p as f32 - q as f32;
            out(p, step * step + line[q]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Blobs and holes without symmetry.
    fn mask() -> Mask {
        Mask::from_fn(61, 47, |x, y| {
            let (x, y) = (f64::from(x), f64::from(y));
            let blob = |cx: f64, cy: f64, r: f64| (x - cx).hypot(y - cy) < r;
            (blob(22.0, 20.0, 11.5) && !blob(24.0, 18.0, 3.2)) || blob(45.0, 33.0, 5.0)
        })
    }

    #[test]
    fn equals_the_distance_found_by_trying_all_pixels() {
        let mask = mask();
        let field = DistanceField::of(&mask, 6).unwrap();
        let rect = field.rect();
        for y in rect.y0..rect.y1 {
            for x in rect.x0..rect.x1 {
                let mut least = f64::INFINITY;
                for v in rect.y0..rect.y1 {
                    for u in rect.x0..rect.x1 {
                        if mask.get(u, v) != mask.get(x, y) {
                            let (dx, dy) = (f64::from(u) - f64::from(x), f64::from(v) - f64::from(y));
                            least = least.min(dx.hypot(dy));
                        }
                    }
                }
                let sign = if mask.get(x, y) { -1.0 } else { 1.0 };
                let found = f64::from(field.at_pixel(x, y));
                assert!((found - sign * (least - 0.5)).abs() < 1e-5, "({x}, {y}): {found}, {least}");
            }
        }
    }

    #[test]
    fn the_gradient_is_the_change_of_the_value() {
        let field = DistanceField::of(&mask(), 6).unwrap();
        for (x, y) in [(12.3, 14.8), (30.2, 9.9), (44.7, 37.1), (20.01, 31.6)] {
            let (_, gradient) = field.with_gradient([x, y]);
            let step = 1e-4;
            let along_x = (field.at([x + step, y]) - field.at([x - step, y])) / (2.0 * step);
            let along_y = (field.at([x, y + step]) - field.at([x, y - step])) / (2.0 * step);
            assert!((gradient[0] - along_x).abs() < 1e-6 && (gradient[1] - along_y).abs() < 1e-6);
        }
    }

    #[test]
    fn beyond_the_rectangle_distance_grows() {
        let field = DistanceField::of(&mask(), 2).unwrap();
        assert!(field.at([-100.0, 20.0]) > field.at([-50.0, 20.0]) + 49.0);
        assert!(DistanceField::of(&Mask::new(10, 10), 2).is_none());
    }
}
