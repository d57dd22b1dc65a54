//! Landmark files: tables with a name and three coordinates, and `.lnd` files of the CAESAR survey.

use std::path::{Path, PathBuf};

use glam::DVec3;

use super::meshes::LengthUnit;
use crate::register::ScanLandmark;

/// Why landmarks cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum LoadLandmarksError {
    /// No such file, or no permission.
    #[error("{path}: cannot read the file")]
    Read { path: PathBuf, source: std::io::Error },
    /// Not a table.
    #[error("{path}: cannot read the table")]
    Table { path: PathBuf, source: csv::Error },
    /// Columns that are not there.
    #[error("{path}: the columns are `{found}`, expected `name` and `x_m,y_m,z_m` (or _cm, _mm)")]
    Columns { path: PathBuf, found: String },
    /// A coordinate that is no number.
    #[error("{path}: line {line}, `{name}`: a coordinate is `{value}`, expected a finite number")]
    Coordinate { path: PathBuf, line: u64, name: String, value: String },
    /// Nothing in it.
    #[error("{path}: has no landmarks")]
    Empty { path: PathBuf },
}

/// Reads landmarks: a `.lnd` file, whose numbers are millimetres, or a table with the columns `name`, `x_m`, `y_m`, `z_m` (or the same in
/// `_cm` or `_mm`). Metres once read.
///
/// # Errors
/// [`LoadLandmarksError`] names file, line and value.
pub fn load_landmarks(path: &Path) -> Result<Vec<ScanLandmark>, LoadLandmarksError> {
    let bytes =
        std::fs::read(path).map_err(|source| LoadLandmarksError::Read { path: path.to_owned(), source })?;
    let is_survey = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("lnd"));
    let landmarks = if is_survey { read_survey(path, &bytes)? } else { read_table(path, &bytes)? };
    if landmarks.is_empty() {
        return Err(LoadLandmarksError::Empty { path: path.to_owned() });
    }
    Ok(landmarks)
}

/// Lines of a `.lnd` file: number, quality, vertex, radius, x, y, z, name; the name may hold blanks. Other lines are its header.
fn read_survey(path: &Path, bytes: &[u8]) -> Result<Vec<ScanLandmark>, LoadLandmarksError> {
    const BEFORE_NAME: usize = 7;
    let text = String::from_utf8_lossy(bytes);
    let mut landmarks = Vec::new();
    for (line, text) in (1..).zip(text.lines()) {
        let words: Vec<&str> = text.split_whitespace().collect();
        if words.len() <= BEFORE_NAME || words[0].parse::<u32>().is_err() {
            continue;
        }
        let name = words[BEFORE_NAME..].join(" ");
        let position = position(path, line, &name, [words[4], words[5], words[6]])?;
        landmarks.push(ScanLandmark { name, position: position * LengthUnit::Millimetre.metres() });
    }
    Ok(landmarks)
}

fn read_table(path: &Path, bytes: &[u8]) -> Result<Vec<ScanLandmark>, LoadLandmarksError> {
    let table = |source| LoadLandmarksError::Table { path: path.to_owned(), source };
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(bytes);
    let header = reader.headers().map_err(table)?.clone();
    let column = |name: String| header.iter().position(|known| known == name);
    let places = LengthUnit::ALL.into_iter().find_map(|unit| {
        let axis = |axis: &str| column(format!("{axis}_{}", unit.symbol()));
        Some((unit, [axis("x")?, axis("y")?, axis("z")?]))
    });
    let (Some(name_place), Some((unit, places))) = (column("name".into()), places) else {
        let found = header.iter().collect::<Vec<_>>().join(",");
        return Err(LoadLandmarksError::Columns { path: path.to_owned(), found });
    };
    let landmark = |row: Result<csv::StringRecord, csv::Error>| {
        let row = row.map_err(table)?;
        let line = row.position().map_or(0, csv::Position::line);
        let name = row[name_place].to_owned();
        let position = position(path, line, &name, places.map(|place| &row[place]))?;
        Ok(ScanLandmark { name, position: position * unit.metres() })
    };
    reader.records().map(landmark).collect()
}

fn position(path: &Path, line: u64, name: &str, words: [&str; 3]) -> Result<DVec3, LoadLandmarksError> {
    let mut coordinates = [0.0; 3];
    for (coordinate, word) in coordinates.iter_mut().zip(words) {
        let number = word.parse::<f64>().ok().filter(|x| x.is_finite());
        *coordinate = number.ok_or_else(|| LoadLandmarksError::Coordinate {
            path: path.to_owned(),
            line,
            name: name.to_owned(),
            value: word.to_owned(),
        })?;
    }
    Ok(DVec3::from_array(coordinates))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(name: &str, text: &str) -> Result<Vec<ScanLandmark>, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        let shown = folder.path().display().to_string() + "/";
        load_landmarks(&path).map_err(|error| error.to_string().replace(&shown, ""))
    }

    #[test]
    fn tables_and_survey_files_are_read() {
        let quoted = read("a.csv", "name,x_m,y_m,z_m\n\"Rt Axilla, Ant.\", 0.1 ,1.2,-0.3\n").unwrap();
        assert_eq!(quoted[0].name, "Rt Axilla, Ant.");
        assert_eq!(quoted[0].position, DVec3::new(0.1, 1.2, -0.3));
        let small = read("a.csv", "z_mm,name,x_mm,y_mm\n3,Sellion,1,2\n").unwrap();
        assert!(small[0].position.distance(DVec3::new(0.001, 0.002, 0.003)) < 1e-15);
        let survey = "SUBJECT_ID = s1\nSTD_LAND = 2\nAUX =\n 1 0 1 24.03 14.73 18.98 576.00 Sellion\n\
                      2 0 2 46.19 6.52 45.73 554.00 Rt. Infraorbitale\nEND =\n";
        let survey = read("a.LND", survey).unwrap();
        assert_eq!(survey.len(), 2);
        assert_eq!(survey[1].name, "Rt. Infraorbitale");
        assert!(survey[1].position.distance(DVec3::new(0.00652, 0.04573, 0.554)) < 1e-12);
    }

    #[test]
    fn bad_files_are_named() {
        let text = read("a.csv", "name,x,y,z\nSellion,1,2,3\n").unwrap_err();
        assert_eq!(
            text,
            "a.csv: the columns are `name,x,y,z`, expected `name` and `x_m,y_m,z_m` (or _cm, _mm)"
        );
        let text = read("a.csv", "name,x_m,y_m,z_m\nSellion,1,2,?\n").unwrap_err();
        assert_eq!(text, "a.csv: line 2, `Sellion`: a coordinate is `?`, expected a finite number");
        assert_eq!(read("a.lnd", "SUBJECT_ID = s1\n").unwrap_err(), "a.lnd: has no landmarks");
        assert_eq!(
            load_landmarks(Path::new("none.csv")).unwrap_err().to_string(),
            "none.csv: cannot read the file"
        );
    }
}
