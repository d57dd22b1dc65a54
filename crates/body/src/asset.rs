//! The body model's file: magic, version, length, postcard data, checksum.
//!
//! | bytes | content |
//! |---|---|
//! | 8 | `UMBRABDY` |
//! | 4 | version, little endian |
//! | 4 | length of the data, little endian |
//! | length | [`BodyFile`] in postcard |
//! | 4 | CRC-32 of the data, little endian |

use serde::{Deserialize, Serialize};

const MAGIC: &[u8; 8] = b"UMBRABDY";
/// Version of the file that this build reads and writes.
pub const VERSION: u32 = 1;
const HEADER_LEN: usize = 16;
const CHECKSUM_LEN: usize = 4;

/// What the file of a body model holds. Points are flat, x y z after one another, metres, body frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BodyFile {
    /// [n_triangles], outward by the right-hand rule.
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
    /// Vertices of the mean body, [n_vertices * 3].
    pub mean_vertices: Vec<f32>,
    /// Metres per standard deviation, [n_components * n_vertices * 3], largest variance first.
    pub vertex_basis: Vec<f32>,
    /// Joints of the mean body, [n_joints * 3].
    pub mean_joints: Vec<f32>,
    /// Metres per standard deviation, [n_components * n_joints * 3].
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
    /// Coefficients at the mean stature, standard deviations, [n_components].
    pub mean_scores: Vec<f32>,
    /// Their change per metre of stature, [n_components].
    pub scores_per_m: Vec<f32>,
}

/// Why bytes are not a body model.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LoadBodyModelError {
    /// Some other file.
    #[error("not a body model: it does not begin with `UMBRABDY`")]
    Magic,
    /// Made for another version of this crate.
    #[error("`version` is {found}, expected {VERSION}")]
    Version {
        /// Version in the file.
        found: u32,
    },
    /// Cut short, or with something behind its end.
    #[error("the file has {found} bytes, expected {expected}")]
    Length {
        /// Bytes there are.
        found: usize,
        /// Bytes there should be.
        expected: usize,
    },
    /// Damaged on the way.
    #[error("`checksum` is {stored:08x}, but that of the data is {computed:08x}")]
    Checksum {
        /// In the file.
        stored: u32,
        /// Of the data.
        computed: u32,
    },
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
        let data = postcard::to_stdvec(self).expect("writing to memory cannot fail");
        let length = u32::try_from(data.len()).expect("a body model is a few megabytes");
        let checksum = crc32fast::hash(&data).to_le_bytes();
        [&MAGIC[..], &VERSION.to_le_bytes(), &length.to_le_bytes(), &data, &checksum].concat()
    }

    /// Undoes [`BodyFile::to_bytes`]; whether the arrays fit each other is for [`BodyModel`](crate::BodyModel) to say.
    ///
    /// # Errors
    /// On another kind or version of file, a wrong length, a wrong checksum.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, LoadBodyModelError> {
        if bytes.get(..8) != Some(MAGIC) {
            return Err(LoadBodyModelError::Magic);
        }
        let number_at = |at: usize| {
            let bytes = bytes.get(at..at + 4).ok_or(LoadBodyModelError::Length { found: bytes.len(), expected: HEADER_LEN });
            bytes.map(|bytes| u32::from_le_bytes(bytes.try_into().expect("four bytes")))
        };
        match number_at(8)? {
            VERSION => {}
            found => return Err(LoadBodyModelError::Version { found }),
        }
        let end = HEADER_LEN + number_at(12)? as usize;
        if bytes.len() != end + CHECKSUM_LEN {
            return Err(LoadBodyModelError::Length { found: bytes.len(), expected: end + CHECKSUM_LEN });
        }
        let (stored, computed) = (number_at(end)?, crc32fast::hash(&bytes[HEADER_LEN..end]));
        if stored != computed {
            return Err(LoadBodyModelError::Checksum { stored, computed });
        }
        postcard::from_bytes(&bytes[HEADER_LEN..end]).map_err(LoadBodyModelError::Decode)
    }
}
