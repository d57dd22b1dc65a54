//! Small dense linear algebra with a fixed order of operations, so that equal input gives equal bits.

/// Columns worked on together, so that they stay in cache.
const BLOCK_COLUMNS: usize = 256;
/// Numbers that stay in the second level of cache together.
const BLOCK_NUMBERS: usize = 32_768;

/// Σ aᵢ bᵢ in eight interleaved partial sums (vectorises, and the order never changes).
///
/// # Panics
/// When the slices differ in length.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len(), "dot of {} and {} numbers", a.len(), b.len());
    let mut sums = [0.0; 8];
    let (a_chunks, a_rest) = a.as_chunks::<8>();
    let (b_chunks, b_rest) = b.as_chunks::<8>();
    for (x, y) in a_chunks.iter().zip(b_chunks) {
        for lane in 0..8 {
            sums[lane] += x[lane] * y[lane];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(x, y)| x * y).sum();
    sums.iter().sum::<f64>() + rest
}

/// All products of the rows of `a` and of `b` (rows of `n`): `out[i * n_b + j] = aᵢ · bⱼ`.
///
/// Some rows of `b` at a time are turned into columns, so that the sums run side by side in vector lanes.
pub(crate) fn products(a: &[f64], b: &[f64], n: usize, out: &mut [f64]) {
    let (n_a, n_b) = (a.len() / n, b.len() / n);
    assert_eq!(out.len(), n_a * n_b, "{} places for {n_a} x {n_b} products", out.len());
    let width = (BLOCK_NUMBERS / n / 8 * 8).clamp(16, BLOCK_COLUMNS);
    for first in (0..n_b).step_by(width) {
        let width = width.min(n_b - first);
        let mut turned = vec![0.0; n * width];
        for j in 0..width {
            for (k, value) in b[(first + j) * n..(first + j + 1) * n].iter().enumerate() {
                turned[k * width + j] = *value;
            }
        }
        let columns: Vec<&[f64]> = turned.chunks_exact(width).collect();
        for (i, coefficients) in a.chunks_exact(n).enumerate() {
            let at = i * n_b + first;
            combine(&columns, coefficients, &mut out[at..at + width]);
        }
    }
}

/// `out += scale * v`.
pub(crate) fn add_scaled(out: &mut [f64], scale: f64, v: &[f64]) {
    assert_eq!(out.len(), v.len(), "adding {} numbers to {}", v.len(), out.len());
    for (o, x) in out.iter_mut().zip(v) {
        *o += scale * x;
    }
}

/// `out = Σⱼ coefficients[j] columns[j]`, four columns in one sweep to halve the memory traffic.
pub(crate) fn combine(columns: &[&[f64]], coefficients: &[f64], out: &mut [f64]) {
    assert_eq!(
        columns.len(),
        coefficients.len(),
        "{} columns, {} coefficients",
        columns.len(),
        coefficients.len()
    );
    out.fill(0.0);
    let quads = columns.len() / 4 * 4;
    for j in (0..quads).step_by(4) {
        let [c0, c1, c2, c3] =
            [coefficients[j], coefficients[j + 1], coefficients[j + 2], coefficients[j + 3]];
        let n = out.len();
        let (v0, v1) = (&columns[j][..n], &columns[j + 1][..n]);
        let (v2, v3) = (&columns[j + 2][..n], &columns[j + 3][..n]);
        for i in 0..n {
            out[i] += (c0 * v0[i] + c1 * v1[i]) + (c2 * v2[i] + c3 * v3[i]);
        }
    }
    for j in quads..columns.len() {
        add_scaled(out, coefficients[j], columns[j]);
    }
}

/// ln Σ exp(xᵢ); −∞ for an empty slice or one of only −∞, never NaN for numbers below +∞.
///
/// ```
/// assert_eq!(bme::log_sum_exp(&[f64::NEG_INFINITY; 3]), f64::NEG_INFINITY);
/// assert!((bme::log_sum_exp(&[1000.0, 1000.0]) - (1000.0 + 2f64.ln())).abs() < 1e-12);
/// ```
pub fn log_sum_exp(x: &[f64]) -> f64 {
    let largest = x.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if largest == f64::NEG_INFINITY {
        return largest;
    }
    largest + x.iter().map(|v| (v - largest).exp()).sum::<f64>().ln()
}

/// exp of each less the [`log_sum_exp`] of all; even shares where all are −∞.
pub(crate) fn shares(log_weights: &[f64]) -> Vec<f64> {
    let total = log_sum_exp(log_weights);
    let even = 1.0 / log_weights.len() as f64;
    log_weights.iter().map(|log| if total > f64::NEG_INFINITY { (log - total).exp() } else { even }).collect()
}

/// A dense symmetric matrix that grows and shrinks by one row and column.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Symmetric {
    n: usize,
    values: Vec<f64>,
}

impl Symmetric {
    pub(crate) fn from_fn(n: usize, mut f: impl FnMut(usize, usize) -> f64) -> Self {
        let values = (0..n * n).map(|at| f(at / n, at % n)).collect();
        Self { n, values }
    }

    /// Row (and column) `i`.
    pub(crate) fn row(&self, i: usize) -> &[f64] {
        &self.values[i * self.n..(i + 1) * self.n]
    }

    pub(crate) fn diagonal(&self, i: usize) -> f64 {
        self.values[i * self.n + i]
    }

    pub(crate) fn times(&self, v: &[f64]) -> Vec<f64> {
        (0..self.n).map(|i| dot(self.row(i), v)).collect()
    }

    /// vᵀ A v.
    pub(crate) fn quadratic(&self, v: &[f64]) -> f64 {
        (0..self.n).map(|i| v[i] * dot(self.row(i), v)).sum()
    }

    /// `A += scale * v vᵀ`.
    pub(crate) fn add_outer(&mut self, scale: f64, v: &[f64]) {
        let n = self.n;
        for (i, row) in self.values.chunks_exact_mut(n.max(1)).enumerate() {
            add_scaled(row, scale * v[i], v);
        }
    }

    /// Appends a row and column: `off_diagonal` to the side, `diagonal` in the corner.
    pub(crate) fn push(&mut self, off_diagonal: &[f64], diagonal: f64) {
        let old = std::mem::take(self);
        let n = old.n;
        *self = Self::from_fn(n + 1, |i, j| match (i == n, j == n) {
            (false, false) => old.values[i * n + j],
            (true, true) => diagonal,
            (true, false) => off_diagonal[j],
            (false, true) => off_diagonal[i],
        });
    }

    /// Takes row and column `at` out.
    pub(crate) fn remove(&mut self, at: usize) {
        let old = std::mem::take(self);
        let from = |i: usize| i + usize::from(i >= at);
        *self = Self::from_fn(old.n - 1, |i, j| old.values[from(i) * old.n + from(j)]);
    }

    /// The lower triangle, row by row: what a file holds.
    pub(crate) fn lower_triangle(&self) -> Vec<f64> {
        (0..self.n).flat_map(|i| self.row(i)[..=i].iter().copied()).collect()
    }

    /// The inverse of [`Self::lower_triangle`]; `None` when the length is no triangle of `n` rows.
    pub(crate) fn from_lower_triangle(n: usize, triangle: &[f64]) -> Option<Self> {
        (triangle.len() == n * (n + 1) / 2).then(|| {
            Self::from_fn(n, |i, j| {
                let (row, column) = (i.max(j), i.min(j));
                triangle[row * (row + 1) / 2 + column]
            })
        })
    }

    /// The Cholesky factor, or `None` where the matrix is not positive definite.
    pub(crate) fn cholesky(&self) -> Option<Cholesky> {
        let mut rows: Vec<Vec<f64>> = Vec::with_capacity(self.n);
        for i in 0..self.n {
            let mut row = Vec::with_capacity(i + 1);
            for j in 0..i {
                row.push((self.row(i)[j] - dot(&row[..j], &rows[j][..j])) / rows[j][j]);
            }
            let square = self.diagonal(i) - dot(&row, &row);
            if square.is_nan() || square <= 0.0 || square.is_infinite() {
                return None;
            }
            row.push(square.sqrt());
            rows.push(row);
        }
        Some(Cholesky { rows })
    }
}

/// L with L Lᵀ = A.
pub(crate) struct Cholesky {
    /// Row i has i + 1 entries.
    rows: Vec<Vec<f64>>,
}

impl Cholesky {
    /// ln |A|.
    pub(crate) fn log_determinant(&self) -> f64 {
        2.0 * self.rows.iter().enumerate().map(|(i, row)| row[i].ln()).sum::<f64>()
    }

    /// A⁻¹ = L⁻ᵀ L⁻¹.
    pub(crate) fn inverse(&self) -> Symmetric {
        let n = self.rows.len();
        // columns[i] is column i of L⁻¹ from its diagonal down.
        let columns: Vec<Vec<f64>> = (0..n)
            .map(|i| {
                let mut column = vec![1.0 / self.rows[i][i]];
                for k in i + 1..n {
                    column.push(-dot(&self.rows[k][i..k], &column) / self.rows[k][k]);
                }
                column
            })
            .collect();
        let mut values = vec![0.0; n * n];
        for i in 0..n {
            for j in i..n {
                let value = dot(&columns[i][j - i..], &columns[j]);
                values[i * n + j] = value;
                values[j * n + i] = value;
            }
        }
        Symmetric { n, values }
    }

    /// A⁻¹ b.
    pub(crate) fn solve(&self, b: &[f64]) -> Vec<f64> {
        let n = self.rows.len();
        assert_eq!(b.len(), n, "{} numbers for {n} equations", b.len());
        let mut x: Vec<f64> = Vec::with_capacity(n);
        for (i, value) in b.iter().enumerate() {
            x.push((value - dot(&self.rows[i][..i], &x)) / self.rows[i][i]);
        }
        for i in (0..n).rev() {
            x[i] /= self.rows[i][i];
            let (before, at) = x.split_at_mut(i);
            add_scaled(before, -at[0], &self.rows[i][..i]);
        }
        x
    }

    /// The squared norms of the columns of L⁻¹ B, where the rows of B are `rows`.
    pub(crate) fn whitened_squares(&self, rows: &[&[f64]], out: &mut [f64]) {
        out.fill(0.0);
        for (block, sums) in out.chunks_mut(BLOCK_COLUMNS).enumerate() {
            let columns = block * BLOCK_COLUMNS..block * BLOCK_COLUMNS + sums.len();
            let mut solved: Vec<Vec<f64>> = Vec::with_capacity(rows.len());
            for (row, l) in rows.iter().zip(&self.rows) {
                let known: Vec<&[f64]> = solved.iter().map(Vec::as_slice).collect();
                let mut next = vec![0.0; sums.len()];
                combine(&known, &l[..known.len()], &mut next);
                let pivot = l[known.len()];
                for ((value, b), sum) in next.iter_mut().zip(&row[columns.clone()]).zip(sums.iter_mut()) {
                    *value = (b - *value) / pivot;
                    *sum += *value * *value;
                }
                solved.push(next);
            }
        }
    }
}

/// Eigenvalues, largest first, and their eigenvectors, by Jacobi's rotations: for small matrices.
pub(crate) fn jacobi_eigen(matrix: &Symmetric) -> (Vec<f64>, Vec<Vec<f64>>) {
    let n = matrix.n;
    let mut a = matrix.clone();
    // Rows of v become the eigenvectors.
    let mut v = Symmetric::from_fn(n, |i, j| f64::from(u8::from(i == j)));
    for _ in 0..60 {
        let off: f64 = (0..n).map(|i| a.row(i)[..i].iter().map(|x| x * x).sum::<f64>()).sum();
        let size: f64 = a.values.iter().map(|x| x * x).sum();
        if off <= 1e-30 * size {
            break;
        }
        for p in 0..n {
            for q in p + 1..n {
                let apq = a.values[p * n + q];
                if apq == 0.0 {
                    continue;
                }
                let theta = (a.diagonal(q) - a.diagonal(p)) / (2.0 * apq);
                let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
                let t = if theta == 0.0 { 1.0 } else { t };
                let c = 1.0 / (t * t + 1.0).sqrt();
                let s = t * c;
                for k in 0..n {
                    let (x, y) = (a.values[k * n + p], a.values[k * n + q]);
                    a.values[k * n + p] = c * x - s * y;
                    a.values[k * n + q] = s * x + c * y;
                }
                for k in 0..n {
                    let (x, y) = (a.values[p * n + k], a.values[q * n + k]);
                    a.values[p * n + k] = c * x - s * y;
                    a.values[q * n + k] = s * x + c * y;
                    let (x, y) = (v.values[p * n + k], v.values[q * n + k]);
                    v.values[p * n + k] = c * x - s * y;
                    v.values[q * n + k] = s * x + c * y;
                }
            }
        }
    }
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&i, &j| a.diagonal(j).total_cmp(&a.diagonal(i)));
    (order.iter().map(|&i| a.diagonal(i)).collect(), order.iter().map(|&i| v.row(i).to_vec()).collect())
}

#[cfg(test)]
mod tests;
