//! Masks as text, `#` for the person and `.` for the background: for tests and for looking.

use std::fmt;
use std::str::FromStr;

use super::Mask;

/// What is wrong with the text of a mask.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ParseMaskError {
    /// A character that is neither `#` nor `.`.
    #[error("row {row}: column {column} is `{found}`, expected `#` or `.`")]
    Character {
        /// Row, from 0.
        row: usize,
        /// Column, from 0.
        column: usize,
        /// The character.
        found: char,
    },
    /// Rows of unequal length.
    #[error("row {row} has {found} columns, expected {expected} as in row 0")]
    RowLength {
        /// Row, from 0.
        row: usize,
        /// Its columns.
        found: usize,
        /// Columns of row 0.
        expected: usize,
    },
}

impl FromStr for Mask {
    type Err = ParseMaskError;

    /// Reads one row a line; blank lines and blanks around a row are skipped.
    fn from_str(text: &str) -> Result<Self, ParseMaskError> {
        let rows: Vec<&str> = text.lines().map(str::trim).filter(|row| !row.is_empty()).collect();
        let width = rows.first().map_or(0, |row| row.chars().count());
        let mut pixels = Vec::with_capacity(width * rows.len());
        for (row, line) in rows.iter().enumerate() {
            for (column, found) in line.chars().enumerate() {
                match found {
                    '#' => pixels.push(true),
                    '.' => pixels.push(false),
                    _ => return Err(ParseMaskError::Character { row, column, found }),
                }
            }
            let found = line.chars().count();
            if found != width {
                return Err(ParseMaskError::RowLength { row, found, expected: width });
            }
        }
        Ok(Self::from_bools(width as u32, rows.len() as u32, &pixels))
    }
}

impl fmt::Display for Mask {
    /// Writes one row a line, each ended by a line break.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for y in 0..self.height() {
            let row: String = (0..self.width()).map(|x| if self.get(x, y) { '#' } else { '.' }).collect();
            writeln!(f, "{row}")?;
        }
        Ok(())
    }
}
