//! `umbra demo`: the main job on the bundled silhouettes.

use std::path::{Path, PathBuf};

use anyhow::bail;
use clap::Args;

use super::track::{exec_config, report};
use crate::config::TrackConfig;
use crate::predict::Activity;
use crate::progress::note;
use crate::run_folder::Existing;
use crate::track::{CameraChoice, ClipInput, TrackJob, track_clip};

/// Arguments of `umbra demo`.
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// The run folder to write; replaced when it is there.
    #[arg(long, value_name = "FOLDER", default_value = "runs/demo")]
    out: PathBuf,
    /// Folder of the bundled clip, where it does not lie in the repository.
    #[arg(long, value_name = "FOLDER")]
    data: Option<PathBuf>,
    /// Worker threads; the results do not depend on them [default: one a core].
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
}

/// Runs the command.
pub fn run(args: &DemoArgs) -> anyhow::Result<()> {
    let data = bundled_clip(args.data.as_deref())?;
    note(&format!("tracking 100 silhouettes of a man who balances on one leg, from {}", data.display()));
    let job = TrackJob {
        input: ClipInput::Masks(data.join("masks")),
        camera: CameraChoice::File(data.join("camera.toml")),
        out: args.out.clone(),
        config: TrackConfig::default(),
        predictor: None,
        save_predictor: None,
        activity: Activity::Any,
        frames: None,
        fps: None,
        redact: false,
        existing: Existing::Replace,
    };
    let outcome = track_clip(&job, exec_config(args.threads)?)?;
    report(&job, &outcome);
    Ok(())
}

/// Where the bundled clip lies: as told, below the current folder, or in the repository that the program was built from.
fn bundled_clip(told: Option<&Path>) -> anyhow::Result<PathBuf> {
    if let Some(folder) = told {
        return Ok(folder.to_owned());
    }
    let beside_source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/balance");
    for folder in [PathBuf::from("fixtures/balance"), beside_source] {
        if folder.join("camera.toml").is_file() {
            return Ok(folder);
        }
    }
    bail!("fixtures/balance: not below the current folder; run from the repository or give --data FOLDER")
}
