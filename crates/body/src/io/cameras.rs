//! Camera files: our TOML, JSON, HumanEva's 22-number `.cal`, OpenCV's YAML.
//!
//! OpenCV and its kin count pixels from the centre of the first one; ours start at its corner. So all readers add
//! 0.5 px to the principal point.

use std::path::{Path, PathBuf};

use glam::{DAffine3, DMat3, DQuat, DVec3};

use super::fields::{Field, FieldError, Value};
use crate::camera::{BadCamera, Camera, Intrinsics};

/// `.cal` files do not say the size of the image: this is HumanEva's.
pub const CAL_IMAGE_SIZE: [u32; 2] = [640, 480];

/// From a pixel whose centre is at whole numbers to one whose corner is.
const PIXEL_CENTRE: f64 = 0.5;

/// A camera as a file describes it. [`load_camera`] has checked that the values make a [`Camera`].
#[derive(Clone, Debug, PartialEq)]
pub struct CameraFile {
    /// The file's name for it.
    pub name: Option<String>,
    /// Frames a second, where the file says it.
    pub frame_rate_hz: Option<f64>,
    /// Lens and image.
    pub intrinsics: Intrinsics,
    /// Place and orientation, metres; OpenCV's files often leave them out.
    pub camera_from_world: Option<DAffine3>,
}

impl CameraFile {
    /// The camera, where the file says its place.
    #[must_use]
    pub fn camera(&self) -> Option<Camera> {
        let place = self.camera_from_world?;
        let camera = Camera::new(self.intrinsics, place.matrix3, place.translation);
        Some(camera.expect("checked when the file was loaded"))
    }
}

/// Why a camera file cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum LoadCameraError {
    /// No such file, no permission, or not text.
    #[error("{path}: cannot read the file")]
    Read { path: PathBuf, source: std::io::Error },
    /// Not TOML.
    #[error("{path}: is not valid TOML")]
    Toml { path: PathBuf, source: Box<toml::de::Error> },
    /// Not JSON.
    #[error("{path}: is not valid JSON")]
    Json { path: PathBuf, source: serde_json::Error },
    /// Not YAML.
    #[error("{path}: is not valid YAML")]
    Yaml { path: PathBuf, source: yaml_rust2::ScanError },
    /// A field is missing or of the wrong kind.
    #[error("{path}: {problem}")]
    Field { path: PathBuf, problem: FieldError },
    /// A `.cal` file with too few or too many numbers.
    #[error("{path}: has {count} numbers, expected the 22 of fx fy cx cy skew k1 k2 p1 p2 k3 R T")]
    CalLength { path: PathBuf, count: usize },
    /// Pixels that are no rectangles.
    #[error("{path}: `{field}` has skew {skew}, expected 0")]
    Skew { path: PathBuf, field: &'static str, skew: f64 },
    /// The values are numbers, but no camera has them.
    #[error("{path}: `{field}`: {problem}")]
    Camera { path: PathBuf, field: &'static str, problem: Box<BadCamera> },
}

/// Reads a camera, in the format that the file's extension or, failing that, its content tells.
///
/// | format | fields | lengths |
/// |---|---|---|
/// | `.toml` | `image_size focal_px principal_point_px distortion rotation translation_m`, optional `name fps` | m |
/// | `.json`, `.yaml`, `.yml` | `width height K dist R T` or OpenCV's `image_width … camera_matrix distortion_coefficients rvec tvec`; place optional | `units`: `m` (if left out) or `mm` |
/// | `.cal` | 22 numbers: fx fy, cx cy, skew, k1 k2 p1 p2 k3, R row by row, T | mm |
///
/// # Errors
/// [`LoadCameraError`] names the file, the field and the value.
pub fn load_camera(path: &Path) -> Result<CameraFile, LoadCameraError> {
    let text = std::fs::read_to_string(path)
        .map_err(|source| LoadCameraError::Read { path: path.to_owned(), source })?;
    parse_camera(path, &text)
}

/// As [`load_camera`], from the file's text; `path` chooses the format and stands in messages.
///
/// # Errors
/// As [`load_camera`].
pub fn parse_camera(path: &Path, text: &str) -> Result<CameraFile, LoadCameraError> {
    let owned = || path.to_owned();
    let field_error = |problem| LoadCameraError::Field { path: owned(), problem };
    let (names, parts) = match Format::of(path, text) {
        Format::Toml => {
            let table = text
                .parse::<toml::Table>()
                .map_err(|source| LoadCameraError::Toml { path: owned(), source: Box::new(source) })?;
            (TOML_NAMES, toml_parts(&toml::Value::Table(table).into()).map_err(field_error)?)
        }
        Format::Json => {
            let value: serde_json::Value = serde_json::from_str(text)
                .map_err(|source| LoadCameraError::Json { path: owned(), source })?;
            (MATRIX_NAMES, matrix_parts(&value.into()).map_err(field_error)?)
        }
        Format::OpenCvYaml => {
            let documents = yaml_rust2::YamlLoader::load_from_str(&plain_yaml(text))
                .map_err(|source| LoadCameraError::Yaml { path: owned(), source })?;
            let value = documents.into_iter().next().map_or(Value::Other, Value::from);
            (MATRIX_NAMES, matrix_parts(&value).map_err(field_error)?)
        }
        Format::Cal => {
            let numbers: Vec<Value> = text.split_whitespace().map(Value::from_word).collect();
            if numbers.len() != CAL_FIELDS.len() {
                return Err(LoadCameraError::CalLength { path: owned(), count: numbers.len() });
            }
            (MATRIX_NAMES, cal_parts(numbers).map_err(field_error)?)
        }
    };
    parts.finish(path, names)
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Format {
    Toml,
    Json,
    OpenCvYaml,
    Cal,
}

impl Format {
    fn of(path: &Path, text: &str) -> Self {
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        match extension.to_str() {
            Some("toml") => Self::Toml,
            Some("json") => Self::Json,
            Some("yaml" | "yml") => Self::OpenCvYaml,
            Some("cal") => Self::Cal,
            _ if text.trim_start().starts_with('{') => Self::Json,
            _ if text.starts_with("%YAML") || text.contains("!!opencv-matrix") => Self::OpenCvYaml,
            _ if text.split_whitespace().all(|word| word.parse::<f64>().is_ok()) => Self::Cal,
            _ => Self::Toml,
        }
    }
}

/// What the fields are called in messages.
#[derive(Clone, Copy)]
struct Names {
    focal: &'static str,
    rotation: &'static str,
    translation: &'static str,
}

const TOML_NAMES: Names = Names { focal: "focal_px", rotation: "rotation", translation: "translation_m" };
const MATRIX_NAMES: Names = Names { focal: "K", rotation: "R", translation: "T" };

/// The numbers of a camera file, before they are known to make a camera.
struct Parts {
    name: Option<String>,
    frame_rate_hz: Option<f64>,
    intrinsics: Intrinsics,
    skew: f64,
    place: Option<(DMat3, DVec3)>,
}

impl Parts {
    fn finish(self, path: &Path, names: Names) -> Result<CameraFile, LoadCameraError> {
        if self.skew != 0.0 {
            return Err(LoadCameraError::Skew { path: path.to_owned(), field: names.focal, skew: self.skew });
        }
        let (rotation, translation) = self.place.unwrap_or((DMat3::IDENTITY, DVec3::ZERO));
        let camera = Camera::new(self.intrinsics, rotation, translation).map_err(|problem| {
            let field = match problem {
                BadCamera::Rotation { .. } => names.rotation,
                BadCamera::Translation { .. } => names.translation,
                _ => names.focal, // sizes and finiteness were checked field by field
            };
            LoadCameraError::Camera { path: path.to_owned(), field, problem: Box::new(problem) }
        })?;
        Ok(CameraFile {
            name: self.name,
            frame_rate_hz: self.frame_rate_hz,
            intrinsics: self.intrinsics,
            camera_from_world: self.place.map(|_| camera.camera_from_world()),
        })
    }
}

fn toml_parts(value: &Value) -> Result<Parts, FieldError> {
    let root = Field::root(value);
    let [width, height] = match root.require(&["image_size"])?.items()?.as_slice() {
        [width, height] => [width.pixels()?, height.pixels()?],
        other => {
            return Err(FieldError::Count { field: "image_size".into(), count: other.len(), expected: 2 });
        }
    };
    let [cx, cy] = root.require(&["principal_point_px"])?.numbers()?;
    Ok(Parts {
        name: root.find(&["name"]).map(|field| field.text().map(str::to_owned)).transpose()?,
        frame_rate_hz: root.find(&["fps"]).map(|field| field.positive_number()).transpose()?,
        intrinsics: Intrinsics {
            width,
            height,
            focal_px: root.require(&["focal_px"])?.numbers()?,
            principal_point_px: [cx + PIXEL_CENTRE, cy + PIXEL_CENTRE],
            distortion: root.require(&["distortion"])?.numbers()?,
        },
        skew: 0.0,
        place: Some((
            matrix_from_rows(root.require(&["rotation"])?.numbers()?),
            DVec3::from(root.require(&["translation_m"])?.numbers::<3>()?),
        )),
    })
}

/// A camera given by the matrices of OpenCV, in JSON or YAML.
fn matrix_parts(value: &Value) -> Result<Parts, FieldError> {
    let root = Field::root(value);
    let [fx, skew, cx, _, fy, cy, ..] =
        root.require(&["K", "camera_matrix", "cameraMatrix"])?.numbers::<9>()?;
    let metres = match root.find(&["units"]) {
        None => 1.0,
        Some(units) => match units.text()?.split([',', ' ']).next() {
            Some("mm") => 0.001,
            Some("m") => 1.0,
            _ => return Err(units.unexpected("\"m\" or \"mm\"")),
        },
    };
    let rotation = match root.find(&["rvec"]) {
        Some(rvec) => Some(DMat3::from_quat(DQuat::from_scaled_axis(rvec.numbers::<3>()?.into()))),
        None => {
            root.find(&["R", "rotation"]).map(|field| field.numbers().map(matrix_from_rows)).transpose()?
        }
    };
    let place = match rotation {
        None => None,
        Some(rotation) => {
            let translation = root.require(&["T", "tvec", "translation"])?.numbers::<3>()?;
            Some((rotation, metres * DVec3::from(translation)))
        }
    };
    Ok(Parts {
        name: root.find(&["name"]).map(|field| field.text().map(str::to_owned)).transpose()?,
        frame_rate_hz: root.find(&["fps"]).map(|field| field.positive_number()).transpose()?,
        intrinsics: Intrinsics {
            width: root.require(&["width", "image_width"])?.pixels()?,
            height: root.require(&["height", "image_height"])?.pixels()?,
            focal_px: [fx, fy],
            principal_point_px: [cx + PIXEL_CENTRE, cy + PIXEL_CENTRE],
            distortion: distortion(&root)?,
        },
        skew,
        place,
    })
}

/// OpenCV writes 4, 5, 8, 12 or 14 coefficients; those after the fifth belong to lens models that we do not have.
fn distortion(root: &Field<'_>) -> Result<[f64; 5], FieldError> {
    let names = ["dist", "distortion_coefficients", "dist_coeffs", "distCoeffs", "D"];
    let Some(field) = root.find(&names) else {
        return Ok([0.0; 5]);
    };
    let mut coefficients = field.flat_numbers()?;
    while coefficients.len() > 5 && coefficients.last() == Some(&0.0) {
        coefficients.pop();
    }
    if coefficients.len() == 4 {
        coefficients.push(0.0);
    }
    <[f64; 5]>::try_from(coefficients.as_slice()).map_err(|_| FieldError::Count {
        field: names[1].to_owned(),
        count: coefficients.len(),
        expected: 5,
    })
}

/// The numbers of a `.cal` file in their order.
const CAL_FIELDS: [&str; 22] = [
    "fx", "fy", "cx", "cy", "skew", "k1", "k2", "p1", "p2", "k3", //
    "R11", "R12", "R13", "R21", "R22", "R23", "R31", "R32", "R33", "T1", "T2", "T3",
];

fn cal_parts(numbers: Vec<Value>) -> Result<Parts, FieldError> {
    let table = Value::Table(CAL_FIELDS.iter().map(|&name| name.to_owned()).zip(numbers).collect());
    let root = Field::root(&table);
    let mut n = [0.0; CAL_FIELDS.len()];
    for (number, name) in n.iter_mut().zip(CAL_FIELDS) {
        *number = root.require(&[name])?.number()?;
    }
    let [width, height] = CAL_IMAGE_SIZE;
    Ok(Parts {
        name: None,
        frame_rate_hz: None,
        intrinsics: Intrinsics {
            width,
            height,
            focal_px: [n[0], n[1]],
            principal_point_px: [n[2] + PIXEL_CENTRE, n[3] + PIXEL_CENTRE],
            distortion: [n[5], n[6], n[7], n[8], n[9]],
        },
        skew: n[4],
        place: Some((
            matrix_from_rows(std::array::from_fn(|i| n[10 + i])),
            0.001 * DVec3::new(n[19], n[20], n[21]),
        )),
    })
}

fn matrix_from_rows(rows: [f64; 9]) -> DMat3 {
    DMat3::from_cols_array(&rows).transpose()
}

/// OpenCV's `FileStorage` dialect as plain YAML: without directives and without type tags.
fn plain_yaml(text: &str) -> String {
    let without_tag = |line: &str| match line.split_once("!!opencv-") {
        Some((before, tag)) => {
            format!("{before}{}", tag.trim_start_matches(|c: char| c.is_alphanumeric() || c == '-'))
        }
        None => line.to_owned(),
    };
    text.lines().filter(|line| !line.starts_with('%')).map(|line| without_tag(line) + "\n").collect()
}

#[cfg(test)]
mod tests;
