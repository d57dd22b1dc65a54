//! Fit of shape coefficients and pose to a scan: Gauss-Newton steps on both together.

use glam::DVec3;
use nalgebra::{DMatrix, DVector};

use super::scan::Scan;
use crate::ik::world_axes;
use crate::mesh::area_normal;
use crate::model::{Body, BodyModel};
use crate::pose::{JointTransforms, Pose};
use crate::skeleton::{JointId, N_DOF, N_JOINTS, Skeleton};

/// How a round of the fit weighs its terms.
#[derive(Clone, Copy, Debug)]
pub(super) struct Round {
    /// Scan farther than this from a vertex does not pull it, metres; 0 leaves the scan out.
    pub farthest_m: f64,
    /// Typical error of a vertex's distance to the scan, metres.
    pub surface_sd_m: f64,
    /// Typical error of a landmark along each axis, metres; robust beyond three times as much.
    pub landmark_sd_m: f64,
    /// Gauss-Newton steps.
    pub steps: usize,
}

/// Surfaces whose normals differ by more than the angle of this cosine are not each other's.
pub(super) const LEAST_COSINE: f64 = 0.5;
/// Spread of joint angles about the rest pose, radians.
const ANGLE_SD_RAD: f64 = 0.35;
/// Angles of the axial skeleton and the clavicles move less.
const TRUNK_ANGLE_SD_RAD: f64 = 0.12;

/// A landmark of the template and where the scan has it.
#[derive(Clone, Debug)]
pub(super) struct LandmarkPair {
    pub vertices: [u32; 3],
    pub barycentric: [f64; 3],
    pub position: DVec3,
}

/// A body of the model in a pose: what the fit moves.
#[derive(Clone, Debug)]
pub(super) struct ModelFit<'a> {
    model: &'a BodyModel,
    pub coefficients_sd: Vec<f64>,
    pub pose: Pose,
    pub body: Body,
    /// Posed vertices, metres, the scan's frame.
    pub vertices: Vec<DVec3>,
}

/// The rows of one least-squares problem.
struct System {
    hessian: DMatrix<f64>,
    gradient: DVector<f64>,
}

impl<'a> ModelFit<'a> {
    pub fn new(model: &'a BodyModel, coefficients_sd: Vec<f64>, pose: Pose) -> Self {
        let body = model.shape(&coefficients_sd);
        let mut fit = Self { model, coefficients_sd, pose, body, vertices: Vec::new() };
        fit.refresh();
        fit
    }

    fn refresh(&mut self) {
        self.body = self.model.shape(&self.coefficients_sd);
        let mut posed = vec![[0.0; 3]; self.body.n_vertices()];
        self.body.skin_into(&self.pose, &mut posed);
        self.vertices = posed.iter().map(|p| DVec3::from_array(p.map(f64::from))).collect();
    }

    /// Steps of one round.
    pub fn run(&mut self, scan: &Scan, landmarks: &[LandmarkPair], round: &Round) {
        for _ in 0..round.steps {
            let system = self.system(scan, landmarks, round);
            // Prior precisions make it positive definite; rounding could only spoil it with wild input.
            let Some(factor) = system.hessian.cholesky() else { return };
            let step = factor.solve(&system.gradient);
            self.advance(&step);
        }
    }

    pub(super) fn advance(&mut self, step: &DVector<f64>) {
        let at = |first: usize| DVec3::new(step[first], step[first + 1], step[first + 2]);
        self.pose.root_position -= at(0);
        let turn = glam::DQuat::from_scaled_axis(-at(3));
        self.pose.root_orientation = (turn * self.pose.root_orientation).normalize();
        for (angle, change) in self.pose.angles.iter_mut().zip(step.iter().skip(6)) {
            *angle -= change;
        }
        self.pose.clamp();
        for (coefficient, change) in self.coefficients_sd.iter_mut().zip(step.iter().skip(6 + N_DOF)) {
            *coefficient -= change;
        }
        self.refresh();
    }

    /// Normal equations of the linearised problem: squared distances to the scan's planes, squared distances of landmarks, and
    /// the priors of shape and pose, each in units of its standard deviation.
    fn system(&self, scan: &Scan, landmarks: &[LandmarkPair], round: &Round) -> System {
        let n = 6 + N_DOF + self.coefficients_sd.len();
        let motion = Motion::of(self);
        let mut rows = Rows { n, flat: Vec::new(), residuals: Vec::new() };
        if round.farthest_m > 0.0 {
            let normals = vertex_normals(&self.vertices, self.model.triangles());
            for (vertex, (&place, &normal)) in self.vertices.iter().zip(&normals).enumerate() {
                let Some(plane) = scan.surface_near(place, normal, round.farthest_m, LEAST_COSINE) else {
                    continue;
                };
                let row = rows.push(plane.height_m(place) / round.surface_sd_m);
                motion.add(vertex, plane.normal / round.surface_sd_m, row);
            }
        }
        for landmark in landmarks {
            let corners = landmark.vertices.iter().zip(landmark.barycentric);
            let place: DVec3 = corners.clone().map(|(&v, w)| self.vertices[v as usize] * w).sum();
            let offset = place - landmark.position;
            // Weights of a Geman-McClure cost: a landmark that is far off counts little.
            let scale = 3.0 * round.landmark_sd_m;
            let weight = 1.0 / (1.0 + offset.length_squared() / (scale * scale)) / round.landmark_sd_m;
            for axis in DVec3::AXES {
                let row = rows.push(weight * axis.dot(offset));
                corners.clone().for_each(|(&v, w)| motion.add(v as usize, axis * (w * weight), row));
            }
        }
        let (mut hessian, mut gradient) = rows.normal_equations();
        for unknown in 0..n {
            let (value, sd) = match unknown {
                0..6 => (0.0, 1e3),
                6.. if unknown < 6 + N_DOF => (self.pose.angles[unknown - 6], angle_sd_rad(unknown - 6)),
                _ => (self.coefficients_sd[unknown - 6 - N_DOF], 1.0),
            };
            hessian[(unknown, unknown)] += 1.0 / (sd * sd);
            gradient[unknown] += value / (sd * sd);
        }
        System { hessian, gradient }
    }
}

fn angle_sd_rad(dof: usize) -> f64 {
    let joint = Skeleton::human().dofs()[dof].joint;
    let is_limb = !matches!(joint.index(), 0..=8 | 18);
    if is_limb { ANGLE_SD_RAD } else { TRUNK_ANGLE_SD_RAD }
}

/// Unit normals of the vertices, area weighted.
pub(super) fn vertex_normals(vertices: &[DVec3], triangles: &[[u32; 3]]) -> Vec<DVec3> {
    let mut normals = vec![DVec3::ZERO; vertices.len()];
    for &triangle in triangles {
        let normal = area_normal(crate::mesh::corners(vertices, triangle));
        triangle.iter().for_each(|&vertex| normals[vertex as usize] += normal);
    }
    normals.into_iter().map(DVec3::normalize_or_zero).collect()
}

/// Rows of a least-squares problem, one after another.
struct Rows {
    n: usize,
    flat: Vec<f64>,
    residuals: Vec<f64>,
}

impl Rows {
    /// A new row of zeros.
    fn push(&mut self, residual: f64) -> &mut [f64] {
        let first = self.flat.len();
        self.residuals.push(residual);
        self.flat.resize(first + self.n, 0.0);
        &mut self.flat[first..]
    }

    /// JᵀJ and Jᵀr.
    fn normal_equations(self) -> (DMatrix<f64>, DVector<f64>) {
        let transposed = DMatrix::from_vec(self.n, self.residuals.len(), self.flat);
        let gradient = &transposed * DVector::from_vec(self.residuals);
        (&transposed * transposed.transpose(), gradient)
    }
}

/// How each unknown moves each vertex, to first order, under linear blend skinning.
pub(super) struct Motion<'a> {
    fit: &'a ModelFit<'a>,
    frames: JointTransforms,
    axes: [DVec3; N_DOF],
    /// Change of each posed joint with each coefficient, `[n_components]` of `[n_joints]`.
    joint_steps: Vec<[DVec3; N_JOINTS]>,
}

impl<'a> Motion<'a> {
    pub(super) fn of(fit: &'a ModelFit<'a>) -> Self {
        let frames = fit.body.world_from_joints(&fit.pose);
        let axes = world_axes(Skeleton::human(), &frames, &fit.pose);
        let steps = fit.model.joint_basis().iter().map(|rest_steps| {
            let mut steps = [DVec3::ZERO; N_JOINTS];
            for joint in JointId::all() {
                let Some(parent) = joint.parent() else { continue };
                let link = rest_steps[joint.index()] - rest_steps[parent.index()];
                steps[joint.index()] = steps[parent.index()] + frames[parent.index()].matrix3 * link;
            }
            steps
        });
        let joint_steps = steps.collect();
        Self { fit, frames, axes, joint_steps }
    }

    /// Adds to `row` how fast `vertex` moves along `direction` with each unknown.
    pub(super) fn add(&self, vertex: usize, direction: DVec3, row: &mut [f64]) {
        let body = &self.fit.body;
        let rest = DVec3::from_array(body.rest_vertices()[vertex].map(f64::from));
        let influences = &body.template().influences[vertex];
        let (root, turned) = row.split_at_mut(6);
        let (angles, shape) = turned.split_at_mut(N_DOF);
        let lever = self.fit.vertices[vertex] - self.fit.pose.root_position;
        root[..3].iter_mut().zip(direction.to_array()).for_each(|(x, d)| *x += d);
        root[3..].iter_mut().zip(lever.cross(direction).to_array()).for_each(|(x, d)| *x += d);
        let skeleton = Skeleton::human();
        // Sum over influences of w Rᵀ direction, for the shape.
        let mut pulled = DVec3::ZERO;
        for &(joint, weight) in influences {
            let weight = f64::from(weight);
            let frame = &self.frames[joint.index()];
            let carried = frame.transform_point3(rest - body.rest_joints()[joint.index()]);
            let mut moved_by = Some(joint);
            while let Some(mover) = moved_by {
                let moment = (carried - self.frames[mover.index()].translation).cross(direction) * weight;
                for dof in skeleton.joint(mover).dofs.clone() {
                    angles[dof] += self.axes[dof].dot(moment);
                }
                moved_by = mover.parent();
            }
            let turned_back = frame.matrix3.transpose() * direction * weight;
            pulled += turned_back;
            let steps = self.joint_steps.iter().zip(self.fit.model.joint_basis());
            for (slot, (posed, rest)) in shape.iter_mut().zip(steps) {
                *slot += weight * direction.dot(posed[joint.index()]) - turned_back.dot(rest[joint.index()]);
            }
        }
        for (slot, component) in shape.iter_mut().zip(self.fit.model.vertex_basis()) {
            *slot += pulled.dot(DVec3::from_array(component[vertex].map(f64::from)));
        }
    }
}
