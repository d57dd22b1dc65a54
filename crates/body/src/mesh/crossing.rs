//! Does a mesh cross itself?

use glam::DVec3;

use super::tree::ray_hit;
use super::{TriangleTree, corners};

/// Whether two triangles cross: an edge of one passes through the other. Triangles in one plane do not count.
pub fn triangles_cross(a: [DVec3; 3], b: [DVec3; 3]) -> bool {
    let pierces = |from: [DVec3; 3], into: [DVec3; 3]| {
        (0..3).any(|k| {
            let (start, end) = (from[k], from[(k + 1) % 3]);
            ray_hit(start, end - start, into).is_some_and(|s| (0.0..=1.0).contains(&s))
        })
    };
    pierces(a, b) || pierces(b, a)
}

/// Pairs of triangles of a mesh that cross, each pair once; triangles that share a vertex are left out.
pub fn crossing_triangles(vertices: &[DVec3], triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let tree = TriangleTree::new(vertices, triangles);
    let mut pairs = Vec::new();
    for (index, &triangle) in triangles.iter().enumerate() {
        let [a, b, c] = corners(vertices, triangle);
        for other in tree.candidates(a.min(b).min(c), a.max(b).max(c)) {
            let neighbour = triangles[other as usize];
            let is_apart = !neighbour.iter().any(|vertex| triangle.contains(vertex));
            if other as usize > index && is_apart && triangles_cross([a, b, c], corners(vertices, neighbour))
            {
                pairs.push([index as u32, other]);
            }
        }
    }
    pairs.sort_unstable();
    pairs
}
