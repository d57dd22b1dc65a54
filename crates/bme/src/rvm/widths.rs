//! Learning a kernel's widths by the gradient of the evidence.

use super::{FitError, Rvm, RvmParams, SparseFit, check_samples, fit_output};
use crate::design::WeightedDesign;
use crate::linalg::{Symmetric, dot};
use crate::{Design, Inputs, Kernel};

/// Steps on the widths between two fits of the bases.
const STEPS_PER_FIT: usize = 15;
/// First and least step of a log width, and the factors by which steps grow and shrink.
const FIRST_STEP: f64 = 0.5;
const LEAST_STEP: f64 = 1e-3;
const GROWTH: f64 = 1.3;
const SHRINKAGE: f64 = 0.4;

impl Rvm {
    /// Fits bases and the width of each block of the kernel in turn, until the evidence stops to rise or `rounds` are
    /// over; blocks that tell nothing about the targets get so wide that they drop out.
    ///
    /// With one block a coordinate, this finds the coordinates that matter. The kernel that is found is that of the
    /// model ([`Rvm::kernel`]).
    ///
    /// # Errors
    /// As [`Rvm::fit`].
    ///
    /// # Panics
    /// As [`Rvm::fit`], and when there are no targets.
    pub fn fit_with_widths(
        kernel: &Kernel,
        inputs: &Inputs,
        targets: &[Vec<f64>],
        weights: &[f64],
        params: &RvmParams,
        rounds: usize,
    ) -> Result<Self, FitError> {
        assert!(!targets.is_empty(), "no targets, expected at least one output");
        let mut design = Design::new(kernel.clone(), inputs.clone());
        for target in targets {
            check_samples(&design, target, weights)?;
        }
        let fit = |design: &Design| -> Vec<SparseFit> {
            let weighted = WeightedDesign::new(design, weights.to_vec());
            targets.iter().map(|target| fit_output(&weighted, target, params, None)).collect()
        };
        let mut fits = fit(&design);
        for _ in 0..rounds {
            let improved = climb_widths(&design, &fits, targets, weights);
            if improved == *design.kernel() {
                break;
            }
            let next_design = Design::new(improved, inputs.clone());
            let next = fit(&next_design);
            let gain = total_evidence(&next) - total_evidence(&fits);
            if gain < params.min_gain {
                break;
            }
            (design, fits) = (next_design, next);
        }
        Ok(Self::from_fits(&design, &fits, weights))
    }
}

fn total_evidence(fits: &[SparseFit]) -> f64 {
    fits.iter().map(|fit| fit.function.log_evidence).sum()
}

/// Moves the log widths uphill with the bases as they are: each by a step of its own, which grows while the slope keeps
/// its sign (`[Riedmiller1993]`); a move that lowers the evidence is taken back.
fn climb_widths(design: &Design, fits: &[SparseFit], targets: &[Vec<f64>], weights: &[f64]) -> Kernel {
    let samples = Samples { design, targets, weights };
    let mut widths: Vec<f64> = design.kernel().blocks().map(|(_, g)| g.ln()).collect();
    let (mut height, mut slope) = samples.evidence_and_slope(fits, &widths);
    let mut steps = vec![FIRST_STEP; widths.len()];
    for _ in 0..STEPS_PER_FIT {
        let trial: Vec<f64> =
            widths.iter().zip(&slope).zip(&steps).map(|((w, s), step)| w + step * s.signum()).collect();
        let (trial_height, trial_slope) = samples.evidence_and_slope(fits, &trial);
        if trial_height > height {
            for ((step, new), old) in steps.iter_mut().zip(&trial_slope).zip(&slope) {
                *step *= if new * old > 0.0 { GROWTH } else { SHRINKAGE };
            }
            (widths, height, slope) = (trial, trial_height, trial_slope);
        } else {
            steps.iter_mut().for_each(|step| *step *= SHRINKAGE);
        }
        if steps.iter().all(|&step| step < LEAST_STEP) {
            break;
        }
    }
    samples.kernel(&widths)
}

struct Samples<'a> {
    design: &'a Design,
    targets: &'a [Vec<f64>],
    weights: &'a [f64],
}

impl Samples<'_> {
    fn kernel(&self, log_widths: &[f64]) -> Kernel {
        let blocks: Vec<(usize, f64)> = self
            .design
            .kernel()
            .blocks()
            .zip(log_widths)
            .map(|((dim, _), w)| (dim, w.clamp(-60.0, 60.0).exp()))
            .collect();
        Kernel::product(&blocks).expect("exponentials of numbers within ±60 are positive")
    }

    /// The log evidence of all outputs at these log widths, and its derivative by each.
    ///
    /// `[Tipping2001]` appendix C: dL/dΦ = β W ((t − Φμ) μᵀ) − W Φ Σ/σ², and dφ/d ln g = −g |x − c|² φ.
    fn evidence_and_slope(&self, fits: &[SparseFit], log_widths: &[f64]) -> (f64, Vec<f64>) {
        let kernel = self.kernel(log_widths);
        let mut height = 0.0;
        let mut slope = vec![0.0; log_widths.len()];
        for (fit, target) in fits.iter().zip(self.targets) {
            height += self.output(&kernel, fit, target, &mut slope);
        }
        (height, slope)
    }

    fn output(&self, kernel: &Kernel, fit: &SparseFit, target: &[f64], slope: &mut [f64]) -> f64 {
        let (inputs, n) = (self.design.inputs(), self.weights.len());
        let centres = self.design.centres();
        let columns: Vec<Vec<f64>> = fit
            .active
            .iter()
            .map(|&basis| {
                if basis == self.design.bias() {
                    return vec![1.0; n];
                }
                let centre = centres.row_f64(basis);
                (0..n).map(|i| kernel.value(&inputs.row_f64(i), &centre)).collect()
            })
            .collect();
        let weighted: Vec<Vec<f64>> = columns
            .iter()
            .map(|column| column.iter().zip(self.weights).map(|(x, w)| x * w).collect())
            .collect();
        let precisions = &fit.function.precisions;
        let information = Symmetric::from_fn(columns.len(), |i, j| {
            dot(&columns[i.min(j)], &weighted[i.max(j)]) + if i == j { precisions[i] } else { 0.0 }
        });
        let Some(factor) = information.cholesky() else { return f64::NEG_INFINITY };
        let products: Vec<f64> = weighted.iter().map(|column| dot(column, target)).collect();
        let mean = factor.solve(&products);
        let covariance = factor.inverse();
        let energy: f64 = target.iter().zip(self.weights).map(|(t, w)| w * t * t).sum();
        let total_weight: f64 = self.weights.iter().sum();
        let noise_variance = (energy - dot(&products, &mean)) / total_weight;
        if noise_variance.is_nan() || noise_variance <= 0.0 {
            return f64::NEG_INFINITY;
        }
        let mut residual = target.to_vec();
        for (column, weight) in columns.iter().zip(&mean) {
            residual.iter_mut().zip(column).for_each(|(r, x)| *r -= weight * x);
        }
        let mut own = vec![0.0; columns.len()];
        for i in 0..n {
            own.iter_mut().zip(&columns).for_each(|(own, column)| *own = column[i]);
            let spread = covariance.times(&own);
            for (m, &basis) in
                fit.active.iter().enumerate().filter(|(_, basis)| **basis != self.design.bias())
            {
                let by_phi = self.weights[i] * (residual[i] * mean[m] / noise_variance - spread[m]);
                let mut start = 0;
                for ((dim, g), slope) in kernel.blocks().zip(slope.iter_mut()) {
                    let range = start..start + dim;
                    let away = inputs.row(i)[range.clone()].iter().zip(&centres.row(basis)[range]);
                    let square: f64 = away.map(|(&x, &c)| (f64::from(x) - f64::from(c)).powi(2)).sum();
                    *slope -= by_phi * g * square * own[m];
                    start += dim;
                }
            }
        }
        let log_determinant = factor.log_determinant() - precisions.iter().map(|a| a.ln()).sum::<f64>();
        -0.5 * (total_weight * ((2.0 * std::f64::consts::PI * noise_variance).ln() + 1.0) + log_determinant)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Purpose, stream};
    use rand::Rng;

    /// y = sin(3 x₀) + x₁ over the unit cube of three coordinates; the third tells nothing.
    fn samples(n: usize) -> (Inputs, Vec<f64>) {
        let mut rng = stream(2, Purpose::Experts);
        let mut uniform = || f64::from(rng.next_u32()) / 4_294_967_296.0;
        let rows: Vec<[f64; 3]> = (0..n).map(|_| [uniform(), uniform(), uniform()]).collect();
        let y = rows.iter().map(|x| (3.0 * x[0]).sin() + x[1] + 0.2 * (uniform() - 0.5)).collect();
        (Inputs::from_rows(3, rows.into_iter().flatten()).unwrap(), y)
    }

    fn kernel() -> Kernel {
        Kernel::product(&[(1, 1.0), (1, 1.0), (1, 1.0)]).unwrap()
    }

    #[test]
    fn slope_is_the_derivative_of_the_evidence() {
        let (inputs, y) = samples(40);
        let design = Design::new(kernel(), inputs);
        let weights: Vec<f64> = (0..40).map(|i| 0.5 + 0.25 * f64::from(i % 3)).collect();
        let weighted = WeightedDesign::new(&design, weights.clone());
        let fits = [fit_output(&weighted, &y, &RvmParams::default(), None)];
        let samples = Samples { design: &design, targets: &[y], weights: &weights };
        let at = [0.2, -0.3, 0.1];
        let (_, slope) = samples.evidence_and_slope(&fits, &at);
        for b in 0..3 {
            let (mut up, mut down) = (at, at);
            up[b] += 1e-5;
            down[b] -= 1e-5;
            let difference = (samples.evidence_and_slope(&fits, &up).0
                - samples.evidence_and_slope(&fits, &down).0)
                / 2e-5;
            assert!(
                (difference - slope[b]).abs() < 1e-4 * (1.0 + slope[b].abs()),
                "{difference} {}",
                slope[b]
            );
        }
    }

    #[test]
    fn coordinates_that_tell_nothing_drop_out() {
        let (inputs, y) = samples(120);
        let weights = [1.0; 120];
        let params = RvmParams::default();
        let plain =
            Rvm::fit(&Design::new(kernel(), inputs.clone()), std::slice::from_ref(&y), &weights, &params)
                .unwrap();
        let learnt = Rvm::fit_with_widths(&kernel(), &inputs, &[y], &weights, &params, 10).unwrap();
        let widths: Vec<f64> = learnt.kernel().blocks().map(|(_, g)| g).collect();
        assert!(widths[2] < 0.05 * widths[0], "{widths:?}");
        assert!(learnt.log_evidence()[0] > plain.log_evidence()[0] + 1.0);
    }
}
