//! A tree of boxes over the triangles of a mesh.

use glam::DVec3;

use super::corners;

/// Triangles in a leaf.
const LEAF: usize = 4;

/// A tree of boxes over triangles, for nearest points, rays and overlaps.
#[derive(Clone, Debug)]
pub struct TriangleTree {
    corners: Vec<[DVec3; 3]>,
    /// Triangles in the order of the leaves.
    order: Vec<u32>,
    nodes: Vec<Node>,
}

/// A box and the triangles `order[first..first + count]` in it; without `right` it is a leaf, else its left child follows it.
#[derive(Clone, Debug)]
struct Node {
    low: DVec3,
    high: DVec3,
    first: usize,
    count: usize,
    right: Option<usize>,
}

/// The point of a mesh nearest to another point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// Triangle it lies on.
    pub triangle: u32,
    /// Weights of the triangle's corners, sum 1.
    pub barycentric: [f64; 3],
    /// The point, metres.
    pub point: DVec3,
    /// How far it is, metres.
    pub distance_m: f64,
}

impl TriangleTree {
    /// A tree over `triangles` of `vertices`.
    ///
    /// # Panics
    /// When there is no triangle, or one names a vertex that is not there.
    pub fn new(vertices: &[DVec3], triangles: &[[u32; 3]]) -> Self {
        assert!(!triangles.is_empty(), "a mesh of 0 triangles has no nearest point");
        let corners = triangles.iter().map(|&triangle| corners(vertices, triangle)).collect();
        let mut tree = Self { corners, order: (0..triangles.len() as u32).collect(), nodes: Vec::new() };
        tree.split(0, triangles.len());
        tree
    }

    fn split(&mut self, first: usize, count: usize) -> usize {
        let points = self.order[first..first + count].iter().flat_map(|&t| self.corners[t as usize]);
        let (low, high) =
            points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        let index = self.nodes.len();
        self.nodes.push(Node { low, high, first, count, right: None });
        if count > LEAF {
            let size = high - low;
            let axis = if size.x >= size.max_element() {
                0
            } else if size.y >= size.max_element() {
                1
            } else {
                2
            };
            let corners = &self.corners;
            let middle = |t: &u32| corners[*t as usize].iter().map(|p| p[axis]).sum::<f64>();
            let half = count / 2;
            self.order[first..first + count]
                .select_nth_unstable_by(half, |a, b| middle(a).total_cmp(&middle(b)));
            self.split(first, half);
            self.nodes[index].right = Some(self.split(first + half, count - half));
        }
        index
    }

    /// The point of the mesh nearest to `point`.
    pub fn nearest(&self, point: DVec3) -> Nearest {
        let mut best = Nearest { triangle: 0, barycentric: [0.0; 3], point, distance_m: f64::INFINITY };
        let mut open = vec![0];
        while let Some(index) = open.pop() {
            let node = &self.nodes[index];
            if node.distance_to(point) >= best.distance_m {
                continue;
            }
            match node.right {
                None => {
                    for &triangle in &self.order[node.first..node.first + node.count] {
                        let corners = self.corners[triangle as usize];
                        let barycentric = nearest_on_triangle(point, corners);
                        let found = weighted(corners, barycentric);
                        if found.distance(point) < best.distance_m {
                            best = Nearest {
                                triangle,
                                barycentric,
                                point: found,
                                distance_m: found.distance(point),
                            };
                        }
                    }
                }
                Some(right) => {
                    let left = index + 1;
                    let left_first =
                        self.nodes[left].distance_to(point) < self.nodes[right].distance_to(point);
                    open.extend(if left_first { [right, left] } else { [left, right] });
                }
            }
        }
        best
    }

    /// Whether the ray from `origin` along `direction` meets a triangle farther than `least` lengths of `direction` away.
    pub fn is_hit(&self, origin: DVec3, direction: DVec3, least: f64) -> bool {
        let mut open = vec![0];
        while let Some(index) = open.pop() {
            let node = &self.nodes[index];
            if !node.is_met(origin, direction) {
                continue;
            }
            match node.right {
                Some(right) => open.extend([index + 1, right]),
                None => {
                    let leaf = &self.order[node.first..node.first + node.count];
                    if leaf.iter().any(|&t| {
                        ray_hit(origin, direction, self.corners[t as usize]).is_some_and(|s| s > least)
                    }) {
                        return true;
                    }
                }
            }
        }
        false
    }

    /// Triangles whose leaf overlaps the box from `low` to `high`: a superset of those that touch it.
    pub fn candidates(&self, low: DVec3, high: DVec3) -> Vec<u32> {
        let (mut open, mut found) = (vec![0], Vec::new());
        while let Some(index) = open.pop() {
            let node = &self.nodes[index];
            if node.low.cmpgt(high).any() || node.high.cmplt(low).any() {
                continue;
            }
            match node.right {
                Some(right) => open.extend([index + 1, right]),
                None => found.extend_from_slice(&self.order[node.first..node.first + node.count]),
            }
        }
        found
    }
}

impl Node {
    fn distance_to(&self, point: DVec3) -> f64 {
        point.distance(point.clamp(self.low, self.high))
    }

    /// Slab test; a direction parallel to a slab divides to infinities of the right sign.
    fn is_met(&self, origin: DVec3, direction: DVec3) -> bool {
        let (a, b) = ((self.low - origin) / direction, (self.high - origin) / direction);
        let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
        leave >= enter.max(0.0)
    }
}

fn weighted(corners: [DVec3; 3], weights: [f64; 3]) -> DVec3 {
    corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2]
}

/// Barycentric weights of the point of a triangle nearest to `p`, by the region it falls in (`[Ericson2005]` section 5.1.5).
fn nearest_on_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> [f64; 3] {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let (d3, d4) = (ab.dot(p - b), ac.dot(p - b));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let (d5, d6) = (ab.dot(p - c), ac.dot(p - c));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let opposite_c = d1 * d4 - d3 * d2;
    if opposite_c <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let t = d1 / (d1 - d3);
        return [1.0 - t, t, 0.0];
    }
    let opposite_b = d5 * d2 - d1 * d6;
    if opposite_b <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let t = d2 / (d2 - d6);
        return [1.0 - t, 0.0, t];
    }
    let opposite_a = d3 * d6 - d5 * d4;
    if opposite_a <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return [0.0, 1.0 - t, t];
    }
    let sum = opposite_a + opposite_b + opposite_c;
    [opposite_a / sum, opposite_b / sum, opposite_c / sum]
}

/// How many lengths of `direction` from `origin` a ray meets a triangle (`[MoellerTrumbore1997]`).
pub(super) fn ray_hit(origin: DVec3, direction: DVec3, [a, b, c]: [DVec3; 3]) -> Option<f64> {
    let (ab, ac) = (b - a, c - a);
    let p = direction.cross(ac);
    let determinant = ab.dot(p);
    if determinant == 0.0 {
        return None;
    }
    let from_a = origin - a;
    let u = from_a.dot(p) / determinant;
    let q = from_a.cross(ab);
    let v = direction.dot(q) / determinant;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0).then(|| ac.dot(q) / determinant)
}
