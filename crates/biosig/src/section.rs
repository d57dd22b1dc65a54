//! Plane sections of a triangle mesh.

use std::collections::HashSet;

use glam::{DVec3, Vec3};

/// A plane that a tape lies in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// A point of it, metres, body frame.
    pub point: DVec3,
    /// Unit normal.
    pub normal: DVec3,
}

impl Plane {
    /// The horizontal plane at `height_m` (y is up).
    pub fn horizontal(height_m: f64) -> Self {
        Self { point: DVec3::Y * height_m, normal: DVec3::Y }
    }

    /// Two axes that span the plane and, with its normal, a right-handed frame.
    fn axes(&self) -> (DVec3, DVec3) {
        self.normal.any_orthonormal_pair()
    }

    /// A point of the plane from its coordinates in [`Plane::axes`].
    pub(crate) fn lift(&self, point: [f64; 2]) -> DVec3 {
        let (u, v) = self.axes();
        self.point + u * point[0] + v * point[1]
    }
}

/// Triangles of one part of a mesh, ready to be cut.
#[derive(Clone, Debug)]
pub(crate) struct Piece {
    triangles: Vec<[u32; 3]>,
    /// Edges, in the direction of their triangle, that no other triangle of the piece runs along the other way.
    rim: Vec<[u32; 2]>,
}

/// The edges of a triangle in its own direction.
fn edges([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]]
}

impl Piece {
    pub fn new(triangles: Vec<[u32; 3]>) -> Self {
        let all: HashSet<[u32; 2]> = triangles.iter().flat_map(|&triangle| edges(triangle)).collect();
        let is_rim = |[from, to]: &[u32; 2]| !all.contains(&[*to, *from]);
        let rim = triangles.iter().flat_map(|&triangle| edges(triangle)).filter(is_rim).collect();
        Self { triangles, rim }
    }

    /// The triangles that reach into a range of heights (`[n_vertices]`).
    pub fn between(&self, heights: &[f32], [low, high]: [f64; 2]) -> Self {
        let reaches = |vertices: &[u32]| {
            let of = vertices.iter().map(|&vertex| f64::from(heights[vertex as usize]));
            of.clone().any(|height| height >= low) && of.clone().any(|height| height <= high)
        };
        Self {
            triangles: self.triangles.iter().copied().filter(|triangle| reaches(triangle)).collect(),
            rim: self.rim.iter().copied().filter(|edge| reaches(edge)).collect(),
        }
    }

    /// Adds the points in which the edges pass through `plane` to `out`, in the plane's axes, metres. `heights` are those of the
    /// vertices along the plane's normal, `[n_vertices]`.
    ///
    /// An edge inside the piece is run along both ways, and counts on its way up; one on the rim counts both ways.
    pub fn cut(&self, vertices: &[[f32; 3]], heights: &[f32], plane: &Plane, out: &mut Vec<[f64; 2]>) {
        let level = plane.normal.dot(plane.point) as f32;
        let (u, v) = plane.axes();
        let height = |vertex: u32| heights[vertex as usize];
        let mut cross = |from: u32, to: u32| {
            let above_level = |vertex: u32| f64::from(height(vertex)) - f64::from(level);
            let share = above_level(from) / (above_level(from) - above_level(to));
            let [start, end] = [position_of(vertices, from), position_of(vertices, to)];
            let crossing = start.lerp(end, share) - plane.point;
            out.push([u.dot(crossing), v.dot(crossing)]);
        };
        for &[a, b, c] in &self.triangles {
            let is_below = [height(a) < level, height(b) < level, height(c) < level];
            match is_below {
                [true, true, true] | [false, false, false] => {}
                [true, false, _] => cross(a, b),
                [_, true, false] => cross(b, c),
                [false, _, true] => cross(c, a),
            }
        }
        for &[from, to] in &self.rim {
            if height(from) >= level && height(to) < level {
                cross(from, to);
            }
        }
    }
}

/// Position of a vertex, metres.
pub(crate) fn position_of(vertices: &[[f32; 3]], vertex: u32) -> DVec3 {
    Vec3::from_array(vertices[vertex as usize]).as_dvec3()
}

/// Heights of the vertices along a direction, metres.
pub(crate) fn heights_along(vertices: &[[f32; 3]], direction: DVec3) -> Vec<f32> {
    let [x, y, z] = direction.to_array().map(|c| c as f32);
    vertices.iter().map(|vertex| x * vertex[0] + y * vertex[1] + z * vertex[2]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_is_cut_at_two_edges() {
        let vertices = [[0.0, 0.0, 0.0], [0.0, 2.0, 0.0], [4.0, 2.0, 0.0]];
        let heights = heights_along(&vertices, DVec3::Y);
        let piece = Piece::new(vec![[0, 1, 2]]);
        let mut points = Vec::new();
        let plane = Plane::horizontal(1.0);
        piece.cut(&vertices, &heights, &plane, &mut points);
        let mut lifted: Vec<DVec3> = points.iter().map(|&p| plane.lift(p)).collect();
        lifted.sort_by(|a, b| a.x.total_cmp(&b.x));
        assert_eq!(lifted.len(), 2);
        assert!(lifted[0].distance(DVec3::new(0.0, 1.0, 0.0)) < 1e-6, "{lifted:?}");
        assert!(lifted[1].distance(DVec3::new(2.0, 1.0, 0.0)) < 1e-6, "{lifted:?}");
        points.clear();
        piece.cut(&vertices, &heights, &Plane::horizontal(2.5), &mut points);
        assert!(points.is_empty());
        assert!(piece.between(&heights, [2.1, 3.0]).triangles.is_empty());
        assert_eq!(piece.between(&heights, [0.5, 0.6]).triangles.len(), 1);
    }

    #[test]
    fn every_edge_of_a_closed_piece_counts_once() {
        let vertices = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let tetrahedron = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];
        let heights = heights_along(&vertices, DVec3::Y);
        let cut = |piece: &Piece| {
            let mut points = Vec::new();
            piece.cut(&vertices, &heights, &Plane::horizontal(0.5), &mut points);
            points.len()
        };
        let closed = Piece::new(tetrahedron.clone());
        assert!(closed.rim.is_empty());
        assert_eq!(cut(&closed), 3);
        let open = Piece::new(tetrahedron[1..].to_vec());
        assert_eq!((open.rim.len(), cut(&open)), (3, 3));
    }
}
