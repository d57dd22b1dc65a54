//! One body for many frames: shape, clothing and the poses of all frames, adjusted together to the outlines of the masks.
//!
//! The unknowns are the leading shape coefficients, the thickness of the clothes, and for each frame its pose. They minimise
//! the distances between the rim of the body and the outline of the mask, both ways, under priors on shape, clothes and
//! joint angles and with the lowest sole on the floor. It is a bundle adjustment `[Triggs2000]`: in every Gauss-Newton step the
//! poses are eliminated (Schur complement), so that each change of the shape takes the poses along that suit it, and the curvature
//! that is left is that of the posterior over the shape.
//!
//! Deviation: the paper searches the coefficients with the annealed filter and re-estimates the pose for each hypothesis by
//! Levenberg-Marquardt ([`search`](mod@super::search) does that). Here one step does both for all frames, and gives the
//! covariance with it; the test is `fit::tests::a_known_body_is_found_again`.

use body::pose_prior::PosePrior;
use body::{Camera, N_DOF, Pose, Skeleton};
use glam::{DVec2, DVec3};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::equations::{Accumulator, FrameEquations, Reduced, ReducedFrame};
use super::figure::{Figure, Posed, Rest, stepped};
use super::rim::{OUTLINE_STEP_PX, RimPoint, Seen, rim};

/// Settings of an adjustment.
#[derive(Clone, Debug, PartialEq)]
pub struct AdjustConfig {
    /// Standard deviation of an outline's displacement, pixels,
    pub outline_sd_px: f64,
    /// and the length of outline over which it is one and the same.
    pub outline_correlation_px: f64,
    /// Distance at which a point of the outline loses its say, in the first step and in the last ones, pixels.
    pub gate_px: [f64; 2],
    /// Height of the lowest sole above the floor: mean and standard deviation, metres.
    pub floor_m: [f64; 2],
    /// Distance from the floor at which a foot no longer stands on it, metres.
    pub floor_gate_m: f64,
    /// Thickness of clothes: mean and standard deviation, metres.
    pub clothing_m: [f64; 2],
    /// Factor on the standard deviations of recorded joint angles,
    pub pose_widening: f64,
    /// and what is added to each, as a share of the range between its limits.
    pub pose_least_sd: f64,
    /// Steps.
    pub steps: usize,
}

impl Default for AdjustConfig {
    fn default() -> Self {
        Self {
            outline_sd_px: 1.5,
            outline_correlation_px: 15.0,
            gate_px: [12.0, 4.0],
            floor_m: [0.0, 0.012],
            floor_gate_m: 0.05,
            clothing_m: [0.0, 0.002],
            pose_widening: 1.3,
            pose_least_sd: 0.06,
            steps: 16,
        }
    }
}

/// A frame to be explained.
pub struct View<'a> {
    /// Its mask.
    pub seen: &'a Seen,
    /// Where to begin.
    pub pose: Pose,
    /// How much it counts, 1 as a rule.
    pub weight: f64,
}

/// What an adjustment comes to.
#[derive(Clone, Debug)]
pub struct Adjusted {
    /// Shape coefficients and, last, the thickness of the clothes in standard deviations of its prior.
    pub mean: DVector<f64>,
    /// Their covariance.
    pub covariance: DMatrix<f64>,
    /// Pose of each frame.
    pub poses: Vec<Pose>,
    /// Root mean square distance of rim and outline of each frame, pixels, each distance cut at the gate.
    pub misfit_px: Vec<f64>,
    /// Height of the lowest point of the body on each frame, metres.
    pub lowest_m: Vec<f64>,
}

/// Largest change of a shape coefficient in one step.
const LARGEST_SHAPE_STEP: f64 = 0.6;
/// Step at which the gate is at its last width, as a share of all steps.
const GATE_CLOSED_AT: f64 = 0.6;

/// Adjusts bodies to outlines.
pub struct Adjuster<'a> {
    figure: &'a Figure,
    camera: &'a Camera,
    config: AdjustConfig,
    pose_mean: DVector<f64>,
    pose_precision: DMatrix<f64>,
}

impl<'a> Adjuster<'a> {
    /// An adjuster of shapes of `figure` before `camera`, whose image is that of the masks, of people who hold themselves as in
    /// `prior`, or about so.
    pub fn new(figure: &'a Figure, camera: &'a Camera, prior: &PosePrior, config: AdjustConfig) -> Self {
        let mut covariance = prior.covariance() * config.pose_widening.powi(2);
        for (i, dof) in Skeleton::human().dofs().iter().enumerate() {
            covariance[(i, i)] += (config.pose_least_sd * (dof.limits_rad[1] - dof.limits_rad[0])).powi(2);
        }
        let precision = covariance.try_inverse().expect("the covariance of a prior is positive definite");
        Self::with_pose_prior(figure, camera, config, prior.mean_rad(), precision)
    }

    /// The same under another Gaussian prior over joint angles, mean `[n_dof]` (radians) and inverse covariance.
    pub fn with_pose_prior(
        figure: &'a Figure,
        camera: &'a Camera,
        config: AdjustConfig,
        mean_rad: &[f64],
        pose_precision: DMatrix<f64>,
    ) -> Self {
        Self { figure, camera, config, pose_mean: DVector::from_column_slice(mean_rad), pose_precision }
    }

    /// Adjusts shape and poses to `views`, from `shape` on.
    ///
    /// # Panics
    /// Without a view, or when `shape` has another length than the figure's.
    pub fn adjust(&self, views: &[View<'_>], shape: &[f64]) -> Adjusted {
        assert!(!views.is_empty(), "no view to adjust to");
        let n_shape = self.figure.n_shape();
        assert_eq!(shape.len(), n_shape, "{} coefficients for {n_shape}", shape.len());
        let mut mean = DVector::from_iterator(n_shape + 1, shape.iter().copied().chain([0.0]));
        let mut poses: Vec<Pose> = views.iter().map(|view| view.pose.clone()).collect();
        for step in 0..self.config.steps {
            let system = self.reduce(views, &poses, &mean, self.gate_px(step, self.config.steps));
            let mut shape_step = system.solve();
            let largest = shape_step.amax();
            if largest > LARGEST_SHAPE_STEP {
                shape_step *= LARGEST_SHAPE_STEP / largest;
            }
            for (pose, frame) in poses.iter_mut().zip(&system.frames) {
                *pose = stepped(pose, frame.pose_step(&shape_step).as_slice());
            }
            mean += shape_step;
        }
        self.assess(views, poses, mean)
    }

    /// How well a shape in these poses fits `views`, with the curvature of the posterior there. `mean` is that of [`Adjusted`].
    pub fn assess(&self, views: &[View<'_>], poses: Vec<Pose>, mean: DVector<f64>) -> Adjusted {
        let system = self.reduce(views, &poses, &mean, self.config.gate_px[1]);
        let covariance =
            system.curvature.clone().try_inverse().expect("the prior makes it positive definite");
        let misfit_px = system.frames.iter().map(|frame| frame.misfit_px).collect();
        let lowest_m = system.frames.iter().map(|frame| frame.lowest_m).collect();
        Adjusted { mean, covariance, poses, misfit_px, lowest_m }
    }

    /// The body that is adjusted.
    pub fn figure(&self) -> &'a Figure {
        self.figure
    }

    /// The camera that sees it.
    pub fn camera(&self) -> &'a Camera {
        self.camera
    }

    /// Settings.
    pub fn config(&self) -> &AdjustConfig {
        &self.config
    }

    /// Adjusts the pose alone, for a body of fixed shape: the pose and minus its log posterior, up to a constant.
    pub fn adjust_pose(&self, view: &View<'_>, rest: &Rest, steps: usize) -> (Pose, f64) {
        let pose = self.fit_pose(view, rest, steps);
        let last = self.frame_equations(view, &pose, rest, self.config.clothing_m[0], self.config.gate_px[1]);
        (pose, last.cost)
    }

    /// The pose alone, as by [`adjust_pose`](Self::adjust_pose).
    pub fn fit_pose(&self, view: &View<'_>, rest: &Rest, steps: usize) -> Pose {
        let mut pose = view.pose.clone();
        for step in 0..steps {
            let gate_px = self.gate_px(step, steps);
            let frame = self.frame_equations(view, &pose, rest, self.config.clothing_m[0], gate_px);
            let reduced = ReducedFrame::of(frame);
            pose = stepped(&pose, reduced.pose_step(&DVector::zeros(self.figure.n_shape() + 1)).as_slice());
        }
        pose
    }

    /// The gate narrows from step to step.
    fn gate_px(&self, step: usize, steps: usize) -> f64 {
        let share = (step as f64 / (GATE_CLOSED_AT * steps as f64)).min(1.0);
        let [first, last] = self.config.gate_px;
        first * (last / first).powf(share)
    }

    /// The normal equations of the shape, with the poses eliminated.
    fn reduce(&self, views: &[View<'_>], poses: &[Pose], mean: &DVector<f64>, gate_px: f64) -> Reduced {
        let n_shape = self.figure.n_shape();
        let rest = self.figure.rest(&mean.as_slice()[..n_shape]);
        let [clothing_m, clothing_sd_m] = self.config.clothing_m;
        let clothing_m = clothing_m + clothing_sd_m * mean[n_shape];
        let frames: Vec<FrameEquations> = views
            .par_iter()
            .zip(poses)
            .map(|(view, pose)| self.frame_equations(view, pose, &rest, clothing_m, gate_px))
            .collect();
        // Coefficients and clothing are in standard deviations: the prior is a unit Gaussian.
        let mut curvature = DMatrix::identity(n_shape + 1, n_shape + 1);
        let mut gradient = mean.clone();
        let mut reduced = Vec::with_capacity(frames.len());
        for frame in frames {
            curvature += &frame.shape_shape;
            gradient += &frame.shape_gradient;
            let (pose_shape, pose_gradient) = (frame.pose_shape.clone(), frame.pose_gradient.clone());
            let frame = ReducedFrame::of(frame);
            curvature -= pose_shape.tr_mul(&frame.shape_response);
            gradient -= frame.shape_response.tr_mul(&pose_gradient);
            reduced.push(frame);
        }
        Reduced { curvature, gradient, frames: reduced }
    }

    fn frame_equations(
        &self,
        view: &View<'_>,
        pose: &Pose,
        rest: &Rest,
        clothing_m: f64,
        gate_px: f64,
    ) -> FrameEquations {
        let posed = self.figure.posed(rest, pose, clothing_m);
        let points = rim(&posed, self.figure.triangles(), self.figure.edges(), self.camera);
        let mut equations = Accumulator::new(self.figure.n_shape() + 1);
        // Rim against outline and outline against rim: each counts half.
        let scale =
            0.5 * view.weight / (self.config.outline_sd_px.powi(2) * self.config.outline_correlation_px);
        for point in &points {
            let (distance_px, gradient) = view.seen.field.with_gradient(point.pixel.to_array());
            let toward = DVec2::from_array(gradient).normalize_or_zero();
            if toward.dot(point.normal) > 0.2 {
                let weight = scale * point.length_px;
                self.add_distance(&mut equations, &posed, point, toward, distance_px, weight, gate_px);
            }
        }
        let outline_scale = scale * OUTLINE_STEP_PX;
        for &(place, normal) in &view.seen.outline {
            let near = points
                .iter()
                .filter(|point| point.normal.dot(normal) > 0.5)
                .min_by(|a, b| a.pixel.distance_squared(place).total_cmp(&b.pixel.distance_squared(place)));
            if let Some(point) = near {
                let offset = point.pixel - place;
                // Too far along the outline to be the same place of the body.
                if offset.length() < LARGEST_MATCH * gate_px {
                    let distance_px = offset.dot(normal);
                    self.add_distance(
                        &mut equations,
                        &posed,
                        point,
                        normal,
                        distance_px,
                        outline_scale,
                        gate_px,
                    );
                }
            }
        }
        self.add_floor(&mut equations, &posed, view.weight);
        self.add_pose_prior(&mut equations, pose);
        equations.finish()
    }

    /// A point of the rim that lies `distance_px` beyond the outline along `toward`.
    #[allow(
        clippy::too_many_arguments,
        reason = "one residual, spelled out; a struct would only rename them"
    )]
    fn add_distance(
        &self,
        equations: &mut Accumulator,
        posed: &Posed<'_>,
        point: &RimPoint,
        toward: DVec2,
        distance_px: f64,
        weight: f64,
        gate_px: f64,
    ) {
        let direction: DVec3 = toward.x * point.pixel_per_m[0] + toward.y * point.pixel_per_m[1];
        let (pose_row, shape_row) = equations.rows();
        let n_shape = shape_row.len() - 1;
        let mut dressed = 0.0;
        for vertex in point.vertices {
            posed.add_derivative(vertex as usize, direction, 0.5, pose_row, &mut shape_row[..n_shape]);
            dressed += 0.5 * posed.dressed(vertex as usize);
        }
        // The surface's normal at the rim lies in the image.
        shape_row[n_shape] = self.config.clothing_m[1] * dressed * direction.length();
        equations.add(distance_px, weight, gate_px);
        equations.note_misfit(distance_px, weight, gate_px);
    }

    fn add_floor(&self, equations: &mut Accumulator, posed: &Posed<'_>, weight: f64) {
        let [height_m, sd_m] = self.config.floor_m;
        let lowest = posed.lowest();
        let (pose_row, shape_row) = equations.rows();
        let n_shape = shape_row.len() - 1;
        posed.add_derivative(lowest, DVec3::Z, 1.0, pose_row, &mut shape_row[..n_shape]);
        equations.lowest_m = posed.vertices[lowest].z;
        let off_m = equations.lowest_m - height_m;
        equations.add(off_m, weight * sd_m.powi(-2), self.config.floor_gate_m);
    }

    /// Minus the log-likelihood of a lowest point at this height above the floor, up to a constant.
    pub fn floor_cost(&self, lowest_m: f64) -> f64 {
        let [height_m, sd_m] = self.config.floor_m;
        let off_m = lowest_m - height_m;
        0.5 * (off_m / sd_m).powi(2) / (1.0 + (off_m / self.config.floor_gate_m).powi(2))
    }

    fn add_pose_prior(&self, equations: &mut Accumulator, pose: &Pose) {
        let away = DVector::from_column_slice(&pose.angles) - &self.pose_mean;
        let mut block = equations.pose_pose.view_mut((6, 6), (N_DOF, N_DOF));
        block += &self.pose_precision;
        let pull = &self.pose_precision * &away;
        equations.cost += 0.5 * pull.dot(&away);
        let mut gradient = equations.pose_gradient.rows_mut(6, N_DOF);
        gradient += pull;
    }
}

/// An outline's point and its match on the rim may be so many gates apart.
const LARGEST_MATCH: f64 = 2.0;
