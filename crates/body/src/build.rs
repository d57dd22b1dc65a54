//! Makes the body model from a population: decimated template, skin, shape space.
//!
//! The mean body of the population is cut along its midline, its left half is decimated and mirrored back, so the
//! template is symmetric. Every template vertex is a vertex of the population's mesh, from which it takes skin weights
//! and body part; its position on a body is the least-squares fit of the template's surface to that body's surface. This
//! fit is linear in the body, so the population's linear basis carries over and principal components are exact.

use glam::DVec3;

use crate::asset::{BodyFile, LandmarkFile, StatureLineFile};
use crate::io::bodies::BodiesData;
use crate::mesh::TriangleTree;
use crate::model::MAX_INFLUENCES;
use crate::skeleton::{JointId, N_JOINTS};

mod decimate;
mod half;
mod pockets;
pub mod prior;
mod shape_space;
mod surface_fit;
#[cfg(test)]
mod tests;

use half::{HalfMesh, MeanBody};
use shape_space::ShapeSpace;
pub use surface_fit::SurfaceFit;

/// Settings of [`build_body_asset`].
#[derive(Clone, Debug, PartialEq)]
pub struct BuildConfig {
    /// Vertices of the template, at most.
    pub n_vertices: usize,
    /// Principal components of shape.
    pub n_components: usize,
}

impl Default for BuildConfig {
    fn default() -> Self {
        Self { n_vertices: 1_200, n_components: 80 }
    }
}

/// Why no model could be made of a population.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// Too few bodies.
    #[error("{found} bodies span fewer than the {wanted} components wanted")]
    TooFewBodies {
        /// Directions in which the bodies differ.
        found: usize,
        /// Components asked for.
        wanted: usize,
    },
    /// The mesh has no mirror image of a vertex.
    #[error("vertex {vertex} of the mean body has no mirror image within {tolerance_m} m")]
    NotSymmetric {
        /// First such vertex.
        vertex: usize,
        /// Largest distance allowed, metres.
        tolerance_m: f64,
    },
    /// No more edges to collapse.
    #[error("the template stays at {found} vertices, {wanted} were wanted")]
    NotDecimated {
        /// Vertices left.
        found: usize,
        /// Vertices asked for.
        wanted: usize,
    },
    /// A landmark that the skeleton needs.
    #[error("the landmark `{name}` is missing")]
    MissingLandmark {
        /// Its name.
        name: &'static str,
    },
    /// A body part that the decimation needs.
    #[error("the body part `{name}` is missing")]
    MissingPart {
        /// Its name.
        name: &'static str,
    },
}

/// Makes the body model of a population; [`BodyFile::to_bytes`] is the asset.
///
/// # Errors
/// When the population is too small or its mesh is not symmetric.
pub fn build_body_asset(data: &BodiesData, config: &BuildConfig) -> Result<BodyFile, BuildError> {
    let body = MeanBody::of(data)?;
    let half =
        decimate::decimate(HalfMesh::left_of(&body), &decimate::Importance::of(data)?, config.n_vertices)?;
    let template = half.with_mirror_image(&body);
    let fit = SurfaceFit::of(&body, &template.sources, &template.triangles);
    let heels = heel_vertices(data)?;
    let space = ShapeSpace::of(data, &fit, heels, config.n_components)?;
    let mean = &space.mean_vertices;
    let tree = TriangleTree::new(mean, &template.triangles);
    let landmark = |(name, vertex): &(String, u32)| {
        let nearest = tree.nearest(data.mean[*vertex as usize]);
        LandmarkFile {
            name: name.clone(),
            triangle: nearest.triangle,
            barycentric: nearest.barycentric.map(|w| w as f32),
        }
    };
    let skin: Vec<Vec<(u8, f32)>> = (0..mean.len()).map(|vertex| skin_of(data, &template, vertex)).collect();
    Ok(BodyFile {
        triangles: template.triangles.iter().map(|t| t.map(|vertex| vertex as u16)).collect(),
        parts: template.sources.iter().map(|&source| data.parts[source as usize]).collect(),
        part_names: data.part_names.clone(),
        landmarks: data.landmarks.iter().map(landmark).collect(),
        influence_counts: skin.iter().map(|influences| influences.len() as u8).collect(),
        influences: skin.concat(),
        mean_vertices: flat(mean),
        vertex_basis: space.vertex_basis.iter().flat_map(|direction| flat(direction)).collect(),
        mean_joints: flat(&space.mean_joints),
        joint_basis: space.joint_basis.iter().flat_map(|direction| flat(direction)).collect(),
        variance_shares: space.variance_shares.iter().map(|&share| share as f32).collect(),
        stature_lines: space.stature_lines.map(|line| StatureLineFile {
            mean_stature_m: line.mean_stature_m as f32,
            mean_scores: line.mean_scores.iter().map(|&score| score as f32).collect(),
            scores_per_m: line.scores_per_m.iter().map(|&score| score as f32).collect(),
        }),
        source_vertices: template.sources,
    })
}

fn flat(points: &[DVec3]) -> Vec<f32> {
    points.iter().flat_map(|point| point.to_array().map(|x| x as f32)).collect()
}

/// Template before its surface is fitted.
struct Template {
    triangles: Vec<[u32; 3]>,
    /// Vertex of the population's mesh for each vertex.
    sources: Vec<u32>,
    /// The vertex on the other side.
    mirror: Vec<u32>,
}

/// Weights of the source vertex, averaged with the mirror image of its counterpart's.
fn skin_of(data: &BodiesData, template: &Template, vertex: usize) -> Vec<(u8, f32)> {
    let mut sums = [0.0; N_JOINTS];
    for &(joint, weight) in &data.skin[template.sources[vertex] as usize] {
        sums[joint.index()] += weight / 2.0;
    }
    for &(joint, weight) in &data.skin[template.sources[template.mirror[vertex] as usize] as usize] {
        sums[joint.mirror().index()] += weight / 2.0;
    }
    let mut influences: Vec<(u8, f32)> = (0u8..).zip(sums).filter(|&(_, weight)| weight > 1e-3).collect();
    influences.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    influences.truncate(MAX_INFLUENCES);
    let sum: f32 = influences.iter().map(|&(_, weight)| weight).sum();
    influences.iter().map(|&(joint, weight)| (joint, weight / sum)).collect()
}

/// The vertices of the soles below the rearmost points of the heels, left and right: where the heels touch the floor. They are
/// the last two joints, which a population does not list.
///
/// # Errors
/// When the landmarks of the heels are missing.
pub fn heel_vertices(data: &BodiesData) -> Result<[u32; 2], BuildError> {
    let heel = |name: &'static str, ankle: JointId| {
        let landmark = data.landmarks.iter().find(|(known, _)| known == name);
        let (_, rearmost) = landmark.ok_or(BuildError::MissingLandmark { name })?;
        let foot = data.parts[*rearmost as usize];
        let toe = data.mean_joints[JointId::from_index(ankle.index() + 2).expect("the toe tip").index()];
        let sole = data.mean[*rearmost as usize].with_y(toe.y);
        let distance = |&vertex: &u32| data.mean[vertex as usize].distance(sole);
        let vertices = (0..data.mean.len() as u32).filter(|&vertex| data.parts[vertex as usize] == foot);
        Ok(vertices.min_by(|a, b| distance(a).total_cmp(&distance(b))).expect("the landmark is one of them"))
    };
    Ok([
        heel("Lt Calcaneous, Post.", JointId::LEFT_ANKLE)?,
        heel("Rt Calcaneous, Post.", JointId::RIGHT_ANKLE)?,
    ])
}
