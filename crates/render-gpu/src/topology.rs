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
