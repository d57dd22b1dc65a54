//! The file of a pose prior.

use nalgebra::{Cholesky, DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::{N_STEP, PosePrior, principal_components};
use crate::container::{self, ContainerError};
use crate::skeleton::N_DOF;

/// Why bytes are not a prior.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum LoadPriorError {
    /// Another kind or version of file, cut short or damaged.
    #[error("not a pose prior")]
    Container(#[source] ContainerError),
    /// The checksum fits but the data do not decode.
    #[error("cannot decode the data")]
    Decode(#[source] postcard::Error),
    /// An array of another length than the skeleton asks for.
    #[error("`{field}` has {found} elements, expected {expected}")]
    FieldLength { field: &'static str, found: usize, expected: usize },
    /// A covariance that no distribution has.
    #[error("`{field}` is not positive definite")]
    NotPositiveDefinite { field: &'static str },
}

pub(super) const MAGIC: &str = "UMBRAPRI";
pub(super) const VERSION: u32 = 1;

/// What the file of a prior holds. Covariances are lower triangles, row by row.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct PriorFile {
    pub notice: String,
    pub n_poses: u64,
    pub frame_rate_hz: f64,
    pub mean_rad: Vec<f64>,
    pub range_rad: Vec<[f64; 2]>,
    pub sample_covariance: Vec<f64>,
    pub covariance: Vec<f64>,
    pub step_covariance: Vec<f64>,
}

impl PosePrior {
    /// The bytes of its file.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let file = PriorFile {
            notice: self.notice.clone(),
            n_poses: self.n_poses,
            frame_rate_hz: self.frame_rate_hz,
            mean_rad: self.mean.as_slice().to_vec(),
            range_rad: self.range.clone(),
            sample_covariance: lower_triangle(&self.sample_covariance),
            covariance: lower_triangle(&self.covariance),
            step_covariance: lower_triangle(&self.step_covariance),
        };
        let data = postcard::to_stdvec(&file).expect("writing to memory cannot fail");
        container::seal(MAGIC, VERSION, &data)
    }

    /// Undoes [`PosePrior::to_bytes`].
    ///
    /// # Errors
    /// [`LoadPriorError`] for other or damaged files and numbers that make no prior.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, LoadPriorError> {
        let data = container::open(MAGIC, VERSION, bytes).map_err(LoadPriorError::Container)?;
        Self::from_file(postcard::from_bytes(data).map_err(LoadPriorError::Decode)?)
    }

    pub(super) fn from_file(file: PriorFile) -> Result<Self, LoadPriorError> {
        check_length("mean_rad", file.mean_rad.len(), N_DOF)?;
        check_length("range_rad", file.range_rad.len(), N_DOF)?;
        let sample_covariance = from_lower_triangle("sample_covariance", &file.sample_covariance, N_DOF)?;
        let covariance = from_lower_triangle("covariance", &file.covariance, N_DOF)?;
        let step_covariance = from_lower_triangle("step_covariance", &file.step_covariance, N_STEP)?;
        let factor = |field, matrix: &DMatrix<f64>| {
            let factors =
                Cholesky::new(matrix.clone()).ok_or(LoadPriorError::NotPositiveDefinite { field })?;
            Ok(factors.l())
        };
        let (components, component_sd) = principal_components(&sample_covariance);
        Ok(Self {
            notice: file.notice,
            n_poses: file.n_poses,
            frame_rate_hz: file.frame_rate_hz,
            mean: DVector::from_vec(file.mean_rad),
            range: file.range_rad,
            covariance_factor: factor("covariance", &covariance)?,
            step_factor: factor("step_covariance", &step_covariance)?,
            sample_covariance,
            covariance,
            components,
            component_sd,
            step_covariance,
        })
    }
}

pub(super) fn lower_triangle(matrix: &DMatrix<f64>) -> Vec<f64> {
    (0..matrix.nrows()).flat_map(|i| (0..=i).map(move |j| matrix[(i, j)])).collect()
}

fn from_lower_triangle(
    field: &'static str,
    entries: &[f64],
    n: usize,
) -> Result<DMatrix<f64>, LoadPriorError> {
    check_length(field, entries.len(), n * (n + 1) / 2)?;
    Ok(DMatrix::from_fn(n, n, |i, j| {
        let (row, column) = (i.max(j), i.min(j));
        entries[row * (row + 1) / 2 + column]
    }))
}

fn check_length(field: &'static str, found: usize, expected: usize) -> Result<(), LoadPriorError> {
    if found == expected { Ok(()) } else { Err(LoadPriorError::FieldLength { field, found, expected }) }
}
