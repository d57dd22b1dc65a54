//! Principal components of shape on the template.

use glam::DVec3;
use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::{BuildError, SurfaceFit};
use crate::io::bodies::BodiesData;

/// Mean, directions in metres per standard deviation, and what stature tells of the scores.
pub(super) struct ShapeSpace {
    pub mean_vertices: Vec<DVec3>,
    pub vertex_basis: Vec<Vec<DVec3>>,
    /// The joints of the population and then the heels.
    pub mean_joints: Vec<DVec3>,
    pub joint_basis: Vec<Vec<DVec3>>,
    /// Share of the variance of the vertices, largest first.
    pub variance_shares: Vec<f64>,
    /// Of all bodies, of women, of men.
    pub stature_lines: [StatureLine; 3],
}

/// Regression of the scores on stature within a group: the conditional mean of a Gaussian.
pub(super) struct StatureLine {
    pub mean_stature_m: f64,
    pub mean_scores: Vec<f64>,
    pub scores_per_m: Vec<f64>,
}

impl ShapeSpace {
    pub fn of(
        data: &BodiesData,
        fit: &SurfaceFit,
        heels: [u32; 2],
        n_components: usize,
    ) -> Result<Self, BuildError> {
        let directions: Vec<Vec<DVec3>> = data.basis.iter().map(|direction| fit.apply(direction)).collect();
        let joints_of = |joints: &[DVec3], vertices: &[DVec3]| -> Vec<DVec3> {
            joints.iter().copied().chain(heels.map(|heel| vertices[heel as usize])).collect()
        };
        let joint_directions: Vec<Vec<DVec3>> = data
            .joint_basis
            .iter()
            .zip(&data.basis)
            .map(|(joints, vertices)| joints_of(joints, vertices))
            .collect();

        let (n_bodies, n_basis) = (data.coefficients.len(), data.basis.len());
        let coefficients = DMatrix::from_fn(n_bodies, n_basis, |body, k| data.coefficients[body][k]);
        let mean_coefficients = coefficients.row_mean();
        let mut centred = coefficients;
        centred.row_iter_mut().for_each(|mut row| row -= &mean_coefficients);
        // c = R u with u white, R the symmetric root of the covariance; then the components are the axes of R G R.
        let covariance = centred.tr_mul(&centred) / n_bodies as f64;
        let root = symmetric_root(covariance);
        let gram = DMatrix::from_fn(n_basis, n_basis, |i, j| inner(&directions[i], &directions[j]));
        let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(&root * gram * &root);
        let mut order: Vec<usize> = (0..n_basis).collect();
        order.sort_by(|&a, &b| eigenvalues[b].total_cmp(&eigenvalues[a]));
        let total = eigenvalues.sum();
        let rank = order.iter().filter(|&&k| eigenvalues[k] > 1e-12 * total).count();
        if rank < n_components || n_bodies <= n_components {
            return Err(BuildError::TooFewBodies { found: rank.min(n_bodies), wanted: n_components });
        }
        order.truncate(n_components);

        let (mut vertex_basis, mut joint_basis, mut scores) = (Vec::new(), Vec::new(), Vec::new());
        for &k in &order {
            let mut steps: DVector<f64> = &root * eigenvectors.column(k);
            let mut component = blend(&directions, &steps);
            if component.iter().map(|step| step.y).sum::<f64>() < 0.0 {
                steps.neg_mut(); // positive scores are taller
                component.iter_mut().for_each(|step| *step = -*step);
            }
            // The score of a body is its projection on the component in the metric of the vertices.
            let along: Vec<f64> = directions.iter().map(|d| inner(d, &component) / eigenvalues[k]).collect();
            scores.push(&centred * DVector::from_vec(along));
            joint_basis.push(blend(&joint_directions, &steps));
            vertex_basis.push(component);
        }
        let mean_steps = mean_coefficients.transpose();
        let mean_vertices = sum(&fit.apply(&data.mean), &blend(&directions, &mean_steps));
        let mean_joints =
            sum(&joints_of(&data.mean_joints, &data.mean), &blend(&joint_directions, &mean_steps));
        let statures = statures_m(&mean_vertices, &vertex_basis, &scores);
        let line = |is_in: &dyn Fn(usize) -> bool| StatureLine::of(&scores, &statures, is_in);
        Ok(Self {
            stature_lines: [line(&|_| true), line(&|b| data.is_female[b]), line(&|b| !data.is_female[b])],
            variance_shares: order.iter().map(|&k| eigenvalues[k] / total).collect(),
            mean_vertices,
            vertex_basis,
            mean_joints,
            joint_basis,
        })
    }
}

impl StatureLine {
    fn of(scores: &[DVector<f64>], statures_m: &[f64], is_in: &dyn Fn(usize) -> bool) -> Self {
        let group: Vec<usize> = (0..statures_m.len()).filter(|&body| is_in(body)).collect();
        let mean = |value: &dyn Fn(usize) -> f64| {
            group.iter().map(|&body| value(body)).sum::<f64>() / group.len() as f64
        };
        let mean_stature_m = mean(&|body| statures_m[body]);
        let variance = mean(&|body| (statures_m[body] - mean_stature_m).powi(2));
        let slope =
            |score: &DVector<f64>| mean(&|body| score[body] * (statures_m[body] - mean_stature_m)) / variance;
        Self {
            mean_stature_m,
            mean_scores: scores.iter().map(|score| mean(&|body| score[body])).collect(),
            scores_per_m: scores.iter().map(slope).collect(),
        }
    }
}

fn symmetric_root(matrix: DMatrix<f64>) -> DMatrix<f64> {
    let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(matrix);
    let roots = eigenvalues.map(|value| value.max(0.0).sqrt());
    &eigenvectors * DMatrix::from_diagonal(&roots) * eigenvectors.transpose()
}

fn inner(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum()
}

fn sum(a: &[DVec3], b: &[DVec3]) -> Vec<DVec3> {
    a.iter().zip(b).map(|(a, b)| *a + *b).collect()
}

fn blend(directions: &[Vec<DVec3>], steps: &DVector<f64>) -> Vec<DVec3> {
    let mut sum = vec![DVec3::ZERO; directions[0].len()];
    for (direction, &step) in directions.iter().zip(steps.iter()) {
        sum.iter_mut().zip(direction).for_each(|(point, along)| *point += step * *along);
    }
    sum
}

/// Height from the lowest to the highest vertex of each body, from its scores.
fn statures_m(mean: &[DVec3], basis: &[Vec<DVec3>], scores: &[DVector<f64>]) -> Vec<f64> {
    let heights = |body: usize, vertex: usize| {
        let steps = basis.iter().zip(scores).map(|(direction, score)| direction[vertex].y * score[body]);
        mean[vertex].y + steps.sum::<f64>()
    };
    let stature = |body: usize| {
        let all = (0..mean.len()).map(|vertex| heights(body, vertex));
        let (low, high) =
            all.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), y| (low.min(y), high.max(y)));
        high - low
    };
    (0..scores[0].len()).map(stature).collect()
}
