//! The outlines of eight meshes at once: vertices in lanes to project them, meshes in lanes to orient triangles.

use bytemuck::{cast, cast_slice};
use wide::{f32x8, i16x16, i32x8};

use crate::project::{NEAR_M, Projector, Snapped, load, round};
use crate::topology::Topology;

/// Meshes that are worked on together.
pub(super) const LANES: usize = 8;

/// Snapped coordinates must fit the two halves of an `i32`, their differences too: the cross product of two edges,
/// at most 2 (2¹⁵ - 1)², then fits an `i32`.
const MAX_SNAPPED: i32 = i16::MAX as i32;
const _: () = assert!(2 * (MAX_SNAPPED as i64).pow(2) <= i32::MAX as i64);

/// The box around the snapped vertices of a mesh.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    pub low: Snapped,
    pub high: Snapped,
}

/// An edge of the outline of a mesh.
#[derive(Clone, Copy, Debug)]
pub(super) struct OutlineEdge {
    pub top: Snapped,
    pub bottom: Snapped,
    /// Whether the silhouette begins here, seen from left to right.
    pub enters: bool,
}

/// The outlines of up to eight meshes of one topology; keeps its memory.
#[derive(Clone, Debug, Default)]
pub(super) struct Outlines {
    /// Per mesh, its snapped vertices as (y << 16 | x), eight to a word.
    by_mesh: [Vec<i32x8>; LANES],
    /// The same, transposed: per vertex, one lane a mesh.
    by_vertex: Vec<i32x8>,
    /// Per triangle, one bit a mesh: whether it turns left on the screen.
    turns_left: Vec<u8>,
    /// Per 64 edges and mesh, one bit an edge: whether it belongs to the outline.
    on_outline: Vec<[u64; LANES]>,
    /// Per mesh, the box of its vertices, or `None` if the mesh needs the plain path.
    bounds: [Option<Bounds>; LANES],
}

impl Outlines {
    /// Takes up to eight meshes, given mesh after mesh.
    pub fn set(&mut self, topology: &Topology, projector: &Projector, positions: &[[f32; 3]]) {
        self.bounds = [None; LANES];
        for (mesh, positions) in positions.chunks_exact(topology.vertices_per_mesh).enumerate() {
            self.bounds[mesh] = snap(projector, positions, &mut self.by_mesh[mesh]);
        }
        self.transpose(topology.vertices_per_mesh.div_ceil(LANES));
        self.orient(&topology.triangles);
        self.find_outline(topology);
    }

    /// The box around a mesh; `None` if it reaches through the near plane, is too large or not finite.
    pub fn bounds(&self, mesh: usize) -> Option<Bounds> {
        self.bounds[mesh]
    }

    /// Calls `visit` with each edge of the outline of a mesh that has bounds.
    #[inline(always)]
    pub fn for_each_edge(&self, topology: &Topology, mesh: usize, mut visit: impl FnMut(OutlineEdge)) {
        let vertices: &[i32] = cast_slice(&self.by_mesh[mesh]);
        for (words, edges) in self.on_outline.iter().zip(topology.edges.chunks(64)) {
            let mut on_outline = words[mesh];
            while on_outline != 0 {
                let edge = &edges[on_outline.trailing_zeros() as usize];
                on_outline &= on_outline - 1;
                let [from, to] = [edge.from, edge.to].map(|vertex| vertices[vertex as usize]);
                // Packed vertices sort by y, then by x.
                let (top, bottom) = (unpack(from.min(to)), unpack(from.max(to)));
                // A front triangle turns left, so that it lies left of its edges: it begins at those that go down.
                let left_is_front = self.turns_left[edge.left as usize] >> mesh & 1 == 1;
                visit(OutlineEdge { top, bottom, enters: left_is_front == (from < to) });
            }
        }
    }

    fn transpose(&mut self, n_blocks: usize) {
        self.by_vertex.clear();
        for mesh in &mut self.by_mesh {
            mesh.resize(n_blocks, i32x8::ZERO);
        }
        for block in 0..n_blocks {
            let lanes = std::array::from_fn(|mesh| self.by_mesh[mesh][block]);
            self.by_vertex.extend_from_slice(&i32x8::transpose(lanes));
        }
    }

    fn orient(&mut self, triangles: &[[u32; 3]]) {
        self.turns_left.clear();
        self.turns_left.extend(triangles.iter().map(|corners| {
            let [a, b, c] = corners.map(|vertex| cast::<i32x8, i16x16>(self.by_vertex[vertex as usize]));
            turn(b - a, c - a).simd_lt(i32x8::ZERO).to_bitmask() as u8
        }));
    }

    fn find_outline(&mut self, topology: &Topology) {
        self.on_outline.clear();
        self.on_outline.extend(topology.edges.chunks(64).map(|edges| {
            let mut words = [0; LANES];
            for (byte, edges) in edges.chunks(8).enumerate() {
                let mut by_edge = [0; 8];
                for (bits, edge) in by_edge.iter_mut().zip(edges) {
                    *bits = self.turns_left[edge.left as usize] ^ self.turns_left[edge.right as usize];
                }
                let by_mesh = transpose_bits(u64::from_le_bytes(by_edge)).to_le_bytes();
                for (word, bits) in words.iter_mut().zip(by_mesh) {
                    *word |= u64::from(bits) << (8 * byte);
                }
            }
            words
        }));
    }
}

/// Projects and snaps a mesh that lies wholly beyond the near plane and within the range of packed coordinates.
fn snap(projector: &Projector, positions: &[[f32; 3]], packed: &mut Vec<i32x8>) -> Option<Bounds> {
    let range = f32x8::splat(MAX_SNAPPED as f32);
    let mut fits = f32x8::ZERO.simd_eq(f32x8::ZERO);
    let (mut low, mut high) = ([range; 2], [-range; 2]);
    packed.clear();
    for first in (0..positions.len()).step_by(8) {
        let points = load(positions, first);
        let [x, y] = projector.project(points);
        // Comparisons are false for NaN. An infinite depth would project to the middle of the image.
        let depth_fits =
            points[2].simd_ge(f32x8::splat(NEAR_M)) & points[2].simd_lt(f32x8::splat(f32::INFINITY));
        fits = fits & depth_fits & x.abs().simd_le(range) & y.abs().simd_le(range);
        for (axis, coordinate) in [x, y].into_iter().enumerate() {
            low[axis] = low[axis].fast_min(coordinate);
            high[axis] = high[axis].fast_max(coordinate);
        }
        packed.push((round(y) << 16) | (round(x) & i32x8::splat(0xffff)));
    }
    let bounds = Bounds {
        low: low.map(|lanes| round(lanes).reduce_min()),
        high: high.map(|lanes| round(lanes).reduce_max()),
    };
    let extent_fits = |axis: usize| bounds.high[axis] - bounds.low[axis] <= MAX_SNAPPED;
    (fits.all() && !positions.is_empty() && extent_fits(0) && extent_fits(1)).then_some(bounds)
}

/// x and y of a packed vertex.
#[inline(always)]
fn unpack(packed: i32) -> Snapped {
    [i32::from(packed as i16), packed >> 16]
}

/// The cross product u.x v.y - u.y v.x of packed vectors: positive for a right turn on the screen, whose y runs down.
#[inline(always)]
fn turn(u: i16x16, v: i16x16) -> i32x8 {
    let v: i32x8 = cast(v);
    let swapped = (v << 16) | (v.unbounded_shr_scalar(16) & i32x8::splat(0xffff)); // low half y, high half x
    let negate_high = i32x8::splat(0xffff_0000_u32 as i32); // -x = !x + 1
    let v_across: i16x16 = cast::<i32x8, i16x16>(swapped ^ negate_high) - cast::<i32x8, i16x16>(negate_high);
    u.dot(v_across)
}

/// Transposes eight rows of eight bits; row r is byte r from the lowest, column c its bit c. `[Warren2012]` section 7-3.
fn transpose_bits(mut rows: u64) -> u64 {
    for (shift, mask) in
        [(7, 0x00aa_00aa_00aa_00aa), (14, 0x0000_cccc_0000_cccc), (28, 0x0000_0000_f0f0_f0f0)]
    {
        let swap = (rows ^ (rows >> shift)) & mask;
        rows ^= swap ^ (swap << shift);
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_transposed() {
        for row in 0..8 {
            for column in 0..8 {
                assert_eq!(transpose_bits(1 << (8 * row + column)), 1 << (8 * column + row));
            }
        }
    }

    #[test]
    fn packed_vectors_turn_as_plain_ones() {
        let pack = |[x, y]: [i32; 2]| cast::<i32x8, i16x16>(i32x8::splat(y << 16 | x & 0xffff));
        let end = MAX_SNAPPED;
        for u in [[1, 0], [0, 1], [-3, 7], [end, end], [-end, end], [end, -end], [-end, -end]] {
            for v in [[0, 1], [5, -2], [end, -end], [-end, end], [-end, -end], [end, end], [0, 0]] {
                let expected = u[0] * v[1] - u[1] * v[0];
                assert_eq!(turn(pack(u), pack(v)).to_array(), [expected; 8], "{u:?} x {v:?}");
            }
        }
    }

    #[test]
    fn vertices_survive_packing() {
        for point in [[0, 0], [1, -1], [-MAX_SNAPPED, MAX_SNAPPED], [MAX_SNAPPED, -MAX_SNAPPED]] {
            assert_eq!(unpack(point[1] << 16 | point[0] & 0xffff), point);
        }
    }
}
