//! Triangle meshes: nearest points, rays, crossings, closedness.

use std::collections::HashMap;

use glam::DVec3;

mod crossing;
mod points;
mod tree;

pub use crossing::{crossing_triangles, triangles_cross};
pub use points::PointTree;
pub use tree::{Nearest, TriangleTree};

#[cfg(test)]
mod tests;

/// The corners of triangle `t`.
pub(crate) fn corners(vertices: &[DVec3], triangle: [u32; 3]) -> [DVec3; 3] {
    triangle.map(|vertex| vertices[vertex as usize])
}

/// Twice the area times the outward unit normal.
pub(crate) fn area_normal([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a)
}

/// Whether every edge lies between exactly two triangles that run along it in opposite directions: the mesh is one or
/// more closed surfaces, consistently oriented.
///
/// ```
/// let tetrahedron = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];
/// assert!(body::mesh::is_closed(&tetrahedron));
/// assert!(!body::mesh::is_closed(&tetrahedron[1..]));
/// ```
pub fn is_closed(triangles: &[[u32; 3]]) -> bool {
    let mut uses: HashMap<(u32, u32), u32> = HashMap::new();
    for &[a, b, c] in triangles {
        for edge in [(a, b), (b, c), (c, a)] {
            *uses.entry(edge).or_default() += 1;
        }
    }
    triangles.iter().all(|&[a, b, c]| {
        [(a, b), (b, c), (c, a)]
            .iter()
            .all(|&(from, to)| uses[&(from, to)] == 1 && uses.get(&(to, from)) == Some(&1))
    })
}

/// Volume inside a closed mesh, cubic metres.
pub fn volume_m3(vertices: &[DVec3], triangles: &[[u32; 3]]) -> f64 {
    let six = |&triangle: &[u32; 3]| {
        let [a, b, c] = corners(vertices, triangle);
        a.dot(b.cross(c))
    };
    triangles.iter().map(six).sum::<f64>() / 6.0
}
