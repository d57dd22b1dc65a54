//! The spectral latent variable model: few coordinates for many outputs, with maps both ways.

mod components;
mod decoder;
mod embedding;

use components::fit_components;
pub use decoder::Decoder;
use embedding::laplacian_eigenmaps;

use crate::cross_validation::{Split, choose, kernels_by_spread};
use crate::linalg::Symmetric;
use crate::rng::some_rows;
use crate::{
    Design, Expert, FitError, Gaussian, Inputs, InputsError, Kernel, MixtureDensity, Rvm, RvmConfig,
};
use crate::{RvmConfigError, RvmParams};

/// Kernel widths tried: inverse width over the mean squared distance of the inputs.
const WIDTH_FACTORS: [f64; 6] = [0.25, 0.5, 1.0, 2.0, 4.0, 8.0];
/// Steps of the Levenberg-Marquardt search of [`SpectralLatentModel::encode`].
const ENCODE_STEPS: usize = 12;

/// Open settings of a latent model; [`LatentParams::new`] checks them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LatentConfig {
    /// Latent coordinates.
    pub n_dims: usize,
    /// Neighbours of a row in the graph.
    pub n_neighbours: usize,
    /// Normal distributions of the prior.
    pub n_components: usize,
    /// Most rows of the spectral embedding, drawn by `seed`; the others are placed by the encoder.
    pub max_landmarks: usize,
    /// Rounds in which the latent points are moved to where the decoder explains their outputs best, before the encoder learns
    /// them.
    pub refinements: usize,
    /// Seed of landmarks, held-out rows and components.
    pub seed: u64,
    /// Settings of both maps.
    pub rvm: RvmConfig,
}

impl Default for LatentConfig {
    fn default() -> Self {
        Self {
            n_dims: 5,
            n_neighbours: 12,
            n_components: 10,
            max_landmarks: 800,
            refinements: 2,
            seed: 0,
            rvm: RvmConfig {
                min_gain: 1e-2,
                min_gain_of_addition: 0.5,
                // Outputs lie close to a surface of few dimensions: what varies about it is far less than they do.
                initial_noise: 1e-3,
                max_bases: 300,
                ..RvmConfig::default()
            },
        }
    }
}

/// Checked settings of a latent model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LatentParams {
    config: LatentConfig,
    rvm: RvmParams,
}

/// Which setting is wrong.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LatentConfigError {
    /// A count that has to be at least one.
    #[error("`{field}` is 0, expected at least 1")]
    Zero {
        /// Which setting.
        field: &'static str,
    },
    /// A setting of the maps.
    #[error("`rvm` cannot be used")]
    Rvm(#[source] RvmConfigError),
}

impl LatentParams {
    /// Checks the settings.
    ///
    /// # Errors
    /// Names the first setting that makes no sense.
    pub fn new(config: LatentConfig) -> Result<Self, LatentConfigError> {
        for (field, value) in [
            ("n_dims", config.n_dims),
            ("n_neighbours", config.n_neighbours),
            ("n_components", config.n_components),
            ("max_landmarks", config.max_landmarks),
        ] {
            if value == 0 {
                return Err(LatentConfigError::Zero { field });
            }
        }
        let rvm = RvmParams::new(config.rvm).map_err(LatentConfigError::Rvm)?;
        Ok(Self { config, rvm })
    }
}

/// Why a latent model cannot be fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LatentError {
    /// Too few rows.
    #[error("{rows} rows for {n_dims} latent dimensions, expected at least {least}")]
    TooFewRows {
        /// Rows given.
        rows: usize,
        /// Dimensions wanted.
        n_dims: usize,
        /// Rows needed.
        least: usize,
    },
    /// All rows are alike.
    #[error("all {rows} rows are alike, expected some that differ")]
    NoSpread {
        /// Rows given.
        rows: usize,
    },
    /// The eigenvalue decomposition does not converge.
    #[error("the spectrum of the neighbour graph cannot be computed")]
    Spectrum,
    /// A latent point is not finite.
    #[error("a latent point is not finite")]
    Points(#[source] InputsError),
    /// One of the maps cannot be fitted.
    #[error("a map between latent points and outputs cannot be fitted")]
    Map(#[source] FitError),
}

/// Latent points x of outputs y: a prior p(x), a decoder p(y | x) and an encoder p(x | y).
///
/// As `[Kanaujia2007]`: Laplacian eigenmaps place the training outputs, sparse Bayesian maps tie both spaces together, and
/// a mixture of normal distributions says where latent points lie.
///
/// ```
/// use bme::{Inputs, LatentConfig, LatentParams, SpectralLatentModel};
/// // A cycle in six outputs.
/// let cycle = |i: i32| (0..6).map(move |d| (f64::from(i) * 0.1 + f64::from(d)).sin());
/// let outputs = Inputs::from_rows(6, (0..126).flat_map(cycle))?;
/// let params = LatentParams::new(LatentConfig { n_dims: 2, ..LatentConfig::default() })?;
/// let model = SpectralLatentModel::fit(&outputs, &params)?;
/// let y: Vec<f64> = cycle(30).collect();
/// let x = model.encode(&y).mean;
/// assert_eq!(x.len(), 2);
/// assert!(model.decode(&x).iter().zip(&y).all(|(a, b)| (a - b).abs() < 0.05));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct SpectralLatentModel {
    pub(crate) prior: MixtureDensity,
    pub(crate) decoder: Decoder,
    pub(crate) encoder: Rvm,
}

impl SpectralLatentModel {
    /// Fits to rows of outputs, which should come on comparable scales (angles in radians, say).
    ///
    /// # Errors
    /// When there are too few rows or they are all alike.
    pub fn fit(outputs: &Inputs, params: &LatentParams) -> Result<Self, LatentError> {
        let config = &params.config;
        let least = config.n_dims + 2;
        if outputs.len() < least {
            return Err(LatentError::TooFewRows { rows: outputs.len(), n_dims: config.n_dims, least });
        }
        if (1..outputs.len()).all(|i| outputs.row(i) == outputs.row(0)) {
            return Err(LatentError::NoSpread { rows: outputs.len() });
        }
        let landmarks =
            outputs.select(&some_rows(outputs.len(), config.max_landmarks.max(least), config.seed));
        let points = laplacian_eigenmaps(&landmarks, config.n_dims, config.n_neighbours)
            .ok_or(LatentError::Spectrum)?;
        let mut points =
            Inputs::from_rows(config.n_dims, points.into_iter().flatten()).map_err(LatentError::Points)?;
        let mut decoder = Decoder::fit(&points, &landmarks, None, params)?;
        let wide = unit_normal(config.n_dims);
        for _ in 0..config.refinements {
            let moved = (0..landmarks.len())
                .flat_map(|i| posterior(&decoder, &landmarks.row_f64(i), &wide, points.row_f64(i)).mean);
            points = Inputs::from_rows(config.n_dims, moved).map_err(LatentError::Points)?;
            decoder = Decoder::fit(&points, &landmarks, Some(decoder.kernel().clone()), params)?;
        }
        let encoder = fit_map(&landmarks, &points, None, params)?;
        let prior = fit_components(&points, config.n_components, config.seed);
        Ok(Self { prior, decoder, encoder })
    }

    /// The length of a latent point.
    pub fn latent_dim(&self) -> usize {
        self.decoder.latent_dim()
    }

    /// The length of an output.
    pub fn output_dim(&self) -> usize {
        self.decoder.output_dim()
    }

    /// p(x).
    pub fn prior(&self) -> &MixtureDensity {
        &self.prior
    }

    /// p(y | x).
    pub fn decoder(&self) -> &Decoder {
        &self.decoder
    }

    /// The mean output at `x`: the quick way for many points.
    ///
    /// # Panics
    /// When `x` has the wrong length.
    pub fn decode(&self, x: &[f64]) -> Vec<f64> {
        let mut mean = vec![0.0; self.output_dim()];
        self.decoder.mean_into(x, &mut vec![0.0; self.decoder.n_features()], &mut mean);
        mean
    }

    /// p(x | y): normal about the most likely point, found from the inverse map's answer, which is the prior here. It goes on
    /// evenly from one frame of a motion to the next; for outputs such as no training has shown, the inverse map is too sure,
    /// and [`Self::nearest`] keeps more of them.
    ///
    /// # Panics
    /// When `y` has the wrong length.
    pub fn encode(&self, y: &[f64]) -> Gaussian {
        let mut prior = Gaussian::default();
        self.encoder.predict(y, &mut prior);
        let start = prior.mean.clone();
        posterior(&self.decoder, y, &prior, start)
    }

    /// The point whose output is most like `y`, under a prior as wide as the embedding: unit variance.
    ///
    /// # Panics
    /// When `y` has the wrong length.
    pub fn nearest(&self, y: &[f64]) -> Vec<f64> {
        posterior(&self.decoder, y, &unit_normal(self.latent_dim()), self.encode(y).mean).mean
    }
}

/// A map whose kernel width is chosen on a tenth of the rows, unless it is given.
fn fit_map(
    from: &Inputs,
    to: &Inputs,
    kernel: Option<Kernel>,
    params: &LatentParams,
) -> Result<Rvm, LatentError> {
    let columns = |rows: &[usize]| -> Vec<Vec<f64>> {
        (0..to.dim()).map(|d| rows.iter().map(|&i| f64::from(to.row(i)[d])).collect()).collect()
    };
    let fit = |kernel: &Kernel, rows: &[usize]| {
        let design = Design::new(kernel.clone(), from.select(rows));
        Rvm::fit(&design, &columns(rows), &vec![1.0; rows.len()], &params.rvm)
    };
    let all: Vec<usize> = (0..from.len()).collect();
    let kernel = match kernel {
        Some(kernel) => kernel,
        None => {
            let split = Split::new(from.len(), 0.1, 1, params.config.seed);
            let mut candidates = kernels_by_spread(from, &WIDTH_FACTORS);
            // A third of the rows tells widths apart as well as all of them, at a tenth of the cost.
            let some: Vec<usize> =
                split.train.iter().copied().step_by(3.min(split.train.len() / 100 + 1)).collect();
            let (best, _) = choose(&candidates, |kernel| {
                let model = fit(kernel, &some)?;
                let error = split.held_out.iter().map(|&i| {
                    let predicted = model.mean(&from.row_f64(i));
                    predicted.iter().zip(to.row(i)).map(|(a, &b)| (a - f64::from(b)).powi(2)).sum::<f64>()
                });
                Ok(-error.sum::<f64>())
            })
            .map_err(LatentError::Map)?;
            candidates.swap_remove(best)
        }
    };
    fit(&kernel, &all).map_err(LatentError::Map)
}

/// What the points of an embedding are together.
fn unit_normal(dim: usize) -> Gaussian {
    Gaussian { mean: vec![0.0; dim], variance: vec![1.0; dim] }
}

/// The mode of N(y | decoder(x), σ²) p(x) by Levenberg-Marquardt from `start`, and the curvature there as variance.
fn posterior(decoder: &Decoder, y: &[f64], prior: &Gaussian, start: Vec<f64>) -> Gaussian {
    let noise = decoder.noise_variance();
    let cost = |x: &[f64], decoded: &[f64]| -> f64 {
        let fit: f64 = y.iter().zip(decoded).zip(&noise).map(|((a, b), v)| (a - b).powi(2) / v).sum();
        let away: f64 =
            x.iter().zip(&prior.mean).zip(&prior.variance).map(|((a, b), v)| (a - b).powi(2) / v).sum();
        fit + away
    };
    let dim = start.len();
    let mut x = start;
    let (mut decoded, mut jacobian) = decoder.mean_and_jacobian(&x);
    let mut damping = 1e-2;
    let mut information = Symmetric::default();
    for _ in 0..ENCODE_STEPS {
        information = Symmetric::from_fn(dim, |i, j| {
            let sum: f64 = jacobian.iter().zip(&noise).map(|(row, v)| row[i] * row[j] / v).sum();
            sum + if i == j { 1.0 / prior.variance[i] } else { 0.0 }
        });
        let gradient: Vec<f64> = (0..dim)
            .map(|i| {
                let residuals = y.iter().zip(&decoded).zip(&noise).map(|((a, b), v)| (a - b) / v);
                let pull: f64 = jacobian.iter().zip(residuals).map(|(row, r)| row[i] * r).sum();
                pull - (x[i] - prior.mean[i]) / prior.variance[i]
            })
            .collect();
        let damped =
            Symmetric::from_fn(dim, |i, j| information.row(i)[j] * if i == j { 1.0 + damping } else { 1.0 });
        let Some(factor) = damped.cholesky() else { break };
        let step = factor.solve(&gradient);
        let trial: Vec<f64> = x.iter().zip(&step).map(|(x, s)| x + s).collect();
        let (trial_decoded, trial_jacobian) = decoder.mean_and_jacobian(&trial);
        if cost(&trial, &trial_decoded) < cost(&x, &decoded) {
            let is_done = step.iter().zip(&gradient).map(|(s, g)| s * g).sum::<f64>() < 1e-6;
            (x, decoded, jacobian) = (trial, trial_decoded, trial_jacobian);
            damping *= 0.1;
            if is_done {
                break;
            }
        } else {
            damping *= 10.0;
        }
    }
    let variance = match information.cholesky() {
        Some(factor) => {
            let covariance = factor.inverse();
            (0..dim).map(|i| covariance.diagonal(i)).collect()
        }
        None => prior.variance.clone(),
    };
    Gaussian { mean: x, variance }
}

#[cfg(test)]
mod tests;
