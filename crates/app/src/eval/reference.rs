//! Reference joints of a real clip: `joints3d.csv` with the columns frame, joint, x_m, y_m, z_m.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use body::JointId;
use glam::DVec3;
use serde::Deserialize;

/// The joints on which a track is judged: in the reference's names and in ours.
pub const JUDGED: [(&str, JointId); 12] = [
    ("LShoulder", JointId::LEFT_SHOULDER),
    ("RShoulder", JointId::RIGHT_SHOULDER),
    ("LElbow", JointId::LEFT_ELBOW),
    ("RElbow", JointId::RIGHT_ELBOW),
    ("LWrist", JointId::LEFT_WRIST),
    ("RWrist", JointId::RIGHT_WRIST),
    ("LHip", JointId::LEFT_HIP),
    ("RHip", JointId::RIGHT_HIP),
    ("LKnee", JointId::LEFT_KNEE),
    ("RKnee", JointId::RIGHT_KNEE),
    ("LAnkle", JointId::LEFT_ANKLE),
    ("RAnkle", JointId::RIGHT_ANKLE),
];

/// Reference positions of the [`JUDGED`] joints on one frame, metres, world; none where a joint was not seen.
pub type ReferenceFrame = [Option<DVec3>; JUDGED.len()];

/// Why reference joints cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadReferenceError {
    /// The file cannot be read as a table.
    #[error("{path}: cannot read the table of joints")]
    Read {
        /// The file.
        path: PathBuf,
        /// What went wrong.
        source: csv::Error,
    },
    /// A joint has some coordinates but not all three, or one that is not finite.
    #[error("{path}: line {line}: `x_m, y_m, z_m` of {joint} are not three finite numbers, nor all empty")]
    Position {
        /// The file.
        path: PathBuf,
        /// Line of the file, from 1.
        line: u64,
        /// Joint of that line.
        joint: String,
    },
    /// Nothing in the file can be compared.
    #[error(
        "{path}: no position of a shoulder, elbow, wrist, hip, knee or ankle, expected at least one frame of them"
    )]
    Empty {
        /// The file.
        path: PathBuf,
    },
}

#[derive(Deserialize)]
struct Row {
    frame: usize,
    joint: String,
    x_m: Option<f64>,
    y_m: Option<f64>,
    z_m: Option<f64>,
}

/// Reads the reference joints by frame; joints that are not judged are left out.
///
/// # Errors
/// See [`ReadReferenceError`].
pub fn read_reference(path: &Path) -> Result<BTreeMap<usize, ReferenceFrame>, ReadReferenceError> {
    let failed = |source| ReadReferenceError::Read { path: path.to_owned(), source };
    let mut reader = csv::Reader::from_path(path).map_err(failed)?;
    let mut frames = BTreeMap::<usize, ReferenceFrame>::new();
    for (index, row) in reader.deserialize().enumerate() {
        let row: Row = row.map_err(failed)?;
        let Some(slot) = JUDGED.iter().position(|(name, _)| *name == row.joint) else { continue };
        frames.entry(row.frame).or_default()[slot] = match (row.x_m, row.y_m, row.z_m) {
            (None, None, None) => None,
            (Some(x), Some(y), Some(z)) if x.is_finite() && y.is_finite() && z.is_finite() => {
                Some(DVec3::new(x, y, z))
            }
            _ => {
                let line = index as u64 + 2;
                return Err(ReadReferenceError::Position { path: path.to_owned(), line, joint: row.joint });
            }
        };
    }
    if frames.values().flatten().flatten().next().is_none() {
        return Err(ReadReferenceError::Empty { path: path.to_owned() });
    }
    Ok(frames)
}

/// The position of `joint` on a frame, if it was seen.
pub fn position(frame: &ReferenceFrame, joint: JointId) -> Option<DVec3> {
    JUDGED.iter().position(|(_, ours)| *ours == joint).and_then(|slot| frame[slot])
}

/// Midpoint of the hips, the root of the comparison; none when a hip was not seen.
pub fn root(frame: &ReferenceFrame) -> Option<DVec3> {
    Some(position(frame, JointId::LEFT_HIP)?.midpoint(position(frame, JointId::RIGHT_HIP)?))
}

/// Heading of the person, radians anticlockwise from world +x: square to the line of the hips in the floor plane.
pub fn heading_rad(frame: &ReferenceFrame) -> Option<f64> {
    let to_left = position(frame, JointId::LEFT_HIP)? - position(frame, JointId::RIGHT_HIP)?;
    let facing = to_left.cross(DVec3::Z);
    Some(facing.y.atan2(facing.x))
}
