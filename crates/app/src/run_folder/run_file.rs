//! `run.toml`: everything that is needed to make the same run again.

use std::fs;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use body::Camera;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

/// Version of the run folder's files.
pub(super) const VERSION: u32 = 1;

/// One input of a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunInput {
    /// What it is used as, such as `video` or `background`.
    pub role: &'static str,
    /// The file, or the folder of frames.
    pub path: PathBuf,
}

/// The form of `run.toml`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct RunFile {
    pub version: u32,
    pub program: String,
    /// Frames a second.
    pub fps: f64,
    pub redacted: bool,
    /// What was assumed because the user did not say it.
    pub assumptions: Vec<String>,
    pub inputs: Vec<InputFile>,
    pub camera: CameraFile,
    pub body: BodyFile,
    pub settings: toml::Table,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct InputFile {
    pub role: String,
    pub path: String,
    /// Of the file's bytes; of a folder, over the names, lengths and bytes of its files in the order of their names.
    pub sha256: String,
}

/// A camera in the conventions of this program: metres, pixels from the top-left corner.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct CameraFile {
    pub width: u32,
    pub height: u32,
    pub focal_px: [f64; 2],
    pub principal_point_px: [f64; 2],
    pub distortion: [f64; 5],
    /// Rows of the rotation of `camera_from_world`.
    pub rotation: [[f64; 3]; 3],
    pub translation_m: [f64; 3],
}

impl CameraFile {
    pub fn from_camera(camera: &Camera) -> Self {
        let intrinsics = camera.intrinsics();
        Self {
            width: intrinsics.width,
            height: intrinsics.height,
            focal_px: intrinsics.focal_px,
            principal_point_px: intrinsics.principal_point_px,
            distortion: intrinsics.distortion,
            rotation: camera.rotation().transpose().to_cols_array_2d(),
            translation_m: camera.translation_m().to_array(),
        }
    }
}

/// The tracked body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct BodyFile {
    pub stature_m: f64,
    pub vertices: u64,
}

impl RunFile {
    pub fn to_text(&self) -> anyhow::Result<String> {
        toml::to_string(self).context("run.toml: a setting has no form in TOML")
    }

    pub fn read(path: &Path) -> anyhow::Result<Self> {
        let name = path.display();
        let text = fs::read_to_string(path).with_context(|| format!("{name}: cannot read the file"))?;
        let table: toml::Table = text.parse().with_context(|| format!("{name}: is not TOML"))?;
        match table.get("version").and_then(toml::Value::as_integer) {
            Some(version) if version == i64::from(VERSION) => {}
            Some(version) => bail!("{name}: `version` is {version}, expected {VERSION}"),
            None => bail!("{name}: has no `version`, expected the run.toml of a run folder"),
        }
        table.try_into().with_context(|| format!("{name}: is not the run.toml of a run folder"))
    }

    /// The first entry in which two runs differ: its name, its value here and its value there.
    pub fn difference(&self, other: &Self) -> anyhow::Result<Option<(String, String, String)>> {
        let (a, b) = (toml::Value::try_from(self)?, toml::Value::try_from(other)?);
        Ok(first_difference("", Some(&a), Some(&b)))
    }
}

fn first_difference(
    name: &str,
    a: Option<&toml::Value>,
    b: Option<&toml::Value>,
) -> Option<(String, String, String)> {
    match (a, b) {
        _ if a == b => None,
        (Some(toml::Value::Table(a)), Some(toml::Value::Table(b))) => {
            let keys = a.keys().chain(b.keys().filter(|key| !a.contains_key(*key)));
            keys.into_iter().find_map(|key| {
                let name = if name.is_empty() { key.clone() } else { format!("{name}.{key}") };
                first_difference(&name, a.get(key), b.get(key))
            })
        }
        (Some(toml::Value::Array(a)), Some(toml::Value::Array(b))) => (0..a.len().max(b.len()))
            .find_map(|index| first_difference(&format!("{name}[{index}]"), a.get(index), b.get(index))),
        _ => {
            let show = |value: Option<&toml::Value>| {
                value.map_or_else(|| "absent".to_owned(), toml::Value::to_string)
            };
            Some((name.to_owned(), show(a), show(b)))
        }
    }
}

/// Reads an input for its hash.
pub(super) fn hash_input(input: &RunInput) -> anyhow::Result<InputFile> {
    let unreadable = || format!("{}: cannot read the {}", input.path.display(), input.role);
    let mut hash = Sha256::new();
    if input.path.is_dir() {
        let mut files = Vec::new();
        for entry in fs::read_dir(&input.path).with_context(unreadable)? {
            let path = entry.with_context(unreadable)?.path();
            if path.is_file() {
                files.push(path);
            }
        }
        files.sort();
        for file in files {
            let name = file.file_name().unwrap_or_default().as_encoded_bytes();
            let length = fs::metadata(&file).with_context(unreadable)?.len();
            hash.update((name.len() as u64).to_le_bytes());
            hash.update(name);
            hash.update(length.to_le_bytes());
            hash_file(&file, &mut hash)
                .with_context(|| format!("{}: cannot read the file", file.display()))?;
        }
    } else {
        hash_file(&input.path, &mut hash).with_context(unreadable)?;
    }
    let sha256 = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    Ok(InputFile { role: input.role.to_owned(), path: input.path.display().to_string(), sha256 })
}

fn hash_file(path: &Path, hash: &mut Sha256) -> std::io::Result<()> {
    let mut file = fs::File::open(path)?;
    let mut block = vec![0; 1 << 16];
    loop {
        let count = file.read(&mut block)?;
        if count == 0 {
            return Ok(());
        }
        hash.update(&block[..count]);
    }
}
