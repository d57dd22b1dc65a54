//! Normal equations of one frame, and what is left of them for the shape when the pose is taken out.

use nalgebra::{Cholesky, DMatrix, DMatrixView, DVector, DVectorView, Dyn};

use super::figure::N_POSE;

/// Largest change of an angle and of the pelvis's position (metres) in one step.
const LARGEST_ANGLE_STEP: f64 = 0.25;
const LARGEST_ROOT_STEP_M: f64 = 0.15;
/// Damping of a step, relative to the curvature.
const DAMPING: f64 = 1e-3;

/// The normal equations of one frame: pose and, shared by all frames, shape with clothing.
pub(super) struct FrameEquations {
    pub pose_pose: DMatrix<f64>,
    pub pose_shape: DMatrix<f64>,
    pub shape_shape: DMatrix<f64>,
    pub pose_gradient: DVector<f64>,
    pub shape_gradient: DVector<f64>,
    pub misfit_px: f64,
    pub lowest_m: f64,
    /// Minus the log posterior of pose and mask, up to a constant.
    pub cost: f64,
}

/// The equations of the shape alone, and how each pose follows it.
pub(super) struct Reduced {
    pub curvature: DMatrix<f64>,
    pub gradient: DVector<f64>,
    pub frames: Vec<ReducedFrame>,
}

pub(super) struct ReducedFrame {
    /// Step of the pose while the shape stays.
    pub own_step: DVector<f64>,
    /// What a step of the shape takes away from it.
    pub shape_response: DMatrix<f64>,
    pub misfit_px: f64,
    pub lowest_m: f64,
}

impl Reduced {
    pub fn solve(&self) -> DVector<f64> {
        let factor: Cholesky<f64, Dyn> =
            Cholesky::new(self.curvature.clone()).expect("the prior makes it positive definite");
        -factor.solve(&self.gradient)
    }
}

impl ReducedFrame {
    pub fn of(frame: FrameEquations) -> Self {
        let mut damped = frame.pose_pose;
        for k in 0..N_POSE {
            damped[(k, k)] += DAMPING * damped[(k, k)] + 1e-6;
        }
        let factor = Cholesky::new(damped).expect("the prior on joint angles makes it positive definite");
        Self {
            own_step: -factor.solve(&frame.pose_gradient),
            shape_response: factor.solve(&frame.pose_shape),
            misfit_px: frame.misfit_px,
            lowest_m: frame.lowest_m,
        }
    }

    pub fn pose_step(&self, shape_step: &DVector<f64>) -> DVector<f64> {
        let mut step = &self.own_step - &self.shape_response * shape_step;
        let angle = step.rows(3, N_POSE - 3).amax() / LARGEST_ANGLE_STEP;
        let root = step.rows(0, 3).amax() / LARGEST_ROOT_STEP_M;
        let excess = angle.max(root);
        if excess > 1.0 {
            step /= excess;
        }
        step
    }
}

/// Collects residuals with their derivatives, and sums the normal equations.
pub(super) struct Accumulator {
    n_shared: usize,
    /// Derivatives by pose and shape times the root of the weight, residual after residual.
    rows: Vec<f64>,
    residuals: Vec<f64>,
    row: Vec<f64>,
    /// What the prior adds.
    pub pose_pose: DMatrix<f64>,
    pub pose_gradient: DVector<f64>,
    misfit: [f64; 2],
    pub lowest_m: f64,
    pub cost: f64,
}

impl Accumulator {
    pub fn new(n_shared: usize) -> Self {
        Self {
            n_shared,
            rows: Vec::new(),
            residuals: Vec::new(),
            row: vec![0.0; N_POSE + n_shared],
            pose_pose: DMatrix::zeros(N_POSE, N_POSE),
            pose_gradient: DVector::zeros(N_POSE),
            misfit: [0.0; 2],
            lowest_m: 0.0,
            cost: 0.0,
        }
    }

    /// The derivatives of the next residual by pose and shape, zero.
    pub fn rows(&mut self) -> (&mut [f64], &mut [f64]) {
        self.row.fill(0.0);
        self.row.split_at_mut(N_POSE)
    }

    /// Adds the residual whose derivatives are in the rows. Residuals far beyond the gate lose their say: the
    /// weights of `[Geman1987]`.
    pub fn add(&mut self, residual: f64, weight: f64, gate: f64) {
        let root = weight.sqrt() / (1.0 + (residual / gate).powi(2));
        self.cost += 0.5 * weight * residual.powi(2) / (1.0 + (residual / gate).powi(2));
        self.rows.extend(self.row.iter().map(|derivative| root * derivative));
        self.residuals.push(root * residual);
    }

    pub fn note_misfit(&mut self, distance_px: f64, weight: f64, gate_px: f64) {
        self.misfit[0] += weight;
        self.misfit[1] += weight * distance_px.abs().min(gate_px).powi(2);
    }

    pub fn finish(self) -> FrameEquations {
        let n = N_POSE + self.n_shared;
        let rows = DMatrixView::from_slice(&self.rows, n, self.residuals.len());
        let products = rows * rows.transpose();
        let gradient = rows * DVectorView::from_slice(&self.residuals, self.residuals.len());
        let [weight, sum] = self.misfit;
        FrameEquations {
            pose_pose: self.pose_pose + products.view((0, 0), (N_POSE, N_POSE)),
            pose_shape: products.view((0, N_POSE), (N_POSE, self.n_shared)).into_owned(),
            shape_shape: products.view((N_POSE, N_POSE), (self.n_shared, self.n_shared)).into_owned(),
            pose_gradient: self.pose_gradient + gradient.rows(0, N_POSE),
            shape_gradient: gradient.rows(N_POSE, self.n_shared).into_owned(),
            misfit_px: if weight > 0.0 { (sum / weight).sqrt() } else { f64::INFINITY },
            lowest_m: self.lowest_m,
            cost: self.cost,
        }
    }
}
