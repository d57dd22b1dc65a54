//! Cuts the mean body along its midline and mirrors the left half back.

use glam::DVec3;

use super::{BuildError, Template, pockets};
use crate::io::bodies::BodiesData;

/// Vertices nearer to the plane x = 0 lie on it.
const MIDLINE_M: f64 = 1e-4;
/// A vertex and its counterpart mirror each other up to this.
const SYMMETRY_M: f64 = 5e-4;

/// The left half (x >= 0) of a symmetric mesh, open along the midline.
pub(super) struct HalfMesh {
    pub vertices: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    /// On the midline: the rim of the half.
    pub on_midline: Vec<bool>,
    /// Inside the mouth, an eye socket or the like.
    pub is_hidden: Vec<bool>,
    pub parts: Vec<u8>,
    /// Vertex of the whole mesh.
    pub sources: Vec<u32>,
    /// Its counterpart there.
    pub mirror_sources: Vec<u32>,
}

impl HalfMesh {
    pub fn left_of(data: &BodiesData) -> Result<Self, BuildError> {
        let is_left = |vertex: u32| data.mean[vertex as usize].x > -MIDLINE_M;
        let kept: Vec<[u32; 3]> = data.triangles.iter().copied().filter(|t| t.iter().all(|&v| is_left(v))).collect();
        let mut sources: Vec<u32> = kept.concat();
        sources.sort_unstable();
        sources.dedup();
        let place = |vertex: u32| sources.binary_search(&vertex).expect("every kept vertex is in the list") as u32;
        let hidden = pockets::hidden_vertices(data, &sources)?;
        Ok(Self {
            vertices: sources.iter().map(|&v| data.mean[v as usize]).collect(),
            triangles: kept.iter().map(|t| t.map(place)).collect(),
            on_midline: sources.iter().map(|&v| data.mean[v as usize].x.abs() < MIDLINE_M).collect(),
            is_hidden: hidden,
            parts: sources.iter().map(|&v| data.parts[v as usize]).collect(),
            mirror_sources: sources.iter().map(|&v| counterpart(data, v)).collect::<Result<_, _>>()?,
            sources,
        })
    }

    /// The whole template: the half, then the mirror images of the vertices off the midline.
    pub fn with_mirror_image(&self) -> Template {
        let mut sources = self.sources.clone();
        let mut mirror: Vec<u32> = (0..self.sources.len() as u32).collect();
        for vertex in 0..self.sources.len() {
            if !self.on_midline[vertex] {
                mirror[vertex] = sources.len() as u32;
                mirror.push(vertex as u32);
                sources.push(self.mirror_sources[vertex]);
            }
        }
        let reflected = self.triangles.iter().map(|&[a, b, c]| [a, c, b].map(|v| mirror[v as usize]));
        Template { triangles: self.triangles.iter().copied().chain(reflected).collect(), sources, mirror }
    }
}

fn counterpart(data: &BodiesData, vertex: u32) -> Result<u32, BuildError> {
    let image = data.mean[vertex as usize] * DVec3::new(-1.0, 1.0, 1.0);
    let distance = |&other: &u32| data.mean[other as usize].distance_squared(image);
    let nearest = (0..data.mean.len() as u32).min_by(|a, b| distance(a).total_cmp(&distance(b)));
    nearest
        .filter(|other| distance(other) < SYMMETRY_M * SYMMETRY_M)
        .ok_or(BuildError::NotSymmetric { vertex: vertex as usize, tolerance_m: SYMMETRY_M })
}
