//! The body model's file: [`BodyFile`] in postcard inside a [`container`].

use serde::{Deserialize, Serialize};

use crate::container::{self, ContainerError};

const MAGIC: &str = "UMBRABDY";
/// Version of the file that this build reads and writes.
pub const VERSION: u32 = 1;

/// What the file of a body model holds. Points are flat, x y z after one another, metres, body frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BodyFile {
    /// `[n_triangles]`, outward by the right-hand rule.
    pub triangles: Vec<[u16; 3]>,
    /// Body part of each vertex: index into `part_names`.
    pub parts: Vec<u8>,
    /// Names of the body parts.
    pub part_names: Vec<String>,
    /// Points of the template's surface with a name.
    pub landmarks: Vec<LandmarkFile>,
    /// How many of `influences` belong to each vertex.
    pub influence_counts: Vec<u8>,
    /// Joint and weight, vertex after vertex, largest weight first.
    pub influences: Vec<(u8, f32)>,
    /// Vertices of the mean body, `[n_vertices * 3]`.
    pub mean_vertices: Vec<f32>,
    /// Metres per standard deviation, `[n_components * n_vertices * 3]`, largest variance first.
    pub vertex_basis: Vec<f32>,
    /// Joints of the mean body, `[n_joints * 3]`.
    pub mean_joints: Vec<f32>,
    /// Metres per standard deviation, `[n_components * n_joints * 3]`.
    pub joint_basis: Vec<f32>,
    /// Share of the population's variance along each component.
    pub variance_shares: Vec<f32>,
    /// Shape given stature: of everyone, of women, of men.
    pub stature_lines: [StatureLineFile; 3],
    /// Vertex of the population's mesh that each vertex comes from.
    pub source_vertices: Vec<u32>,
}

/// A point on a triangle of the template.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LandmarkFile {
    /// Its name in the population's table.
    pub name: String,
    /// Triangle it lies on.
    pub triangle: u32,
    /// Weights of the triangle's corners.
    pub barycentric: [f32; 3],
}

/// Regression of the shape coefficients on stature.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StatureLineFile {
    /// Metres.
    pub mean_stature_m: f32,
    /// Coefficients at the mean stature, standard deviations, `[n_components]`.
    pub mean_scores: Vec<f32>,
    /// Their change per metre of stature, `[n_components]`.
    pub scores_per_m: Vec<f32>,
}

/// Why bytes are not a body model.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LoadBodyModelError {
    /// Another kind or version of file, cut short, or damaged.
    #[error(transparent)]
    Container(#[from] ContainerError),
    /// The checksum fits but the data do not decode.
    #[error("cannot decode the data")]
    Decode(#[source] postcard::Error),
    /// An array of another length than the others ask for.
    #[error("`{field}` has {found} elements, expected {expected}")]
    FieldLength {
        /// Array at fault.
        field: &'static str,
        /// Its length.
        found: usize,
        /// The length that fits.
        expected: usize,
    },
    /// An index beyond the end of what it points into.
    #[error("`{field}[{element}]` names {value}, but there are {count}")]
    OutOfRange {
        /// Array at fault.
        field: &'static str,
        /// Element at fault.
        element: usize,
        /// Index found.
        value: usize,
        /// Number of things it may name.
        count: usize,
    },
    /// Weights that are no average.
    #[error("the skin weights of vertex {vertex} sum to {sum}, expected 1")]
    WeightSum {
        /// Vertex at fault.
        vertex: usize,
        /// Sum of its weights.
        sum: f32,
    },
    /// A number that is not finite.
    #[error("`{field}[{element}]` is {value}, expected a finite number")]
    NotFinite {
        /// Array at fault.
        field: &'static str,
        /// Element at fault.
        element: usize,
        /// Number found.
        value: f32,
    },
}

impl BodyFile {
    /// The bytes of the file.
    pub fn to_bytes(&self) -> Vec<u8> {
        container::seal(MAGIC, VERSION, &postcard::to_stdvec(self).expect("writing to memory cannot fail"))
    }

    /// Undoes [`BodyFile::to_bytes`]; whether the arrays fit each other is for [`BodyModel`](crate::BodyModel) to say.
    ///
    /// # Errors
    /// On another kind or version of file, a wrong length, a wrong checksum.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, LoadBodyModelError> {
        postcard::from_bytes(container::open(MAGIC, VERSION, bytes)?).map_err(LoadBodyModelError::Decode)
    }
}
