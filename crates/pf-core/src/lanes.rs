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

/// eˣ for x of zero or less, without branches and calls, so that eight can be worked out side by side. Relative error
/// below 1e-15; zero below −708, where the result would no longer be a normal number.
#[inline(always)]
pub(crate) fn exp_of_nonpositive(x: f64) -> f64 {
    const LOWEST: f64 = -708.0;
    /// ln 2 as a sum: the first part has so few digits that its products with whole numbers below 2^11 are exact.
    const LN_2: [f64; 2] = [0.693_147_180_369_123_8, 1.908_214_929_270_587_7e-10];
    /// Adding this leaves no room for digits behind the point: it rounds, and the low bits hold the whole number.
    const ROUNDS: f64 = 6_755_399_441_055_744.0;
    /// 1/k! for k = 13 down to 0: on |r| ≤ ln 2 / 2 what is left out is below 1e-17.
    const SERIES: [f64; 14] = [
        1.0 / 6_227_020_800.0,
        1.0 / 479_001_600.0,
        1.0 / 39_916_800.0,
        1.0 / 3_628_800.0,
        1.0 / 362_880.0,
        1.0 / 40_320.0,
        1.0 / 5_040.0,
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        0.5,
        1.0,
        1.0,
    ];
    let clamped = if x > LOWEST { x } else { LOWEST };
    let shifted = clamped * std::f64::consts::LOG2_E + ROUNDS;
    let n = shifted - ROUNDS;
    let r = clamped - n * LN_2[0] - n * LN_2[1];
    let series = SERIES.iter().fold(0.0, |sum, c| sum * r + c);
    let power_of_two = f64::from_bits((shifted.to_bits() << 52).wrapping_add(1023 << 52));
    if x >= LOWEST { series * power_of_two } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponentials_agree_with_the_standard_library() {
        for i in 0..=708_000 {
            let x = -f64::from(i) * 1e-3;
            let off = (exp_of_nonpositive(x) / x.exp() - 1.0).abs();
            assert!(off < 1e-15, "{x}: off by {off}");
        }
        assert_eq!([0.0, -709.0, f64::NEG_INFINITY].map(exp_of_nonpositive), [1.0, 0.0, 0.0]);
    }

    #[test]
    fn lanes_and_their_rest_are_all_counted() {
        for n in 0..30u32 {
            let numbers: Vec<f64> = (0..n).map(|i| f64::from((i * 7) % 11)).collect();
            assert_eq!(sum(&numbers, |x| x), numbers.iter().sum());
            assert_eq!(max(&numbers), numbers.iter().copied().fold(f64::NEG_INFINITY, f64::max));
            assert!(all_below_infinity(&numbers));
            for bad in [f64::NAN, f64::INFINITY] {
                let with_bad: Vec<f64> = numbers.iter().copied().chain([bad]).collect();
                assert!(!all_below_infinity(&with_bad));
            }
        }
    }
}
