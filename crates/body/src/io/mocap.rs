//! Motion capture files: ASF skeletons with AMC motions, BVH, and the 44-number JSON of physics-based humanoids.

use std::path::{Path, PathBuf};

use glam::DVec3;

mod asf;
mod bvh;
mod cmu;
mod humanoid;

pub use asf::load_asf_amc;
pub use bvh::load_bvh;
pub use cmu::{IndexEntry, LoadIndexError, load_index, load_indexed_clip};
pub use humanoid::load_humanoid_json;

/// Why a motion cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum LoadMocapError {
    /// No such file, no permission, or not text.
    #[error("{path}: cannot read the file")]
    Read { path: PathBuf, source: std::io::Error },
    /// Not JSON, or JSON of another form.
    #[error("{path}: is not a JSON motion")]
    Json { path: PathBuf, source: serde_json::Error },
    /// A word that does not belong at its place.
    #[error("{path}: line {line}: found `{found}`, expected {expected}")]
    Unexpected { path: PathBuf, line: usize, found: String, expected: &'static str },
    /// The file ends too early.
    #[error("{path}: the file ends, expected {expected}")]
    Ended { path: PathBuf, expected: &'static str },
    /// A frame with too few or too many numbers.
    #[error("{path}: frame {frame} has {count} numbers, expected {expected}")]
    FrameLength { path: PathBuf, frame: usize, count: usize, expected: usize },
    /// A frame that says nothing of a bone that moves.
    #[error("{path}: frame {frame} has no line of bone `{bone}`")]
    BoneMissing { path: PathBuf, frame: usize, bone: String },
    /// A motion without frames.
    #[error("{path}: has no frames")]
    NoFrames { path: PathBuf },
}

fn read(path: &Path) -> Result<String, LoadMocapError> {
    std::fs::read_to_string(path).map_err(|source| LoadMocapError::Read { path: path.to_owned(), source })
}

fn clip_name(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// A text word by word, with line numbers for messages.
struct Words<'a> {
    path: &'a Path,
    words: Vec<(usize, &'a str)>,
    next: usize,
}

impl<'a> Words<'a> {
    /// The words of all lines; what follows `comment` in a line is left out.
    fn new(path: &'a Path, text: &'a str, comment: Option<char>) -> Self {
        let line = |(index, line): (usize, &'a str)| {
            let code = comment.map_or(line, |mark| line.split(mark).next().unwrap_or_default());
            code.split_whitespace().map(move |word| (index + 1, word))
        };
        Self { path, words: text.lines().enumerate().flat_map(line).collect(), next: 0 }
    }

    fn peek(&self) -> Option<&'a str> {
        self.words.get(self.next).map(|(_, word)| *word)
    }

    /// The number of the line that the next word stands in.
    fn line(&self) -> Option<usize> {
        self.words.get(self.next).map(|(line, _)| *line)
    }

    fn word(&mut self, expected: &'static str) -> Result<&'a str, LoadMocapError> {
        let word =
            self.peek().ok_or_else(|| LoadMocapError::Ended { path: self.path.to_owned(), expected })?;
        self.next += 1;
        Ok(word)
    }

    /// How many words are left in the line that the next word stands in.
    fn left_in_line(&self) -> usize {
        self.words[self.next..].iter().take_while(|(line, _)| Some(*line) == self.line()).count()
    }

    /// Those words.
    fn rest_of_line(&mut self) -> &[(usize, &'a str)] {
        let start = self.next;
        self.next += self.left_in_line();
        &self.words[start..self.next]
    }

    fn keyword(&mut self, expected: &'static str) -> Result<(), LoadMocapError> {
        let word = self.word(expected)?;
        if word.eq_ignore_ascii_case(expected) { Ok(()) } else { Err(self.unexpected(expected)) }
    }

    fn number(&mut self, expected: &'static str) -> Result<f64, LoadMocapError> {
        match self.word(expected)?.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => Err(self.unexpected(expected)),
        }
    }

    fn vector(&mut self, expected: &'static str) -> Result<DVec3, LoadMocapError> {
        Ok(DVec3::new(self.number(expected)?, self.number(expected)?, self.number(expected)?))
    }

    /// The error that the word taken last is not what was expected.
    fn unexpected(&self, expected: &'static str) -> LoadMocapError {
        let (line, word) = self.words[self.next - 1];
        LoadMocapError::Unexpected { path: self.path.to_owned(), line, found: word.to_owned(), expected }
    }
}

/// What a channel of a motion file changes: place along an axis or rotation about it.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Channel {
    Move(DVec3),
    Turn(DVec3),
}

#[cfg(test)]
mod tests;
