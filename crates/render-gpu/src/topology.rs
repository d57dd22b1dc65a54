//! Which triangle lies on either side of each edge of a closed mesh.

use std::collections::BTreeMap;

/// Why a list of triangles bounds no volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TopologyError {
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle} names vertex {vertex}, but a mesh has {count} vertices")]
    VertexOutOfRange {
        /// The triangle.
        triangle: usize,
        /// The vertex it names.
        vertex: u32,
        /// Vertices per mesh.
        count: usize,
    },
    /// The triangles run through an edge more often one way than the other: the surface has a hole there, or its
    /// triangles are not oriented alike.
    #[error(
        "the edge from vertex {from} to {to} is not met by one in the other direction: the mesh is open or inconsistently oriented there"
    )]
    OpenEdge {
        /// Where the unmatched edge starts.
        from: u32,
        /// Where it ends.
        to: u32,
    },
}

/// An edge and its two triangles: `left` runs through it from `from` to `to`, `right` the other way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Edge {
    pub from: u32,
    pub to: u32,
    pub left: u32,
    pub right: u32,
}

/// The edges of a closed, consistently oriented mesh.
///
/// Where more than two triangles meet in an edge they are paired at will: any pairing of opposite directions gives
/// the same boundary of a set of triangles.
#[derive(Clone, Debug, Default)]
pub(crate) struct Topology {
    pub vertices_per_mesh: usize,
    pub triangles: Vec<[u32; 3]>,
    pub edges: Vec<Edge>,
}

impl Topology {
    pub fn new(triangles: &[[u32; 3]], vertices_per_mesh: usize) -> Result<Self, TopologyError> {
        check_vertices(triangles, vertices_per_mesh)?;
        // Half edges that still wait for their opposite, by direction, with their triangles.
        let mut waiting: BTreeMap<[u32; 2], Vec<u32>> = BTreeMap::new();
        let mut edges = Vec::with_capacity(triangles.len() * 3 / 2);
        for (triangle, corners) in triangles.iter().enumerate() {
            for corner in 0..3 {
                let (from, to) = (corners[corner], corners[(corner + 1) % 3]);
                if from == to {
                    continue;
                }
                match waiting.get_mut(&[to, from]).and_then(Vec::pop) {
                    Some(left) => edges.push(Edge { from: to, to: from, left, right: triangle as u32 }),
                    None => waiting.entry([from, to]).or_default().push(triangle as u32),
                }
            }
        }
        match waiting.iter().find(|(_, triangles)| !triangles.is_empty()) {
            Some((&[from, to], _)) => Err(TopologyError::OpenEdge { from, to }),
            None => Ok(Self { vertices_per_mesh, triangles: triangles.to_vec(), edges }),
        }
    }

    /// Whether this is the topology of these triangles.
    pub fn is_of(&self, triangles: &[[u32; 3]], vertices_per_mesh: usize) -> bool {
        self.vertices_per_mesh == vertices_per_mesh && self.triangles == triangles
    }
}

/// Checks that every corner names a vertex.
pub(crate) fn check_vertices(triangles: &[[u32; 3]], count: usize) -> Result<(), TopologyError> {
    for (triangle, corners) in triangles.iter().enumerate() {
        if let Some(&vertex) = corners.iter().find(|&&vertex| vertex as usize >= count) {
            return Err(TopologyError::VertexOutOfRange { triangle, vertex, count });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const TETRAHEDRON: [[u32; 3]; 4] = [[0, 1, 2], [1, 0, 3], [2, 1, 3], [0, 2, 3]];

    #[test]
    fn each_edge_has_a_triangle_on_either_side() {
        let topology = Topology::new(&TETRAHEDRON, 4).expect("a tetrahedron is closed");
        assert_eq!(topology.edges.len(), 6);
        let runs = |triangle: u32, from, to| {
            let corners = TETRAHEDRON[triangle as usize];
            (0..3).any(|i| (corners[i], corners[(i + 1) % 3]) == (from, to))
        };
        for Edge { from, to, left, right } in topology.edges {
            assert!(runs(left, from, to) && runs(right, to, from), "edge from {from} to {to}");
        }
    }

    #[test]
    fn several_sheets_may_meet_in_an_edge() {
        // Two tetrahedra that share the edge from 0 to 1.
        let mut triangles = TETRAHEDRON.to_vec();
        triangles.extend(TETRAHEDRON.map(|corners| corners.map(|v| if v < 2 { v } else { v + 2 })));
        assert_eq!(Topology::new(&triangles, 6).expect("both are closed").edges.len(), 12);
    }

    #[test]
    fn holes_and_turned_triangles_are_named() {
        let hole = Topology::new(&TETRAHEDRON[..3], 4).expect_err("a side is missing");
        assert_eq!(hole, TopologyError::OpenEdge { from: 0, to: 3 });
        assert_eq!(
            hole.to_string(),
            "the edge from vertex 0 to 3 is not met by one in the other direction: \
             the mesh is open or inconsistently oriented there"
        );
        let turned = [[0, 1, 2], [1, 0, 3], [1, 2, 3], [0, 2, 3]];
        assert!(matches!(Topology::new(&turned, 4), Err(TopologyError::OpenEdge { .. })));
        let stray = Topology::new(&TETRAHEDRON, 3).expect_err("there is no vertex 3");
        assert_eq!(stray, TopologyError::VertexOutOfRange { triangle: 1, vertex: 3, count: 3 });
    }
}
