//! Least-squares fit of the template's surface to the surface of a body on the population's mesh.

use glam::DVec3;
use nalgebra::{Cholesky, DMatrix, Dyn};

use super::pockets::{hidden_vertices, vertex_normals};
use crate::io::bodies::BodiesData;
use crate::mesh::{TriangleTree, area_normal, corners};

/// Weight of smoothness against distance.
const SMOOTHNESS: f64 = 0.05;
/// Rounds of nearest points and fit.
const N_ROUNDS: usize = 4;
/// A vertex is tied to the nearest triangle only if their normals agree to the angle of this cosine.
const LEAST_COSINE: f64 = 0.3;

/// The template's vertices T for a body of vertices V minimise
/// sum over i of a_i |B_i T - V_i|^2 + lambda |L (T - S V)|^2, where a is the area around a vertex, B ties it to a point of a template
/// triangle, S picks the source vertices and L is the umbrella Laplacian: T is linear in V.
pub struct SurfaceFit {
    sources: Vec<u32>,
    ties: Vec<Tie>,
    /// lambda LᵀL
    smoothness: DMatrix<f64>,
    normal: Cholesky<f64, Dyn>,
}

/// A vertex of the population's mesh and its place on the template.
struct Tie {
    vertex: u32,
    area: f64,
    corners: [u32; 3],
    barycentric: [f64; 3],
}

impl SurfaceFit {
    /// Ties the template with `triangles` over vertices that start at `sources` of the mean body to the population's mesh.
    pub(super) fn new(data: &BodiesData, sources: &[u32], triangles: &[[u32; 3]]) -> Self {
        let mut template: Vec<DVec3> = sources.iter().map(|&source| data.mean[source as usize]).collect();
        let laplacian = umbrella(sources.len(), triangles);
        let areas = visible_areas(data);
        let mean_area = areas.iter().sum::<f64>() / sources.len() as f64;
        let smoothness = laplacian.tr_mul(&laplacian) * (SMOOTHNESS * mean_area);
        let normals = vertex_normals(&data.mean, &data.triangles);
        let mut fit = None;
        for _ in 0..N_ROUNDS {
            let ties = tie(data, &template, triangles, &areas, &normals);
            let mut matrix = smoothness.clone();
            for tie in &ties {
                for (&i, bi) in tie.corners.iter().zip(tie.barycentric) {
                    for (&j, bj) in tie.corners.iter().zip(tie.barycentric) {
                        matrix[(i as usize, j as usize)] += tie.area * bi * bj;
                    }
                }
            }
            // The smoothness alone leaves translations free; the ties hold them.
            let normal = Cholesky::new(matrix).expect("ties to a whole surface fix every vertex");
            let round = Self { sources: sources.to_vec(), ties, smoothness: smoothness.clone(), normal };
            template = round.apply(&data.mean);
            fit = Some(round);
        }
        fit.expect("there is at least one round")
    }

    /// Template vertices of a body, or of a direction of the basis, given on the population's mesh; metres.
    pub fn apply(&self, population_vertices: &[DVec3]) -> Vec<DVec3> {
        let n = self.sources.len();
        let mut picked = DMatrix::zeros(n, 3);
        for (row, &source) in self.sources.iter().enumerate() {
            let p = population_vertices[source as usize];
            (0..3).for_each(|axis| picked[(row, axis)] = p[axis]);
        }
        let mut right = &self.smoothness * picked;
        for tie in &self.ties {
            let p = population_vertices[tie.vertex as usize] * tie.area;
            for (&corner, weight) in tie.corners.iter().zip(tie.barycentric) {
                (0..3).for_each(|axis| right[(corner as usize, axis)] += weight * p[axis]);
            }
        }
        self.normal.solve_mut(&mut right);
        (0..n).map(|row| DVec3::new(right[(row, 0)], right[(row, 1)], right[(row, 2)])).collect()
    }
}

fn tie(data: &BodiesData, template: &[DVec3], triangles: &[[u32; 3]], areas: &[f64], normals: &[DVec3]) -> Vec<Tie> {
    let tree = TriangleTree::new(template, triangles);
    let tie_of = |vertex: usize| {
        let nearest = tree.nearest(data.mean[vertex]);
        let corners_of = triangles[nearest.triangle as usize];
        let agree = area_normal(corners(template, corners_of)).normalize_or_zero().dot(normals[vertex]) > LEAST_COSINE;
        let tie = || Tie { vertex: vertex as u32, area: areas[vertex], corners: corners_of, barycentric: nearest.barycentric };
        (agree && areas[vertex] > 0.0).then(tie)
    };
    (0..data.mean.len()).filter_map(tie_of).collect()
}

/// A third of the area of the triangles around each vertex; 0 in pockets, which the template closes.
fn visible_areas(data: &BodiesData) -> Vec<f64> {
    let mut areas = vec![0.0; data.mean.len()];
    for &triangle in &data.triangles {
        let third = area_normal(corners(&data.mean, triangle)).length() / 6.0;
        triangle.iter().for_each(|&vertex| areas[vertex as usize] += third);
    }
    let all: Vec<u32> = (0..data.mean.len() as u32).collect();
    let hidden = hidden_vertices(data, &all).expect("the decimation has found the parts it needs");
    areas.iter().zip(hidden).map(|(&area, is_hidden)| if is_hidden { 0.0 } else { area }).collect()
}

/// Rows: a vertex minus the mean of its neighbours.
fn umbrella(n_vertices: usize, triangles: &[[u32; 3]]) -> DMatrix<f64> {
    let mut matrix = DMatrix::zeros(n_vertices, n_vertices);
    for &[a, b, c] in triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            matrix[(from as usize, to as usize)] = -1.0; // the reverse edge comes with the triangle beyond it
        }
    }
    for mut row in matrix.row_iter_mut() {
        let degree = -row.sum();
        row /= degree;
    }
    matrix.fill_diagonal(1.0);
    matrix
}
