//! Files that are written whole or not at all.

use std::fs;
use std::path::Path;

use anyhow::Context as _;

/// Writes `bytes` to a new file beside `path`, which then takes its place; makes the folder where there is none.
///
/// # Errors
/// When something cannot be written; the message names it.
pub fn write_whole(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    let folder = path.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(folder).with_context(|| format!("{}: cannot make the folder", folder.display()))?;
    let partial = path.with_extension("partial");
    fs::write(&partial, bytes).with_context(|| format!("{}: cannot write", partial.display()))?;
    fs::rename(&partial, path).with_context(|| format!("{}: cannot write", path.display()))
}
