//! The map from latent points to outputs: a plane, and sparse kernels for what the plane leaves.
//!
//! Kernels alone forget: away from the latent points of the training their sum falls back to a constant, so that a person who
//! holds the trunk as nobody in the training did comes back as the mean. The plane goes on.

use super::{LatentError, LatentParams, fit_map};
use crate::linalg::{Symmetric, dot};
use crate::{Expert as _, Inputs, Kernel, Rvm};

/// Variance of the noise over that of the slopes, both in units of the latent points: what keeps a coordinate that does not
/// vary from having any slope.
const RIDGE: f64 = 1e-3;

/// p(y | x) = N(A x + f(x), σ²), f being a relevance vector machine.
#[derive(Clone, Debug, PartialEq)]
pub struct Decoder {
    /// A, row after row.
    pub(crate) slopes: Vec<f64>,
    pub(crate) kernels: Rvm,
}

impl Decoder {
    /// Least squares for the plane, then `kernel`, or the one that is best on a tenth of the rows, for the rest.
    pub(super) fn fit(
        points: &Inputs,
        outputs: &Inputs,
        kernel: Option<Kernel>,
        params: &LatentParams,
    ) -> Result<Self, LatentError> {
        let slopes = slopes(points, outputs);
        let dim = points.dim();
        let rest = (0..points.len()).flat_map(|i| {
            let x = points.row_f64(i);
            let rows = slopes.chunks_exact(dim).zip(outputs.row(i));
            rows.map(|(slopes, &y)| f64::from(y) - dot(slopes, &x)).collect::<Vec<_>>()
        });
        let rest = Inputs::from_rows(outputs.dim(), rest).map_err(LatentError::Points)?;
        let kernels = fit_map(points, &rest, kernel, params)?;
        Ok(Self { slopes, kernels })
    }

    /// The length of a latent point.
    pub fn latent_dim(&self) -> usize {
        self.kernels.input_dim()
    }

    /// The length of an output.
    pub fn output_dim(&self) -> usize {
        self.kernels.output_dim()
    }

    /// Length of the room that [`Self::mean_into`] works in.
    pub fn n_features(&self) -> usize {
        self.kernels.n_features()
    }

    /// The mean output at `x`, without allocating: `room` is [`Self::n_features`] long, `mean` as long as an output.
    ///
    /// # Panics
    /// When a length is wrong.
    pub fn mean_into(&self, x: &[f64], room: &mut [f64], mean: &mut [f64]) {
        self.kernels.mean_into(x, room, mean);
        mean.iter_mut()
            .zip(self.slopes.chunks_exact(x.len()))
            .for_each(|(mean, slopes)| *mean += dot(slopes, x));
    }

    /// The mean output at `x` and its derivatives, `[output_dim][latent_dim]`.
    ///
    /// # Panics
    /// When `x` has the wrong length.
    pub fn mean_and_jacobian(&self, x: &[f64]) -> (Vec<f64>, Vec<Vec<f64>>) {
        let (mut mean, mut jacobian) = self.kernels.mean_and_jacobian(x);
        let rows = mean.iter_mut().zip(&mut jacobian).zip(self.slopes.chunks_exact(x.len()));
        for ((mean, row), slopes) in rows {
            *mean += dot(slopes, x);
            row.iter_mut().zip(slopes).for_each(|(derivative, slope)| *derivative += slope);
        }
        (mean, jacobian)
    }

    /// σ² of each output.
    pub fn noise_variance(&self) -> Vec<f64> {
        self.kernels.noise_variance()
    }

    pub(super) fn kernel(&self) -> &Kernel {
        self.kernels.kernel()
    }
}

/// A of the plane nearest to the rows, which the constant of the kernels lifts to its place.
fn slopes(points: &Inputs, outputs: &Inputs) -> Vec<f64> {
    let n = points.len() as f64;
    let centred = |rows: &Inputs| -> Vec<Vec<f64>> {
        (0..rows.dim())
            .map(|d| {
                let mean = (0..rows.len()).map(|i| f64::from(rows.row(i)[d])).sum::<f64>() / n;
                (0..rows.len()).map(|i| f64::from(rows.row(i)[d]) - mean).collect()
            })
            .collect()
    };
    let (x, y) = (centred(points), centred(outputs));
    let scatter =
        Symmetric::from_fn(points.dim(), |i, j| dot(&x[i], &x[j]) + if i == j { RIDGE * n } else { 0.0 });
    let factor = scatter.cholesky().expect("a scatter with a ridge is positive definite");
    y.iter().flat_map(|y| factor.solve(&x.iter().map(|x| dot(x, y)).collect::<Vec<_>>())).collect()
}
