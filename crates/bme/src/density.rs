//! Mixtures of normal distributions: what a mixture of experts predicts.

use rand::Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::linalg::log_sum_exp;
use crate::{Expert, Gaussian};

/// Steps of a fixed-point iteration that has not settled by then never will.
const MODE_STEPS: usize = 500;
/// Two modes closer than this many standard deviations in every coordinate are one.
const MODE_DISTANCE: f64 = 0.1;

/// Σ_k exp(log_weights\[k\]) N(y | components\[k\]).
///
/// ```
/// use bme::{Gaussian, MixtureDensity};
/// let component = |mean| Gaussian { mean: vec![mean], variance: vec![1.0] };
/// let density = MixtureDensity { log_weights: vec![0.5_f64.ln(); 2], components: vec![component(-4.0), component(4.0)] };
/// assert!(density.mean()[0].abs() < 1e-12);
/// assert_eq!(density.modes().len(), 2);
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MixtureDensity {
    /// ln of the weights, whose sum is 1; −∞ is a component that never is.
    pub log_weights: Vec<f64>,
    /// The components, all of one length.
    pub components: Vec<Gaussian>,
}

/// A local maximum of a density.
#[derive(Clone, Debug, PartialEq)]
pub struct Mode {
    /// Where it is.
    pub at: Vec<f64>,
    /// ln of the density there.
    pub log_density: f64,
}

impl MixtureDensity {
    /// The length of a point.
    pub fn dim(&self) -> usize {
        self.components.first().map_or(0, |component| component.mean.len())
    }

    /// ln p(y); −∞ where every component has weight 0.
    ///
    /// # Panics
    /// When `y` is not [`Self::dim`] long.
    pub fn log_density(&self, y: &[f64]) -> f64 {
        log_sum_exp(&self.log_joint(y))
    }

    /// The same without allocating: `room` is as long as there are components.
    ///
    /// # Panics
    /// When a length is wrong.
    pub fn log_density_in(&self, y: &[f64], room: &mut [f64]) -> f64 {
        assert_eq!(room.len(), self.components.len(), "room for {} components", room.len());
        room.iter_mut().zip(self.log_joints(y)).for_each(|(log, joint)| *log = joint);
        log_sum_exp(room)
    }

    /// ln of weight times density, of each component.
    pub(crate) fn log_joint(&self, y: &[f64]) -> Vec<f64> {
        self.log_joints(y).collect()
    }

    fn log_joints(&self, y: &[f64]) -> impl Iterator<Item = f64> {
        let parts = self.log_weights.iter().zip(&self.components);
        parts.map(move |(weight, component)| weight + component.log_density(y))
    }

    /// A random point.
    pub fn sample<R: Rng + ?Sized>(&self, rng: &mut R) -> Vec<f64> {
        let component = &self.components[draw(&self.log_weights, rng)];
        let spread = component.mean.iter().zip(&component.variance);
        spread.map(|(m, v)| m + v.sqrt() * Distribution::<f64>::sample(&StandardNormal, rng)).collect()
    }

    /// The mean.
    pub fn mean(&self) -> Vec<f64> {
        let mut mean = vec![0.0; self.dim()];
        for (weight, component) in self.log_weights.iter().zip(&self.components) {
            mean.iter_mut().zip(&component.mean).for_each(|(sum, m)| *sum += weight.exp() * m);
        }
        mean
    }

    /// The variance of each coordinate.
    pub fn variance(&self) -> Vec<f64> {
        let mean = self.mean();
        let mut variance = vec![0.0; self.dim()];
        for (weight, component) in self.log_weights.iter().zip(&self.components) {
            for d in 0..mean.len() {
                let away = component.mean[d] - mean[d];
                variance[d] += weight.exp() * (component.variance[d] + away * away);
            }
        }
        variance
    }

    /// The local maxima, highest first.
    ///
    /// From every component's mean, the fixed point y = (Σ p_k V_k⁻¹)⁻¹ Σ p_k V_k⁻¹ m_k of `[Carreira2000]`, which never
    /// descends; p_k is the share of component k at y.
    pub fn modes(&self) -> Vec<Mode> {
        let mut modes: Vec<Mode> = Vec::new();
        for (start, weight) in self.components.iter().zip(&self.log_weights) {
            if *weight == f64::NEG_INFINITY {
                continue;
            }
            let at = self.climb(&start.mean);
            let is_new = modes.iter().all(|mode| {
                let apart = mode.at.iter().zip(&at).zip(&start.variance);
                apart.into_iter().any(|((a, b), v)| (a - b).abs() > MODE_DISTANCE * v.sqrt())
            });
            if is_new {
                let log_density = self.log_density(&at);
                modes.push(Mode { at, log_density });
            }
        }
        modes.sort_by(|a, b| b.log_density.total_cmp(&a.log_density));
        modes
    }

    fn climb(&self, start: &[f64]) -> Vec<f64> {
        let mut at = start.to_vec();
        for _ in 0..MODE_STEPS {
            let joint = self.log_joint(&at);
            let total = log_sum_exp(&joint);
            if total == f64::NEG_INFINITY {
                break;
            }
            let mut largest_step = 0.0_f64;
            for (d, value) in at.iter_mut().enumerate() {
                let (mut pull, mut precision) = (0.0, 0.0);
                for (share, component) in joint.iter().map(|j| (j - total).exp()).zip(&self.components) {
                    pull += share * component.mean[d] / component.variance[d];
                    precision += share / component.variance[d];
                }
                let step = pull / precision - *value;
                largest_step = largest_step.max(step.abs() * precision.sqrt());
                *value += step;
            }
            if largest_step < 1e-9 {
                break;
            }
        }
        at
    }
}

/// An index drawn with probabilities exp(log_weights).
///
/// # Panics
/// When all weights are zero.
pub(crate) fn draw<R: Rng + ?Sized>(log_weights: &[f64], rng: &mut R) -> usize {
    let total = log_sum_exp(log_weights);
    assert!(total > f64::NEG_INFINITY, "all {} weights are zero, expected one above", log_weights.len());
    // 53 bits: every double in [0, 1) that is a multiple of 2⁻⁵³ is equally likely.
    let mut left = (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
    let mut last = 0;
    for (index, weight) in log_weights.iter().enumerate().filter(|(_, weight)| **weight > f64::NEG_INFINITY) {
        last = index;
        left -= (weight - total).exp();
        if left < 0.0 {
            break;
        }
    }
    last
}

/// Writes the first two moments of a density over one prediction.
pub(crate) fn moments_into(density: &MixtureDensity, out: &mut Gaussian) {
    out.mean = density.mean();
    out.variance = density.variance();
}

/// Collects one component an expert.
pub(crate) fn predict_all<E: Expert>(log_gates: Vec<f64>, experts: &[E], x: &[f64]) -> MixtureDensity {
    let components = experts
        .iter()
        .map(|expert| {
            let mut component = Gaussian::default();
            expert.predict(x, &mut component);
            component
        })
        .collect();
    MixtureDensity { log_weights: log_gates, components }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Purpose, stream};

    fn density() -> MixtureDensity {
        MixtureDensity {
            log_weights: vec![0.25_f64.ln(), 0.75_f64.ln(), f64::NEG_INFINITY],
            components: vec![
                Gaussian { mean: vec![-2.0, 1.0], variance: vec![0.5, 0.2] },
                Gaussian { mean: vec![3.0, 0.0], variance: vec![1.0, 2.0] },
                Gaussian { mean: vec![99.0, 99.0], variance: vec![1.0, 1.0] },
            ],
        }
    }

    #[test]
    fn density_integrates_to_one() {
        let (density, h) = (density(), 0.05);
        let mut sum = 0.0;
        for i in -200..300 {
            for j in -200..200 {
                sum += density.log_density(&[f64::from(i) * h, f64::from(j) * h]).exp() * h * h;
            }
        }
        assert!((sum - 1.0).abs() < 1e-6, "{sum}");
    }

    #[test]
    fn samples_have_its_moments() {
        let density = density();
        let mut rng = stream(1, Purpose::Components);
        let n = 20_000;
        let samples: Vec<_> = (0..n).map(|_| density.sample(&mut rng)).collect();
        for d in 0..2 {
            let mean = samples.iter().map(|s| s[d]).sum::<f64>() / f64::from(n);
            let variance = samples.iter().map(|s| (s[d] - mean).powi(2)).sum::<f64>() / f64::from(n);
            // Five standard errors.
            let error = (density.variance()[d] / f64::from(n)).sqrt();
            assert!((mean - density.mean()[d]).abs() < 5.0 * error);
            assert!((variance / density.variance()[d] - 1.0).abs() < 0.05);
        }
        // By hand: 0.25 · −2 + 0.75 · 3, and 0.25 (0.5 + 3.75²) + 0.75 (1 + 1.25²).
        assert!((density.mean()[0] - 1.75).abs() < 1e-12);
        assert!((density.variance()[0] - 5.562_5).abs() < 1e-12);
    }

    #[test]
    fn modes_are_local_maxima_and_all_of_them() {
        let density = density();
        let modes = density.modes();
        assert_eq!(modes.len(), 2);
        assert!(modes[0].log_density >= modes[1].log_density);
        for mode in &modes {
            for step in [[1e-3, 0.0], [-1e-3, 0.0], [0.0, 1e-3], [0.0, -1e-3]] {
                assert!(
                    density.log_density(&[mode.at[0] + step[0], mode.at[1] + step[1]]) < mode.log_density
                );
            }
        }
        // Close components have one mode between them.
        let merged = MixtureDensity {
            log_weights: vec![0.5_f64.ln(); 2],
            components: vec![
                Gaussian { mean: vec![-0.5], variance: vec![1.0] },
                Gaussian { mean: vec![0.5], variance: vec![1.0] },
            ],
        };
        assert_eq!(merged.modes().len(), 1);
        assert!(merged.modes()[0].at[0].abs() < 1e-6);
    }

    #[test]
    fn impossible_rows_are_minus_infinity_not_nan() {
        let mut density = density();
        density.log_weights.fill(f64::NEG_INFINITY);
        assert_eq!(density.log_density(&[0.0, 0.0]), f64::NEG_INFINITY);
        assert!(density.modes().is_empty());
    }
}
