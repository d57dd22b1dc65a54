//! Least-squares fit of the template's surface to the surface of a body on the population's mesh.

use glam::DVec3;
use nalgebra::{Cholesky, DMatrix, Dyn};

use super::BuildError;
use super::half::MeanBody;
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
    ///
    /// # Errors
    /// When the mean body is not symmetric or has no part `head`.
    ///
    /// # Panics
    /// When `sources` or `triangles` name a vertex that is not there, or `sources` hold no mirror image of one.
    pub fn new(data: &BodiesData, sources: &[u32], triangles: &[[u32; 3]]) -> Result<Self, BuildError> {
        Ok(Self::of(&MeanBody::of(data)?, sources, triangles))
    }

    pub(super) fn of(body: &MeanBody, sources: &[u32], triangles: &[[u32; 3]]) -> Self {
        let mut template: Vec<DVec3> =
            sources.iter().map(|&source| body.data.mean[source as usize]).collect();
        let laplacian = umbrella(sources.len(), triangles);
        let areas = visible_areas(body);
        let mean_area = areas.iter().sum::<f64>() / sources.len() as f64;
        let smoothness = laplacian.tr_mul(&laplacian) * (SMOOTHNESS * mean_area);
        let mirror: Vec<u32> = sources.iter().map(|&source| mirror_of(body, sources, source)).collect();
        let mut fit = None;
        for _ in 0..N_ROUNDS {
            let ties = tie(body, &template, triangles, &areas, &mirror);
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
            template = round.apply(&body.data.mean);
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

/// Template vertex whose source is the counterpart of `source`.
fn mirror_of(body: &MeanBody, sources: &[u32], source: u32) -> u32 {
    let counterpart = body.counterparts[source as usize];
    let place = sources.iter().position(|&other| other == counterpart);
    place.expect("the template is the mirror image of itself") as u32
}

/// Ties of the left half and their mirror images: which triangle is nearest must not differ between the sides.
fn tie(
    body: &MeanBody,
    template: &[DVec3],
    triangles: &[[u32; 3]],
    areas: &[f64],
    mirror: &[u32],
) -> Vec<Tie> {
    let tree = TriangleTree::new(template, triangles);
    let mut ties = Vec::new();
    for vertex in (0..areas.len() as u32).filter(|&v| areas[v as usize] > 0.0) {
        let side = if body.on_midline(vertex) { 0.5 } else { 1.0 };
        if !body.is_left(vertex) && side == 1.0 {
            continue;
        }
        let (normal, nearest) =
            (body.normals[vertex as usize], tree.nearest(body.data.mean[vertex as usize]));
        let own = triangles[nearest.triangle as usize];
        if area_normal(corners(template, own)).normalize_or_zero().dot(normal) > LEAST_COSINE {
            let (area, barycentric) = (side * areas[vertex as usize], nearest.barycentric);
            let image = own.map(|corner| mirror[corner as usize]);
            ties.push(Tie { vertex, area, corners: own, barycentric });
            ties.push(Tie { vertex: body.counterparts[vertex as usize], area, corners: image, barycentric });
        }
    }
    ties
}

/// A third of the area of the triangles around each vertex; 0 in pockets, which the template closes.
fn visible_areas(body: &MeanBody) -> Vec<f64> {
    let mut areas = vec![0.0; body.data.mean.len()];
    for &triangle in &body.data.triangles {
        let third = area_normal(corners(&body.data.mean, triangle)).length() / 6.0;
        triangle.iter().for_each(|&vertex| areas[vertex as usize] += third);
    }
    areas.iter().zip(&body.is_hidden).map(|(&area, &is_hidden)| if is_hidden { 0.0 } else { area }).collect()
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
