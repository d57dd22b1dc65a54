//! Mesh files: OBJ and PLY. Lengths stay in the file's unit, vertices in the file's order.
//!
//! OBJ is read here and not by a library: those number the vertices anew, by first use in a face, and registered bodies are
//! compared vertex by vertex.

use std::fs::File;
use std::io::{BufRead, BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};

use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult};

/// A mesh, or points alone.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshFile {
    /// In the file's unit, axes and order, `[n_vertices]`.
    pub positions: Vec<[f32; 3]>,
    /// Faces of more than three corners are cut into fans, `[n_triangles]`.
    pub triangles: Vec<[u32; 3]>,
}

/// Unit of the lengths in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LengthUnit {
    /// 1 m.
    Metre,
    /// 0.01 m.
    Centimetre,
    /// 0.001 m.
    Millimetre,
}

impl LengthUnit {
    /// Largest first.
    pub const ALL: [Self; 3] = [Self::Metre, Self::Centimetre, Self::Millimetre];
    /// Largest extents of a scan of a person that are believed, metres: with arms raised, or with somebody beside.
    const PERSON_M: [f64; 2] = [1.0, 6.0];

    /// Metres in one unit.
    pub const fn metres(self) -> f64 {
        match self {
            Self::Metre => 1.0,
            Self::Centimetre => 0.01,
            Self::Millimetre => 0.001,
        }
    }

    /// `m`, `cm` or `mm`.
    pub const fn symbol(self) -> &'static str {
        match self {
            Self::Metre => "m",
            Self::Centimetre => "cm",
            Self::Millimetre => "mm",
        }
    }

    /// The unit in which something of this largest extent is a person, if there is one.
    ///
    /// ```
    /// use body::io::meshes::LengthUnit;
    /// assert_eq!(LengthUnit::of_person(1_740.0), Some(LengthUnit::Millimetre));
    /// assert_eq!(LengthUnit::of_person(0.02), None);
    /// ```
    pub fn of_person(extent: f64) -> Option<Self> {
        let [least, most] = Self::PERSON_M;
        Self::ALL.into_iter().find(|unit| (least..=most).contains(&(extent * unit.metres())))
    }
}

/// Why a mesh cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum LoadMeshError {
    /// No such file, or no permission.
    #[error("{path}: cannot read the file")]
    Read { path: PathBuf, source: std::io::Error },
    /// Neither `.obj` nor `.ply`.
    #[error("{path}: the name does not end in .obj or .ply")]
    UnknownFormat { path: PathBuf },
    /// Not PLY, or cut short.
    #[error("{path}: is not valid PLY")]
    Ply { path: PathBuf, source: ParseError },
    /// A PLY file of something else.
    #[error("{path}: `element vertex` has no `property {property}`")]
    PlyProperty { path: PathBuf, property: &'static str },
    /// A line of an OBJ file that says nothing.
    #[error("{path}: line {line}: `{text}`, expected {expected}")]
    ObjLine { path: PathBuf, line: usize, text: String, expected: &'static str },
    /// A face of vertices that are not there.
    #[error("{path}: `faces[{face}]` names vertex {vertex}, but there are {count} vertices")]
    VertexOutOfRange { path: PathBuf, face: usize, vertex: i64, count: usize },
    /// A vertex that is nowhere.
    #[error("{path}: `vertices[{vertex}]` is {position:?}, expected finite numbers")]
    NotFinite { path: PathBuf, vertex: usize, position: [f32; 3] },
    /// Nothing in it.
    #[error("{path}: has no vertices")]
    Empty { path: PathBuf },
}

/// Reads an OBJ or PLY file, whichever its name says.
///
/// # Errors
/// [`LoadMeshError`] names file, place and value.
pub fn load_mesh(path: &Path) -> Result<MeshFile, LoadMeshError> {
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    let is_ply = match extension.to_str() {
        Some("obj") => false,
        Some("ply") => true,
        _ => return Err(LoadMeshError::UnknownFormat { path: path.to_owned() }),
    };
    let file = File::open(path).map_err(|source| LoadMeshError::Read { path: path.to_owned(), source })?;
    let reader = BufReader::new(file);
    if is_ply { read_ply(path, reader) } else { read_obj(path, reader) }
}

/// Faces as the file has them, before they are known to be sound.
struct Polygons {
    positions: Vec<[f32; 3]>,
    faces: Vec<Vec<i64>>,
}

impl Polygons {
    fn finish(self, path: &Path) -> Result<MeshFile, LoadMeshError> {
        let count = self.positions.len();
        if count == 0 {
            return Err(LoadMeshError::Empty { path: path.to_owned() });
        }
        if let Some(vertex) = self.positions.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
            let position = self.positions[vertex];
            return Err(LoadMeshError::NotFinite { path: path.to_owned(), vertex, position });
        }
        let mut triangles = Vec::with_capacity(self.faces.len());
        for (face, corners) in self.faces.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&vertex| vertex < 0 || vertex >= count as i64) {
                return Err(LoadMeshError::VertexOutOfRange { path: path.to_owned(), face, vertex, count });
            }
            let corner = |at: usize| corners[at] as u32;
            triangles.extend((2..corners.len()).map(|last| [corner(0), corner(last - 1), corner(last)]));
        }
        Ok(MeshFile { positions: self.positions, triangles })
    }
}

/// One vertex or face of a PLY file; what else it has is left aside.
#[derive(Default)]
struct PlyItem {
    position: [f32; 3],
    corners: Vec<i64>,
}

impl PropertyAccess for PlyItem {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        let axis = match name {
            "x" => 0,
            "y" => 1,
            "z" => 2,
            "vertex_indices" | "vertex_index" => {
                let Some(corners) = corners(&value) else { return PropertyAccessResult::UnsupportedType };
                self.corners = corners;
                return PropertyAccessResult::Set;
            }
            _ => return PropertyAccessResult::Ignored,
        };
        let Some(coordinate) = value.to_f32_lossy() else { return PropertyAccessResult::UnsupportedType };
        self.position[axis] = coordinate;
        PropertyAccessResult::Set
    }
}

/// Vertex numbers of a face, negative ones included: it is for [`Polygons::finish`] to complain.
fn corners(value: &Property) -> Option<Vec<i64>> {
    match value {
        Property::ListInt(corners) => Some(corners.iter().map(|&corner| corner.into()).collect()),
        other => Some(other.to_u32_list()?.into_iter().map(i64::from).collect()),
    }
}

fn read_ply(path: &Path, reader: impl BufRead) -> Result<MeshFile, LoadMeshError> {
    let invalid = |source| LoadMeshError::Ply { path: path.to_owned(), source };
    let parser = Parser::<PlyItem>::new();
    let mut reader = Reader::new(reader);
    let header = parser.read_header(&mut reader).map_err(invalid)?;
    let mut polygons = Polygons { positions: Vec::new(), faces: Vec::new() };
    for (name, element) in &header.elements {
        if name == "vertex" {
            let missing =
                ["x", "y", "z"].into_iter().find(|property| !element.properties.contains_key(*property));
            if let Some(property) = missing {
                return Err(LoadMeshError::PlyProperty { path: path.to_owned(), property });
            }
        }
        let items = parser.read_payload_for_element(&mut reader, element, &header).map_err(invalid)?;
        match name.as_str() {
            "vertex" => polygons.positions = items.into_iter().map(|item| item.position).collect(),
            "face" => polygons.faces = items.into_iter().map(|item| item.corners).collect(),
            _ => {}
        }
    }
    polygons.finish(path)
}

fn read_obj(path: &Path, reader: impl BufRead) -> Result<MeshFile, LoadMeshError> {
    let mut polygons = Polygons { positions: Vec::new(), faces: Vec::new() };
    for (index, line) in reader.lines().enumerate() {
        let line = line.map_err(|source| LoadMeshError::Read { path: path.to_owned(), source })?;
        let unexpected = |expected| LoadMeshError::ObjLine {
            path: path.to_owned(),
            line: index + 1,
            text: line.trim().to_owned(),
            expected,
        };
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let numbers: Vec<f32> = words.map_while(|word| word.parse().ok()).collect();
                let [x, y, z, ..] = numbers[..] else { return Err(unexpected("three coordinates")) };
                polygons.positions.push([x, y, z]);
            }
            Some("f") => {
                let count = polygons.positions.len() as i64;
                let corner = |word: &str| corner_of(word, count);
                let corners: Option<Vec<i64>> = words.map(corner).collect();
                let corners = corners.filter(|corners| corners.len() >= 3);
                polygons.faces.push(corners.ok_or_else(|| unexpected("three vertex numbers or more"))?);
            }
            _ => {} // normals, texture, materials, groups, comments
        }
    }
    polygons.finish(path)
}

/// From `7`, `7/1`, `7//2` or `7/1/2` to 6; negative numbers count back from the last vertex so far.
fn corner_of(word: &str, count: i64) -> Option<i64> {
    match word.split('/').next()?.parse::<i64>().ok()? {
        number if number > 0 => Some(number - 1),
        number if number < 0 => Some(count + number),
        _ => None,
    }
}

/// Why a mesh cannot be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum WriteMeshError {
    /// No permission, no space, no folder.
    #[error("{path}: cannot write the file")]
    Write { path: PathBuf, source: std::io::Error },
}

/// Writes an OBJ file. Numbers are written so that reading gives the same bits.
///
/// # Errors
/// [`WriteMeshError`] when the file cannot be written.
pub fn write_obj(path: &Path, positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Result<(), WriteMeshError> {
    let write = || {
        let mut out = BufWriter::new(File::create(path)?);
        for [x, y, z] in positions {
            writeln!(out, "v {x} {y} {z}")?;
        }
        for [a, b, c] in triangles {
            writeln!(out, "f {} {} {}", a + 1, b + 1, c + 1)?;
        }
        out.flush()
    };
    write().map_err(|source| WriteMeshError::Write { path: path.to_owned(), source })
}

#[cfg(test)]
mod tests;
