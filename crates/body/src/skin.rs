//! Linear blend skinning, eight poses at a time.

use glam::{DAffine3, DVec3};
use wide::f32x8;

use crate::model::Body;
use crate::pose::{JointTransforms, Pose, RestJoints, forward_kinematics};
use crate::skeleton::{JointId, N_JOINTS, Skeleton};

#[cfg(test)]
mod tests;

/// Poses skinned together, one in each lane.
pub const LANES: usize = 8;

/// Rest positions times weights, so that a posed vertex is a sum of matrix times vector over its joints:
/// sum of w M_j (v - r_j) = sum of M_j (w (v - r_j), w), with M_j the frame of joint j and r_j its rest position.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct WeightedRest {
    /// End of each vertex's terms, `[n_vertices]`.
    ends: Vec<u32>,
    terms: Vec<Term>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Term {
    /// w (v - r) and w.
    position: [f32; 4],
    joint: u32,
}

/// Rows of [rotation | translation] of every joint, a pose in each lane.
type JointLanes = [[Lanes; 12]; N_JOINTS];

/// Aligned so that a load never straddles two cache lines.
#[derive(Clone, Copy)]
#[repr(align(32))]
struct Lanes([f32; LANES]);

impl WeightedRest {
    pub(crate) fn new(
        influences: &[Vec<(JointId, f32)>],
        vertices: &[[f32; 3]],
        joints: &RestJoints,
    ) -> Self {
        let (mut ends, mut terms) = (Vec::with_capacity(vertices.len()), Vec::new());
        for (influences, vertex) in influences.iter().zip(vertices) {
            for &(joint, weight) in influences {
                let offset =
                    (DVec3::from_array(vertex.map(f64::from)) - joints[joint.index()]) * f64::from(weight);
                let [x, y, z] = offset.to_array().map(|x| x as f32);
                terms.push(Term { position: [x, y, z, weight], joint: joint.index() as u32 });
            }
            ends.push(terms.len() as u32);
        }
        Self { ends, terms }
    }

    /// Skins up to [`LANES`] poses into as many meshes.
    fn skin(&self, lanes: &JointLanes, meshes: &mut [&mut [[f32; 3]]]) {
        let mut start = 0;
        for (vertex, &end) in self.ends.iter().enumerate() {
            // Plain locals: arrays of lanes, mapped, are not kept in registers.
            let (mut x, mut y, mut z) = (f32x8::ZERO, f32x8::ZERO, f32x8::ZERO);
            for term in &self.terms[start..end as usize] {
                let [px, py, pz, w] = term.position;
                let (px, py, pz, w) = (f32x8::splat(px), f32x8::splat(py), f32x8::splat(pz), f32x8::splat(w));
                let matrix = &lanes[term.joint as usize];
                let row = |first: usize| {
                    let at = |column: usize| f32x8::from(matrix[first + column].0);
                    at(0) * px + at(1) * py + at(2) * pz + at(3) * w
                };
                x += row(0);
                y += row(4);
                z += row(8);
            }
            start = end as usize;
            let (x, y, z) = (x.to_array(), y.to_array(), z.to_array());
            for (lane, mesh) in meshes.iter_mut().enumerate() {
                mesh[vertex] = [x[lane], y[lane], z[lane]];
            }
        }
    }
}

impl Body {
    /// Joint frames in the world, f64: see [`forward_kinematics`].
    ///
    /// # Panics
    /// When the pose has the wrong number of angles.
    pub fn world_from_joints(&self, pose: &Pose) -> JointTransforms {
        forward_kinematics(Skeleton::human(), self.rest_joints(), pose)
    }

    /// Joint positions, `[n_joints]`, metres, world.
    ///
    /// # Panics
    /// When the pose has the wrong number of angles.
    pub fn joints_world(&self, pose: &Pose) -> [DVec3; N_JOINTS] {
        self.world_from_joints(pose).map(|frame| frame.translation)
    }

    /// Vertices of the posed body, `[n_vertices]`, metres, world.
    ///
    /// ```
    /// use body::{BodyModel, Pose};
    /// let body = BodyModel::builtin().mean();
    /// let mut vertices = vec![[0.0; 3]; body.n_vertices()];
    /// body.skin_into(&Pose::upright(glam::DVec3::new(0.0, 0.0, 0.9), 0.0), &mut vertices);
    /// assert!(vertices.iter().all(|vertex| vertex[2].abs() < 2.0));
    /// ```
    ///
    /// # Panics
    /// When `out` has another length than the body has vertices, or the pose the wrong number of angles.
    pub fn skin_into(&self, pose: &Pose, out: &mut [[f32; 3]]) {
        self.skin_batch_into(&DAffine3::IDENTITY, std::slice::from_ref(pose), out);
    }

    /// Vertices of many poses, mesh after mesh, `[n_poses * n_vertices]`, metres, in the frame that `target_from_world`
    /// leads to: a camera's for the scorer. Allocates nothing. The fastest number of poses is a multiple of [`LANES`].
    ///
    /// # Panics
    /// When `out` does not hold a mesh for each pose, or a pose has the wrong number of angles.
    pub fn skin_batch_into(&self, target_from_world: &DAffine3, poses: &[Pose], out: &mut [[f32; 3]]) {
        let n = self.n_vertices();
        let (found, expected) = (out.len(), poses.len() * n);
        assert_eq!(found, expected, "room for {found} vertices, but {} poses have {expected}", poses.len());
        for (poses, out) in poses.chunks(LANES).zip(out.chunks_mut(LANES * n)) {
            let lanes = self.joint_lanes(target_from_world, poses);
            let mut meshes: [&mut [[f32; 3]]; LANES] = Default::default();
            for (mesh, out) in meshes.iter_mut().zip(out.chunks_mut(n)) {
                *mesh = out;
            }
            self.weighted.skin(&lanes, &mut meshes[..poses.len()]);
        }
    }

    fn joint_lanes(&self, target_from_world: &DAffine3, poses: &[Pose]) -> JointLanes {
        let mut lanes: JointLanes = [[Lanes([0.0; LANES]); 12]; N_JOINTS];
        for (lane, pose) in poses.iter().enumerate() {
            for (matrix, world_from_joint) in lanes.iter_mut().zip(self.world_from_joints(pose)) {
                let frame = *target_from_world * world_from_joint;
                let columns = frame.matrix3.to_cols_array_2d();
                for row in 0..3 {
                    for column in 0..3 {
                        matrix[4 * row + column].0[lane] = columns[column][row] as f32;
                    }
                    matrix[4 * row + 3].0[lane] = frame.translation[row] as f32;
                }
            }
        }
        lanes
    }
}
