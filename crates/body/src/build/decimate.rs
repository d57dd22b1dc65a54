//! Edge collapse by quadric errors (`[GarlandHeckbert1997]`) on the left half of a body.
//!
//! Deviation: an edge collapses onto one of its ends, so every vertex left is one of the mesh, with its skin weights and its
//! part. Positions are fitted afterwards. A vertex collapses only onto one of its own part, so borders of parts stay; errors
//! count more around joints, where skin bends, and less in the face and on the toes; vertices in pockets go first.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;

use super::BuildError;
use super::half::HalfMesh;
use crate::io::bodies::BodiesData;
use crate::mesh::{area_normal, corners};

/// Price of a long edge against a geometric error: keeps triangles even where the surface is flat.
const EVENNESS: f64 = 3e-3;
/// No triangle may turn by more than the angle of this cosine.
const LEAST_TURN_COSINE: f64 = 0.3;
/// Twice the area over the sum of the squared edges, at least; 0.577 in an equilateral triangle.
const LEAST_ROUNDNESS: f64 = 0.12;
/// Neighbours of a vertex, at least and at most.
const LEAST_NEIGHBOURS: usize = 3;
const MOST_NEIGHBOURS: usize = 10;
/// Factor of errors where the skin belongs to several joints.
const JOINT_IMPORTANCE: f64 = 4.0;

/// How much errors count at each vertex of the whole mesh.
pub(super) struct Importance(Vec<f64>);

impl Importance {
    pub fn of(data: &BodiesData) -> Result<Self, BuildError> {
        let mut of_part = vec![1.0; data.part_names.len()];
        for (name, factor) in
            [("head", 1.0), ("left_hand", 1.0), ("right_hand", 1.0), ("left_foot", 0.7), ("right_foot", 0.7)]
        {
            of_part[part(data, name)? as usize] = factor;
        }
        let vertex = |(influences, &part): (&Vec<_>, &u8)| {
            let largest = influences.iter().fold(0.0f32, |largest, &(_, weight)| largest.max(weight));
            let blend = f64::from(1.0 - largest) * 2.0; // 0 inside a segment, 1 half-way between two
            of_part[part as usize] * (1.0 + (JOINT_IMPORTANCE - 1.0) * blend.min(1.0))
        };
        Ok(Self(data.skin.iter().zip(&data.parts).map(vertex).collect()))
    }
}

/// The label of the part called `name`.
pub(super) fn part(data: &BodiesData, name: &'static str) -> Result<u8, BuildError> {
    let place = data.part_names.iter().position(|known| known == name);
    Ok(place.ok_or(BuildError::MissingPart { name })? as u8)
}

/// Collapses edges until half and mirror image together have at most `n_vertices`.
pub(super) fn decimate(
    half: HalfMesh,
    importance: &Importance,
    n_vertices: usize,
) -> Result<HalfMesh, BuildError> {
    let mut mesh = Collapsing::new(half, importance);
    while mesh.whole_count() > n_vertices || mesh.is_any_hidden() {
        if !mesh.collapse_cheapest() {
            return Err(BuildError::NotDecimated { found: mesh.whole_count(), wanted: n_vertices });
        }
    }
    Ok(mesh.compact())
}

/// The quadratic form p -> sum of weighted squared distances of p to planes.
#[derive(Clone, Copy, Default)]
struct Quadric {
    /// nnT as xx, xy, xz, yy, yz, zz.
    square: [f64; 6],
    linear: DVec3,
    constant: f64,
}

impl Quadric {
    fn of_plane(unit_normal: DVec3, point: DVec3, weight: f64) -> Self {
        let (n, d) = (unit_normal, -unit_normal.dot(point));
        let square = [n.x * n.x, n.x * n.y, n.x * n.z, n.y * n.y, n.y * n.z, n.z * n.z].map(|x| x * weight);
        Self { square, linear: n * (d * weight), constant: d * d * weight }
    }

    fn add(&mut self, other: &Self) {
        self.square.iter_mut().zip(other.square).for_each(|(a, b)| *a += b);
        self.linear += other.linear;
        self.constant += other.constant;
    }

    fn at(&self, p: DVec3) -> f64 {
        let [xx, xy, xz, yy, yz, zz] = self.square;
        let form = xx * p.x * p.x + yy * p.y * p.y + zz * p.z * p.z;
        form + 2.0 * (xy * p.x * p.y + xz * p.x * p.z + yz * p.y * p.z + self.linear.dot(p)) + self.constant
    }
}

struct Collapsing {
    half: HalfMesh,
    importance: Vec<f64>,
    quadrics: Vec<Quadric>,
    /// Triangles around each vertex; empty when it is gone.
    around: Vec<Vec<u32>>,
    /// Candidates (cost bits, from, onto, version of both): non-negative floats order like their bits.
    queue: BinaryHeap<Reverse<(u64, u32, u32, u32)>>,
    versions: Vec<u32>,
}

impl Collapsing {
    fn new(half: HalfMesh, importance: &Importance) -> Self {
        let n = half.vertices.len();
        let mut mesh = Self {
            importance: half.sources.iter().map(|&source| importance.0[source as usize]).collect(),
            quadrics: vec![Quadric::default(); n],
            around: vec![Vec::new(); n],
            queue: BinaryHeap::new(),
            versions: vec![0; n],
            half,
        };
        for (index, triangle) in mesh.half.triangles.iter().enumerate() {
            triangle.iter().for_each(|&vertex| mesh.around[vertex as usize].push(index as u32));
            if triangle.iter().any(|&vertex| mesh.half.is_hidden[vertex as usize]) {
                continue;
            }
            let points = corners(&mesh.half.vertices, *triangle);
            let normal = area_normal(points);
            let mean_importance = triangle.iter().map(|&v| mesh.importance[v as usize]).sum::<f64>() / 3.0;
            let quadric = Quadric::of_plane(
                normal.normalize_or_zero(),
                points[0],
                normal.length() / 6.0 * mean_importance,
            );
            triangle.iter().for_each(|&vertex| mesh.quadrics[vertex as usize].add(&quadric));
        }
        (0..n as u32).for_each(|vertex| mesh.enqueue(vertex));
        mesh
    }

    fn position(&self, vertex: u32) -> DVec3 {
        self.half.vertices[vertex as usize]
    }

    fn neighbours(&self, vertex: u32) -> Vec<u32> {
        let triangles = self.around[vertex as usize].iter();
        let mut found: Vec<u32> =
            triangles.flat_map(|&t| self.half.triangles[t as usize]).filter(|&v| v != vertex).collect();
        found.sort_unstable();
        found.dedup();
        found
    }

    fn whole_count(&self) -> usize {
        let alive = (0..self.around.len()).filter(|&vertex| !self.around[vertex].is_empty());
        alive.map(|vertex| if self.half.on_midline[vertex] { 1 } else { 2 }).sum()
    }

    fn is_any_hidden(&self) -> bool {
        self.around
            .iter()
            .zip(&self.half.is_hidden)
            .any(|(around, &is_hidden)| is_hidden && !around.is_empty())
    }

    /// Puts all edges at `vertex` into the queue, in both directions.
    fn enqueue(&mut self, vertex: u32) {
        for other in self.neighbours(vertex) {
            for (from, onto) in [(vertex, other), (other, vertex)] {
                let version = self.versions[from as usize] + self.versions[onto as usize];
                self.queue.push(Reverse((self.cost(from, onto).to_bits(), from, onto, version)));
            }
        }
    }

    fn cost(&self, from: u32, onto: u32) -> f64 {
        let length_squared = self.position(from).distance_squared(self.position(onto));
        if self.half.is_hidden[from as usize] {
            return length_squared * 1e-12;
        }
        let mut quadric = self.quadrics[from as usize];
        quadric.add(&self.quadrics[onto as usize]);
        let evenness = EVENNESS * self.importance[from as usize] * length_squared * length_squared;
        quadric.at(self.position(onto)).max(0.0) + evenness
    }

    /// False when no edge may be collapsed any more.
    fn collapse_cheapest(&mut self) -> bool {
        while let Some(Reverse((_, from, onto, version))) = self.queue.pop() {
            let is_current = version == self.versions[from as usize] + self.versions[onto as usize];
            if is_current && !self.around[from as usize].is_empty() && self.may_collapse(from, onto) {
                self.collapse(from, onto);
                return true;
            }
        }
        false
    }

    /// Whether the surface stays a manifold, also once mirrored, keeps its parts and does not fold.
    fn may_collapse(&self, from: u32, onto: u32) -> bool {
        let is_hidden = self.half.is_hidden[from as usize];
        if self.half.parts[from as usize] != self.half.parts[onto as usize] && !is_hidden {
            return false;
        }
        let (near_from, near_onto) = (self.neighbours(from), self.neighbours(onto));
        let common = near_from.iter().filter(|&v| near_onto.contains(v)).count();
        let shared =
            self.around[from as usize].iter().filter(|t| self.around[onto as usize].contains(t)).count();
        if common != shared || shared == 0 {
            return false; // the link condition
        }
        let on_midline = |vertex: u32| self.half.on_midline[vertex as usize];
        let is_rim = shared == 1;
        if on_midline(from) && !(on_midline(onto) && is_rim) {
            return false;
        }
        // An inner edge between two points of the midline would meet its own mirror image.
        let joins_midline = |&v: &u32| v != onto && on_midline(v) && !near_onto.contains(&v);
        if !on_midline(from) && on_midline(onto) && near_from.iter().any(joins_midline) {
            return false;
        }
        let keeps_three = |v: &u32| !near_onto.contains(v) || self.neighbours(*v).len() > LEAST_NEIGHBOURS;
        if !near_from.iter().all(keeps_three) {
            return false;
        }
        if is_hidden {
            return true;
        }
        let valence =
            near_from.iter().filter(|&&v| v != onto && !near_onto.contains(&v)).count() + near_onto.len() - 1;
        (LEAST_NEIGHBOURS..=MOST_NEIGHBOURS).contains(&valence)
            && self.around[from as usize].iter().all(|&t| self.stays_upright(t, from, onto))
    }

    fn stays_upright(&self, triangle: u32, from: u32, onto: u32) -> bool {
        let before = self.half.triangles[triangle as usize];
        if before.contains(&onto) || before.iter().any(|&v| self.half.is_hidden[v as usize]) {
            return true;
        }
        let [a, b, c] = corners(&self.half.vertices, before.map(|v| if v == from { onto } else { v }));
        let (old, new) = (area_normal(corners(&self.half.vertices, before)), area_normal([a, b, c]));
        let edges = a.distance_squared(b) + b.distance_squared(c) + c.distance_squared(a);
        old.dot(new) > LEAST_TURN_COSINE * old.length() * new.length()
            && new.length() > LEAST_ROUNDNESS * edges
    }

    fn collapse(&mut self, from: u32, onto: u32) {
        for triangle in std::mem::take(&mut self.around[from as usize]) {
            let corners = self.half.triangles[triangle as usize];
            if corners.contains(&onto) {
                corners.iter().for_each(|&v| self.around[v as usize].retain(|&t| t != triangle));
            } else {
                self.half.triangles[triangle as usize] = corners.map(|v| if v == from { onto } else { v });
                self.around[onto as usize].push(triangle);
            }
        }
        let quadric = self.quadrics[from as usize];
        self.quadrics[onto as usize].add(&quadric);
        // What `onto` may do has changed, and what its neighbours may do around it.
        for vertex in self.neighbours(onto).into_iter().chain([onto]) {
            self.versions[vertex as usize] += 1;
        }
        for vertex in self.neighbours(onto).into_iter().chain([onto]) {
            self.enqueue(vertex);
        }
    }

    fn compact(self) -> HalfMesh {
        let kept: Vec<usize> =
            (0..self.around.len()).filter(|&vertex| !self.around[vertex].is_empty()).collect();
        let mut triangles: Vec<u32> = self.around.concat();
        triangles.sort_unstable();
        triangles.dedup();
        let place = |vertex: u32| {
            kept.binary_search(&(vertex as usize)).expect("corners of triangles are kept") as u32
        };
        let half = self.half;
        HalfMesh {
            vertices: kept.iter().map(|&v| half.vertices[v]).collect(),
            triangles: triangles.iter().map(|&t| half.triangles[t as usize].map(place)).collect(),
            on_midline: kept.iter().map(|&v| half.on_midline[v]).collect(),
            is_hidden: kept.iter().map(|&v| half.is_hidden[v]).collect(),
            parts: kept.iter().map(|&v| half.parts[v]).collect(),
            sources: kept.iter().map(|&v| half.sources[v]).collect(),
        }
    }
}
