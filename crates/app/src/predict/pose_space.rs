//! Few coordinates for the poses of an activity: principal components, measured by how far they move the joints.

use body::pose::forward_kinematics;
use body::{JointId, RestJoints, Skeleton};
use glam::DVec3;
use nalgebra::{Cholesky, DMatrix, DVector, SymmetricEigen};
use serde::{Deserialize, Serialize};

use super::viewed::{ROW_LEN, ViewedPose};

/// Poses at which joints are moved to see what an angle does.
const MEASURED_POSES: usize = 40;
/// An angle that moves no joint counts as one that moves all joints by this much a radian, metres.
const LEAST_METRES_PER_RAD: f64 = 0.02;
/// Step of the difference quotients, radians.
const STEP_RAD: f64 = 1e-4;

/// Poses (tilt and joint angles) as a mean and a sum of principal components, coordinates in standard deviations.
///
/// Components are those of joint positions: the angles are turned into metres by the mean of JᵀJ, J being how the joints
/// move with the angles. A twist that nobody can see costs nothing to lose, a knee much.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseSpace {
    mean: Vec<f64>,
    /// Columns of [`ROW_LEN`] numbers, one standard deviation long, one a component.
    basis: Vec<Vec<f64>>,
    /// Rows of the left inverse.
    inverse: Vec<Vec<f64>>,
}

impl PoseSpace {
    /// The first `n_components` components of `poses` of people with joints `rest`.
    ///
    /// # Panics
    /// When there are no poses, or more components than a pose has numbers.
    pub fn fit(poses: &[ViewedPose], rest: &RestJoints, n_components: usize) -> Self {
        assert!(!poses.is_empty(), "no poses");
        assert!(n_components <= ROW_LEN, "{n_components} components of {ROW_LEN} numbers");
        let rows: Vec<DVector<f64>> = poses.iter().map(|pose| DVector::from_vec(pose.to_row())).collect();
        let n = rows.len() as f64;
        let mean = rows.iter().fold(DVector::zeros(ROW_LEN), |sum, row| sum + row) / n;
        // metric = L Lᵀ; Lᵀ(row − mean) is in metres.
        let factor = Cholesky::new(metric(poses, rest)).expect("the metric has a positive floor").l();
        let to_metres = factor.transpose();
        let scatter = rows.iter().fold(DMatrix::zeros(ROW_LEN, ROW_LEN), |sum, row| {
            let metres = &to_metres * (row - &mean);
            sum + &metres * metres.transpose()
        }) / n;
        let eigen = SymmetricEigen::new(scatter);
        let mut order: Vec<usize> = (0..ROW_LEN).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let (mut basis, mut inverse) = (Vec::new(), Vec::new());
        for &component in &order[..n_components] {
            let direction = eigen.eigenvectors.column(component).into_owned();
            let sd = eigen.eigenvalues[component].max(1e-12).sqrt();
            let column =
                to_metres.solve_upper_triangular(&direction).expect("a Cholesky factor is regular") * sd;
            basis.push(column.as_slice().to_vec());
            inverse.push((to_metres.tr_mul(&direction) / sd).as_slice().to_vec());
        }
        Self { mean: mean.as_slice().to_vec(), basis, inverse }
    }

    /// Whether lengths and numbers are those of a space, as after reading a file.
    pub(super) fn is_sound(&self) -> bool {
        let rows = || std::iter::once(&self.mean).chain(&self.basis).chain(&self.inverse);
        self.basis.len() == self.inverse.len()
            && rows().all(|row| row.len() == ROW_LEN && row.iter().all(|value| value.is_finite()))
    }

    /// Number of coordinates.
    pub fn dim(&self) -> usize {
        self.basis.len()
    }

    /// The coordinates of a pose, `[dim]`, standard deviations.
    pub fn encode(&self, pose: &ViewedPose) -> Vec<f64> {
        let row = pose.to_row();
        let along = |inverse: &Vec<f64>| {
            inverse.iter().zip(&row).zip(&self.mean).map(|((i, r), mean)| i * (r - mean)).sum()
        };
        self.inverse.iter().map(along).collect()
    }

    /// Coordinates, then cosine and sine of the heading: what experts predict, [dim + 2].
    pub fn point(&self, pose: &ViewedPose) -> Vec<f64> {
        let mut point = self.encode(pose);
        point.extend([pose.heading_rad.cos(), pose.heading_rad.sin()]);
        point
    }

    /// The pose at a [`point`](Self::point), or near where cosine and sine are not those of one angle.
    pub fn pose_at(&self, point: &[f64]) -> ViewedPose {
        self.decode(bme::heading_of(point), &point[..self.dim()])
    }

    /// The pose at `coordinates`, `[dim]`, inside the joint limits, facing `heading_rad`.
    ///
    /// # Panics
    /// When there are not [`Self::dim`] coordinates.
    pub fn decode(&self, heading_rad: f64, coordinates: &[f64]) -> ViewedPose {
        assert_eq!(coordinates.len(), self.dim(), "{} coordinates", coordinates.len());
        let mut row = self.mean.clone();
        for (coordinate, column) in coordinates.iter().zip(&self.basis) {
            row.iter_mut().zip(column).for_each(|(value, c)| *value += coordinate * c);
        }
        ViewedPose::from_row(heading_rad, &row)
    }
}

/// Mean over poses and joints of JᵀJ, J being the motion of a joint (pelvis fixed) with tilt and angles, metres² a radian².
fn metric(poses: &[ViewedPose], rest: &RestJoints) -> DMatrix<f64> {
    let step = poses.len().div_ceil(MEASURED_POSES);
    let measured: Vec<&ViewedPose> = poses.iter().step_by(step).collect();
    let joints = |row: &[f64]| -> Vec<DVec3> {
        let tilt_rad = DVec3::from_slice(row);
        let viewed = ViewedPose { heading_rad: 0.0, tilt_rad, angles: row[3..].to_vec() };
        let frames = forward_kinematics(Skeleton::human(), rest, &viewed.pose(-DVec3::X, DVec3::ZERO));
        JointId::all().map(|joint| frames[joint.index()].translation).collect()
    };
    let mut metric = DMatrix::identity(ROW_LEN, ROW_LEN) * LEAST_METRES_PER_RAD.powi(2);
    for pose in &measured {
        let row = pose.to_row();
        let at = joints(&row);
        let mut jacobian = DMatrix::zeros(3 * at.len(), ROW_LEN);
        for column in 0..ROW_LEN {
            let mut moved = row.clone();
            moved[column] += STEP_RAD;
            for (joint, (to, from)) in joints(&moved).iter().zip(&at).enumerate() {
                let velocity = (*to - *from) / STEP_RAD;
                velocity
                    .to_array()
                    .iter()
                    .enumerate()
                    .for_each(|(axis, v)| jacobian[(3 * joint + axis, column)] = *v);
            }
        }
        metric += jacobian.tr_mul(&jacobian) / (at.len() * measured.len()) as f64;
    }
    metric
}
