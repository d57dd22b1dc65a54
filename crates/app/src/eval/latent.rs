//! `umbra eval latent`: how much of a pose latent coordinates keep, and how well they tell the next one.
//!
//! Models learn from the training people of a folder of recorded motion and are tried on its validation people, who took no
//! part; beside that, the first part of the training frames of each stage sequence teaches, and the last part tests.

use std::path::{Path, PathBuf};

use body::N_DOF;
use body::pose_prior::{PosePrior, PosePriorConfig};
use body::retarget::Motion;
use rayon::prelude::*;
use serde::Serialize;

use super::joint_error::mean;
use super::{markdown_row, write_json};
use crate::predict::{Activity, LatentPoses};
use crate::stage::Sequence;
use crate::train::{Recordings, TrainingFrames};

/// Most poses that a model is tried on.
const MOST_POSES: usize = 2_000;

/// What is kept of poses that a model was not learned from.
#[derive(Clone, Debug, Serialize)]
pub struct LatentRow {
    /// What the poses are of.
    pub name: String,
    /// Coordinates.
    pub dims: usize,
    /// Poses learned from, and
    pub trained_on: usize,
    /// poses tried.
    pub tested_on: usize,
    /// Mean absolute error of the joint angles that come back from the coordinates, degrees, and
    pub error_deg: f64,
    /// that of as many principal components.
    pub components_error_deg: f64,
    /// Root mean square of the error of the next frame's coordinates over that of taking them not to move.
    pub step_ratio: f64,
}

/// What `eval.json` holds.
#[derive(Clone, Debug, Serialize)]
pub struct LatentReport {
    /// The folder of recorded motion.
    pub recordings: PathBuf,
    /// One row a model.
    pub rows: Vec<LatentRow>,
}

/// Fits and tries models of so many coordinates, one after the other, or of as many as the shipped ones have where `dims` is
/// empty; writes `eval.json` to `out` and returns the report.
///
/// # Errors
/// When the data cannot be read, show too few poses, or the report cannot be written.
pub fn evaluate(
    recordings: &Path,
    stage: Option<&Path>,
    dims: &[usize],
    out: &Path,
) -> anyhow::Result<LatentReport> {
    let dims_of = |activity: Activity| match dims {
        [] => vec![activity.n_latent()],
        dims => dims.to_vec(),
    };
    let [train, validate] = ["train", "validate"].map(|split| Recordings::read_split(recordings, split));
    let (train, validate) = (train?, validate?);
    let mut rows = Vec::new();
    for activity in Activity::ALL {
        let tested: Vec<Motion> = validate.motions(activity).cloned().collect();
        if !tested.is_empty() {
            let motions: Vec<Motion> = train.motions(activity).cloned().collect();
            let prior = train.prior(activity)?;
            for n_dims in dims_of(activity) {
                let latent = train.latent(activity, n_dims)?;
                let name = format!("{}, other people", activity.name());
                rows.push(row(name, &motions, &tested, &latent, &prior));
            }
        }
    }
    for sequence in stage.map_or(Ok(Vec::new()), Sequence::read_all)? {
        let sequence = sequence.for_validation();
        let held_out = Sequence { train: sequence.test.clone(), ..sequence.clone() };
        let [train, test] = [&sequence, &held_out]
            .map(|sequence| TrainingFrames::read(sequence, &sequence.cameras[0], "observed"));
        let [train, test] = [train?.motion.motion, test?.motion.motion].map(|motion| vec![motion]);
        let prior = PosePrior::learn(&train, "", &PosePriorConfig { mirror: false, ..Default::default() })?;
        for n_dims in dims_of(Activity::Walk) {
            let latent = LatentPoses::fit(&train, n_dims, false, "")?;
            rows.push(row(format!("{}, later frames", sequence.title()), &train, &test, &latent, &prior));
        }
    }
    let report = LatentReport { recordings: recordings.to_owned(), rows };
    write_json(out, &report)?;
    Ok(report)
}

fn row(
    name: String,
    trained: &[Motion],
    tested: &[Motion],
    latent: &LatentPoses,
    prior: &PosePrior,
) -> LatentRow {
    let n_poses = |motions: &[Motion]| motions.iter().map(|motion| motion.poses.len()).sum::<usize>();
    let dims = latent.dim();
    let step = n_poses(tested).div_ceil(MOST_POSES);
    let pairs: Vec<[&[f64]; 2]> = tested
        .iter()
        .flat_map(|motion| motion.poses.windows(2))
        .step_by(step)
        .map(|pair| [0, 1].map(|i| pair[i].angles.as_slice()))
        .collect();
    let tried: Vec<[f64; 4]> = pairs.par_iter().map(|pair| try_pair(latent, prior, pair)).collect();
    let total = |figure: usize| tried.iter().map(|figures| figures[figure]).sum::<f64>();
    LatentRow {
        name,
        dims,
        trained_on: n_poses(trained),
        tested_on: tried.len(),
        error_deg: mean(tried.iter().map(|figures| figures[0])),
        components_error_deg: mean(tried.iter().map(|figures| figures[1])),
        step_ratio: (total(2) / total(3)).sqrt(),
    }
}

/// Errors of one pose, degrees, by latent coordinates and by components; squared errors of the coordinates one frame later, as
/// expected and as they were.
fn try_pair(latent: &LatentPoses, prior: &PosePrior, pair: &[&[f64]; 2]) -> [f64; 4] {
    let [from, to] = pair.map(|angles| latent.coordinates_in_motion(angles));
    let mut angles = vec![0.0; N_DOF];
    latent.angles_into(&latent.coordinates(pair[0]), &mut angles);
    let off_deg = |angles: &[f64]| mean(angles.iter().zip(pair[0]).map(|(a, b)| (a - b).abs().to_degrees()));
    let (mut step, mut variance) = (vec![0.0; from.len()], vec![0.0; from.len()]);
    latent.dynamics().step_into(&from, &mut step, &mut variance);
    let missed = (0..from.len()).map(|d| (from[d] + step[d] - to[d]).powi(2)).sum();
    let moved = from.iter().zip(&to).map(|(a, b)| (a - b).powi(2)).sum();
    let by_components = prior.reconstruct(&prior.project(pair[0], from.len()));
    [off_deg(&angles), off_deg(&by_components), missed, moved]
}

/// The report as a Markdown table.
pub fn table(report: &LatentReport) -> String {
    let mut text = String::from(
        "| poses of | coordinates | learned from | tried on | error ° | as many components ° | next frame, error over motion |\n\
         |---|---:|---:|---:|---:|---:|---:|\n",
    );
    for row in &report.rows {
        text += &markdown_row([
            row.name.clone(),
            row.dims.to_string(),
            row.trained_on.to_string(),
            row.tested_on.to_string(),
            format!("{:.2}", row.error_deg),
            format!("{:.2}", row.components_error_deg),
            format!("{:.2}", row.step_ratio),
        ]);
    }
    text
}
