//! How poses go on: the next coordinates of a pose from the present ones.

use bme::file::{MemoryFile, ModelFileError, RvmFile};
use bme::{Design, Expert as _, FitError, Inputs, InputsError, Rvm, RvmConfig, RvmParams, kernels_by_spread};
use pf_core::scratch::with_buffer;
use serde::{Deserialize, Serialize};

/// Inverse kernel width over the mean squared distance of the training poses: smooth over about a fifth of a stride.
const WIDTH_FACTOR: f64 = 1.0;
/// Poses that may carry a kernel.
const MAX_CENTRES: usize = 400;

/// p(x_n | x_{n-1}): the change of each coordinate by relevance vector regression, with its variance.
///
/// Steps are regressed, not places: far from all training poses the mean step is the mean of all steps.
#[derive(Clone, Debug)]
pub struct LatentDynamics {
    step: Rvm,
}

/// Why no dynamics can be learned.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DynamicsError {
    /// No two poses in a row.
    #[error("no clip has two poses in a row, expected pairs of poses to learn steps from")]
    NoSteps,
    /// A coordinate that is not finite.
    #[error("a coordinate of a pose cannot be used")]
    Coordinates(#[source] InputsError),
    /// A regression that fails.
    #[error("steps of poses cannot be learned")]
    Fit(#[source] FitError),
}

impl LatentDynamics {
    /// Learns from clips of coordinates at the frame rate of the tracker, `clips[clip][frame][coordinate]`.
    ///
    /// # Errors
    /// When there are no two poses in a row or a coordinate is not finite.
    ///
    /// # Panics
    /// When poses have different numbers of coordinates.
    pub fn fit(clips: &[Vec<Vec<f64>>]) -> Result<Self, DynamicsError> {
        let pairs: Vec<[&Vec<f64>; 2]> =
            clips.iter().flat_map(|clip| clip.windows(2)).map(|pair| [&pair[0], &pair[1]]).collect();
        let dim = pairs.first().ok_or(DynamicsError::NoSteps)?[0].len();
        assert!(
            pairs.iter().flatten().all(|pose| pose.len() == dim),
            "poses of other than {dim} coordinates"
        );
        let from = pairs.iter().flat_map(|[from, _]| from.iter().copied());
        let inputs = Inputs::from_rows(dim, from).map_err(DynamicsError::Coordinates)?;
        let steps: Vec<Vec<f64>> =
            (0..dim).map(|d| pairs.iter().map(|[from, to]| to[d] - from[d]).collect()).collect();
        let spread = bme::mean_squared_distance(&inputs);
        if spread <= 0.0 {
            return Err(DynamicsError::NoSteps);
        }
        let kernel = kernels_by_spread(&inputs, &[WIDTH_FACTOR]).swap_remove(0);
        let every = inputs.len().div_ceil(MAX_CENTRES);
        let centres = inputs.select(&(0..inputs.len()).step_by(every).collect::<Vec<_>>());
        // Steps follow from poses closely: what looks like noise at first is mostly the next harmonic.
        let config = RvmConfig {
            min_gain: 0.1,
            min_gain_of_addition: 1.0,
            initial_noise: 1e-4,
            max_bases: 16,
            ..RvmConfig::default()
        };
        let params = RvmParams::new(config).expect("the settings above are positive");
        let weights = vec![1.0; inputs.len()];
        let design = Design::with_centres(kernel, inputs, centres);
        Ok(Self { step: Rvm::fit(&design, &steps, &weights, &params).map_err(DynamicsError::Fit)? })
    }

    /// Number of coordinates.
    pub fn dim(&self) -> usize {
        self.step.output_dim()
    }

    /// Mean and variance of the step of each coordinate to the next frame, `[dim]`.
    ///
    /// # Panics
    /// When there are not [`Self::dim`] coordinates.
    pub fn step_into(&self, previous: &[f64], mean: &mut [f64], variance: &mut [f64]) {
        with_buffer(self.step.n_features(), |room| self.step.predict_into(previous, room, mean, variance));
    }
}

/// What a file holds of [`LatentDynamics`].
#[derive(Serialize, Deserialize)]
pub(super) struct DynamicsFile(RvmFile);

impl From<&LatentDynamics> for DynamicsFile {
    fn from(dynamics: &LatentDynamics) -> Self {
        let mut step = RvmFile::from(&dynamics.step);
        step.memory = MemoryFile::default();
        Self(step)
    }
}

impl TryFrom<DynamicsFile> for LatentDynamics {
    type Error = ModelFileError;

    fn try_from(file: DynamicsFile) -> Result<Self, ModelFileError> {
        Ok(Self { step: Rvm::try_from(file.0)? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cycle of 40 frames in three coordinates.
    fn cycle(n: usize) -> Vec<Vec<f64>> {
        let phase = |frame: usize| std::f64::consts::TAU * frame as f64 / 40.0;
        (0..n).map(|frame| vec![phase(frame).cos(), phase(frame).sin(), (2.0 * phase(frame)).sin()]).collect()
    }

    #[test]
    fn a_cycle_goes_on() {
        let clip = cycle(121);
        let dynamics = LatentDynamics::fit(std::slice::from_ref(&clip)).unwrap();
        for pair in clip.windows(2) {
            let (mut step, mut variance) = ([0.0; 3], [0.0; 3]);
            dynamics.step_into(&pair[0], &mut step, &mut variance);
            let off = (0..3).map(|d| pair[0][d] + step[d] - pair[1][d]);
            assert!(off.into_iter().all(|off| off.abs() < 0.02), "{step:?} {pair:?}");
            assert!(variance.iter().all(|v| *v > 0.0 && *v < 1e-2));
        }
    }

    #[test]
    fn clips_are_not_joined() {
        assert!(matches!(LatentDynamics::fit(&[cycle(1), cycle(1)]), Err(DynamicsError::NoSteps)));
        let mut broken = cycle(5);
        broken[2][1] = f64::NAN;
        assert_eq!(
            LatentDynamics::fit(&[broken]).unwrap_err().to_string(),
            "a coordinate of a pose cannot be used"
        );
    }
}
