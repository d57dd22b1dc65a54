//! Gaussian noise in local coordinates.

use crate::rng::ParticleRng;

/// A zero-mean Gaussian: independent coordinates or a full covariance.
#[derive(Clone, Debug, PartialEq)]
pub struct Gaussian(Noise);

#[derive(Clone, Debug, PartialEq)]
enum Noise {
    /// Standard deviation per coordinate.
    Diagonal(Vec<f64>),
    /// Lower triangle of the Cholesky factor, row after row.
    Full { dim: usize, factor: Vec<f64> },
}

/// Why numbers are no covariance.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BadCovariance {
    /// A standard deviation is not finite, or negative, or zero where that is of no use.
    #[error(
        "standard deviation {coordinate} is {value}, expected a finite number, zero or more in fixed noise, above zero as a floor"
    )]
    StandardDeviation {
        /// Which coordinate.
        coordinate: usize,
        /// Its value.
        value: f64,
    },
    /// The matrix has a direction of zero or negative variance.
    #[error(
        "the covariance has pivot {pivot} at coordinate {coordinate}, expected a positive definite matrix"
    )]
    NotPositiveDefinite {
        /// Where the factorisation stops.
        coordinate: usize,
        /// What stands there.
        pivot: f64,
    },
}

impl Gaussian {
    /// Independent coordinates of these standard deviations, `[dim]`; zero keeps a coordinate still.
    ///
    /// # Errors
    /// When one is negative or not finite.
    pub fn diagonal(standard_deviations: Vec<f64>) -> Result<Self, BadCovariance> {
        match standard_deviations.iter().position(|s| !(*s >= 0.0 && s.is_finite())) {
            Some(coordinate) => {
                Err(BadCovariance::StandardDeviation { coordinate, value: standard_deviations[coordinate] })
            }
            None => Ok(Self(Noise::Diagonal(standard_deviations))),
        }
    }

    /// A covariance `[dim, dim]`, row after row; its lower triangle is read.
    ///
    /// # Errors
    /// When it is not positive definite.
    ///
    /// # Panics
    /// When the number of entries is not `dim * dim`.
    pub fn full(covariance: &[f64], dim: usize) -> Result<Self, BadCovariance> {
        assert_eq!(
            covariance.len(),
            dim * dim,
            "a covariance of {dim} coordinates has {} entries",
            dim * dim
        );
        let mut factor = covariance.to_vec();
        cholesky(&mut factor, dim)?;
        Ok(Self(Noise::Full { dim, factor }))
    }

    /// Number of coordinates.
    pub fn dim(&self) -> usize {
        match &self.0 {
            Noise::Diagonal(standard_deviations) => standard_deviations.len(),
            Noise::Full { dim, .. } => *dim,
        }
    }

    /// Replaces the covariance, reusing the memory.
    pub(crate) fn set_full(&mut self, covariance: &[f64], new_dim: usize) -> Result<(), BadCovariance> {
        match &mut self.0 {
            Noise::Full { dim, factor } if *dim == new_dim => {
                factor.copy_from_slice(covariance);
                cholesky(factor, new_dim)
            }
            _ => {
                *self = Self::full(covariance, new_dim)?;
                Ok(())
            }
        }
    }

    /// Draws an increment, `scale` times the standard deviation; takes `dim` standard normals from `rng`.
    pub fn sample(&self, scale: f64, rng: &mut ParticleRng, delta: &mut [f64]) {
        rng.fill_standard_normal(delta);
        match &self.0 {
            Noise::Diagonal(standard_deviations) => {
                for (d, s) in delta.iter_mut().zip(standard_deviations) {
                    *d *= scale * s;
                }
            }
            // delta <- L delta in place: the last row first, so that what it reads is still the normal draw.
            Noise::Full { dim, factor } => {
                for i in (0..*dim).rev() {
                    let row = &factor[i * dim..=i * dim + i];
                    let product: f64 = row.iter().zip(&*delta).map(|(l, z)| l * z).sum();
                    delta[i] = scale * product;
                }
            }
        }
    }

    /// Natural log of the density at `delta`. A coordinate that is kept still has density one at zero, and zero elsewhere.
    pub fn log_density(&self, delta: &[f64]) -> f64 {
        const HALF_LN_2PI: f64 = 0.918_938_533_204_672_7;
        match &self.0 {
            Noise::Diagonal(standard_deviations) => {
                let log_density = |(&d, &s): (&f64, &f64)| match s > 0.0 {
                    true => -0.5 * (d / s).powi(2) - s.ln() - HALF_LN_2PI,
                    false if d == 0.0 => 0.0,
                    false => f64::NEG_INFINITY,
                };
                delta.iter().zip(standard_deviations).map(log_density).sum()
            }
            Noise::Full { dim, factor } => crate::scratch::with_buffer(*dim, |whitened| {
                let mut log_density = 0.0;
                for i in 0..*dim {
                    let row = &factor[i * dim..=i * dim + i];
                    let known: f64 = row[..i].iter().zip(&*whitened).map(|(l, z)| l * z).sum();
                    whitened[i] = (delta[i] - known) / row[i];
                    log_density -= 0.5 * whitened[i].powi(2) + row[i].ln() + HALF_LN_2PI;
                }
                log_density
            }),
        }
    }
}

/// Turns the lower triangle of `matrix` `[dim, dim]` into its Cholesky factor, row by row.
fn cholesky(matrix: &mut [f64], dim: usize) -> Result<(), BadCovariance> {
    for i in 0..dim {
        for j in 0..=i {
            let (row_i, row_j) = (i * dim, j * dim);
            let known: f64 = (0..j).map(|k| matrix[row_i + k] * matrix[row_j + k]).sum();
            let rest = matrix[row_i + j] - known;
            if i != j {
                matrix[row_i + j] = rest / matrix[row_j + j];
            } else if rest > 0.0 && rest.is_finite() {
                matrix[row_i + i] = rest.sqrt();
            } else {
                return Err(BadCovariance::NotPositiveDefinite { coordinate: i, pivot: rest });
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
