//! Files that are written whole or not at all.

use std::fs;
use std::path::Path;

use crate::run_folder::WriteRunError;

/// Writes `bytes` to a new file beside `path`, which then takes its place; makes the folder where there is none.
///
/// # Errors
/// When something cannot be written; the message names it.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), WriteRunError> {
    let folder = path.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(folder).map_err(|source| WriteRunError::Folder { path: folder.to_owned(), source })?;
    let mut partial = path.as_os_str().to_owned();
    partial.push(".part");
    let written = fs::write(&partial, bytes).and_then(|()| fs::rename(&partial, path));
    if written.is_err() {
        // The first error is the one to report.
        let _ = fs::remove_file(&partial);
    }
    written.map_err(|source| WriteRunError::File { path: path.to_owned(), source })
}
