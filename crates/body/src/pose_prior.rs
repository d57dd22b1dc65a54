//! What recorded motion says of poses and of steps from frame to frame: means, covariances, principal components.
//!
//! A weak prior for unscripted motion, not a model of any activity: one Gaussian over the joint angles and one over the
//! steps of root and angles. Both contain each pose and step together with its mirror image.

use crate::pose::Pose;
use crate::retarget::Motion;
use crate::skeleton::{N_DOF, Skeleton};
use nalgebra::{DMatrix, DVector, SymmetricEigen};

mod file;

pub use file::LoadPriorError;
use file::{PriorFile, lower_triangle};

/// Coordinates of a step: displacement of the pelvis (3), its rotation vector (3), both in the pelvis frame before the
/// step, then the joint angles.
pub const N_STEP: usize = 6 + N_DOF;

/// How to learn a prior.
#[derive(Clone, Debug, PartialEq)]
pub struct PosePriorConfig {
    /// Whether mirror images of poses and steps count: of people at large they do, one person has a side that hangs.
    pub mirror: bool,
    /// Share by which correlations shrink towards zero, as the poses are of few people.
    pub shrinkage: f64,
    /// Standard deviation added to each angle, radians: recordings hold some joints that people move.
    pub angle_floor_rad: f64,
    /// Standard deviation added to the step of each angle and of the root's rotation, radians a frame.
    pub step_floor_rad: f64,
    /// Standard deviation added to the step of the root, metres a frame.
    pub step_floor_m: f64,
    /// Steps in which an angle moves faster than this are jumps of the recording and left out, radians a second.
    pub jump_rad_per_sec: f64,
}

impl Default for PosePriorConfig {
    fn default() -> Self {
        Self {
            mirror: true,
            shrinkage: 0.05,
            angle_floor_rad: 2f64.to_radians(),
            step_floor_rad: 0.1f64.to_radians(),
            step_floor_m: 0.0005,
            jump_rad_per_sec: 25.0,
        }
    }
}

/// Why no prior can be learned.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum LearnPriorError {
    /// Nothing to learn from.
    #[error("the motions have {n_poses} poses, expected at least {N_DOF}")]
    TooFewPoses { n_poses: usize },
    /// Steps of different lengths.
    #[error("{motion}: has {found} frames a second, expected {expected} as in the first motion")]
    FrameRate { motion: String, found: f64, expected: f64 },
}

/// Gaussians over poses and steps. See the [module](self) for what they are.
///
/// ```
/// use body::pose_prior::PosePrior;
/// use body::N_DOF;
///
/// let prior = PosePrior::builtin();
/// let standing = vec![0.0; N_DOF];
/// let close = prior.reconstruct(&prior.project(&standing, 20));
/// assert!(prior.mahalanobis_squared(prior.mean_rad()) < prior.mahalanobis_squared(&standing));
/// assert_eq!(close.len(), N_DOF);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct PosePrior {
    notice: String,
    n_poses: u64,
    frame_rate_hz: f64,
    mean: DVector<f64>,
    range: Vec<[f64; 2]>,
    sample_covariance: DMatrix<f64>,
    covariance: DMatrix<f64>,
    covariance_factor: DMatrix<f64>,
    /// Columns are principal directions, the widest first.
    components: DMatrix<f64>,
    component_sd: Vec<f64>,
    step_covariance: DMatrix<f64>,
    step_factor: DMatrix<f64>,
}

impl PosePrior {
    /// The prior that the crate carries, learned from the CMU motion capture database: see [`PosePrior::notice`].
    ///
    /// # Panics
    /// Never: a test loads the file.
    #[must_use]
    pub fn builtin() -> Self {
        Self::from_bytes(include_bytes!("../assets/umbra-prior.bin")).expect("the crate's own prior is sound")
    }

    /// Learns from `motions` and, where `config` says so, their mirror images. `notice` says whose they are.
    ///
    /// # Errors
    /// [`LearnPriorError`] for too few poses or motions of different rates.
    ///
    /// # Panics
    /// When the configuration makes no covariance positive definite (floors of zero, say).
    pub fn learn(
        motions: &[Motion],
        notice: &str,
        config: &PosePriorConfig,
    ) -> Result<Self, LearnPriorError> {
        let n_poses: usize = motions.iter().map(|motion| motion.poses.len()).sum();
        if n_poses < N_DOF {
            return Err(LearnPriorError::TooFewPoses { n_poses });
        }
        let frame_rate_hz = motions[0].frame_rate_hz;
        if let Some(other) = motions.iter().find(|motion| motion.frame_rate_hz != frame_rate_hz) {
            let (motion, found) = (other.name.clone(), other.frame_rate_hz);
            return Err(LearnPriorError::FrameRate { motion, found, expected: frame_rate_hz });
        }
        let with_mirror =
            |motion: &Motion| std::iter::once(motion.clone()).chain(config.mirror.then(|| motion.mirrored()));
        let seen: Vec<Motion> = motions.iter().flat_map(with_mirror).collect();
        let poses: Vec<DVector<f64>> = seen
            .iter()
            .flat_map(|motion| &motion.poses)
            .map(|pose| DVector::from_column_slice(&pose.angles))
            .collect();
        let mean = poses.iter().sum::<DVector<f64>>() / poses.len() as f64;
        let sample_covariance = second_moment(poses.iter().map(|pose| pose - &mean));
        let covariance = regularised(&sample_covariance, config.shrinkage, |_| config.angle_floor_rad);

        let largest_change = config.jump_rad_per_sec / frame_rate_hz;
        let steps = seen
            .iter()
            .flat_map(|motion| motion.poses.windows(2).map(|pair| step(&pair[0], &pair[1])))
            .filter(|step| step.rows(6, N_DOF).amax() <= largest_change);
        // About zero, not about the mean: a walker's mean step is movement, too.
        let step_covariance = regularised(&second_moment(steps), config.shrinkage, |coordinate| {
            if coordinate < 3 { config.step_floor_m } else { config.step_floor_rad }
        });
        let range = (0..N_DOF).map(|dof| {
            let angles = poses.iter().map(|pose| pose[dof]);
            [angles.clone().fold(f64::INFINITY, f64::min), angles.fold(f64::NEG_INFINITY, f64::max)]
        });
        let file = PriorFile {
            notice: notice.to_owned(),
            n_poses: n_poses as u64,
            frame_rate_hz,
            mean_rad: mean.as_slice().to_vec(),
            range_rad: range.collect(),
            sample_covariance: lower_triangle(&sample_covariance),
            covariance: lower_triangle(&covariance),
            step_covariance: lower_triangle(&step_covariance),
        };
        Ok(Self::from_file(file).expect("floors of more than zero make covariances positive definite"))
    }

    /// Source and terms of the recordings it was learned from.
    #[must_use]
    pub fn notice(&self) -> &str {
        &self.notice
    }

    /// Poses it was learned from, mirror images not counted.
    #[must_use]
    pub fn n_poses(&self) -> u64 {
        self.n_poses
    }

    /// Steps a second that the step covariance is for.
    #[must_use]
    pub fn frame_rate_hz(&self) -> f64 {
        self.frame_rate_hz
    }

    /// Mean angles, `[n_dof]`, radians.
    #[must_use]
    pub fn mean_rad(&self) -> &[f64] {
        self.mean.as_slice()
    }

    /// Standard deviation of each angle, `[n_dof]`, radians, with the floor that regularisation adds.
    #[must_use]
    pub fn sd_rad(&self) -> Vec<f64> {
        self.covariance.diagonal().map(f64::sqrt).as_slice().to_vec()
    }

    /// Least and largest angle seen, `[n_dof]`, radians.
    #[must_use]
    pub fn range_rad(&self) -> &[[f64; 2]] {
        &self.range
    }

    /// Regularised covariance of the angles, `[n_dof, n_dof]`, radians².
    #[must_use]
    pub fn covariance(&self) -> &DMatrix<f64> {
        &self.covariance
    }

    /// `(θ − mean)ᵀ covariance⁻¹ (θ − mean)`: minus twice the log density of the angles but for a constant. Its mean over
    /// draws from the prior is [`N_DOF`].
    ///
    /// # Panics
    /// When there are not [`N_DOF`] angles.
    #[must_use]
    pub fn mahalanobis_squared(&self, angles: &[f64]) -> f64 {
        let away = DVector::from_column_slice(angles) - &self.mean;
        let white = self.covariance_factor.solve_lower_triangular(&away);
        white.expect("the diagonal of a Cholesky factor is positive").norm_squared()
    }

    /// Standard deviations along the principal directions, radians, the widest first.
    #[must_use]
    pub fn component_sd_rad(&self) -> &[f64] {
        &self.component_sd
    }

    /// Coordinates of the angles along the first `n_components` principal directions, in standard deviations.
    ///
    /// # Panics
    /// When there are not [`N_DOF`] angles or `n_components` exceeds [`N_DOF`].
    #[must_use]
    pub fn project(&self, angles: &[f64], n_components: usize) -> Vec<f64> {
        let away = DVector::from_column_slice(angles) - &self.mean;
        let along = self.components.columns(0, n_components).tr_mul(&away);
        along.iter().zip(&self.component_sd).map(|(length, sd)| length / sd).collect()
    }

    /// The angles at `coordinates` along as many principal directions, in standard deviations; undoes
    /// [`PosePrior::project`] for angles in their span. Joint limits are not applied.
    ///
    /// # Panics
    /// When there are more than [`N_DOF`] coordinates.
    #[must_use]
    pub fn reconstruct(&self, coordinates: &[f64]) -> Vec<f64> {
        let lengths = coordinates.iter().zip(&self.component_sd).map(|(coordinate, sd)| coordinate * sd);
        let lengths = DVector::from_iterator(coordinates.len(), lengths);
        (&self.mean + self.components.columns(0, coordinates.len()) * lengths).as_slice().to_vec()
    }

    /// Mean square of steps from frame to frame, [`N_STEP`] × [`N_STEP`], metres and radians.
    #[must_use]
    pub fn step_covariance(&self) -> &DMatrix<f64> {
        &self.step_covariance
    }

    /// Lower triangular L with `L Lᵀ` = [`PosePrior::step_covariance`]: L times standard normal numbers is a step.
    #[must_use]
    pub fn step_factor(&self) -> &DMatrix<f64> {
        &self.step_factor
    }
}

/// The step from `from` to `to` in the coordinates of [`N_STEP`].
#[must_use]
pub fn step(from: &Pose, to: &Pose) -> DVector<f64> {
    let pelvis_from_world = from.root_orientation.inverse();
    let moved = pelvis_from_world * (to.root_position - from.root_position);
    let turned = pelvis_from_world * to.root_orientation;
    let turned = if turned.w < 0.0 { -turned } else { turned }.to_scaled_axis();
    let angles = to.angles.iter().zip(&from.angles).map(|(to, from)| to - from);
    DVector::from_iterator(N_STEP, moved.to_array().into_iter().chain(turned.to_array()).chain(angles))
}

/// `from` after `step`: undoes [`step()`], but for joint limits, inside which it ends.
///
/// # Panics
/// When the step has not [`N_STEP`] coordinates.
#[must_use]
pub fn stepped(from: &Pose, step: &[f64]) -> Pose {
    assert_eq!(step.len(), N_STEP, "a step of {} coordinates for {N_STEP}", step.len());
    let vector = |at: usize| glam::DVec3::new(step[at], step[at + 1], step[at + 2]);
    let angles = from.angles.iter().zip(&step[6..]).zip(Skeleton::human().dofs());
    Pose {
        root_position: from.root_position + from.root_orientation * vector(0),
        root_orientation: (from.root_orientation * glam::DQuat::from_scaled_axis(vector(3))).normalize(),
        angles: angles.map(|((angle, change), dof)| dof.clamp(angle + change)).collect(),
    }
}

/// Mean of `x xᵀ`.
fn second_moment(vectors: impl Iterator<Item = DVector<f64>>) -> DMatrix<f64> {
    let mut sum: Option<DMatrix<f64>> = None;
    let mut count = 0.0;
    for vector in vectors {
        let sum = sum.get_or_insert_with(|| DMatrix::zeros(vector.len(), vector.len()));
        sum.ger(1.0, &vector, &vector, 1.0);
        count += 1.0;
    }
    sum.map_or_else(|| DMatrix::zeros(N_STEP, N_STEP), |sum| sum / count)
}

/// Correlations shrunk by `shrinkage`, and the square of `floor` added to each variance.
fn regularised(covariance: &DMatrix<f64>, shrinkage: f64, floor: impl Fn(usize) -> f64) -> DMatrix<f64> {
    DMatrix::from_fn(covariance.nrows(), covariance.ncols(), |i, j| {
        if i == j { covariance[(i, i)] + floor(i).powi(2) } else { (1.0 - shrinkage) * covariance[(i, j)] }
    })
}

/// Eigenvectors as columns and square roots of the eigenvalues, largest first; the largest entry of each is positive.
fn principal_components(covariance: &DMatrix<f64>) -> (DMatrix<f64>, Vec<f64>) {
    /// Directions that do not vary get this standard deviation, so that coordinates along them stay finite. Radians.
    const SMALLEST_SD: f64 = 1e-6;
    let eigen = SymmetricEigen::new(covariance.clone());
    let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let columns: Vec<DVector<f64>> = order
        .iter()
        .map(|&index| {
            let column = eigen.eigenvectors.column(index);
            column * column[column.iamax()].signum()
        })
        .collect();
    let sd = order.iter().map(|&index| eigen.eigenvalues[index].max(0.0).sqrt().max(SMALLEST_SD)).collect();
    (DMatrix::from_columns(&columns), sd)
}

#[cfg(test)]
mod tests;
