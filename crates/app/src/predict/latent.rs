//! Few coordinates for the poses of an activity, and how they go on.

use anyhow::{Context as _, ensure};
use bme::file::{LatentFile, ModelFileError};
use bme::{Inputs, LatentConfig, LatentParams, MixtureDensity, RvmConfig, SpectralLatentModel};
use body::N_DOF;
use body::container::{self, ContainerError};
use body::retarget::Motion;
use pf_core::scratch::with_buffer;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::dynamics::{DynamicsFile, LatentDynamics};

const MAGIC: &str = "UMBRALAT";
/// Version of the file that this build reads and writes.
const VERSION: u32 = 2;

/// Settings that make small models: a pose has many angles, and each has bases of its own.
fn config(n_dims: usize) -> LatentConfig {
    let default = LatentConfig::default();
    let rvm = RvmConfig { min_gain: 0.2, min_gain_of_addition: 1.0, max_bases: 16, ..default.rvm };
    LatentConfig { n_dims, max_landmarks: 500, rvm, ..default }
}

/// A spectral latent variable model over joint angles, with dynamics of its coordinates: the x of `[Kanaujia2014]`.
#[derive(Clone, Debug)]
pub struct LatentPoses {
    notice: String,
    frame_rate_hz: f64,
    model: SpectralLatentModel,
    dynamics: LatentDynamics,
    /// Least and largest value of each coordinate in the training.
    range: Vec<[f64; 2]>,
    /// Root mean square of each coordinate's step to the next frame.
    step_sd: Vec<f64>,
}

impl LatentPoses {
    /// Learns `n_dims` coordinates from `motions` of one frame rate and, where `mirror` says so, their mirror images. `notice`
    /// says whose they are.
    ///
    /// # Errors
    /// When there are too few poses, or none that differ, or frame rates do.
    pub fn fit(motions: &[Motion], n_dims: usize, mirror: bool, notice: &str) -> anyhow::Result<Self> {
        let frame_rate_hz = motions.first().context("no motion to learn poses from")?.frame_rate_hz;
        for Motion { name, frame_rate_hz: found, .. } in motions {
            ensure!(
                *found == frame_rate_hz,
                "{name}: has {found} frames a second, expected {frame_rate_hz} as in the first motion"
            );
        }
        let mirrored = motions.iter().filter(|_| mirror).map(Motion::mirrored);
        let seen: Vec<Motion> = motions.iter().cloned().chain(mirrored).collect();
        let angles =
            seen.iter().flat_map(|motion| &motion.poses).flat_map(|pose| pose.angles.iter().copied());
        let outputs = Inputs::from_rows(N_DOF, angles).context("joint angles of the training")?;
        let params = LatentParams::new(config(n_dims)).context("settings of the latent poses")?;
        let model = SpectralLatentModel::fit(&outputs, &params).context("latent poses cannot be learned")?;
        let clips: Vec<Vec<Vec<f64>>> = seen
            .par_iter()
            .map(|motion| motion.poses.iter().map(|pose| model.encode(&pose.angles).mean).collect())
            .collect();
        let dynamics = LatentDynamics::fit(&clips).context("how poses go on cannot be learned")?;
        let over = |coordinate: usize, pick: fn(f64, f64) -> f64, start: f64| {
            clips.iter().flatten().map(|point| point[coordinate]).fold(start, pick)
        };
        let range = (0..n_dims)
            .map(|d| [over(d, f64::min, f64::INFINITY), over(d, f64::max, f64::NEG_INFINITY)])
            .collect();
        let step_sd = (0..n_dims)
            .map(|d| {
                let steps = clips.iter().flat_map(|clip| clip.windows(2)).map(|pair| pair[1][d] - pair[0][d]);
                let (sum, n) = steps.fold((0.0, 0.0), |(sum, n), step| (sum + step * step, n + 1.0));
                (sum / n).sqrt()
            })
            .collect();
        Ok(Self { notice: notice.to_owned(), frame_rate_hz, model, dynamics, range, step_sd })
    }

    /// Source and terms of the recordings it was learned from.
    pub fn notice(&self) -> &str {
        &self.notice
    }

    /// Number of coordinates.
    pub fn dim(&self) -> usize {
        self.model.latent_dim()
    }

    /// The joint angles, `[n_dof]`, radians, at coordinates `[dim]`; limits are not applied.
    pub fn angles_into(&self, coordinates: &[f64], angles: &mut [f64]) {
        let decoder = self.model.decoder();
        with_buffer(decoder.n_features(), |room| decoder.mean_into(coordinates, room, angles));
    }

    /// The coordinates whose joint angles come nearest to `angles`, `[n_dof]`.
    pub fn coordinates(&self, angles: &[f64]) -> Vec<f64> {
        self.model.nearest(angles)
    }

    /// The coordinates that most likely lie behind joint angles, `[n_dof]`, of a motion whose steps [`Self::dynamics`] know.
    pub fn coordinates_in_motion(&self, angles: &[f64]) -> Vec<f64> {
        self.model.encode(angles).mean
    }

    /// p(coordinates).
    pub fn prior(&self) -> &MixtureDensity {
        self.model.prior()
    }

    /// Least and largest value of each coordinate in the training.
    pub fn range(&self) -> &[[f64; 2]] {
        &self.range
    }

    /// Root mean square of each coordinate's step from one frame to the next, and
    pub fn step_sd(&self) -> &[f64] {
        &self.step_sd
    }

    /// how they go on, at
    pub fn dynamics(&self) -> &LatentDynamics {
        &self.dynamics
    }

    /// so many frames a second.
    pub fn frame_rate_hz(&self) -> f64 {
        self.frame_rate_hz
    }

    /// The file of this model.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut model = LatentFile::from(&self.model);
        model.shrink();
        let file = LatentPosesFile {
            notice: self.notice.clone(),
            frame_rate_hz: self.frame_rate_hz,
            model,
            dynamics: (&self.dynamics).into(),
            range: self.range.clone(),
            step_sd: self.step_sd.clone(),
        };
        let data = postcard::to_stdvec(&file).expect("plain numbers and strings always encode");
        container::seal(MAGIC, VERSION, &data)
    }

    /// Reads what [`Self::to_bytes`] wrote.
    ///
    /// # Errors
    /// [`LoadLatentError`] says what is wrong; the caller knows the path.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, LoadLatentError> {
        let data = container::open(MAGIC, VERSION, bytes)?;
        let file: LatentPosesFile = postcard::from_bytes(data).map_err(LoadLatentError::Decode)?;
        let model = SpectralLatentModel::try_from(file.model).map_err(LoadLatentError::Model)?;
        let dynamics = LatentDynamics::try_from(file.dynamics).map_err(LoadLatentError::Model)?;
        let dim = model.latent_dim();
        let found = [model.output_dim(), dynamics.dim(), file.range.len(), file.step_sd.len()];
        let expected = [N_DOF, dim, dim, dim];
        if found != expected {
            return Err(LoadLatentError::Parts { found, expected });
        }
        if !(file.frame_rate_hz > 0.0 && file.step_sd.iter().all(|sd| *sd > 0.0 && sd.is_finite())) {
            return Err(LoadLatentError::Steps);
        }
        let LatentPosesFile { notice, frame_rate_hz, range, step_sd, .. } = file;
        Ok(Self { notice, frame_rate_hz, model, dynamics, range, step_sd })
    }
}

#[derive(Serialize, Deserialize)]
struct LatentPosesFile {
    notice: String,
    frame_rate_hz: f64,
    model: LatentFile,
    dynamics: DynamicsFile,
    range: Vec<[f64; 2]>,
    step_sd: Vec<f64>,
}

/// Why bytes are no latent poses.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LoadLatentError {
    /// Another kind or version of file, cut short, or damaged.
    #[error(transparent)]
    Container(#[from] ContainerError),
    /// The checksum fits but the data do not decode.
    #[error("cannot decode the data")]
    Decode(#[source] postcard::Error),
    /// Maps that cannot be.
    #[error("`model` or `dynamics` cannot be used")]
    Model(#[source] ModelFileError),
    /// Parts of different models.
    #[error("angles, dynamics, `range` and `step_sd` are {found:?} long, expected {expected:?}")]
    Parts {
        /// Lengths found.
        found: [usize; 4],
        /// Lengths of one model.
        expected: [usize; 4],
    },
    /// Rates or steps that cannot be.
    #[error("`frame_rate_hz` and `step_sd` have to be above 0")]
    Steps,
}

#[cfg(test)]
mod tests {
    use super::*;
    use body::{Pose, Skeleton};
    use glam::DVec3;

    /// A gait of two harmonics, 90 frames a second or so.
    fn gait(n: usize) -> Motion {
        let pose = |frame: usize| {
            let phase = 0.15 * frame as f64;
            let mut pose = Pose::upright(DVec3::Z, 0.0);
            for (d, (angle, dof)) in pose.angles.iter_mut().zip(Skeleton::human().dofs()).enumerate() {
                let d = d as f64;
                let [low, high] = dof.limits_rad;
                let swing = 0.2 * (phase + d).sin() + 0.05 * (2.0 * phase + d * d).cos();
                *angle = 0.5 * (low + high) + (high - low) * swing;
            }
            pose
        };
        Motion { name: "gait".to_owned(), frame_rate_hz: 60.0, poses: (0..n).map(pose).collect() }
    }

    #[test]
    fn poses_and_steps_of_a_gait_come_back_from_a_file() {
        let motion = gait(200);
        let latent = LatentPoses::fit(std::slice::from_ref(&motion), 3, false, "a gait").unwrap();
        let latent = LatentPoses::from_bytes(&latent.to_bytes()).unwrap();
        assert_eq!((latent.dim(), latent.notice()), (3, "a gait"));
        let (mut step, mut variance) = ([0.0; 3], [0.0; 3]);
        for pair in motion.poses.windows(2) {
            let [from, to] = [&pair[0], &pair[1]].map(|pose| latent.coordinates(&pose.angles));
            let mut angles = vec![0.0; N_DOF];
            latent.angles_into(&from, &mut angles);
            let off: f64 =
                angles.iter().zip(&pair[0].angles).map(|(a, b)| (a - b).abs()).sum::<f64>() / N_DOF as f64;
            assert!(off < 0.03, "{off} rad");
            latent.dynamics().step_into(&from, &mut step, &mut variance);
            let sizes: f64 = from.iter().zip(&to).map(|(a, b)| (a - b).powi(2)).sum();
            let missed: f64 = (0..3).map(|d| (from[d] + step[d] - to[d]).powi(2)).sum();
            assert!(missed < 0.1 * sizes, "steps of {sizes} missed by {missed}");
        }
    }

    #[test]
    fn what_is_no_model_is_refused() {
        assert!(LatentPoses::fit(&[], 3, false, "").is_err());
        let motion = gait(60);
        let slower = Motion { name: "slow".to_owned(), frame_rate_hz: 30.0, ..motion.clone() };
        let error = LatentPoses::fit(&[motion.clone(), slower], 3, false, "").unwrap_err().to_string();
        assert_eq!(error, "slow: has 30 frames a second, expected 60 as in the first motion");
        let bytes = LatentPoses::fit(&[motion], 2, false, "").unwrap().to_bytes();
        assert!(LatentPoses::from_bytes(&bytes[..bytes.len() - 9]).is_err());
    }
}
