//! The append-only file that a run grows by: what it holds survives a crash or a full disk.
//!
//! After a first line that names the format come the frames, each as its length (4 bytes, little-endian), the CRC-32 of
//! its bytes (the same), and the bytes. A torn or damaged tail is dropped when the journal is opened again.

use std::fs::{self, File};
use std::io::{Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};

use super::files::{WriteRunError, private_file};
use super::record::{Entry, EntryFile};

const MAGIC: &[u8] = b"umbra journal 3\n";
const HEADER_BYTES: usize = 8;

/// A journal that grows.
pub(super) struct Journal {
    path: PathBuf,
    file: File,
    /// Bytes that hold complete entries.
    length: u64,
}

impl Journal {
    /// Starts an empty journal.
    pub fn create(path: &Path) -> Result<Self, WriteRunError> {
        let failed = WriteRunError::file(path);
        let open = || {
            let mut file = private_file().create(true).truncate(true).open(path)?;
            file.write_all(MAGIC).map(|()| file)
        };
        let file = open().map_err(failed)?;
        Ok(Self { path: path.to_owned(), file, length: MAGIC.len() as u64 })
    }

    /// Opens the journal of an interrupted run, with its entries up to the last one that has a checkpoint; the others
    /// have to be computed again and are removed. Reads every entry of a journal that will not grow.
    pub fn reopen(path: &Path) -> anyhow::Result<(Self, Vec<Entry>)> {
        let (mut entries, ends) = read_entries(path)?;
        let kept = entries.iter().rposition(|entry| entry.checkpoint.is_some()).map_or(0, |last| last + 1);
        entries.truncate(kept);
        let length = kept.checked_sub(1).map_or(MAGIC.len() as u64, |last| ends[last]);
        let open = || {
            let mut file = private_file().open(path)?;
            file.set_len(length)?;
            file.seek(SeekFrom::Start(length)).map(|_| file)
        };
        let file = open().map_err(WriteRunError::file(path))?;
        Ok((Self { path: path.to_owned(), file, length }, entries))
    }

    /// Appends an entry; after an error the journal still ends with the entry before.
    pub fn push(&mut self, entry: &Entry) -> Result<(), WriteRunError> {
        let write = |file: &mut File| {
            let payload =
                postcard::to_stdvec(&EntryFile::from_entry(entry)).map_err(std::io::Error::other)?;
            let length = u32::try_from(payload.len()).map_err(std::io::Error::other)?;
            let mut bytes = Vec::with_capacity(HEADER_BYTES + payload.len());
            bytes.extend_from_slice(&length.to_le_bytes());
            bytes.extend_from_slice(&crc32fast::hash(&payload).to_le_bytes());
            bytes.extend_from_slice(&payload);
            file.write_all(&bytes).map(|()| bytes.len() as u64)
        };
        match write(&mut self.file) {
            Ok(added) => {
                self.length += added;
                Ok(())
            }
            Err(error) => {
                // Reading drops a torn tail too, so this may fail.
                let _ = self.file.set_len(self.length);
                Err(WriteRunError::file(&self.path)(error))
            }
        }
    }
}

/// The complete entries of a journal, and where in the file each ends.
pub(super) fn read_entries(path: &Path) -> anyhow::Result<(Vec<Entry>, Vec<u64>)> {
    let bytes = fs::read(path).with_context(|| format!("{}: cannot read the journal", path.display()))?;
    // A crash while it was created may have left less than the first line.
    ensure!(
        bytes.starts_with(MAGIC) || MAGIC.starts_with(&bytes),
        "{}: is not a journal that this version can read, expected one that starts with {:?}",
        path.display(),
        String::from_utf8_lossy(MAGIC).trim_end(),
    );
    let (mut entries, mut ends) = (Vec::new(), Vec::new());
    let mut rest = bytes.get(MAGIC.len()..).unwrap_or_default();
    while let Some((entry, length)) = first_entry(rest) {
        rest = &rest[length..];
        entries.push(entry);
        ends.push((bytes.len() - rest.len()) as u64);
    }
    Ok((entries, ends))
}

/// The entry at the start of `bytes` and its length in bytes; `None` when it is torn or damaged.
fn first_entry(bytes: &[u8]) -> Option<(Entry, usize)> {
    let (header, rest) = bytes.split_at_checked(HEADER_BYTES)?;
    let number = |bytes: &[u8]| bytes.try_into().map(u32::from_le_bytes).ok();
    let payload = rest.get(..number(&header[..4])? as usize)?;
    if crc32fast::hash(payload) != number(&header[4..])? {
        return None;
    }
    let file: EntryFile = postcard::from_bytes(payload).ok()?;
    Some((file.into_entry()?, HEADER_BYTES + payload.len()))
}
