//! The Gaussian kernel over blocks of an input, each with a width of its own.

use crate::Inputs;

/// exp(−Σ_b g_b |x_b − x′_b|²): one block is the plain Gaussian kernel, several make the product kernel K(x) K(r).
///
/// ```
/// use bme::Kernel;
/// let product = Kernel::product(&[(2, 0.5), (1, 3.0)])?;
/// let value = product.value(&[1.0, 2.0, 5.0], &[0.0, 2.0, 5.5]);
/// assert!((value - (-0.5 * 1.0 - 3.0 * 0.25_f64).exp()).abs() < 1e-15);
/// # Ok::<(), bme::KernelError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Kernel {
    blocks: Vec<Block>,
}

/// |x − c|² in eight interleaved partial sums.
fn squared_distance(x: &[f64], centre: &[f32]) -> f64 {
    let mut sums = [0.0; 8];
    let (x_chunks, x_rest) = x.as_chunks::<8>();
    let (c_chunks, c_rest) = centre.as_chunks::<8>();
    for (x, c) in x_chunks.iter().zip(c_chunks) {
        for lane in 0..8 {
            let difference = x[lane] - f64::from(c[lane]);
            sums[lane] += difference * difference;
        }
    }
    let rest: f64 = x_rest.iter().zip(c_rest).map(|(x, &c)| (x - f64::from(c)).powi(2)).sum();
    sums.iter().sum::<f64>() + rest
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Block {
    dim: usize,
    inverse_width: f64,
}

/// Why a [`Kernel`] cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum KernelError {
    /// No block of at least one coordinate.
    #[error("the kernel has no coordinates, expected at least one")]
    NoCoordinates,
    /// A width that is no positive number.
    #[error("`inverse_width` of block {block} is {value}, expected a positive number")]
    InverseWidth {
        /// Which block.
        block: usize,
        /// What was given.
        value: f64,
    },
}

impl Kernel {
    /// exp(−g |x − x′|²) over `dim` coordinates.
    ///
    /// # Errors
    /// When `dim` is zero or `inverse_width` (g, per squared unit of the input) is no positive number.
    pub fn gaussian(dim: usize, inverse_width: f64) -> Result<Self, KernelError> {
        Self::product(&[(dim, inverse_width)])
    }

    /// The product of Gaussian kernels over consecutive blocks of `(dim, inverse_width)`.
    ///
    /// # Errors
    /// When no block has a coordinate or a width is no positive number.
    pub fn product(blocks: &[(usize, f64)]) -> Result<Self, KernelError> {
        if blocks.iter().all(|&(dim, _)| dim == 0) {
            return Err(KernelError::NoCoordinates);
        }
        for (block, &(_, value)) in blocks.iter().enumerate() {
            if !(value > 0.0 && value.is_finite()) {
                return Err(KernelError::InverseWidth { block, value });
            }
        }
        let blocks = blocks.iter().map(|&(dim, inverse_width)| Block { dim, inverse_width }).collect();
        Ok(Self { blocks })
    }

    /// The length of an input.
    pub fn dim(&self) -> usize {
        self.blocks.iter().map(|b| b.dim).sum()
    }

    /// `(dim, inverse_width)` of each block.
    pub fn blocks(&self) -> impl Iterator<Item = (usize, f64)> {
        self.blocks.iter().map(|b| (b.dim, b.inverse_width))
    }

    /// The kernel with every inverse width multiplied by `factor`.
    ///
    /// # Errors
    /// When that leaves a width that is no positive number.
    pub fn scaled(&self, factor: f64) -> Result<Self, KernelError> {
        let blocks: Vec<_> = self.blocks().map(|(dim, g)| (dim, g * factor)).collect();
        Self::product(&blocks)
    }

    /// K(x, x′).
    ///
    /// # Panics
    /// When an input has not [`Self::dim`] coordinates.
    pub fn value(&self, x: &[f64], other: &[f64]) -> f64 {
        assert_eq!(x.len(), self.dim(), "an input of {} for a kernel over {}", x.len(), self.dim());
        assert_eq!(other.len(), self.dim(), "an input of {} for a kernel over {}", other.len(), self.dim());
        let (mut start, mut exponent) = (0, 0.0);
        for block in &self.blocks {
            let range = start..start + block.dim;
            let squares = x[range.clone()].iter().zip(&other[range]).map(|(a, b)| (a - b) * (a - b));
            exponent += block.inverse_width * squares.sum::<f64>();
            start += block.dim;
        }
        (-exponent).exp()
    }

    /// K(x, c) of all centres, appended to `out`.
    pub(crate) fn at_centres(&self, centres: &Inputs, x: &[f64], out: &mut Vec<f64>) {
        out.extend(self.values(centres, x));
    }

    /// K(x, c) of one centre after the other.
    pub(crate) fn values<'a>(&'a self, centres: &'a Inputs, x: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        assert_eq!(x.len(), self.dim(), "an input of {} for a kernel over {}", x.len(), self.dim());
        (0..centres.len()).map(move |centre| {
            let centre = centres.row(centre);
            let (mut start, mut exponent) = (0, 0.0);
            for block in &self.blocks {
                let range = start..start + block.dim;
                exponent += block.inverse_width * squared_distance(&x[range.clone()], &centre[range]);
                start += block.dim;
            }
            (-exponent).exp()
        })
    }

    /// Moves `x` to where this kernel is exp(−|z − z′|²): every block times √g.
    pub(crate) fn whiten(&self, x: impl Iterator<Item = f64>, out: &mut Vec<f64>) {
        let scales = self.blocks.iter().flat_map(|b| std::iter::repeat_n(b.inverse_width.sqrt(), b.dim));
        out.extend(x.zip(scales).map(|(value, scale)| value * scale));
    }
}
