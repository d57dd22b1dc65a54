//! Coordinates of a pose and what is known of them before a mask is seen: free joint angles, their principal components, or
//! the latent poses of an activity.

use std::sync::Arc;

use body::pose_prior::PosePrior;
use body::{JointId, N_DOF, Skeleton};
use nalgebra::{DMatrix, DVector};

use super::latent_joints::LatentJoints;
use super::state::RIGID_DIM;
use crate::config::{Motion, TrackParams};
use crate::predict::LatentPoses;

/// Rate for which pose models give their steps.
pub const STEP_RATE_HZ: f64 = 60.0;

/// Coordinates of a pose: the joint angles themselves, or fewer numbers from which they follow.
///
/// # Laws
/// - `latent_from_angles` undoes `angles_from_latent` for clamped coordinates, up to the joint limits; of latent poses, it gives
///   coordinates of nearly the same angles.
/// - `clamp` twice is `clamp` once.
/// - `angles_from_latent` gives angles within the joint limits.
pub trait PoseModel: Send + Sync {
    /// Number of coordinates, at most [`N_DOF`].
    fn dim(&self) -> usize;
    /// The joint angles, `[n_dof]`, radians, of coordinates `[dim]`.
    fn angles_from_latent(&self, latent: &[f64], angles: &mut [f64]);
    /// The coordinates whose joint angles come nearest to `angles`.
    fn latent_from_angles(&self, angles: &[f64], latent: &mut [f64]);
    /// Brings coordinates back to where the model holds.
    fn clamp(&self, latent: &mut [f64]);
    /// ln p(pose) up to a constant.
    fn log_prior(&self, latent: &[f64]) -> f64;
    /// Standard deviation of each coordinate's change within a sixtieth of a second, `[dim]`.
    fn step_sd(&self) -> &[f64];
    /// Standard deviation of the pelvis's change in that time: position (metres) and rotation (radians), pelvis frame.
    fn rigid_step_sd(&self) -> [f64; RIGID_DIM];
    /// Coordinates that belong together: trunk and head, each arm, each leg. Empty where coordinates move the whole body.
    fn parts(&self) -> &[Vec<usize>] {
        &[]
    }
    /// The joint angles, `[n_dof]`, radians, of an upright person seen for the first time.
    fn mean_angles(&self) -> &[f64];
    /// How coordinates are expected to change within a sixtieth of a second, `[dim]`, and with what standard deviation; `false`
    /// where nothing but [`step_sd`](Self::step_sd) is known.
    fn expected_step(&self, _latent: &[f64], _step: &mut [f64], _sd: &mut [f64]) -> bool {
        false
    }
}

/// The pose model that the settings ask for, over the poses of `prior`, or over those of `latent` where it is asked for.
///
/// # Errors
/// When `latent` gives none.
pub fn pose_model(
    prior: &PosePrior,
    latent: impl FnOnce() -> anyhow::Result<LatentPoses>,
    params: &TrackParams,
) -> anyhow::Result<Arc<dyn PoseModel>> {
    Ok(match params.motion {
        Motion::Any => Arc::new(FreeJoints::new(prior, params.widening())),
        Motion::Captured => Arc::new(JointComponents::new(prior, params.components as usize)),
        Motion::Latent => Arc::new(LatentJoints::new(latent()?, prior)),
    })
}

/// Every joint angle is a coordinate of its own, within hard limits and under one Gaussian. For motions that no
/// training showed: a space of gaits cannot raise an arm.
pub struct FreeJoints {
    mean: Vec<f64>,
    precision: DMatrix<f64>,
    step_sd: Vec<f64>,
    parts: Vec<Vec<usize>>,
}

/// Standard deviation of the angles of a clavicle, for [`Widening::frees_clavicles`]. The recordings hang the arms on the trunk, so that clavicles hardly move
/// in them; in life they lift a raised arm by up to half a radian. Freeing them lowers the joint error on the bundled real
/// clip by 10 mm.
const CLAVICLE_SD_RAD: f64 = 0.25;

/// The pelvis of somebody of whom nothing is known moves so far within a sixtieth of a second, metres and radians.
const ANY_RIGID_STEP_SD: [f64; RIGID_DIM] = [0.012, 0.012, 0.012, 0.02, 0.02, 0.02];

/// By how much a prior is widened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Widening {
    /// Factor on all standard deviations of poses.
    pub factor: f64,
    /// Standard deviation added (in square) to each angle, as a share of the range between its limits.
    pub least_sd: f64,
    /// Least standard deviation of each angle's step from frame to frame, likewise.
    pub least_step: f64,
    /// Whether clavicles may lift a raised arm although the recordings hardly move them.
    pub frees_clavicles: bool,
}

impl FreeJoints {
    /// The model of a learned prior, with a wider Gaussian: recordings of gait know little of what else a body can do, and
    /// some joints hardly move in them.
    pub fn new(prior: &PosePrior, widening: Widening) -> Self {
        let mut covariance = prior.covariance() * widening.factor.powi(2);
        let mut step_sd = Vec::with_capacity(N_DOF);
        for (i, dof) in Skeleton::human().dofs().iter().enumerate() {
            let range = dof.limits_rad[1] - dof.limits_rad[0];
            let is_freed = widening.frees_clavicles
                && [JointId::LEFT_CLAVICLE, JointId::RIGHT_CLAVICLE].contains(&dof.joint);
            let least_sd = if is_freed { CLAVICLE_SD_RAD } else { widening.least_sd * range };
            covariance[(i, i)] += least_sd.powi(2);
            step_sd.push(
                prior.step_covariance()[(RIGID_DIM + i, RIGID_DIM + i)]
                    .sqrt()
                    .max(widening.least_step * range),
            );
        }
        let precision = covariance.try_inverse().expect("the covariance of a prior is positive definite");
        Self { mean: prior.mean_rad().to_vec(), precision, step_sd, parts: joint_parts() }
    }

    /// Mean of the joint angles, `[n_dof]`, radians.
    pub fn mean(&self) -> &[f64] {
        &self.mean
    }

    /// Inverse of their covariance.
    pub fn precision(&self) -> &DMatrix<f64> {
        &self.precision
    }
}

impl PoseModel for FreeJoints {
    fn dim(&self) -> usize {
        N_DOF
    }

    fn angles_from_latent(&self, latent: &[f64], angles: &mut [f64]) {
        angles.copy_from_slice(latent);
    }

    fn latent_from_angles(&self, angles: &[f64], latent: &mut [f64]) {
        latent.copy_from_slice(angles);
        self.clamp(latent);
    }

    fn clamp(&self, latent: &mut [f64]) {
        clamp_angles(latent);
    }

    /// -1/2 dᵀ P d, with the difference d from the mean and the precision P.
    fn log_prior(&self, latent: &[f64]) -> f64 {
        let mut difference = [0.0; N_DOF];
        for (i, d) in difference.iter_mut().enumerate() {
            *d = latent[i] - self.mean[i];
        }
        let mut product = [0.0; N_DOF];
        for (column, d) in self.precision.as_slice().as_chunks::<N_DOF>().0.iter().zip(difference) {
            for (i, sum) in product.iter_mut().enumerate() {
                *sum += column[i] * d;
            }
        }
        -0.5 * product.iter().zip(difference).map(|(p, d)| p * d).sum::<f64>()
    }

    fn step_sd(&self) -> &[f64] {
        &self.step_sd
    }

    fn rigid_step_sd(&self) -> [f64; RIGID_DIM] {
        ANY_RIGID_STEP_SD
    }

    fn parts(&self) -> &[Vec<usize>] {
        &self.parts
    }

    fn mean_angles(&self) -> &[f64] {
        &self.mean
    }
}

/// Joint angles by part of the body: trunk and head, left and right arm from the clavicle on, left and right leg.
fn joint_parts() -> Vec<Vec<usize>> {
    const ROOTS: [JointId; 4] =
        [JointId::LEFT_CLAVICLE, JointId::RIGHT_CLAVICLE, JointId::LEFT_HIP, JointId::RIGHT_HIP];
    let part_of = |mut joint: JointId| loop {
        if let Some(limb) = ROOTS.iter().position(|root| *root == joint) {
            return limb + 1;
        }
        match joint.parent() {
            Some(parent) => joint = parent,
            None => return 0,
        }
    };
    let mut parts = vec![Vec::new(); ROOTS.len() + 1];
    for (index, dof) in Skeleton::human().dofs().iter().enumerate() {
        parts[part_of(dof.joint)].push(index);
    }
    parts
}

/// Joint angles are a mean and a sum of principal components; coordinates are in standard deviations, none beyond
/// three.
pub struct JointComponents {
    mean: Vec<f64>,
    /// Orthogonal columns, one standard deviation long, [n_dof, k].
    basis: DMatrix<f64>,
    /// Left inverse of the basis, [k, n_dof].
    inverse: DMatrix<f64>,
    step_sd: Vec<f64>,
    rigid_step_sd: [f64; RIGID_DIM],
}

/// Least standard deviation of a step of the pelvis, metres or radians.
const LEAST_RIGID_STEP_SD: f64 = 0.006;

impl JointComponents {
    /// The first `k` components of a learned prior.
    ///
    /// # Panics
    /// When there are not so many.
    pub fn new(prior: &PosePrior, k: usize) -> Self {
        let mean = prior.mean_rad().to_vec();
        let column = |component: usize| {
            let mut unit = vec![0.0; component + 1];
            unit[component] = prior.component_sd_rad()[component];
            DVector::from_iterator(N_DOF, prior.reconstruct(&unit).iter().zip(&mean).map(|(a, m)| a - m))
        };
        let basis = DMatrix::from_columns(&(0..k).map(column).collect::<Vec<_>>());
        let inverse = (basis.transpose() * &basis).try_inverse().expect("components are independent")
            * basis.transpose();
        let steps = prior.step_covariance().view((RIGID_DIM, RIGID_DIM), (N_DOF, N_DOF));
        let latent_steps = &inverse * steps * inverse.transpose();
        let step_sd = latent_steps.diagonal().iter().map(|variance| variance.sqrt()).collect();
        Self { mean, basis, inverse, step_sd, rigid_step_sd: captured_rigid_step_sd(prior) }
    }
}

/// [`PoseModel::rigid_step_sd`] of those whose poses are known from `prior`.
pub(super) fn captured_rigid_step_sd(prior: &PosePrior) -> [f64; RIGID_DIM] {
    let per_step = prior.frame_rate_hz() / STEP_RATE_HZ;
    std::array::from_fn(|i| per_step * prior.step_covariance()[(i, i)].sqrt().max(LEAST_RIGID_STEP_SD))
}

/// Coordinates of [`JointComponents`] reach so far: what lies beyond is not a captured motion.
const MAX_SD: f64 = 3.0;

impl PoseModel for JointComponents {
    fn dim(&self) -> usize {
        self.basis.ncols()
    }

    fn angles_from_latent(&self, latent: &[f64], angles: &mut [f64]) {
        angles.copy_from_slice(&self.mean);
        for (column, z) in self.basis.column_iter().zip(latent) {
            for (angle, along) in angles.iter_mut().zip(column.iter()) {
                *angle += z * along;
            }
        }
        clamp_angles(angles);
    }

    fn latent_from_angles(&self, angles: &[f64], latent: &mut [f64]) {
        let offset = DVector::from_iterator(N_DOF, angles.iter().zip(&self.mean).map(|(a, m)| a - m));
        latent.copy_from_slice((&self.inverse * offset).as_slice());
        self.clamp(latent);
    }

    fn clamp(&self, latent: &mut [f64]) {
        for z in latent {
            *z = z.clamp(-MAX_SD, MAX_SD);
        }
    }

    fn log_prior(&self, latent: &[f64]) -> f64 {
        -0.5 * latent.iter().map(|z| z * z).sum::<f64>()
    }

    fn step_sd(&self) -> &[f64] {
        &self.step_sd
    }

    fn rigid_step_sd(&self) -> [f64; RIGID_DIM] {
        self.rigid_step_sd
    }

    fn mean_angles(&self) -> &[f64] {
        &self.mean
    }
}

/// Brings each angle inside its limits.
pub(super) fn clamp_angles(angles: &mut [f64]) {
    for (angle, dof) in angles.iter_mut().zip(Skeleton::human().dofs()) {
        *angle = dof.clamp(*angle);
    }
}
