//! From camera frame to snapped pixels: the one place where coordinates are rounded.
//!
//! Everything up to here is `f32`; everything after it is exact integer arithmetic, so that backends can be compared
//! with `==`. Multiplications and additions are kept apart (no fused multiply-add): the same bits on any machine.

use wide::{f32x8, i32x8};

use crate::camera::Intrinsics;

/// Snapped coordinates count sixteenths of a pixel.
pub(crate) const SUBPIXELS: i32 = 16;

/// Distance of the near plane: whatever is nearer to the camera is cut away, metres.
pub const NEAR_M: f32 = 0.05;

/// Snapped coordinates end here (262,144 px from the middle of the image); what lies further out is moved to the end.
const SNAP_LIMIT: f32 = (1 << 22) as f32;

/// A point in an image: sixteenths of a pixel right of and below the [`origin`](Projector::origin).
pub(crate) type Snapped = [i32; 2];

/// Projects, distorts and snaps vertices for one camera.
#[derive(Clone, Debug)]
pub(crate) struct Projector {
    focal: [f32x8; 2],
    centre: [f32x8; 2],
    lens: Option<Lens>,
    /// The pixel corner in the middle of the image from which snapped coordinates count.
    pub origin: [i32; 2],
}

impl Projector {
    /// `camera` has passed its check.
    pub fn new(camera: &Intrinsics) -> Self {
        let origin = [camera.width as i32 / 2, camera.height as i32 / 2];
        let subpixels = f64::from(SUBPIXELS);
        let centre = |axis: usize| subpixels * (camera.principal_point_px[axis] - f64::from(origin[axis]));
        Self {
            focal: camera.focal_px.map(|focal| f32x8::splat((subpixels * focal) as f32)),
            centre: [centre(0), centre(1)].map(|centre| f32x8::splat(centre as f32)),
            lens: Lens::new(camera.distortion),
            origin,
        }
    }

    /// Image coordinates of eight points at `z >= NEAR_M`, in sixteenths of a pixel, not yet rounded.
    #[inline(always)]
    pub fn project(&self, [x, y, z]: [f32x8; 3]) -> [f32x8; 2] {
        let inverse_depth = f32x8::ONE / z;
        let mut point = [x * inverse_depth, y * inverse_depth];
        if let Some(lens) = &self.lens {
            point = lens.distort(point);
        }
        [point[0] * self.focal[0] + self.centre[0], point[1] * self.focal[1] + self.centre[1]]
    }

    /// [`project`](Self::project), rounded (ties to even). Far coordinates end at the snap limit.
    pub fn snap(&self, points: [f32x8; 3]) -> [i32x8; 2] {
        let limit = f32x8::splat(SNAP_LIMIT);
        self.project(points).map(|coordinate| round(coordinate.clamp(-limit, limit)))
    }

    /// [`snap`](Self::snap) of one point.
    pub fn snap_one(&self, point: [f32; 3]) -> Snapped {
        self.snap(point.map(f32x8::splat)).map(|lanes| lanes.to_array()[0])
    }
}

/// Rounds to the nearest integer, ties to even; for coordinates within the `i32` range.
#[inline(always)]
pub(crate) fn round(coordinate: f32x8) -> i32x8 {
    coordinate.fast_round_int()
}

/// Reads eight vertices from `first` on, as lanes of x, y and z; past the end the last vertex repeats.
#[inline(always)]
pub(crate) fn load(positions: &[[f32; 3]], first: usize) -> [f32x8; 3] {
    match positions[first..].first_chunk() {
        Some(chunk) => transpose(chunk),
        None => transpose(&std::array::from_fn(|lane| positions[(first + lane).min(positions.len() - 1)])),
    }
}

#[inline(always)]
fn transpose([a, b, c, d, e, f, g, h]: &[[f32; 3]; 8]) -> [f32x8; 3] {
    let axis = |i: usize| f32x8::new([a[i], b[i], c[i], d[i], e[i], f[i], g[i], h[i]]);
    [axis(0), axis(1), axis(2)]
}

/// Radial and tangential distortion of normalised image coordinates.
#[derive(Clone, Debug)]
struct Lens {
    k: [f32x8; 3],
    p: [f32x8; 2],
    /// Squared radius up to which the polynomial is used.
    reach: f32x8,
}

/// Where the polynomial ends when it rises for ever: the tangent of 76 degrees, squared.
const MAX_REACH: f64 = 16.0;

impl Lens {
    /// `None` for an ideal lens.
    fn new([k1, k2, p1, p2, k3]: [f64; 5]) -> Option<Self> {
        if [k1, k2, p1, p2, k3] == [0.0; 5] {
            return None;
        }
        let splat = |value: f64| f32x8::splat(value as f32);
        Some(Self { k: [k1, k2, k3].map(splat), p: [p1, p2].map(splat), reach: splat(reach(k1, k2, k3)) })
    }

    /// `[OpenCV]` camera model. Deviation: past `reach`, where the polynomial may fold back and would draw what is
    /// far outside the view into the image, the distorted radius grows on in proportion; tested by
    /// `points_outside_the_view_stay_outside`.
    #[inline(always)]
    fn distort(&self, point: [f32x8; 2]) -> [f32x8; 2] {
        let far = f32x8::splat(1e4); // keeps squares finite
        let [x, y] = point.map(|coordinate| coordinate.clamp(-far, far));
        let radius_2 = (x * x + y * y).max(f32x8::splat(1e-12));
        let shrink = (self.reach / radius_2).sqrt().min(f32x8::ONE);
        let [x, y] = [x * shrink, y * shrink];
        let ([xx, xy, yy], [k1, k2, k3], [p1, p2]) = ([x * x, x * y, y * y], self.k, self.p);
        let r2 = xx + yy;
        let radial = f32x8::ONE + r2 * (k1 + r2 * (k2 + r2 * k3));
        let two = f32x8::splat(2.0);
        let distorted_x = x * radial + two * p1 * xy + p2 * (r2 + two * xx);
        let distorted_y = y * radial + p1 * (r2 + two * yy) + two * p2 * xy;
        [distorted_x / shrink, distorted_y / shrink]
    }
}

/// The squared radius up to which r (1 + k1 r² + k2 r⁴ + k3 r⁶) rises, at most [`MAX_REACH`].
fn reach(k1: f64, k2: f64, k3: f64) -> f64 {
    let slope = |u: f64| 1.0 + u * (3.0 * k1 + u * (5.0 * k2 + u * 7.0 * k3)); // derivative, with u = r²
    let mut last = 0.0;
    for turn in slope_turns(k1, k2, k3) {
        if slope(turn) <= 0.0 {
            // The slope falls from above zero at `last` to zero or below at `turn`: halve the interval.
            let (mut rising, mut falling) = (last, turn);
            for _ in 0..60 {
                let middle = 0.5 * (rising + falling);
                if slope(middle) > 0.0 { rising = middle } else { falling = middle }
            }
            return rising;
        }
        last = turn;
    }
    MAX_REACH
}

/// Where the slope in [`reach`] stops rising or falling, in order, and at last [`MAX_REACH`].
fn slope_turns(k1: f64, k2: f64, k3: f64) -> impl Iterator<Item = f64> {
    let [a, b, c] = [21.0 * k3, 10.0 * k2, 3.0 * k1]; // a u² + b u + c = 0
    let root = (b * b - 4.0 * a * c).sqrt();
    let q = -0.5 * (b + b.signum() * root);
    let mut turns = [q / a, c / q, MAX_REACH];
    // NaN and infinity (no turn, or no quadratic term) sort to the end and are left out with what lies beyond.
    turns.sort_by(f64::total_cmp);
    turns.into_iter().filter(|&turn| turn > 0.0 && turn <= MAX_REACH)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(distortion: [f64; 5]) -> Intrinsics {
        Intrinsics {
            focal_px: [610.0, 590.0],
            principal_point_px: [322.5, 241.25],
            distortion,
            ..Intrinsics::centred(640, 480, 1.0)
        }
    }

    #[test]
    fn lens_distortion_is_that_of_opencv() {
        // Pixels worked out in double precision with a separate program.
        let projector = Projector::new(&camera([-0.28, 0.09, 0.0015, -0.0025, 0.012]));
        for (point, [u, v]) in [
            ([0.3, -0.2, 1.5], [442.304_336_595, 163.993_434_812]),
            ([-0.8, 0.6, 2.0], [93.072_9, 407.623_362_5]),
            ([1.0, 0.9, 1.8], [617.322_473_616, 499.126_542_076]),
        ] {
            let expected = [u - 320.0, v - 240.0].map(|pixels: f64| (16.0 * pixels).round() as i32);
            assert_eq!(projector.snap_one(point), expected, "{point:?}");
        }
    }

    #[test]
    fn points_outside_the_view_stay_outside() {
        // With k1 = -0.3 the polynomial turns back at r² = 1 / 0.9 and would put r² = 1 / 0.3 in the middle of the image.
        assert!((reach(-0.3, 0.0, 0.0) - 1.0 / 0.9).abs() < 1e-12);
        for distortion in
            [[-0.3, 0.0, 0.0, 0.0, 0.0], [-0.3, 0.0, 0.002, -0.003, 0.0], [0.1, -0.4, 0.0, 0.0, 0.05]]
        {
            let projector = Projector::new(&camera(distortion));
            let mut last = 0;
            for step in 1..400 {
                let [x, _] = projector.snap_one([0.05 * step as f32, 0.0, 1.0]);
                assert!(x > last, "{distortion:?}: step {step} is at {x} after {last}");
                last = x;
            }
        }
    }

    #[test]
    fn the_reach_of_a_lens_is_where_its_slope_first_falls_to_zero() {
        for k in [
            [-0.3, 0.0, 0.0],
            [0.2, -0.3, 0.0],
            [0.0, 0.0, -0.01],
            [-0.5, 0.2, -0.05],
            [0.1, 0.1, 0.1],
            [-0.6, 0.3, 0.0],
        ] {
            let slope = |u: f64| 1.0 + 3.0 * k[0] * u + 5.0 * k[1] * u * u + 7.0 * k[2] * u.powi(3);
            let by_search = (0..160_000).map(|i| f64::from(i) * 1e-4).find(|&u| slope(u) <= 0.0);
            let expected = by_search.unwrap_or(MAX_REACH);
            assert!((reach(k[0], k[1], k[2]) - expected).abs() < 2e-4, "{k:?}: expected {expected}");
        }
    }

    #[test]
    fn coordinates_round_to_sixteenths_with_ties_to_even() {
        let projector = Projector::new(&Intrinsics::centred(640, 480, 100.0));
        let snapped = |sixteenths: f32| projector.snap_one([sixteenths / 1600.0, 0.0, 1.0])[0];
        assert_eq!([0.0, 0.499, 0.501, -0.499, -0.501, 7.25].map(snapped), [0, 0, 1, 0, -1, 7]);
        let halves = Projector::new(&Intrinsics::centred(640, 480, 128.0));
        let snapped = |sixteenths: f32| halves.snap_one([sixteenths / 2048.0, 0.0, 1.0])[0];
        assert_eq!([0.5, 1.5, 2.5, -0.5, -1.5].map(snapped), [0, 2, 2, 0, -2]);
    }

    #[test]
    fn far_coordinates_end_at_the_limit() {
        let projector = Projector::new(&Intrinsics::centred(640, 480, 1000.0));
        assert_eq!(projector.snap_one([1e30, -1e30, NEAR_M]), [1 << 22, -(1 << 22)]);
    }

    #[test]
    fn the_last_vertex_fills_the_last_eight() {
        let positions: Vec<[f32; 3]> =
            (0..11).map(|i| [i as f32, 10.0 * i as f32, 100.0 * i as f32]).collect();
        assert_eq!(load(&positions, 0)[1].to_array(), [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0]);
        assert_eq!(load(&positions, 8)[2].to_array(), [800.0, 900.0, 1e3, 1e3, 1e3, 1e3, 1e3, 1e3]);
    }
}
