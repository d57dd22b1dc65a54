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
