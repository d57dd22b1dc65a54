//! `umbra train`: predictors of poses from masks.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context as _;
use clap::Args;
use clap::builder::RangedU64ValueParser;

use super::eval::data_folder;
use crate::predict::{Activity, MAX_POSE_DIM, PosePredictor};
use crate::progress::{Progress, note};
use crate::stage::Sequence;
use crate::train::validate::cross_validate;
use crate::train::{
    DescriptorKind, Recordings, TrainConfig, TrainingFrames, kept_latent, kept_predictor, notice_of,
    train_on_sequence,
};
use crate::whole_file::write_whole;

/// Reads a number in `range`.
fn count(range: RangeInclusive<u64>) -> RangedU64ValueParser<usize> {
    RangedU64ValueParser::new().range(range)
}

/// Arguments of `umbra train`.
#[derive(Debug, Args)]
pub struct TrainArgs {
    /// A stage-like data set [default: as UMBRA_DATA names it].
    #[arg(long, value_name = "FOLDER")]
    stage: Option<PathBuf>,
    /// Sequences of it, as `S1/Walking_1`. Without any, the models that the program ships are trained: priors over the poses
    /// of recorded people and of the training frames of the stage-like data set, latent poses, and predictors on masks rendered of
    /// them. Either way, models that are in the output folder already are kept, whatever their settings: an interrupted training
    /// goes on there. Those of other frames or another source are refused.
    #[arg(long, value_name = "SEQUENCE", num_args = 1..)]
    sequence: Vec<String>,
    /// The folder of recorded motion for those; without --stage, they learn from it alone [default: cmu of the data folder, and
    /// its stage].
    #[arg(long, value_name = "FOLDER", visible_alias = "cmu", conflicts_with = "sequence")]
    recordings: Option<PathBuf>,
    /// The camera whose masks are learned from.
    #[arg(long, default_value = "C2")]
    camera: String,
    /// Kind of masks: `observed` or `clean`.
    #[arg(long, default_value = "observed")]
    masks: String,
    /// What describes a mask.
    #[arg(long, value_enum, default_value = "crop")]
    descriptor: DescriptorKind,
    /// Where the models go, one file a sequence.
    #[arg(long, value_name = "FOLDER", default_value = "models")]
    out: PathBuf,
    /// Hold parts of the training frames out and print the errors there; writes no model.
    #[arg(long, requires = "sequence")]
    validate: bool,
    /// Coordinates of a pose.
    #[arg(long, value_name = "NUMBER", default_value_t = TrainConfig::default().pose_dim, value_parser = count(1..=MAX_POSE_DIM as u64))]
    pose_dim: usize,
    /// Views rendered of each pose, beside those that were filmed.
    #[arg(long, value_name = "NUMBER", default_value_t = TrainConfig::default().views_per_pose, value_parser = count(0..=1000))]
    views_per_pose: usize,
    /// Sectors of headings with experts of their own.
    #[arg(long, value_name = "NUMBER", default_value_t = TrainConfig::default().experts.n_views, value_parser = count(1..=64))]
    sectors: usize,
    /// Experts for each coordinate in each sector.
    #[arg(long, value_name = "NUMBER", default_value_t = TrainConfig::default().experts.experts_per_output, value_parser = count(1..=32))]
    experts: usize,
    /// Learn from mirror images, too: for poses that may be met from any side.
    #[arg(long)]
    mirror: bool,
    /// Seed of everything that is drawn.
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

impl TrainArgs {
    fn config(&self) -> TrainConfig {
        let mut config = TrainConfig {
            descriptor: self.descriptor,
            pose_dim: self.pose_dim,
            views_per_pose: self.views_per_pose,
            mirror: self.mirror,
            seed: self.seed,
            ..TrainConfig::default()
        };
        config.experts.n_views = self.sectors;
        config.experts.experts_per_output = self.experts;
        config
    }
}

/// Trains, or validates, one sequence after the other.
pub fn run(args: &TrainArgs) -> anyhow::Result<()> {
    if args.sequence.is_empty() {
        return train_shipped(args);
    }
    let stage = data_folder(args.stage.as_deref(), "stage")?;
    let config = args.config();
    for name in &args.sequence {
        let sequence = Sequence::read(&stage.join(name))?;
        let start = Instant::now();
        let frames = TrainingFrames::read(&sequence, &args.camera, &args.masks)?;
        if args.validate {
            let errors = cross_validate(&frames, &config)?;
            note(&format!(
                "{name}: mean {:.1} mm, mode {:.1}, best of five {:.1}, with the true heading {:.1}; heading {:.1} degrees; ln p {:.2}; {:.1} s",
                errors.mean_mm,
                errors.mode_mm,
                errors.best_mode_mm,
                errors.true_heading_mm,
                errors.heading_deg,
                errors.log_density,
                start.elapsed().as_secs_f64(),
            ));
            continue;
        }
        let path = args.out.join(sequence.model_file_name());
        if path.is_file() {
            kept_predictor(&path, &notice_of(&frames), config.descriptor)?;
            note(&there_already(&path));
        } else {
            let predictor = train_on_sequence(&frames, &config)?;
            predictor.write(&path)?;
            say(&path, &predictor, start);
        }
    }
    Ok(())
}

/// Every model that is not in the output folder yet.
fn train_shipped(args: &TrainArgs) -> anyhow::Result<()> {
    let (folder, stage) = match &args.recordings {
        Some(folder) => (folder.clone(), args.stage.clone()),
        None => (data_folder(None, "cmu")?, Some(data_folder(args.stage.as_deref(), "stage")?)),
    };
    let mut recordings = Recordings::read(&folder)?;
    if let Some(stage) = stage {
        recordings.add_stage(&Sequence::read_all(&stage)?, &args.camera)?;
    }
    let config = args.config().for_people_at_large();
    let path = |kind: &str, activity: Activity| args.out.join(format!("{kind}-{}.bin", activity.name()));
    for activity in Activity::ALL {
        let [latent, predictor] = ["latent", "predict"].map(|kind| path(kind, activity));
        if latent.is_file() {
            kept_latent(&latent, &recordings.notice())?;
        }
        if predictor.is_file() {
            kept_predictor(&predictor, &recordings.notice(), config.descriptor)?;
        }
    }
    let cannot_learn = || format!("{}: cannot be trained on", folder.display());
    let mut progress = Progress::start("models", 0, Some(Activity::ALL.len() as u64));
    for activity in Activity::ALL {
        let [prior, latent, predict] = ["prior", "latent", "predict"].map(|kind| path(kind, activity));
        if activity != Activity::Any {
            let learned = recordings.prior(activity).with_context(cannot_learn)?;
            write_whole(&prior, &learned.to_bytes())?;
        }
        let start = Instant::now();
        if latent.is_file() {
            progress.note(&there_already(&latent));
        } else {
            let learned = recordings.latent(activity, activity.n_latent()).with_context(cannot_learn)?;
            write_whole(&latent, &learned.to_bytes())?;
            note(&format!("{}: {:.1} s", latent.display(), start.elapsed().as_secs_f64()));
        }
        let start = Instant::now();
        if predict.is_file() {
            progress.note(&there_already(&predict));
        } else {
            let predictor = recordings.predictor(activity, &config).with_context(cannot_learn)?;
            predictor.write_small(&predict)?;
            say(&predict, &predictor, start);
        }
        progress.advance();
    }
    Ok(())
}

/// A model does not tell its settings, so that one that is kept may have been trained with others.
fn there_already(path: &Path) -> String {
    format!("{}: there already, and kept; remove it to train it anew", path.display())
}

fn say(path: &Path, predictor: &PosePredictor, start: Instant) {
    note(&format!(
        "{}: {} masks, {:.1} s",
        path.display(),
        predictor.training().n_masks,
        start.elapsed().as_secs_f64()
    ));
}
