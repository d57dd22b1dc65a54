//! Reader of a population of bodies on one mesh: a folder of NumPy arrays and tables.

use std::path::{Path, PathBuf};

use glam::DVec3;

use crate::skeleton::{JointId, N_JOINTS};

#[cfg(test)]
mod tests;

/// Joints that the folder holds: all but the heels, which are taken from the mesh.
pub const N_POPULATION_JOINTS: usize = N_JOINTS - 2;

/// Points that measuring needs and `landmarks.csv` leaves out, with their vertices on the population's mesh.
const MORE_LANDMARKS: [(&str, u32); 2] = [("Navel", 4104), ("Below Adam's Apple", 803)];

/// A population of bodies: one mesh, a linear basis of its vertices and joints, one row of coefficients per body.
/// Body frame: y up, facing +z, its left at +x, soles at y = 0; metres.
#[derive(Clone, Debug)]
pub struct BodiesData {
    /// Vertices of the mean body, `[n_vertices]`.
    pub mean: Vec<DVec3>,
    /// Closed, outward by the right-hand rule.
    pub triangles: Vec<[u32; 3]>,
    /// `[n_basis]` of `[n_vertices]`, metres a unit.
    pub basis: Vec<Vec<DVec3>>,
    /// `[n_bodies]` of `[n_basis]`.
    pub coefficients: Vec<Vec<f64>>,
    /// Whether each body is a woman's, `[n_bodies]`.
    pub is_female: Vec<bool>,
    /// Joints of the mean body, `[28]`.
    pub mean_joints: Vec<DVec3>,
    /// `[n_basis]` of `[28]`, metres a unit.
    pub joint_basis: Vec<Vec<DVec3>>,
    /// Joints and weights of each vertex; the weights sum to 1.
    pub skin: Vec<Vec<(JointId, f32)>>,
    /// Index into `part_names` per vertex.
    pub parts: Vec<u8>,
    /// Names of the body parts.
    pub part_names: Vec<String>,
    /// Name and vertex of each landmark: those of `landmarks.csv`, then the navel and the point below the Adam's apple.
    pub landmarks: Vec<(String, u32)>,
}

/// Why a population could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadBodiesError {
    /// The operating system refused.
    #[error("{path}: cannot read the file")]
    Read {
        /// File at fault.
        path: PathBuf,
        /// Its reason.
        source: std::io::Error,
    },
    /// Not a NumPy array of the element type needed.
    #[error("{path}: expected a NumPy array of {expected}")]
    Array {
        /// File at fault.
        path: PathBuf,
        /// Element type, as NumPy writes it.
        expected: &'static str,
        /// What the decoder says.
        source: std::io::Error,
    },
    /// An array of another shape.
    #[error("{path}: the shape is {found:?}, expected {expected}")]
    Shape {
        /// File at fault.
        path: PathBuf,
        /// Shape in the file.
        found: Vec<u64>,
        /// Shape needed, in words.
        expected: &'static str,
    },
    /// Not a table.
    #[error("{path}: cannot read the table")]
    Table {
        /// File at fault.
        path: PathBuf,
        /// What the reader says.
        source: csv::Error,
    },
    /// A cell that makes no sense.
    #[error("{path}: row {row}, `{field}` is `{value}`, expected {expected}")]
    Field {
        /// File at fault.
        path: PathBuf,
        /// Row, counted from 1 below the header.
        row: usize,
        /// Column.
        field: &'static str,
        /// Its text; empty when the column is missing.
        value: String,
        /// What it should hold.
        expected: &'static str,
    },
    /// An index beyond the end of what it points into.
    #[error("{path}: element {element} is {value}, but there are {count}")]
    OutOfRange {
        /// File at fault.
        path: PathBuf,
        /// Place in the array or row of the table.
        element: usize,
        /// Index found.
        value: u32,
        /// Number of things it may name.
        count: usize,
    },
    /// A number that is not finite.
    #[error("{path}: element {element} is {value}, expected a finite number")]
    NotFinite {
        /// File at fault.
        path: PathBuf,
        /// Place in the array.
        element: usize,
        /// Number found.
        value: f32,
    },
}

impl BodiesData {
    /// Reads `template_vertices.npy`, `faces.npy`, `basis.npy`, `coefficients_public.npy`, `joint_template.npy`,
    /// `joint_basis.npy`, `skin_joints.npy`, `skin_weights.npy`, `parts.npy`, `part_names.csv`, `landmarks.csv` and the
    /// column `sex` of `truth.csv` from `folder`.
    ///
    /// # Errors
    /// Names the file at fault and what was expected of it.
    pub fn read(folder: &Path) -> Result<Self, ReadBodiesError> {
        let mean = read_points(&folder.join("template_vertices.npy"))?;
        let n_vertices = mean.len();
        let faces = Array::<u32>::read(&folder.join("faces.npy"), "<u4")?;
        faces.expect_shape(&[None, Some(3)], "[n_triangles, 3]")?;
        faces.expect_below(n_vertices)?;
        let basis = points(&folder.join("basis.npy"), Some(n_vertices))?;
        let coefficients = Array::<f32>::read(&folder.join("coefficients_public.npy"), "<f4")?;
        coefficients.expect_shape(&[None, Some(basis.len())], "[n_bodies, n_basis]")?;
        coefficients.expect_finite()?;
        let joint_basis = points(&folder.join("joint_basis.npy"), Some(N_POPULATION_JOINTS))?;
        let mean_joints = read_points(&folder.join("joint_template.npy"))?;
        let part_names = column(&folder.join("part_names.csv"), "name")?;
        let parts = Array::<u32>::read(&folder.join("parts.npy"), "<u4")?;
        parts.expect_shape(&[Some(n_vertices)], "[n_vertices]")?;
        parts.expect_below(part_names.len())?;
        let more = MORE_LANDMARKS.iter().filter(|(_, vertex)| (*vertex as usize) < n_vertices);
        let landmarks = read_landmarks(&folder.join("landmarks.csv"), n_vertices)?
            .into_iter()
            .chain(more.map(|&(name, vertex)| (name.to_string(), vertex)));
        Ok(Self {
            triangles: faces.values.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
            coefficients: rows(&coefficients.values, basis.len()),
            is_female: read_sexes(&folder.join("truth.csv"), coefficients.values.len() / basis.len())?,
            skin: read_skin(folder, n_vertices)?,
            parts: parts.values.iter().map(|&part| part as u8).collect(),
            landmarks: landmarks.collect(),
            mean,
            basis,
            mean_joints,
            joint_basis,
            part_names,
        })
    }

    /// The bodies that nothing may be trained on: of every six couples the last. The shape space, the predictors and their
    /// calibration see [the others](Self::training_bodies) only, so that these can test them. The rows go by stature, men and
    /// women in turn, so both parts have people of every size and of both sexes.
    pub fn held_out(&self) -> Vec<usize> {
        (0..self.coefficients.len()).filter(|&body| is_held_out(body)).collect()
    }

    /// The bodies that are not [held out](Self::held_out).
    pub fn training_bodies(&self) -> Vec<usize> {
        (0..self.coefficients.len()).filter(|&body| !is_held_out(body)).collect()
    }

    /// The population without the bodies [held out](Self::held_out).
    #[must_use]
    pub fn training(mut self) -> Self {
        let training = self.training_bodies();
        self.coefficients = training.iter().map(|&body| self.coefficients[body].clone()).collect();
        self.is_female = training.iter().map(|&body| self.is_female[body]).collect();
        self
    }

    /// Vertices of body `index`, metres, body frame.
    pub fn vertices(&self, index: usize) -> Vec<DVec3> {
        combine(&self.mean, &self.basis, &self.coefficients[index])
    }

    /// Joints of body `index`, `[28]`, metres, body frame.
    pub fn joints(&self, index: usize) -> Vec<DVec3> {
        combine(&self.mean_joints, &self.joint_basis, &self.coefficients[index])
    }
}

fn is_held_out(body: usize) -> bool {
    (body / 2) % 6 == 5
}

fn combine(mean: &[DVec3], basis: &[Vec<DVec3>], coefficients: &[f64]) -> Vec<DVec3> {
    let mut sum = mean.to_vec();
    for (direction, &coefficient) in basis.iter().zip(coefficients) {
        for (point, step) in sum.iter_mut().zip(direction) {
            *point += coefficient * *step;
        }
    }
    sum
}

fn rows(values: &[f32], width: usize) -> Vec<Vec<f64>> {
    values.chunks_exact(width).map(|row| row.iter().map(|&x| f64::from(x)).collect()).collect()
}

struct Array<T> {
    path: PathBuf,
    shape: Vec<u64>,
    values: Vec<T>,
}

impl<T: npyz::Deserialize> Array<T> {
    fn read(path: &Path, expected: &'static str) -> Result<Self, ReadBodiesError> {
        let read = |source| ReadBodiesError::Read { path: path.into(), source };
        let array = |source| ReadBodiesError::Array { path: path.into(), expected, source };
        let bytes = std::fs::read(path).map_err(read)?;
        let file = npyz::NpyFile::new(&bytes[..]).map_err(array)?;
        let shape = file.shape().to_vec();
        let values = file.into_vec::<T>().map_err(array)?;
        Ok(Self { path: path.into(), shape, values })
    }

    fn expect_shape(&self, shape: &[Option<usize>], expected: &'static str) -> Result<(), ReadBodiesError> {
        let fits =
            |(&found, wanted): (&u64, &Option<usize>)| wanted.is_none_or(|wanted| wanted as u64 == found);
        if self.shape.len() == shape.len()
            && self.shape.iter().zip(shape).all(fits)
            && !self.values.is_empty()
        {
            return Ok(());
        }
        Err(ReadBodiesError::Shape { path: self.path.clone(), found: self.shape.clone(), expected })
    }
}

impl Array<u32> {
    fn expect_below(&self, count: usize) -> Result<(), ReadBodiesError> {
        match self.values.iter().position(|&value| value as usize >= count) {
            None => Ok(()),
            Some(element) => {
                let value = self.values[element];
                Err(ReadBodiesError::OutOfRange { path: self.path.clone(), element, value, count })
            }
        }
    }
}

impl Array<f32> {
    fn expect_finite(&self) -> Result<(), ReadBodiesError> {
        match self.values.iter().position(|value| !value.is_finite()) {
            None => Ok(()),
            Some(element) => Err(ReadBodiesError::NotFinite {
                path: self.path.clone(),
                element,
                value: self.values[element],
            }),
        }
    }
}

/// The points of an `[n, 3]` array of `<f4`, metres.
///
/// # Errors
/// Names the file and what was expected of it.
pub fn read_points(path: &Path) -> Result<Vec<DVec3>, ReadBodiesError> {
    Ok(points(path, None)?.swap_remove(0))
}

/// One set of points of an `[n, 3]` array, or the sets of an `[n_sets, count, 3]` array when `count` is given.
fn points(path: &Path, count: Option<usize>) -> Result<Vec<Vec<DVec3>>, ReadBodiesError> {
    let array = Array::<f32>::read(path, "<f4")?;
    match count {
        None => array.expect_shape(&[None, Some(3)], "[n, 3]")?,
        Some(_) => array.expect_shape(&[None, count, Some(3)], "[n_basis, n of the mean, 3]")?,
    }
    array.expect_finite()?;
    let points: Vec<DVec3> =
        array.values.chunks_exact(3).map(|p| DVec3::new(p[0].into(), p[1].into(), p[2].into())).collect();
    Ok(points.chunks_exact(count.unwrap_or(points.len())).map(<[DVec3]>::to_vec).collect())
}

fn read_skin(folder: &Path, n_vertices: usize) -> Result<Vec<Vec<(JointId, f32)>>, ReadBodiesError> {
    let joints = Array::<u32>::read(&folder.join("skin_joints.npy"), "<u4")?;
    let weights = Array::<f32>::read(&folder.join("skin_weights.npy"), "<f4")?;
    joints.expect_shape(&[Some(n_vertices), Some(6)], "[n_vertices, 6]")?;
    joints.expect_below(N_POPULATION_JOINTS)?;
    weights.expect_shape(&[Some(n_vertices), Some(6)], "[n_vertices, 6]")?;
    weights.expect_finite()?;
    let vertex = |(joints, weights): (&[u32], &[f32])| {
        let pairs = joints.iter().zip(weights).filter(|&(_, &weight)| weight > 0.0);
        pairs
            .map(|(&joint, &weight)| (JointId::from_index(joint as usize).expect("checked above"), weight))
            .collect()
    };
    Ok(joints.values.chunks_exact(6).zip(weights.values.chunks_exact(6)).map(vertex).collect())
}

fn read_landmarks(path: &Path, n_vertices: usize) -> Result<Vec<(String, u32)>, ReadBodiesError> {
    let (names, ids) = (column(path, "name")?, column(path, "vertex_id")?);
    let landmark = |(row, (name, id)): (usize, (String, String))| match id.parse::<u32>() {
        Err(_) => Err(field(path, row, "vertex_id", id, "a vertex number")),
        Ok(value) if value as usize >= n_vertices => {
            Err(ReadBodiesError::OutOfRange { path: path.into(), element: row, value, count: n_vertices })
        }
        Ok(id) => Ok((name, id)),
    };
    names.into_iter().zip(ids).enumerate().map(landmark).collect()
}

fn read_sexes(path: &Path, n_bodies: usize) -> Result<Vec<bool>, ReadBodiesError> {
    let sexes = column(path, "sex")?;
    if sexes.len() != n_bodies {
        return Err(field(path, sexes.len(), "sex", String::new(), "one row per body"));
    }
    let is_female = |(row, sex): (usize, String)| match sex.as_str() {
        "female" => Ok(true),
        "male" => Ok(false),
        _ => Err(field(path, row, "sex", sex, "`female` or `male`")),
    };
    sexes.into_iter().enumerate().map(is_female).collect()
}

fn field(
    path: &Path,
    row: usize,
    field: &'static str,
    value: String,
    expected: &'static str,
) -> ReadBodiesError {
    ReadBodiesError::Field { path: path.into(), row: row + 1, field, value, expected }
}

/// The cells of the column called `name`.
fn column(path: &Path, name: &'static str) -> Result<Vec<String>, ReadBodiesError> {
    let table = |source| ReadBodiesError::Table { path: path.into(), source };
    let mut reader = csv::Reader::from_path(path).map_err(table)?;
    let place = reader.headers().map_err(table)?.iter().position(|header| header == name);
    let place = place.ok_or_else(|| field(path, 0, name, String::new(), "a column of this name"))?;
    reader.records().map(|row| row.map(|row| row[place].to_string()).map_err(table)).collect()
}
