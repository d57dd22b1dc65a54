//! A finished run, read back: where its masks come from, its camera, and the poses of its frames.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use body::{Camera, Intrinsics, N_DOF, Pose};
use glam::{DMat3, DQuat, DVec3};

use super::run_file::{CameraFile, RunFile};
use super::{POSES, RUN_FILE, Status};
use crate::predict::Activity;
use crate::track::{Background, ClipInput};

/// What a later step needs of a run.
#[derive(Clone, Debug)]
pub struct FinishedRun {
    /// Where its masks come from.
    pub input: ClipInput,
    /// The camera, at full resolution.
    pub camera: Camera,
    /// Frames a second.
    pub fps: f64,
    /// What the person was said to do.
    pub activity: Activity,
    /// Number, status and pose of each frame.
    pub frames: Vec<(u64, Status, Pose)>,
}

impl FinishedRun {
    /// Reads `run.toml` and `poses.csv`.
    ///
    /// # Errors
    /// When the folder holds no finished run; the message names the file.
    pub fn read(folder: &Path) -> anyhow::Result<Self> {
        let name = folder.display();
        if !folder.join(RUN_FILE).is_file() {
            bail!("{name}: holds no {RUN_FILE}, expected a run folder");
        }
        let run = RunFile::read(&folder.join(RUN_FILE))?;
        if !folder.join(POSES).is_file() {
            bail!("{name}: holds no {POSES}, expected a finished run: track again with --resume");
        }
        Ok(Self {
            input: input(&run).with_context(|| format!("{name}: cannot tell where the masks come from"))?,
            camera: camera(&run.camera).with_context(|| format!("{name}: `camera` of {RUN_FILE}"))?,
            fps: run.fps,
            activity: run
                .settings
                .get("activity")
                .and_then(toml::Value::as_str)
                .map_or(Activity::Any, Activity::called),
            frames: read_poses(&folder.join(POSES))?,
        })
    }
}

fn input(run: &RunFile) -> anyhow::Result<ClipInput> {
    let path = |role: &str| -> Option<PathBuf> {
        run.inputs.iter().find(|input| input.role == role).map(|input| PathBuf::from(&input.path))
    };
    if let Some(masks) = path("masks") {
        return Ok(ClipInput::Masks(masks));
    }
    let video = path("video").context("`inputs` has neither `masks` nor `video`")?;
    let learned = run.settings.get("learned_background").and_then(toml::Value::as_str);
    let background = match (path("background"), learned) {
        (Some(plate), _) => Background::Plate(plate),
        (None, Some("mixture")) => Background::Mixture,
        (None, _) => Background::Median,
    };
    Ok(ClipInput::Frames(video, background))
}

fn camera(file: &CameraFile) -> anyhow::Result<Camera> {
    let intrinsics = Intrinsics {
        width: file.width,
        height: file.height,
        focal_px: file.focal_px,
        principal_point_px: file.principal_point_px,
        distortion: file.distortion,
    };
    let rotation = DMat3::from_cols_array_2d(&file.rotation).transpose();
    Ok(Camera::new(intrinsics, rotation, DVec3::from_array(file.translation_m))?)
}

fn read_poses(path: &Path) -> anyhow::Result<Vec<(u64, Status, Pose)>> {
    const FIRST_NUMBER: usize = 3;
    let name = path.display();
    let mut reader =
        csv::Reader::from_path(path).with_context(|| format!("{name}: cannot read the table"))?;
    let mut frames = Vec::new();
    for row in reader.records() {
        let row = row.with_context(|| format!("{name}: cannot read the table"))?;
        let cell = |index: usize| row.get(index).unwrap_or_default();
        let frame = cell(0);
        let index: u64 =
            frame.parse().with_context(|| format!("{name}: `frame` is `{frame}`, expected a number"))?;
        let status = [Status::Tracked, Status::Coasting, Status::Lost];
        let status = status.into_iter().find(|status| status.name() == cell(2)).with_context(|| {
            format!("{name}: frame {index}, `status` is `{}`, expected tracked, coasting or lost", cell(2))
        })?;
        let mut numbers = [0.0; 7 + N_DOF];
        for (place, number) in numbers.iter_mut().enumerate() {
            let text = cell(FIRST_NUMBER + place);
            *number = text
                .parse()
                .with_context(|| format!("{name}: frame {index}, found `{text}`, expected a number"))?;
        }
        let [x, y, z, qw, qx, qy, qz, ..] = numbers;
        let pose = Pose {
            root_position: DVec3::new(x, y, z),
            root_orientation: DQuat::from_xyzw(qx, qy, qz, qw).normalize(),
            angles: numbers[7..].to_vec(),
        };
        frames.push((index, status, pose));
    }
    Ok(frames)
}
