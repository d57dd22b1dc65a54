//! A mixture of axis-aligned normal distributions fitted to points: the prior over latent positions.

use crate::kmeans::Clusters;
use crate::linalg;
use crate::{Gaussian, Inputs, MixtureDensity};

/// Rounds of expectation maximisation.
const ROUNDS: usize = 50;
/// A component's variance is never below this fraction of the variance of all points in that coordinate.
const VARIANCE_FLOOR: f64 = 1e-3;

/// At most `n_components` components, by expectation maximisation from k-means clusters.
///
/// # Panics
/// When there are no points or no components.
pub(crate) fn fit_components(points: &Inputs, n_components: usize, seed: u64) -> MixtureDensity {
    let (n, dim) = (points.len(), points.dim());
    let clusters = Clusters::new(points, n_components, seed);
    let everything = moments(points, &vec![1.0; n], &vec![0.0; dim]).0;
    let floor: Vec<f64> = everything.variance.iter().map(|v| (v * VARIANCE_FLOOR).max(1e-12)).collect();
    let mut shares: Vec<Vec<f64>> = (0..clusters.centres.len())
        .map(|k| clusters.assignment.iter().map(|&a| f64::from(u8::from(a == k))).collect())
        .collect();
    let mut density = MixtureDensity::default();
    for _ in 0..ROUNDS {
        let fitted: Vec<(Gaussian, f64)> =
            shares.iter().map(|share| moments(points, share, &floor)).collect();
        density = MixtureDensity {
            log_weights: fitted.iter().map(|(_, weight)| (weight / n as f64).ln()).collect(),
            components: fitted.into_iter().map(|(component, _)| component).collect(),
        };
        for i in 0..n {
            let joint = density.log_joint(&points.row_f64(i));
            shares.iter_mut().zip(linalg::shares(&joint)).for_each(|(share, own)| share[i] = own);
        }
    }
    density
}

/// Mean and variance of points under weights, and the weights' sum.
fn moments(points: &Inputs, weights: &[f64], floor: &[f64]) -> (Gaussian, f64) {
    let total: f64 = weights.iter().sum();
    let scale = 1.0 / total.max(f64::MIN_POSITIVE);
    let mut mean = vec![0.0; points.dim()];
    for (i, w) in weights.iter().enumerate() {
        mean.iter_mut().zip(points.row(i)).for_each(|(m, &v)| *m += w * scale * f64::from(v));
    }
    let mut variance = floor.to_vec();
    for (i, w) in weights.iter().enumerate() {
        let away = points.row(i).iter().zip(&mean).map(|(&v, m)| (f64::from(v) - m).powi(2));
        variance.iter_mut().zip(away).for_each(|(sum, square)| *sum += w * scale * square);
    }
    (Gaussian { mean, variance }, total)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Purpose, stream};

    #[test]
    fn finds_the_components_of_a_mixture() {
        let truth = MixtureDensity {
            log_weights: vec![0.3_f64.ln(), 0.7_f64.ln()],
            components: vec![
                Gaussian { mean: vec![-3.0, 0.0], variance: vec![0.5, 1.0] },
                Gaussian { mean: vec![2.0, 1.0], variance: vec![1.0, 0.25] },
            ],
        };
        let mut rng = stream(9, Purpose::Components);
        let values: Vec<f64> = (0..4_000).flat_map(|_| truth.sample(&mut rng)).collect();
        let fitted = fit_components(&Inputs::from_rows(2, values).unwrap(), 2, 1);
        for (component, weight) in truth.components.iter().zip([0.3, 0.7]) {
            let found = fitted.components.iter().zip(&fitted.log_weights).find(|(c, w)| {
                // Four standard errors or so of 1,200 points.
                let close = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 0.12);
                close(&c.mean, &component.mean)
                    && close(&c.variance, &component.variance)
                    && (w.exp() - weight).abs() < 0.03
            });
            assert!(found.is_some(), "{component:?} is not among {fitted:?}");
        }
    }
}
