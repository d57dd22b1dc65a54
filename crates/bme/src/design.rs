//! The design matrix of kernels and a constant, and its products under sample weights.

use std::sync::OnceLock;

use rayon::prelude::*;

use crate::linalg::{dot, products};
use crate::{Inputs, Kernel};

/// Rows of the Gram matrix made in one piece; constant, so that results do not depend on threads.
const BLOCK_ROWS: usize = 128;

/// All candidate bases at all samples: one kernel per centre, and after them the constant 1 (the bias).
///
/// Made once for a set of inputs and shared by every output and expert that is fitted to them.
#[derive(Clone, Debug)]
pub struct Design {
    kernel: Kernel,
    inputs: Inputs,
    centres: Inputs,
    /// `columns[m * n + i]` = φ_m(x_i).
    columns: Vec<f64>,
}

impl Design {
    /// A kernel on every sample.
    ///
    /// # Panics
    /// When the kernel is over another number of coordinates than the inputs have.
    pub fn new(kernel: Kernel, inputs: Inputs) -> Self {
        let centres = inputs.clone();
        Self::with_centres(kernel, inputs, centres)
    }

    /// Kernels on these centres only: memory is one `f64` per sample and centre.
    ///
    /// # Panics
    /// As [`Self::new`].
    pub fn with_centres(kernel: Kernel, inputs: Inputs, centres: Inputs) -> Self {
        let (n, dim) = (inputs.len(), kernel.dim());
        let (z_inputs, input_norms) = whitened(&kernel, &inputs);
        let (z_centres, centre_norms) = whitened(&kernel, &centres);
        let mut columns = vec![1.0; (centres.len() + 1) * n];
        let (kernels, _bias) = columns.split_at_mut(centres.len() * n);
        // A kernel on every sample is symmetric: each block starts at its own first sample, the rest is copied.
        let is_symmetric = centres == inputs;
        let blocks = kernels.par_chunks_mut(BLOCK_ROWS * n.max(1)).enumerate();
        let blocks =
            blocks.zip(z_centres.par_chunks(BLOCK_ROWS * dim)).zip(centre_norms.par_chunks(BLOCK_ROWS));
        blocks.for_each(|(((block, columns), z), norms)| {
            let first = if is_symmetric { block * BLOCK_ROWS } else { 0 };
            let mut inner = vec![0.0; norms.len() * (n - first)];
            products(z, &z_inputs[first * dim..], dim, &mut inner);
            let rows = columns.chunks_exact_mut(n).zip(inner.chunks_exact(n - first)).zip(norms);
            for ((column, inner), centre_norm) in rows {
                for ((value, inner), norm) in column[first..].iter_mut().zip(inner).zip(&input_norms[first..])
                {
                    *value = (-(centre_norm + norm - 2.0 * inner).max(0.0)).exp();
                }
            }
        });
        if is_symmetric {
            for row in 0..n {
                for column in 0..row / BLOCK_ROWS * BLOCK_ROWS {
                    kernels[row * n + column] = kernels[column * n + row];
                }
            }
        }
        Self { kernel, inputs, centres, columns }
    }

    /// The kernel of all bases.
    pub fn kernel(&self) -> &Kernel {
        &self.kernel
    }

    /// The samples.
    pub fn inputs(&self) -> &Inputs {
        &self.inputs
    }

    /// The number of samples.
    pub fn n_samples(&self) -> usize {
        self.inputs.len()
    }

    /// The number of candidates, the bias included.
    pub fn n_bases(&self) -> usize {
        self.centres.len() + 1
    }

    /// Which candidate is the bias.
    pub fn bias(&self) -> usize {
        self.centres.len()
    }

    /// What the candidates before the bias are centred on.
    pub fn centres(&self) -> &Inputs {
        &self.centres
    }

    /// φ_m at every sample.
    pub fn column(&self, basis: usize) -> &[f64] {
        let n = self.n_samples();
        &self.columns[basis * n..(basis + 1) * n]
    }

    /// Φᵀ u over all candidates.
    pub(crate) fn project(&self, u: &[f64]) -> Vec<f64> {
        (0..self.n_bases()).map(|m| dot(self.column(m), u)).collect()
    }
}

/// Rows where the kernel is exp(−|z − z′|²), and their squared norms.
fn whitened(kernel: &Kernel, rows: &Inputs) -> (Vec<f64>, Vec<f64>) {
    assert_eq!(kernel.dim(), rows.dim(), "a kernel over {}, inputs of {}", kernel.dim(), rows.dim());
    let mut z = Vec::with_capacity(rows.len() * rows.dim());
    for i in 0..rows.len() {
        kernel.whiten(rows.row(i).iter().map(|&v| f64::from(v)), &mut z);
    }
    let norms = z.chunks_exact(rows.dim()).map(|z| dot(z, z)).collect();
    (z, norms)
}

/// What [`Sequential`](crate::rvm::sequential::Sequential) has to know of ΦᵀWΦ over its candidates.
pub(crate) trait Products: Sync {
    /// φ_mᵀWφ_m of all candidates.
    fn squares(&self) -> &[f64];
    /// Column `basis`.
    fn product(&self, basis: usize) -> &[f64];
}

/// A [`Design`] under sample weights W, with the columns of ΦᵀWΦ kept once somebody asked for them.
pub(crate) struct WeightedDesign<'a> {
    pub(crate) design: &'a Design,
    pub(crate) weights: Vec<f64>,
    /// φ_mᵀ W φ_m.
    squares: Vec<f64>,
    products: Vec<OnceLock<Vec<f64>>>,
}

impl<'a> WeightedDesign<'a> {
    pub(crate) fn new(design: &'a Design, weights: Vec<f64>) -> Self {
        assert_eq!(
            weights.len(),
            design.n_samples(),
            "{} weights, {} samples",
            weights.len(),
            design.n_samples()
        );
        let squares = (0..design.n_bases())
            .map(|m| {
                let column = design.column(m);
                let mut sums = [0.0; 8];
                let (chunks, rest) = column.as_chunks::<8>();
                let (w_chunks, w_rest) = weights.as_chunks::<8>();
                for (c, w) in chunks.iter().zip(w_chunks) {
                    for lane in 0..8 {
                        sums[lane] += w[lane] * c[lane] * c[lane];
                    }
                }
                let rest: f64 = rest.iter().zip(w_rest).map(|(c, w)| w * c * c).sum();
                sums.iter().sum::<f64>() + rest
            })
            .collect();
        let products = (0..design.n_bases()).map(|_| OnceLock::new()).collect();
        Self { design, weights, squares, products }
    }

    /// Makes the columns of these bases in one matrix product.
    pub(crate) fn prepare(&self, bases: &[usize]) {
        let (n, p) = (self.design.n_samples(), self.design.n_bases());
        let mut weighted = Vec::with_capacity(n * bases.len());
        for &basis in bases {
            weighted.extend(self.design.column(basis).iter().zip(&self.weights).map(|(c, w)| c * w));
        }
        let mut out = vec![0.0; p * bases.len()];
        products(&weighted, &self.design.columns, n.max(1), &mut out);
        for (&basis, column) in bases.iter().zip(out.chunks_exact(p)) {
            self.products[basis].get_or_init(|| column.to_vec());
        }
    }
}

impl Products for WeightedDesign<'_> {
    fn squares(&self) -> &[f64] {
        &self.squares
    }

    fn product(&self, basis: usize) -> &[f64] {
        self.products[basis].get_or_init(|| {
            let column = self.design.column(basis);
            let weighted: Vec<f64> = column.iter().zip(&self.weights).map(|(c, w)| c * w).collect();
            self.design.project(&weighted)
        })
    }
}
