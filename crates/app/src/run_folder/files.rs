//! Files that only their owner reads, written whole or not at all.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// A result could not be written: a full disk, a missing permission.
#[derive(Debug, thiserror::Error)]
pub enum WriteRunError {
    /// A file.
    #[error("{path}: cannot write the file")]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A folder.
    #[error("{path}: cannot create the folder")]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A file of an earlier run.
    #[error("{path}: cannot remove the file of an earlier run")]
    Remove {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

impl WriteRunError {
    pub(super) fn file(path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        |source| Self::File { path, source }
    }
}

/// Creates a folder that only its owner enters, and those above it.
pub(super) fn create_private_folder(path: &Path) -> Result<(), WriteRunError> {
    let failed = |source| WriteRunError::Folder { path: path.to_owned(), source };
    if let Some(parent) = path.parent() {
        fs::create_dir_all(parent).map_err(failed)?;
    }
    let mut builder = fs::DirBuilder::new();
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    match builder.create(path) {
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists && path.is_dir() => Ok(()),
        result => result.map_err(failed),
    }
}

/// Options that create a file which only its owner reads.
pub(super) fn private_file() -> OpenOptions {
    let mut options = OpenOptions::new();
    options.write(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    options
}

/// Writes a whole file that only its owner reads: it appears complete, or stays as it was.
///
/// # Errors
/// When the disk is full, say.
pub fn write_private(path: &Path, bytes: &[u8]) -> Result<(), WriteRunError> {
    write_whole(path, bytes)
}

/// Writes a whole file: it appears complete, or stays as it was.
pub(super) fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), WriteRunError> {
    let mut file = PendingFile::create(path)?;
    file.write_all(bytes).map_err(WriteRunError::file(path))?;
    file.keep()
}

/// A file under a temporary name, which [`keep`](Self::keep) turns into the real one and dropping removes.
pub(super) struct PendingFile {
    path: PathBuf,
    temporary: PathBuf,
    file: Option<BufWriter<File>>,
}

impl PendingFile {
    /// Starts the file that shall be called `path`.
    pub fn create(path: &Path) -> Result<Self, WriteRunError> {
        let mut temporary = path.as_os_str().to_owned();
        temporary.push(".part");
        let temporary = PathBuf::from(temporary);
        let opened = private_file().create(true).truncate(true).open(&temporary);
        let file = opened.map_err(WriteRunError::file(path))?;
        Ok(Self { path: path.to_owned(), temporary, file: Some(BufWriter::new(file)) })
    }

    /// Everything is written: gives the file its name.
    pub fn keep(mut self) -> Result<(), WriteRunError> {
        let failed = WriteRunError::file(&self.path);
        let Some(file) = self.file.take() else { return Ok(()) };
        let result = file
            .into_inner()
            .map_err(io::IntoInnerError::into_error)
            .and_then(|file| file.sync_all())
            .and_then(|()| fs::rename(&self.temporary, &self.path));
        if result.is_err() {
            // The first error is the one to report.
            let _ = fs::remove_file(&self.temporary);
        }
        result.map_err(failed)
    }

    fn writer(&mut self) -> io::Result<&mut BufWriter<File>> {
        self.file.as_mut().ok_or_else(|| io::Error::other("the file is finished"))
    }
}

impl Write for PendingFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.writer()?.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer()?.flush()
    }
}

impl Seek for PendingFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.writer()?.seek(to)
    }
}

impl Drop for PendingFile {
    fn drop(&mut self) {
        if let Some(file) = self.file.take() {
            // Not finished, so there is nothing worth flushing or reporting.
            let _ = file.into_parts();
            let _ = fs::remove_file(&self.temporary);
        }
    }
}
