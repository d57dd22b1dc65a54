//! Lens distortion after `[Brown1966]`, forwards and backwards, in normalised image coordinates.

use glam::{DMat2, DVec2};

/// Iterations of Newton's method; it needs four or five inside an image.
const MAX_STEPS: usize = 50;

/// Newton's method has found the point when it maps this close to the given one (1e-12 is 1e-9 px).
const TOLERANCE: f64 = 1e-12;

/// A fold-over is looked for up to this radius (tangent of the angle off the axis): 89.4 degrees.
const WIDEST_RADIUS: f64 = 100.0;

/// Radial and tangential distortion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Lens {
    /// `k1 k2 p1 p2 k3`.
    coefficients: [f64; 5],
    /// Radius up to which the radial part grows; beyond it the image would fold over itself.
    fold_radius: f64,
}

impl Lens {
    pub(crate) fn new(coefficients: [f64; 5]) -> Self {
        let [k1, k2, _, _, k3] = coefficients;
        Self { coefficients, fold_radius: fold_radius(k1, k2, k3) }
    }

    /// Where the point `p` = (x/z, y/z) of an ideal pinhole lands; `None` beyond the fold-over radius.
    pub(crate) fn distort(&self, p: DVec2) -> Option<DVec2> {
        (p.length() < self.fold_radius).then(|| self.map(p))
    }

    /// Undoes [`Lens::distort`] by Newton's method that stays inside the fold-over radius.
    pub(crate) fn undistort(&self, distorted: DVec2) -> Option<DVec2> {
        let mut p = self.inside(distorted);
        let mut residual = self.map(p) - distorted;
        for _ in 0..MAX_STEPS {
            if residual.length() <= TOLERANCE * (1.0 + distorted.length()) {
                return Some(p);
            }
            let jacobian = self.jacobian(p);
            if jacobian.determinant() <= 0.0 {
                return None;
            }
            // The whole Newton step, or the first of its halves that comes closer.
            let step = jacobian.inverse() * residual;
            (p, residual) = (0..20)
                .map(|halvings| self.inside(p - step / f64::from(1 << halvings)))
                .map(|candidate| (candidate, self.map(candidate) - distorted))
                .find(|(_, closer)| closer.length() < residual.length())?;
        }
        None
    }

    /// `[Brown1966]`, with r² = x² + y²:
    /// `p (1 + k1 r² + k2 r⁴ + k3 r⁶) + (2 p1 xy + p2 (r² + 2x²), p1 (r² + 2y²) + 2 p2 xy)`.
    fn map(&self, p: DVec2) -> DVec2 {
        let [k1, k2, p1, p2, k3] = self.coefficients;
        let (x, y, r2) = (p.x, p.y, p.length_squared());
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let tangential = DVec2::new(
            2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        p * radial + tangential
    }

    /// Derivative of [`Lens::map`].
    fn jacobian(&self, p: DVec2) -> DMat2 {
        let [k1, k2, p1, p2, k3] = self.coefficients;
        let (x, y, r2) = (p.x, p.y, p.length_squared());
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3)); // d radial / dx = slope x
        let xy = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y;
        DMat2::from_cols(
            DVec2::new(radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x, xy),
            DVec2::new(xy, radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x),
        )
    }

    fn inside(&self, p: DVec2) -> DVec2 {
        let limit = 0.999_999 * self.fold_radius;
        if p.length() > limit { p * (limit / p.length()) } else { p }
    }
}

/// The smallest r > 0 at which r (1 + k1 r² + k2 r⁴ + k3 r⁶) stops growing; infinite when it never does.
fn fold_radius(k1: f64, k2: f64, k3: f64) -> f64 {
    // With s = r² the derivative is g(s) = 1 + 3 k1 s + 5 k2 s² + 7 k3 s³, and g(0) = 1.
    let g = |s: f64| 1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * 7.0 * k3));
    // Between the zeros of g' = 3 k1 + 10 k2 s + 21 k3 s² the sign of g changes at most once.
    let mut ends = positive_roots(21.0 * k3, 10.0 * k2, 3.0 * k1);
    ends.retain(|s| *s < WIDEST_RADIUS * WIDEST_RADIUS);
    ends.push(WIDEST_RADIUS * WIDEST_RADIUS);
    let mut start = 0.0;
    for end in ends {
        if g(end) <= 0.0 {
            return bisect(g, start, end).sqrt();
        }
        start = end;
    }
    f64::INFINITY
}

/// Positive solutions of a s² + b s + c = 0 in rising order.
fn positive_roots(a: f64, b: f64, c: f64) -> Vec<f64> {
    let mut roots = if a == 0.0 {
        vec![-c / b]
    } else {
        let root = (b * b - 4.0 * a * c).sqrt(); // NaN without solutions
        vec![(-b - root) / (2.0 * a), (-b + root) / (2.0 * a)]
    };
    roots.retain(|s| s.is_finite() && *s > 0.0);
    roots.sort_by(f64::total_cmp);
    roots
}

/// The zero between `low`, where `g` is positive, and `high`, where it is not.
fn bisect(g: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if g(middle) > 0.0 { low = middle } else { high = middle }
    }
    low
}
