//! Plane sections of a triangle mesh.

use glam::{DVec2, DVec3};

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

/// Adds the points in which the edges of `triangles` pass through `plane` to `out`, in its axes, metres. An edge between
/// two of the triangles counts twice, which a hull does not mind.
pub(crate) fn cut(vertices: &[[f32; 3]], triangles: &[[u32; 3]], plane: &Plane, out: &mut Vec<[f64; 2]>) {
    let (u, v) = plane.axes();
    let in_plane = |p: DVec3| DVec2::new(u.dot(p), v.dot(p));
    for triangle in triangles {
        let corners =
            triangle.map(|vertex| DVec3::from_array(vertices[vertex as usize].map(f64::from)) - plane.point);
        let heights = corners.map(|corner| plane.normal.dot(corner));
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            if (heights[from] < 0.0) != (heights[to] < 0.0) {
                let share = heights[from] / (heights[from] - heights[to]);
                let crossing = in_plane(corners[from]).lerp(in_plane(corners[to]), share);
                out.push(crossing.to_array());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_is_cut_at_two_edges() {
        let vertices = [[0.0, 0.0, 0.0], [0.0, 2.0, 0.0], [4.0, 2.0, 0.0]];
        let mut points = Vec::new();
        let plane = Plane::horizontal(1.0);
        cut(&vertices, &[[0, 1, 2]], &plane, &mut points);
        let mut lifted: Vec<DVec3> = points.iter().map(|&p| plane.lift(p)).collect();
        lifted.sort_by(|a, b| a.x.total_cmp(&b.x));
        assert!(lifted[0].distance(DVec3::new(0.0, 1.0, 0.0)) < 1e-12, "{lifted:?}");
        assert!(lifted[1].distance(DVec3::new(2.0, 1.0, 0.0)) < 1e-12, "{lifted:?}");
        points.clear();
        cut(&vertices, &[[0, 1, 2]], &Plane::horizontal(2.5), &mut points);
        assert!(points.is_empty());
    }
}
