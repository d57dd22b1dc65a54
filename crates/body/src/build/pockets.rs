//! Which vertices of the head no one sees from outside: mouth, eye sockets, nostrils.

use glam::DVec3;

use super::BuildError;
use crate::io::bodies::BodiesData;
use crate::mesh::{TriangleTree, area_normal, corners};

/// Directions of view, spread evenly over the sphere.
const N_VIEWS: usize = 96;
/// A vertex seen from fewer of the views before it lies in a pocket.
const LEAST_SEEN: f64 = 0.12;
/// Rays start this far above the surface, metres.
const LIFT_M: f64 = 1e-4;

/// Whether each vertex of the mean body belongs to the head and lies in a pocket.
pub(super) fn hidden_vertices(data: &BodiesData, normals: &[DVec3]) -> Result<Vec<bool>, BuildError> {
    let head = super::decimate::part(data, "head")?;
    let tree = TriangleTree::new(&data.mean, &data.triangles);
    let views: Vec<DVec3> = (0..N_VIEWS).map(view).collect();
    let is_hidden = |vertex: usize| {
        if data.parts[vertex] != head {
            return false;
        }
        let (normal, point) = (normals[vertex], data.mean[vertex]);
        let before: Vec<DVec3> = views.iter().copied().filter(|view| view.dot(normal) > 0.1).collect();
        let seen = before.iter().filter(|&&view| !tree.is_hit(point + normal * LIFT_M, view, 0.0)).count();
        (seen as f64) < LEAST_SEEN * before.len() as f64
    };
    Ok((0..data.mean.len()).map(is_hidden).collect())
}

/// Point `index` of a Fibonacci spiral on the unit sphere.
fn view(index: usize) -> DVec3 {
    let golden_angle = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let y = 1.0 - (2 * index + 1) as f64 / N_VIEWS as f64;
    let (sin, cos) = (golden_angle * index as f64).sin_cos();
    DVec3::new((1.0 - y * y).sqrt() * cos, y, (1.0 - y * y).sqrt() * sin)
}

/// Unit normals, the mean of the triangles around a vertex weighted by area.
pub(super) fn vertex_normals(vertices: &[DVec3], triangles: &[[u32; 3]]) -> Vec<DVec3> {
    let mut normals = vec![DVec3::ZERO; vertices.len()];
    for &triangle in triangles {
        let normal = area_normal(corners(vertices, triangle));
        triangle.iter().for_each(|&vertex| normals[vertex as usize] += normal);
    }
    normals.iter().map(|normal| normal.normalize_or_zero()).collect()
}
