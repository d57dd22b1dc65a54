//! Sums and maxima of long slices: eight running values side by side, always combined in the same order.

const LANES: usize = 8;

/// Σ `value` of the numbers.
pub(crate) fn sum(numbers: &[f64], value: impl Fn(f64) -> f64) -> f64 {
    let chunks = numbers.chunks_exact(LANES);
    let rest: f64 = chunks.remainder().iter().map(|x| value(*x)).sum();
    let mut lanes = [0.0; LANES];
    for chunk in chunks {
        for (lane, x) in lanes.iter_mut().zip(chunk) {
            *lane += value(*x);
        }
    }
    lanes.iter().sum::<f64>() + rest
}

/// The largest of the numbers, none of them NaN; −∞ when there is none.
pub(crate) fn max(numbers: &[f64]) -> f64 {
    let larger = |a: f64, b: f64| if b > a { b } else { a };
    let mut lanes = [f64::NEG_INFINITY; LANES];
    let chunks = numbers.chunks_exact(LANES);
    let rest = chunks.remainder();
    for chunk in chunks {
        for (lane, x) in lanes.iter_mut().zip(chunk) {
            *lane = larger(*lane, *x);
        }
    }
    lanes.iter().chain(rest).fold(f64::NEG_INFINITY, |a, b| larger(a, *b))
}

/// Whether each number is below +∞ (NaN is not).
pub(crate) fn all_below_infinity(numbers: &[f64]) -> bool {
    numbers.iter().fold(true, |all, x| all & (*x < f64::INFINITY))
}
