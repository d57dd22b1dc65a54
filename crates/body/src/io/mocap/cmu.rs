//! The table of a folder of motion capture clips, `index.csv`, and the clips that it names.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::{LoadMocapError, load_asf_amc, load_humanoid_json};
use crate::mocap::MocapClip;

/// One line of `index.csv`.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
pub struct IndexEntry {
    /// Its name, as in `02_05`.
    pub clip: String,
    /// Its path inside the folder: `.amc`, whose skeleton is the one `.asf` beside it, or `.json`.
    pub file: PathBuf,
    /// What the person does.
    pub action: String,
    /// `train` or `validate`.
    pub split: String,
}

/// Why a table of clips cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum LoadIndexError {
    /// Not there, not CSV, or without the columns `clip file action split`.
    #[error("{path}: is not a table of clips")]
    Csv { path: PathBuf, source: csv::Error },
}

/// Reads `index.csv` in `folder`.
///
/// # Errors
/// [`LoadIndexError`] when it is not there or lacks a column.
pub fn load_index(folder: &Path) -> Result<Vec<IndexEntry>, LoadIndexError> {
    let path = folder.join("index.csv");
    let rows = csv::Reader::from_path(&path).and_then(|mut reader| reader.deserialize().collect());
    rows.map_err(|source| LoadIndexError::Csv { path, source })
}

/// Reads the clip of `entry` from `folder`.
///
/// # Errors
/// [`LoadMocapError`] as of the reader of its format.
pub fn load_indexed_clip(folder: &Path, entry: &IndexEntry) -> Result<MocapClip, LoadMocapError> {
    let path = folder.join(&entry.file);
    if path.extension().is_some_and(|extension| extension == "json") {
        return load_humanoid_json(&path);
    }
    // asfamc/02/02_05.amc has its skeleton in asfamc/02/02.asf.
    let subject = path.parent().and_then(Path::file_name).unwrap_or_default();
    load_asf_amc(&path.with_file_name(subject).with_extension("asf"), &path)
}
