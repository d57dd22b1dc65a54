//! The last step: vertices leave the shape space, held together by the edges of the template.

use glam::{DMat3, DVec3};

use super::model_fit::{LEAST_COSINE, LandmarkPair, vertex_normals};
use super::scan::Scan;

/// Weights of one round, all relative to E_V, the mean square of the distances from the vertices to the scan.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stiffness {
    /// Of E_R: how unwilling neighbours are to move apart.
    pub edges: f64,
    /// Of E_L, the landmarks.
    pub landmarks: f64,
    /// Scan farther than this does not pull, metres.
    pub farthest_m: f64,
}

/// Keeps the system regular where nothing pulls: leaving the start costs this much of what leaving the scan does.
const ANCHOR: f64 = 1e-3;
/// Relative residual at which the conjugate gradients stop, and their steps at most.
const RESIDUAL: f64 = 1e-7;
const MAX_STEPS: usize = 600;

/// Displacements d of the vertices x that minimise
/// sum of (n (x + d - c))² over planes of the scan + λ_L sum of |B (x + d) - l|² + λ_R sum of |d_i - d_j|² over edges.
pub(super) fn deform(
    start: &[DVec3],
    current: &[DVec3],
    triangles: &[[u32; 3]],
    edges: &[[u32; 2]],
    scan: &Scan,
    landmarks: &[LandmarkPair],
    stiffness: &Stiffness,
) -> Vec<DVec3> {
    let n = start.len();
    let mut system = BlockSystem {
        blocks: vec![DMat3::from_diagonal(DVec3::splat(ANCHOR)); n],
        right: vec![DVec3::ZERO; n],
        edges,
        edge_weight: stiffness.edges,
        landmarks,
        landmark_weight: stiffness.landmarks,
    };
    let normals = vertex_normals(current, triangles);
    for vertex in 0..n {
        let (place, normal) = (current[vertex], normals[vertex]);
        let Some(plane) = scan.surface_near(place, normal, stiffness.farthest_m, LEAST_COSINE) else {
            continue;
        };
        let n = plane.normal;
        system.blocks[vertex] += DMat3::from_cols(n * n.x, n * n.y, n * n.z);
        system.right[vertex] -= n * plane.height_m(start[vertex]);
    }
    for landmark in landmarks {
        let corners = || landmark.vertices.iter().zip(landmark.barycentric);
        let place: DVec3 = corners().map(|(&v, w)| start[v as usize] * w).sum();
        let pull = (landmark.position - place) * stiffness.landmarks;
        corners().for_each(|(&v, w)| system.right[v as usize] += pull * w);
    }
    let steps = system.solve();
    start.iter().zip(steps).map(|(place, step)| *place + step).collect()
}

/// A sparse symmetric positive definite system in blocks of three.
struct BlockSystem<'a> {
    blocks: Vec<DMat3>,
    right: Vec<DVec3>,
    edges: &'a [[u32; 2]],
    edge_weight: f64,
    landmarks: &'a [LandmarkPair],
    landmark_weight: f64,
}

impl BlockSystem<'_> {
    fn times(&self, x: &[DVec3], out: &mut [DVec3]) {
        for ((out, block), x) in out.iter_mut().zip(&self.blocks).zip(x) {
            *out = *block * *x;
        }
        for &[a, b] in self.edges {
            let pull = self.edge_weight * (x[a as usize] - x[b as usize]);
            out[a as usize] += pull;
            out[b as usize] -= pull;
        }
        for landmark in self.landmarks {
            let corners = || landmark.vertices.iter().zip(landmark.barycentric);
            let place: DVec3 = corners().map(|(&v, w)| x[v as usize] * w).sum();
            corners().for_each(|(&v, w)| out[v as usize] += self.landmark_weight * w * place);
        }
    }

    /// Conjugate gradients (`[Hestenes1952]`), each block of the diagonal inverted as preconditioner.
    fn solve(&self) -> Vec<DVec3> {
        let n = self.right.len();
        let mut diagonal = self.blocks.clone();
        for &[a, b] in self.edges {
            diagonal[a as usize] += DMat3::from_diagonal(DVec3::splat(self.edge_weight));
            diagonal[b as usize] += DMat3::from_diagonal(DVec3::splat(self.edge_weight));
        }
        let inverse: Vec<DMat3> = diagonal.iter().map(DMat3::inverse).collect();
        let dot = |a: &[DVec3], b: &[DVec3]| a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum::<f64>();
        let precondition = |r: &[DVec3]| r.iter().zip(&inverse).map(|(r, m)| *m * *r).collect::<Vec<_>>();
        let (mut x, mut residual) = (vec![DVec3::ZERO; n], self.right.clone());
        let mut direction = precondition(&residual);
        let mut product = vec![DVec3::ZERO; n];
        let mut fall = dot(&residual, &direction);
        let enough = fall * RESIDUAL * RESIDUAL;
        for _ in 0..MAX_STEPS {
            if fall <= enough {
                break;
            }
            self.times(&direction, &mut product);
            let step = fall / dot(&direction, &product);
            for k in 0..n {
                x[k] += step * direction[k];
                residual[k] -= step * product[k];
            }
            let preconditioned = precondition(&residual);
            let next = dot(&residual, &preconditioned);
            let keep = next / fall;
            fall = next;
            for (d, p) in direction.iter_mut().zip(preconditioned) {
                *d = p + keep * *d;
            }
        }
        x
    }
}
