//! The largest value of a function of one variable.

/// Equal steps of a scan.
const SCAN_STEPS: usize = 6;
const MAX_STEPS: usize = 40;
/// 2 - the golden ratio.
const GOLDEN_SHARE: f64 = 0.381_966_011_250_105_1;

/// An interval around the largest value of a coarse scan.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bracket {
    /// Its ends.
    pub ends: [f64; 2],
    best: (f64, f64),
}

/// Scans `f` between `low` and `high`.
pub(crate) fn bracket(mut f: impl FnMut(f64) -> f64, [low, high]: [f64; 2]) -> Bracket {
    let at = |step: usize| low + (high - low) * step as f64 / SCAN_STEPS as f64;
    let values: Vec<f64> = (0..=SCAN_STEPS).map(|step| f(at(step))).collect();
    let best = (0..=SCAN_STEPS).max_by(|&a, &b| values[a].total_cmp(&values[b])).expect("the scan has steps");
    let ends = [at(best.saturating_sub(1)), at((best + 1).min(SCAN_STEPS))];
    Bracket { ends, best: (at(best), values[best]) }
}

/// Where `f` is largest in the bracket, up to `tolerance`, and its value there: Brent's method (`[Brent1973]` chapter 5). One
/// maximum near the best place of the scan is assumed.
pub(crate) fn maximum(mut f: impl FnMut(f64) -> f64, bracket: Bracket, tolerance: f64) -> (f64, f64) {
    let (place, value) = brent(|x| -f(x), bracket.ends, tolerance);
    // Brent's method never looks at the ends of its interval.
    if -value > bracket.best.1 { (place, -value) } else { bracket.best }
}

/// The least value of `f` in an interval: parabolas through the three best points, golden sections where those fail.
fn brent(mut f: impl FnMut(f64) -> f64, [mut a, mut b]: [f64; 2], tolerance: f64) -> (f64, f64) {
    let mut x = a + GOLDEN_SHARE * (b - a);
    let mut fx = f(x);
    // x is the best point, w the second best, v the one before; e is the step before the last one.
    let (mut w, mut v, mut fw, mut fv) = (x, x, fx, fx);
    let (mut d, mut e) = (0.0_f64, 0.0_f64);
    for _ in 0..MAX_STEPS {
        let middle = a.midpoint(b);
        if (x - middle).abs() <= 2.0 * tolerance - 0.5 * (b - a) {
            break;
        }
        let parabola = (e.abs() > tolerance).then(|| {
            let r = (x - w) * (fx - fv);
            let q = (x - v) * (fx - fw);
            (r, q, (x - v) * q - (x - w) * r)
        });
        let step = parabola.and_then(|(r, q, p)| {
            let q = 2.0 * (q - r);
            let (p, q) = if q > 0.0 { (-p, q) } else { (p, -q) };
            let fits = p.abs() < (0.5 * q * e).abs() && p > q * (a - x) && p < q * (b - x);
            fits.then(|| p / q)
        });
        if let Some(step) = step {
            (e, d) = (d, step);
            if x + d - a < 2.0 * tolerance || b - (x + d) < 2.0 * tolerance {
                d = tolerance.copysign(middle - x);
            }
        } else {
            e = if x < middle { b - x } else { a - x };
            d = GOLDEN_SHARE * e;
        }
        let u = x + if d.abs() >= tolerance { d } else { tolerance.copysign(d) };
        let fu = f(u);
        if fu <= fx {
            if u < x {
                b = x
            } else {
                a = x
            }
            (v, fv, w, fw, x, fx) = (w, fw, x, fx, u, fu);
        } else {
            if u < x {
                a = u
            } else {
                b = u
            }
            if fu <= fw || w == x {
                (v, fv, w, fw) = (w, fw, u, fu);
            } else if fu <= fv || v == x || v == w {
                (v, fv) = (u, fu);
            }
        }
    }
    (x, fx)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn search(f: impl Fn(f64) -> f64, range: [f64; 2], tolerance: f64) -> (f64, f64) {
        maximum(&f, bracket(&f, range), tolerance)
    }

    #[test]
    fn smooth_maxima_are_found_in_few_looks() {
        let looks = std::cell::Cell::new(0);
        let hill = |x: f64| {
            looks.set(looks.get() + 1);
            (x - 0.3).cos()
        };
        let (place, value) = search(hill, [-2.0, 2.0], 1e-6);
        assert!((place - 0.3).abs() < 1e-4 && (value - 1.0).abs() < 1e-9, "{place} {value}");
        assert!(looks.get() < 30, "{}", looks.get());
    }

    #[test]
    fn kinks_and_ends_are_found() {
        let (place, _) = search(|x| -(x - 0.123_f64).abs(), [-1.0, 1.0], 1e-4);
        assert!((place - 0.123).abs() < 3e-4, "{place}");
        assert_eq!(search(|x| x, [0.0, 2.0], 1e-3), (2.0, 2.0));
        assert_eq!(search(|x| -x, [0.0, 2.0], 1e-3), (0.0, 0.0));
    }

    #[test]
    fn the_higher_of_two_hills_is_taken() {
        let hills = |x: f64| (-(x + 1.0).powi(2)).exp() + 1.5 * (-(x - 2.0).powi(2)).exp();
        let (place, _) = search(hills, [-3.0, 4.0], 1e-6);
        assert!((place - 2.0).abs() < 1e-2, "{place}");
    }
}
