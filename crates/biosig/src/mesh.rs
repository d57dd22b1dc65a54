//! Meshes as files have them, brought into a state that can be measured, with notes of what was done.

use std::collections::HashMap;

use body::mesh::is_closed;
use glam::DVec3;

/// Why a mesh cannot be measured at all.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// Points alone, or nothing.
    #[error("the mesh has no triangles")]
    NoTriangles,
    /// Vertices that are all in one place or line.
    #[error("all {triangles} triangles of the mesh have no area")]
    NoArea {
        /// Triangles there are.
        triangles: usize,
    },
}

/// A mesh without repeated vertices and triangles of no area, its triangles outward.
#[derive(Clone, Debug, PartialEq)]
pub struct SoundMesh {
    /// Metres.
    pub vertices: Vec<[f32; 3]>,
    /// Outward by the right-hand rule.
    pub triangles: Vec<[u32; 3]>,
    /// What was found and done.
    pub notes: MeshNotes,
}

/// What was found in a mesh, and done about it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MeshNotes {
    /// Vertices at the place of another one: they were joined.
    pub joined_vertices: usize,
    /// Triangles without area or with one corner twice: they were left out.
    pub dropped_triangles: usize,
    /// Edges with a triangle on one side only: the mesh has holes, its volume is not known.
    pub open_edges: usize,
    /// Edges of more than two triangles: sections do not mind, volumes may.
    pub crowded_edges: usize,
    /// The triangles faced inwards: they were turned.
    pub was_inside_out: bool,
    /// The triangles on the two sides of an edge face differently somewhere, or it is open: the volume is not known.
    pub is_closed: bool,
}

impl SoundMesh {
    /// Cleans a mesh; lengths in metres.
    ///
    /// # Errors
    /// When nothing is left that has an area.
    ///
    /// # Panics
    /// When a triangle names a vertex that is not there.
    pub fn new(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Result<Self, MeshError> {
        if triangles.is_empty() {
            return Err(MeshError::NoTriangles);
        }
        let (vertices, place_of) = join(positions);
        let mut notes =
            MeshNotes { joined_vertices: positions.len() - vertices.len(), ..MeshNotes::default() };
        let joined = triangles.iter().map(|triangle| triangle.map(|vertex| place_of[vertex as usize]));
        let mut sound: Vec<[u32; 3]> = joined.filter(|triangle| has_area(&vertices, triangle)).collect();
        notes.dropped_triangles = triangles.len() - sound.len();
        if sound.is_empty() {
            return Err(MeshError::NoArea { triangles: triangles.len() });
        }
        for count in edge_uses(&sound).into_values() {
            notes.open_edges += usize::from(count == 1);
            notes.crowded_edges += usize::from(count > 2);
        }
        notes.is_closed = is_closed(&sound);
        if signed_volume_m3(&vertices, &sound) < 0.0 {
            notes.was_inside_out = true;
            sound.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        }
        Ok(Self { vertices, triangles: sound, notes })
    }
}

/// Vertices without repeats, in the order of their first use, and the new number of each old one.
fn join(positions: &[[f32; 3]]) -> (Vec<[f32; 3]>, Vec<u32>) {
    let mut vertices = Vec::with_capacity(positions.len());
    let mut known: HashMap<[u32; 3], u32> = HashMap::with_capacity(positions.len());
    let place_of = positions.iter().map(|position| {
        // Adding zero makes -0 and 0 the same.
        *known.entry(position.map(|x| (x + 0.0).to_bits())).or_insert_with(|| {
            vertices.push(*position);
            vertices.len() as u32 - 1
        })
    });
    let place_of = place_of.collect();
    (vertices, place_of)
}

fn corners(vertices: &[[f32; 3]], triangle: &[u32; 3]) -> [DVec3; 3] {
    triangle.map(|vertex| DVec3::from_array(vertices[vertex as usize].map(f64::from)))
}

fn has_area(vertices: &[[f32; 3]], triangle: &[u32; 3]) -> bool {
    let [a, b, c] = corners(vertices, triangle);
    (b - a).cross(c - a).length_squared() > 0.0
}

fn edge_uses(triangles: &[[u32; 3]]) -> HashMap<[u32; 2], usize> {
    let mut uses = HashMap::new();
    for &[a, b, c] in triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            *uses.entry([from.min(to), from.max(to)]).or_default() += 1;
        }
    }
    uses
}

/// About the middle of the vertices, so that a hole does little harm to the sign.
fn signed_volume_m3(vertices: &[[f32; 3]], triangles: &[[u32; 3]]) -> f64 {
    let middle =
        vertices.iter().map(|p| DVec3::from_array(p.map(f64::from))).sum::<DVec3>() / vertices.len() as f64;
    let six = |triangle: &[u32; 3]| {
        let [a, b, c] = corners(vertices, triangle).map(|corner| corner - middle);
        a.dot(b.cross(c))
    };
    triangles.iter().map(six).sum::<f64>() / 6.0
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNERS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    const TETRAHEDRON: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];

    #[test]
    fn a_sound_mesh_stays_as_it_is() {
        let mesh = SoundMesh::new(&CORNERS, &TETRAHEDRON).unwrap();
        assert_eq!((&mesh.vertices[..], &mesh.triangles[..]), (&CORNERS[..], &TETRAHEDRON[..]));
        assert_eq!(mesh.notes, MeshNotes { is_closed: true, ..MeshNotes::default() });
    }

    #[test]
    fn repeated_vertices_are_joined_and_flat_triangles_dropped() {
        let corners: Vec<[f32; 3]> = TETRAHEDRON.iter().flatten().map(|&v| CORNERS[v as usize]).collect();
        let mut triangles: Vec<[u32; 3]> = (0..4).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        triangles.push([0, 1, 1]);
        let mesh = SoundMesh::new(&corners, &triangles).unwrap();
        assert_eq!((mesh.vertices.len(), mesh.triangles.len()), (4, 4));
        let expected =
            MeshNotes { joined_vertices: 8, dropped_triangles: 1, is_closed: true, ..MeshNotes::default() };
        assert_eq!(mesh.notes, expected);
    }

    #[test]
    fn holes_crowded_edges_and_wrong_sides_are_told() {
        let open = SoundMesh::new(&CORNERS, &TETRAHEDRON[1..]).unwrap().notes;
        assert_eq!((open.open_edges, open.is_closed), (3, false));
        let fin = [&CORNERS[..], &[[0.5, -0.5, 0.0]]].concat();
        let crowded = SoundMesh::new(&fin, &[&TETRAHEDRON[..], &[[0, 1, 4]]].concat()).unwrap().notes;
        assert_eq!((crowded.crowded_edges, crowded.open_edges, crowded.is_closed), (1, 2, false));
        let inward = TETRAHEDRON.map(|[a, b, c]| [a, c, b]);
        let turned = SoundMesh::new(&CORNERS, &inward).unwrap();
        assert!(turned.notes.was_inside_out);
        assert_eq!(turned.triangles, TETRAHEDRON.map(|[a, b, c]| [a, b, c]));
    }

    #[test]
    fn nothing_to_measure_is_an_error() {
        let message = |vertices: &[[f32; 3]], triangles: &[[u32; 3]]| {
            SoundMesh::new(vertices, triangles).unwrap_err().to_string()
        };
        assert_eq!(message(&CORNERS, &[]), "the mesh has no triangles");
        assert_eq!(message(&[[1.0; 3]; 3], &[[0, 1, 2]]), "all 1 triangles of the mesh have no area");
    }
}
