//! A body that is linear in its shape, posed, with the derivatives of its points.

use body::ik::world_axes;
use body::pose::forward_kinematics;
use body::{BodyModel, JointId, JointTransforms, N_DOF, N_JOINTS, Pose, RestJoints, Skeleton};
use glam::{DQuat, DVec3};

/// Parts that clothes leave bare.
const BARE_PARTS: [&str; 4] = ["head", "neck", "hand", "foot"];

/// Rest vertices and joints of a body model as functions of the leading shape coefficients, in `f64`.
pub struct Figure {
    n_shape: usize,
    mean: Vec<DVec3>,
    /// `[n_vertices][n_shape]`, metres a standard deviation.
    basis: Vec<DVec3>,
    mean_joints: RestJoints,
    /// `[n_joints][n_shape]`.
    joint_basis: Vec<DVec3>,
    influences: Vec<Vec<(JointId, f64)>>,
    triangles: Vec<[u32; 3]>,
    edges: Vec<Edge>,
    /// 1 where clothes lie over the skin, 0 where it is bare, `[n_vertices]`.
    dressed: Vec<f64>,
}

/// Two triangles meet in it.
#[derive(Clone, Copy, Debug)]
pub struct Edge {
    /// Its ends.
    pub vertices: [u32; 2],
    /// Its triangles.
    pub triangles: [u32; 2],
    /// The third corner of each.
    pub opposite: [u32; 2],
}

/// One shape of a figure at rest.
pub struct Rest {
    /// `[n_vertices]`, metres, body frame.
    pub vertices: Vec<DVec3>,
    /// Metres, body frame.
    pub joints: RestJoints,
}

/// One shape in one pose.
pub struct Posed<'a> {
    figure: &'a Figure,
    rest: &'a Rest,
    root: DVec3,
    frames: JointTransforms,
    /// Axis of every angle, world, `[n_dof]`.
    axes: [DVec3; N_DOF],
    /// How each joint moves with each shape coefficient while the pelvis stays, world, `[n_joints][n_shape]`.
    joint_steps: Vec<DVec3>,
    /// `[n_vertices]`, metres, world.
    pub vertices: Vec<DVec3>,
}

impl Figure {
    /// The first `n_shape` components of `model`.
    ///
    /// # Panics
    /// When the model has not so many.
    pub fn new(model: &BodyModel, n_shape: usize) -> Self {
        let wide = |vertex: &[f32; 3]| DVec3::from_array(vertex.map(f64::from));
        let mean_body = model.mean();
        let mean: Vec<DVec3> = mean_body.rest_vertices().iter().map(wide).collect();
        let mean_joints = *mean_body.rest_joints();
        let (mut basis, mut joint_basis) =
            (vec![DVec3::ZERO; mean.len() * n_shape], vec![DVec3::ZERO; N_JOINTS * n_shape]);
        for k in 0..n_shape {
            let mut unit = vec![0.0; k + 1];
            unit[k] = 1.0;
            let body = model.shape(&unit);
            for (v, vertex) in body.rest_vertices().iter().enumerate() {
                basis[v * n_shape + k] = wide(vertex) - mean[v];
            }
            for (j, joint) in body.rest_joints().iter().enumerate() {
                joint_basis[j * n_shape + k] = *joint - mean_joints[j];
            }
        }
        let template = model.template();
        let is_bare =
            |part: u8| BARE_PARTS.iter().any(|bare| template.part_names[usize::from(part)].contains(bare));
        let influences = template
            .influences
            .iter()
            .map(|influences| influences.iter().map(|&(joint, weight)| (joint, f64::from(weight))).collect());
        Self {
            n_shape,
            mean,
            basis,
            mean_joints,
            joint_basis,
            influences: influences.collect(),
            triangles: template.triangles.clone(),
            edges: edges(&template.triangles),
            dressed: template.parts.iter().map(|&part| f64::from(u8::from(!is_bare(part)))).collect(),
        }
    }

    /// Number of shape coefficients.
    pub fn n_shape(&self) -> usize {
        self.n_shape
    }

    /// Outward by the right-hand rule.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Every edge once.
    pub fn edges(&self) -> &[Edge] {
        &self.edges
    }

    /// The body with these shape coefficients, `[n_shape]`, at rest.
    pub fn rest(&self, shape: &[f64]) -> Rest {
        let sum = |mean: &DVec3, steps: &[DVec3]| {
            *mean + steps.iter().zip(shape).map(|(step, c)| *c * *step).sum::<DVec3>()
        };
        let vertices = self.mean.iter().zip(self.basis.chunks_exact(self.n_shape));
        let mut joints = self.mean_joints;
        for (joint, steps) in joints.iter_mut().zip(self.joint_basis.chunks_exact(self.n_shape)) {
            *joint = sum(joint, steps);
        }
        Rest { vertices: vertices.map(|(mean, steps)| sum(mean, steps)).collect(), joints }
    }

    /// The body `rest` in `pose`, its dressed parts `clothing_m` thicker.
    pub fn posed<'a>(&'a self, rest: &'a Rest, pose: &Pose, clothing_m: f64) -> Posed<'a> {
        let skeleton = Skeleton::human();
        let frames = forward_kinematics(skeleton, &rest.joints, pose);
        let axes = world_axes(skeleton, &frames, pose);
        let mut joint_steps = vec![DVec3::ZERO; N_JOINTS * self.n_shape];
        for joint in JointId::all() {
            let Some(parent) = joint.parent() else { continue };
            for k in 0..self.n_shape {
                let (own, parents) = (joint.index() * self.n_shape + k, parent.index() * self.n_shape + k);
                let step = self.joint_basis[own] - self.joint_basis[parents];
                joint_steps[own] = joint_steps[parents] + frames[parent.index()].matrix3 * step;
            }
        }
        let mut vertices: Vec<DVec3> = rest
            .vertices
            .iter()
            .zip(&self.influences)
            .map(|(&vertex, influences)| {
                let terms = influences.iter().map(|&(joint, weight)| {
                    weight * frames[joint.index()].transform_point3(vertex - rest.joints[joint.index()])
                });
                terms.sum()
            })
            .collect();
        if clothing_m != 0.0 {
            let normals = vertex_normals(&vertices, &self.triangles);
            for ((vertex, normal), dressed) in vertices.iter_mut().zip(normals).zip(&self.dressed) {
                *vertex += clothing_m * dressed * normal;
            }
        }
        Posed { figure: self, rest, root: pose.root_position, frames, axes, joint_steps, vertices }
    }
}

/// Columns of a derivative: position of the pelvis, its rotation about the world's axes, the joint angles.
pub const N_POSE: usize = 6 + N_DOF;

impl Posed<'_> {
    /// Adds to `pose_row` (`[N_POSE]`) and `shape_row` (`[n_shape]`) how far vertex `vertex` moves along `direction` with
    /// each unknown, times `weight`.
    pub fn add_derivative(
        &self,
        vertex: usize,
        direction: DVec3,
        weight: f64,
        pose_row: &mut [f64],
        shape_row: &mut [f64],
    ) {
        let direction = weight * direction;
        direction.to_array().iter().zip(&mut pose_row[..3]).for_each(|(d, out)| *out += d);
        let lever = self.vertices[vertex] - self.root;
        lever.cross(direction).to_array().iter().zip(&mut pose_row[3..6]).for_each(|(d, out)| *out += d);

        let influences = &self.figure.influences[vertex];
        let n_shape = self.figure.n_shape;
        let rest_vertex = self.rest.vertices[vertex];
        let vertex_steps = &self.figure.basis[vertex * n_shape..][..n_shape];
        // Sum of weights and of weighted positions over the joints that each joint moves.
        let (mut weights, mut positions) = ([0.0; N_JOINTS], [DVec3::ZERO; N_JOINTS]);
        for &(joint, share) in influences {
            let index = joint.index();
            let frame = &self.frames[index];
            let position = share * frame.transform_point3(rest_vertex - self.rest.joints[index]);
            let mut mover = Some(joint);
            while let Some(ancestor) = mover {
                weights[ancestor.index()] += share;
                positions[ancestor.index()] += position;
                mover = ancestor.parent();
            }
            let local = share * (frame.matrix3.transpose() * direction);
            let joint_rest = &self.figure.joint_basis[index * n_shape..][..n_shape];
            let joint_world = &self.joint_steps[index * n_shape..][..n_shape];
            for (k, out) in shape_row.iter_mut().enumerate() {
                *out += local.dot(vertex_steps[k] - joint_rest[k]) + share * direction.dot(joint_world[k]);
            }
        }
        let skeleton = Skeleton::human();
        for joint in JointId::all() {
            let index = joint.index();
            if weights[index] == 0.0 {
                continue;
            }
            let lever = positions[index] - weights[index] * self.frames[index].translation;
            let turned = lever.cross(direction);
            for dof in skeleton.joint(joint).dofs.clone() {
                pose_row[6 + dof] += self.axes[dof].dot(turned);
            }
        }
    }

    /// 1 for a dressed vertex, 0 for a bare one.
    pub fn dressed(&self, vertex: usize) -> f64 {
        self.figure.dressed[vertex]
    }

    /// The lowest vertex.
    pub fn lowest(&self) -> usize {
        let height = |v: usize| self.vertices[v].z;
        (0..self.vertices.len())
            .min_by(|&a, &b| height(a).total_cmp(&height(b)))
            .expect("a body has vertices")
    }
}

/// `pose` after a step of its [`N_POSE`] unknowns, inside the joint limits.
pub fn stepped(pose: &Pose, step: &[f64]) -> Pose {
    let mut moved = pose.clone();
    moved.root_position += DVec3::from_slice(step);
    let turn = DQuat::from_scaled_axis(DVec3::from_slice(&step[3..]));
    moved.root_orientation = (turn * pose.root_orientation).normalize();
    moved.angles.iter_mut().zip(&step[6..]).for_each(|(angle, change)| *angle += change);
    moved.clamp();
    moved
}

/// Unit normals, `[n_vertices]`, outward.
pub fn vertex_normals(vertices: &[DVec3], triangles: &[[u32; 3]]) -> Vec<DVec3> {
    let mut normals = vec![DVec3::ZERO; vertices.len()];
    for triangle in triangles {
        let [a, b, c] = triangle.map(|vertex| vertices[vertex as usize]);
        let normal = (b - a).cross(c - a);
        triangle.iter().for_each(|&vertex| normals[vertex as usize] += normal);
    }
    normals.iter_mut().for_each(|normal| *normal = normal.normalize_or_zero());
    normals
}

fn edges(triangles: &[[u32; 3]]) -> Vec<Edge> {
    let mut sides: Vec<(u32, u32, u32, u32)> = Vec::with_capacity(3 * triangles.len());
    for (index, &[a, b, c]) in (0..).zip(triangles) {
        for (from, to, opposite) in [(a, b, c), (b, c, a), (c, a, b)] {
            sides.push((from.min(to), from.max(to), index, opposite));
        }
    }
    sides.sort_unstable();
    let pairs = sides.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)).filter(|pair| pair.len() == 2);
    pairs
        .map(|pair| Edge {
            vertices: [pair[0].0, pair[0].1],
            triangles: [pair[0].2, pair[1].2],
            opposite: [pair[0].3, pair[1].3],
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_are_those_of_finite_differences() {
        let figure = Figure::new(&BodyModel::builtin(), 4);
        let shape = [0.7, -1.2, 0.4, 1.5];
        let mut pose = Pose::upright(DVec3::new(0.3, -0.2, 0.95), 0.8);
        pose.angles.iter_mut().enumerate().for_each(|(k, angle)| *angle = 0.1 * (k as f64).sin());
        pose.clamp();
        let direction = DVec3::new(0.3, -0.8, 0.5);
        let place = |shape: &[f64], pose: &Pose, vertex: usize| {
            direction.dot(figure.posed(&figure.rest(shape), pose, 0.0).vertices[vertex])
        };
        let rest = figure.rest(&shape);
        let posed = figure.posed(&rest, &pose, 0.0);
        const STEP: f64 = 1e-5;
        for vertex in (0..posed.vertices.len()).step_by(97) {
            let (mut pose_row, mut shape_row) = ([0.0; N_POSE], [0.0; 4]);
            posed.add_derivative(vertex, direction, 1.0, &mut pose_row, &mut shape_row);
            for (k, analytic) in pose_row.into_iter().enumerate() {
                let at = |sign: f64| {
                    let mut step = [0.0; N_POSE];
                    step[k] = sign * STEP;
                    place(&shape, &stepped(&pose, &step), vertex)
                };
                let numeric = (at(1.0) - at(-1.0)) / (2.0 * STEP);
                assert!(
                    (numeric - analytic).abs() < 1e-6,
                    "vertex {vertex}, unknown {k}: {numeric}, {analytic}"
                );
            }
            for (k, analytic) in shape_row.into_iter().enumerate() {
                let at = |sign: f64| {
                    let mut shape = shape;
                    shape[k] += sign * STEP;
                    place(&shape, &pose, vertex)
                };
                let numeric = (at(1.0) - at(-1.0)) / (2.0 * STEP);
                assert!(
                    (numeric - analytic).abs() < 1e-6,
                    "vertex {vertex}, shape {k}: {numeric}, {analytic}"
                );
            }
        }
    }

    #[test]
    fn the_figure_is_the_body_of_the_model() {
        let model = BodyModel::builtin();
        let figure = Figure::new(&model, 5);
        let shape = [1.0, -0.5, 0.3, 0.8, -1.1];
        let body = model.shape(&shape);
        let mut pose = Pose::upright(DVec3::new(0.0, 0.0, 0.9), 0.3);
        pose.angles[24] = 0.6;
        let mut expected = vec![[0.0; 3]; body.n_vertices()];
        body.skin_into(&pose, &mut expected);
        let rest = figure.rest(&shape);
        for (found, expected) in figure.posed(&rest, &pose, 0.0).vertices.iter().zip(expected) {
            assert!(found.distance(DVec3::from_array(expected.map(f64::from))) < 1e-5);
        }
    }
}
