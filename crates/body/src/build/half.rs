//! Cuts the mean body along its midline and mirrors the left half back.

use glam::DVec3;

use super::{BuildError, Template, pockets};
use crate::io::bodies::BodiesData;

/// Vertices nearer to the plane x = 0 lie on it.
const MIDLINE_M: f64 = 1e-4;
/// A vertex and its counterpart mirror each other up to this.
const SYMMETRY_M: f64 = 5e-4;

/// What the steps need to know of the population's mean body.
pub(super) struct MeanBody<'a> {
    pub data: &'a BodiesData,
    /// The vertex on the other side.
    pub counterparts: Vec<u32>,
    /// Inside the mouth, an eye socket or the like.
    pub is_hidden: Vec<bool>,
    pub normals: Vec<DVec3>,
}

impl<'a> MeanBody<'a> {
    pub fn of(data: &'a BodiesData) -> Result<Self, BuildError> {
        let mut by_height: Vec<u32> = (0..data.mean.len() as u32).collect();
        by_height.sort_by(|&a, &b| data.mean[a as usize].y.total_cmp(&data.mean[b as usize].y));
        let counterpart = |vertex: usize| {
            let image = data.mean[vertex] * DVec3::new(-1.0, 1.0, 1.0);
            let first = by_height.partition_point(|&v| data.mean[v as usize].y < image.y - SYMMETRY_M);
            let level =
                by_height[first..].iter().take_while(|&&v| data.mean[v as usize].y < image.y + SYMMETRY_M);
            let near =
                level.map(|&v| (data.mean[v as usize].distance(image), v)).filter(|near| near.0 < SYMMETRY_M);
            let nearest = near.min_by(|a, b| a.0.total_cmp(&b.0));
            nearest
                .map(|(_, vertex)| vertex)
                .ok_or(BuildError::NotSymmetric { vertex, tolerance_m: SYMMETRY_M })
        };
        let counterparts = (0..data.mean.len()).map(counterpart).collect::<Result<Vec<u32>, _>>()?;
        let normals = pockets::vertex_normals(&data.mean, &data.triangles);
        let mut is_hidden = pockets::hidden_vertices(data, &normals)?;
        for vertex in 0..is_hidden.len() {
            if data.mean[vertex].x < 0.0 {
                is_hidden[vertex] = is_hidden[counterparts[vertex] as usize];
            }
        }
        Ok(Self { data, counterparts, is_hidden, normals })
    }

    pub fn on_midline(&self, vertex: u32) -> bool {
        self.data.mean[vertex as usize].x.abs() < MIDLINE_M
    }

    pub fn is_left(&self, vertex: u32) -> bool {
        self.data.mean[vertex as usize].x >= MIDLINE_M
    }
}

/// The left half (x >= 0) of a symmetric mesh, open along the midline.
pub(super) struct HalfMesh {
    pub vertices: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    /// On the midline: the rim of the half.
    pub on_midline: Vec<bool>,
    pub is_hidden: Vec<bool>,
    pub parts: Vec<u8>,
    /// Vertex of the whole mesh.
    pub sources: Vec<u32>,
}

impl HalfMesh {
    pub fn left_of(body: &MeanBody) -> Self {
        let data = body.data;
        let is_kept = |&v: &u32| body.is_left(v) || body.on_midline(v);
        let kept: Vec<[u32; 3]> = data.triangles.iter().copied().filter(|t| t.iter().all(is_kept)).collect();
        let mut sources: Vec<u32> = kept.concat();
        sources.sort_unstable();
        sources.dedup();
        let place =
            |vertex: u32| sources.binary_search(&vertex).expect("every kept vertex is in the list") as u32;
        Self {
            vertices: sources.iter().map(|&v| data.mean[v as usize]).collect(),
            triangles: kept.iter().map(|t| t.map(place)).collect(),
            on_midline: sources.iter().map(|&v| body.on_midline(v)).collect(),
            is_hidden: sources.iter().map(|&v| body.is_hidden[v as usize]).collect(),
            parts: sources.iter().map(|&v| data.parts[v as usize]).collect(),
            sources,
        }
    }

    /// The whole template: the half, then the mirror images of the vertices off the midline.
    pub fn with_mirror_image(&self, body: &MeanBody) -> Template {
        let mut sources = self.sources.clone();
        let mut mirror: Vec<u32> = (0..self.sources.len() as u32).collect();
        for (vertex, &source) in
            self.sources.iter().enumerate().filter(|&(vertex, _)| !self.on_midline[vertex])
        {
            mirror[vertex] = sources.len() as u32;
            mirror.push(vertex as u32);
            sources.push(body.counterparts[source as usize]);
        }
        let reflected = self.triangles.iter().map(|&[a, b, c]| [a, c, b].map(|v| mirror[v as usize]));
        Template { triangles: self.triangles.iter().copied().chain(reflected).collect(), sources, mirror }
    }
}
