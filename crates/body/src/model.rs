//! The body model: template, shape space, and the bodies it gives.

use std::sync::Arc;

use glam::DVec3;

use crate::asset::{BodyFile, LoadBodyModelError};
use crate::pose::RestJoints;
use crate::skeleton::{JointId, N_JOINTS};
use crate::skin::WeightedRest;

mod check;
#[cfg(test)]
mod tests;

/// Joints that move a vertex, at most.
pub const MAX_INFLUENCES: usize = 6;
/// Weights of a vertex sum to 1 up to this.
pub(crate) const WEIGHT_SUM_TOLERANCE: f32 = 1e-5;

static BUILTIN: &[u8] = include_bytes!("../assets/umbra-body.bin");

/// Sex, where it is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sex {
    /// A woman.
    Female,
    /// A man.
    Male,
}

/// What all bodies of a model share.
#[derive(Clone, Debug, PartialEq)]
pub struct Template {
    /// Closed and outward by the right-hand rule, `[n_triangles]`.
    pub triangles: Vec<[u32; 3]>,
    /// Body part of each vertex: index into `part_names`.
    pub parts: Vec<u8>,
    /// Names of the body parts, as in `left_thigh`.
    pub part_names: Vec<String>,
    /// Joints and weights of each vertex, at most [`MAX_INFLUENCES`], sum 1, largest first.
    pub influences: Vec<Vec<(JointId, f32)>>,
    /// Named points of the surface.
    pub landmarks: Vec<Landmark>,
    /// Vertex of the population's mesh that each vertex comes from.
    pub source_vertices: Vec<u32>,
}

/// A named point on a triangle of the template.
#[derive(Clone, Debug, PartialEq)]
pub struct Landmark {
    /// As in `Rt Acromion`.
    pub name: String,
    /// Vertices of its triangle.
    pub vertices: [u32; 3],
    /// Their weights, sum 1.
    pub barycentric: [f32; 3],
}

/// A population of bodies: a mean, principal components, and the template they are drawn on.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyModel {
    template: Arc<Template>,
    mean_vertices: Vec<[f32; 3]>,
    vertex_basis: Vec<Vec<[f32; 3]>>,
    mean_joints: RestJoints,
    joint_basis: Vec<RestJoints>,
    variance_shares: Vec<f32>,
    stature_lines: [StatureLine; 3],
}

/// Regression of the shape coefficients on stature.
#[derive(Clone, Debug, PartialEq)]
struct StatureLine {
    mean_stature_m: f64,
    mean_scores: Vec<f64>,
    scores_per_m: Vec<f64>,
}

impl BodyModel {
    /// The model that comes with this crate: 1,200 adults, women and men alike.
    ///
    /// ```
    /// let model = body::BodyModel::builtin();
    /// let body = model.shape_for_stature(1.78, Some(body::Sex::Male));
    /// assert!((body.stature_m() - 1.78).abs() < 1e-3);
    /// ```
    pub fn builtin() -> Self {
        Self::from_bytes(BUILTIN).expect("the file in the program is tested")
    }

    /// Reads a model.
    ///
    /// # Errors
    /// Says which field is wrong and what was expected.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, LoadBodyModelError> {
        Self::from_file(BodyFile::from_bytes(bytes)?)
    }

    /// The model of a decoded file.
    ///
    /// # Errors
    /// When its arrays do not fit each other.
    pub fn from_file(file: BodyFile) -> Result<Self, LoadBodyModelError> {
        check::check(&file)?;
        let n_vertices = file.parts.len();
        let mut rest = &file.influences[..];
        let influences = file.influence_counts.iter().map(|&count| {
            let (own, others) = rest.split_at(count.into());
            rest = others;
            own.iter()
                .map(|&(joint, weight)| (JointId::from_index(joint.into()).expect("checked"), weight))
                .collect()
        });
        let influences = influences.collect();
        let triangles: Vec<[u32; 3]> = file.triangles.iter().map(|t| t.map(u32::from)).collect();
        let landmarks = file.landmarks.into_iter().map(|landmark| Landmark {
            name: landmark.name,
            vertices: triangles[landmark.triangle as usize],
            barycentric: landmark.barycentric,
        });
        let template = Template {
            landmarks: landmarks.collect(),
            triangles,
            parts: file.parts,
            part_names: file.part_names,
            influences,
            source_vertices: file.source_vertices,
        };
        let wide = |values: Vec<f32>| values.into_iter().map(f64::from).collect();
        Ok(Self {
            template: Arc::new(template),
            mean_vertices: points(&file.mean_vertices),
            vertex_basis: file.vertex_basis.chunks_exact(3 * n_vertices).map(points).collect(),
            mean_joints: joints(&file.mean_joints),
            joint_basis: file.joint_basis.chunks_exact(3 * N_JOINTS).map(joints).collect(),
            variance_shares: file.variance_shares,
            stature_lines: file.stature_lines.map(|line| StatureLine {
                mean_stature_m: line.mean_stature_m.into(),
                mean_scores: wide(line.mean_scores),
                scores_per_m: wide(line.scores_per_m),
            }),
        })
    }

    /// What all its bodies share.
    pub fn template(&self) -> &Template {
        &self.template
    }

    /// Triangles of every body, outward by the right-hand rule, `[n_triangles]`.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.template.triangles
    }

    /// Number of vertices of every body.
    pub fn n_vertices(&self) -> usize {
        self.mean_vertices.len()
    }

    /// Number of shape coefficients.
    pub fn n_components(&self) -> usize {
        self.vertex_basis.len()
    }

    /// Share of the population's variance along each component, largest first.
    pub fn variance_shares(&self) -> &[f32] {
        &self.variance_shares
    }

    /// Directions of shape, metres per standard deviation, `[n_components]` of `[n_vertices]`.
    pub(crate) fn vertex_basis(&self) -> &[Vec<[f32; 3]>] {
        &self.vertex_basis
    }

    /// What they do to the joints, metres per standard deviation, `[n_components]`.
    pub(crate) fn joint_basis(&self) -> &[RestJoints] {
        &self.joint_basis
    }

    /// The mean body.
    pub fn mean(&self) -> Body {
        self.shape(&[])
    }

    /// The body with the first shape coefficients given in standard deviations; those left out are 0.
    ///
    /// # Panics
    /// When there are more coefficients than components.
    pub fn shape(&self, coefficients_sd: &[f64]) -> Body {
        let (given, known) = (coefficients_sd.len(), self.n_components());
        assert!(given <= known, "{given} coefficients for {known} components");
        let mut vertices = self.mean_vertices.clone();
        let mut joints = self.mean_joints;
        for (k, &coefficient) in coefficients_sd.iter().enumerate() {
            let step = coefficient as f32;
            for (vertex, along) in vertices.iter_mut().zip(&self.vertex_basis[k]) {
                vertex.iter_mut().zip(along).for_each(|(x, a)| *x += step * a);
            }
            for (joint, along) in joints.iter_mut().zip(&self.joint_basis[k]) {
                *joint += coefficient * *along;
            }
        }
        Body::new(Arc::clone(&self.template), vertices, joints)
    }

    /// The coefficients of the body nearest to these rest vertices (least squares; the components are orthogonal),
    /// standard deviations, `[n_components]`. It must stand as the mean does, soles at y = 0.
    ///
    /// # Panics
    /// When there are more or fewer vertices than the model has.
    pub fn coefficients_of(&self, rest_vertices: &[DVec3]) -> Vec<f64> {
        let (found, expected) = (rest_vertices.len(), self.n_vertices());
        assert_eq!(found, expected, "{found} vertices for a model of {expected}");
        let wide = |p: &[f32; 3]| DVec3::from_array(p.map(f64::from));
        let coefficient = |direction: &Vec<[f32; 3]>| {
            let (mut along, mut square) = (0.0, 0.0);
            for ((vertex, mean), step) in rest_vertices.iter().zip(&self.mean_vertices).zip(direction) {
                let step = wide(step);
                along += step.dot(*vertex - wide(mean));
                square += step.length_squared();
            }
            along / square
        };
        self.vertex_basis.iter().map(coefficient).collect()
    }

    /// The most probable coefficients of a person of this stature: the conditional mean of the Gaussian shape space
    /// given stature and, where it is known, sex; standard deviations, `[n_components]`.
    pub fn coefficients_for_stature(&self, stature_m: f64, sex: Option<Sex>) -> Vec<f64> {
        let line = match sex {
            None => &self.stature_lines[0],
            Some(Sex::Female) => &self.stature_lines[1],
            Some(Sex::Male) => &self.stature_lines[2],
        };
        let along = |stature_m: f64| -> Vec<f64> {
            let step = stature_m - line.mean_stature_m;
            line.mean_scores.iter().zip(&line.scores_per_m).map(|(mean, slope)| mean + slope * step).collect()
        };
        // Stature is linear in the coefficients but for the choice of the lowest and the highest vertex.
        let mut asked_m = stature_m;
        for _ in 0..3 {
            asked_m += stature_m - self.shape(&along(asked_m)).stature_m();
        }
        along(asked_m)
    }

    /// The most probable body of this stature: see [`BodyModel::coefficients_for_stature`].
    pub fn shape_for_stature(&self, stature_m: f64, sex: Option<Sex>) -> Body {
        self.shape(&self.coefficients_for_stature(stature_m, sex))
    }
}

fn points(flat: &[f32]) -> Vec<[f32; 3]> {
    flat.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect()
}

fn joints(flat: &[f32]) -> RestJoints {
    std::array::from_fn(|joint| DVec3::from_array([0, 1, 2].map(|axis| f64::from(flat[3 * joint + axis]))))
}

/// One person's body: surface and joints at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    template: Arc<Template>,
    rest_vertices: Vec<[f32; 3]>,
    rest_joints: RestJoints,
    pub(crate) weighted: WeightedRest,
}

impl Body {
    fn new(template: Arc<Template>, rest_vertices: Vec<[f32; 3]>, rest_joints: RestJoints) -> Self {
        let weighted = WeightedRest::new(&template.influences, &rest_vertices, &rest_joints);
        Self { template, rest_vertices, rest_joints, weighted }
    }

    /// What it shares with the other bodies of its model.
    pub fn template(&self) -> &Template {
        &self.template
    }

    /// Triangles, outward by the right-hand rule, `[n_triangles]`.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.template.triangles
    }

    /// Number of vertices.
    pub fn n_vertices(&self) -> usize {
        self.rest_vertices.len()
    }

    /// Vertices at rest, metres, body frame, soles near y = 0, `[n_vertices]`.
    pub fn rest_vertices(&self) -> &[[f32; 3]] {
        &self.rest_vertices
    }

    /// Joints at rest, metres, body frame.
    pub fn rest_joints(&self) -> &RestJoints {
        &self.rest_joints
    }

    /// Height of the surface at rest.
    pub fn stature_m(&self) -> f64 {
        let heights = self.rest_vertices.iter().map(|vertex| f64::from(vertex[1]));
        let (low, high) =
            heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), y| (low.min(y), high.max(y)));
        high - low
    }

    /// The landmark called `name` at rest, metres, body frame.
    pub fn landmark(&self, name: &str) -> Option<DVec3> {
        let landmark = self.template.landmarks.iter().find(|landmark| landmark.name == name)?;
        let corners = landmark.vertices.iter().zip(landmark.barycentric);
        let terms = corners
            .map(|(&v, w)| DVec3::from_array(self.rest_vertices[v as usize].map(f64::from)) * f64::from(w));
        Some(terms.sum())
    }
}
