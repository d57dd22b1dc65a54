//! Choosing a kernel by what it predicts on samples that were held out.

use crate::density::draw;
use crate::rng::{Purpose, stream};
use crate::{Inputs, Kernel};

/// A division of samples, both parts in rising order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Split {
    /// Samples to fit to.
    pub train: Vec<usize>,
    /// Samples to judge by.
    pub held_out: Vec<usize>,
}

impl Split {
    /// Holds out `share` of `n` samples in runs of `run` neighbours.
    ///
    /// Frames of a clip resemble their neighbours: single frames held out would be too easy to predict.
    ///
    /// # Panics
    /// When `share` is not between 0 and 1 or `run` is 0.
    pub fn new(n: usize, share: f64, run: usize, seed: u64) -> Self {
        assert!(share > 0.0 && share < 1.0, "a share of {share} held out, expected between 0 and 1");
        assert!(run > 0, "runs of 0 samples");
        let n_runs = n.div_ceil(run);
        let wanted = ((n_runs as f64 * share).round() as usize).clamp(1, n_runs.saturating_sub(1).max(1));
        let mut runs: Vec<usize> = (0..n_runs).collect();
        let mut rng = stream(seed, Purpose::CrossValidation);
        for i in 0..wanted.min(n_runs) {
            let j = i + draw(&vec![0.0; n_runs - i], &mut rng);
            runs.swap(i, j);
        }
        let mut is_held = vec![false; n_runs];
        runs.iter().take(wanted).for_each(|&r| is_held[r] = true);
        let (held_out, train) = (0..n).partition(|i| is_held[i / run]);
        Self { train, held_out }
    }
}

/// Kernels whose inverse widths are `factors` over the mean squared distance of the inputs, all blocks together.
///
/// # Panics
/// When the inputs are all equal, or a factor is no positive number.
pub fn kernels_by_spread(inputs: &Inputs, factors: &[f64]) -> Vec<Kernel> {
    let spread = mean_squared_distance(inputs);
    assert!(spread > 0.0, "{} equal inputs have no spread", inputs.len());
    let kernel = |factor: &f64| {
        Kernel::gaussian(inputs.dim(), factor / spread).expect("factors and spread are positive numbers")
    };
    factors.iter().map(kernel).collect()
}

/// Mean of |x − x′|² over all pairs: twice the sum of the variances.
pub fn mean_squared_distance(inputs: &Inputs) -> f64 {
    let (n, dim) = (inputs.len() as f64, inputs.dim());
    let mut mean = vec![0.0; dim];
    for i in 0..inputs.len() {
        mean.iter_mut().zip(inputs.row(i)).for_each(|(m, &v)| *m += f64::from(v) / n);
    }
    let squares = (0..inputs.len()).map(|i| {
        let away = inputs.row(i).iter().zip(&mean).map(|(&v, m)| (f64::from(v) - m).powi(2));
        away.sum::<f64>()
    });
    2.0 * squares.sum::<f64>() / n
}

/// The candidate with the highest score, and all scores; the first of equals, and never one that scores NaN.
///
/// `score` fits with a candidate and says how good it is on held-out samples (the mean squared error, negated, say).
///
/// # Errors
/// The first error of `score`.
///
/// # Panics
/// When there are no candidates.
pub fn choose<T, E>(
    candidates: &[T],
    mut score: impl FnMut(&T) -> Result<f64, E>,
) -> Result<(usize, Vec<f64>), E> {
    assert!(!candidates.is_empty(), "no candidates to choose from");
    let scores: Vec<f64> = candidates.iter().map(&mut score).collect::<Result<_, E>>()?;
    let mut best = 0;
    for (index, &score) in scores.iter().enumerate() {
        if score > scores[best] || scores[best].is_nan() {
            best = index;
        }
    }
    Ok((best, scores))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Design, Rvm, RvmParams};

    #[test]
    fn split_holds_out_whole_runs() {
        let split = Split::new(100, 0.1, 5, 3);
        assert_eq!((split.train.len(), split.held_out.len()), (90, 10));
        assert!(split.held_out.chunks(5).all(|run| run[0] % 5 == 0 && run[4] == run[0] + 4));
        assert!(split.held_out.iter().all(|i| !split.train.contains(i)));
        assert_ne!(split, Split::new(100, 0.1, 5, 4));
    }

    #[test]
    fn spread_is_the_mean_over_pairs() {
        let inputs = Inputs::from_rows(1, [0.0, 1.0, 5.0]).unwrap();
        // Nine pairs: 2 · (1 + 25 + 16) / 9.
        assert!((mean_squared_distance(&inputs) - 84.0 / 9.0).abs() < 1e-12);
    }

    #[test]
    fn chooses_the_width_that_fits() {
        let x: Vec<f64> = (0..200).map(|i| f64::from(i) * 0.05).collect();
        let y: Vec<f64> = x
            .iter()
            .enumerate()
            .map(|(i, x)| (2.0 * x).sin() + 0.1 * (f64::from(i as u32 * 37 % 11) - 5.0) / 5.0)
            .collect();
        let inputs = Inputs::from_rows(1, x).unwrap();
        let split = Split::new(200, 0.2, 10, 1);
        let kernels = kernels_by_spread(&inputs, &[1e-3, 30.0, 1e6]);
        let (best, scores) = choose(&kernels, |kernel| {
            let train: Vec<f64> = split.train.iter().map(|&i| y[i]).collect();
            let design = Design::new(kernel.clone(), inputs.select(&split.train));
            let weights = vec![1.0; train.len()];
            let model = Rvm::fit(&design, &[train], &weights, &RvmParams::default())?;
            // By error, not by density: one run held out is at the end of the line, and how sure a sparse model is
            // beyond its last basis tells nothing about the width.
            let error = split.held_out.iter().map(|&i| (model.mean(&inputs.row_f64(i))[0] - y[i]).powi(2));
            Ok::<_, crate::FitError>(-error.sum::<f64>())
        })
        .unwrap();
        assert_eq!(best, 1, "{scores:?}");
        assert_eq!(choose(&[f64::NAN, 1.0, 2.0, 2.0], |&s| Ok::<_, ()>(s)).unwrap().0, 2);
    }
}
