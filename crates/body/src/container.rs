//! The shell of binary files, those of this crate and others: magic, version, length, data, checksum.
//!
//! | bytes | content |
//! |---|---|
//! | 8 | magic |
//! | 4 | version, little endian |
//! | 4 | length of the data, little endian |
//! | length | the data |
//! | 4 | CRC-32 of the data, little endian |

const HEADER_LEN: usize = 16;
const CHECKSUM_LEN: usize = 4;

/// Why bytes are not a file of the kind and version asked for.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum ContainerError {
    /// Some other file.
    #[error("`magic`: the file does not begin with `{expected}`")]
    Magic { expected: &'static str },
    /// Made for another version of this crate.
    #[error("`version` is {found}, expected {expected}")]
    Version { found: u32, expected: u32 },
    /// Cut short, or with something behind its end.
    #[error("the file has {found} bytes, expected {expected}")]
    Length { found: usize, expected: usize },
    /// Damaged on the way.
    #[error("`checksum` is {stored:08x}, but that of the data is {computed:08x}")]
    Checksum { stored: u32, computed: u32 },
}

/// The file that holds `data`.
///
/// # Panics
/// When `magic` has not 8 bytes or the data exceed 4 GiB.
pub fn seal(magic: &'static str, version: u32, data: &[u8]) -> Vec<u8> {
    assert_eq!(magic.len(), 8, "magic `{magic}`");
    let length = u32::try_from(data.len()).expect("the crate's files are a few megabytes");
    let checksum = crc32fast::hash(data).to_le_bytes();
    [magic.as_bytes(), &version.to_le_bytes(), &length.to_le_bytes(), data, &checksum].concat()
}

/// The data of a file that [`seal`] made.
///
/// # Errors
/// [`ContainerError`] when it is of another kind or version, cut short or damaged.
pub fn open<'a>(magic: &'static str, version: u32, bytes: &'a [u8]) -> Result<&'a [u8], ContainerError> {
    if !bytes.starts_with(magic.as_bytes()) {
        return Err(ContainerError::Magic { expected: magic });
    }
    let number_at = |at: usize| {
        let four =
            bytes.get(at..at + 4).ok_or(ContainerError::Length { found: bytes.len(), expected: HEADER_LEN });
        four.map(|four| u32::from_le_bytes(four.try_into().expect("four bytes")))
    };
    let found = number_at(8)?;
    if found != version {
        return Err(ContainerError::Version { found, expected: version });
    }
    let end = HEADER_LEN + number_at(12)? as usize;
    if bytes.len() != end + CHECKSUM_LEN {
        return Err(ContainerError::Length { found: bytes.len(), expected: end + CHECKSUM_LEN });
    }
    let data = &bytes[HEADER_LEN..end];
    let (stored, computed) = (number_at(end)?, crc32fast::hash(data));
    if stored != computed {
        return Err(ContainerError::Checksum { stored, computed });
    }
    Ok(data)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opens_what_was_sealed_and_nothing_else() {
        let bytes = seal("UMBRATST", 3, b"some data");
        assert_eq!(open("UMBRATST", 3, &bytes), Ok(&b"some data"[..]));
        let message =
            |version, bytes: &[u8]| open("UMBRATST", version, bytes).expect_err("a bad file").to_string();
        assert_eq!(message(4, &bytes), "`version` is 3, expected 4");
        assert_eq!(message(3, b"PNG"), "`magic`: the file does not begin with `UMBRATST`");
        assert_eq!(message(3, &bytes[..28]), "the file has 28 bytes, expected 29");
        assert_eq!(message(3, &bytes[..10]), "the file has 10 bytes, expected 16");
        for bit in 0..8 * b"some data".len() {
            let mut damaged = bytes.clone();
            damaged[HEADER_LEN + bit / 8] ^= 1 << (bit % 8);
            assert!(message(3, &damaged).starts_with("`checksum` is "), "bit {bit}");
        }
    }
}
