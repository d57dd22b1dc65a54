//! `umbra eval`: accuracy against reference data.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::bail;
use clap::{Args, Subcommand};

use super::track::{SettingsArgs, exec_config, parse_frames};
use crate::config::Method;
use crate::eval::{biosig, girths, latent, real, register, shape, shape_space, stage, stage_masks};
use crate::predict::Activity;
use crate::shape::ShapeMethod;
use crate::train::DescriptorKind;

/// What is evaluated.
#[derive(Debug, Subcommand)]
pub enum EvalCommand {
    /// A real clip against its reference joints.
    Real(RealArgs),
    /// Stature, weight and gender from known shapes and girths.
    Biosig(BiosigArgs),
    /// The measuring code on bodies whose girths are known.
    Girths(GirthsArgs),
    /// Registration of the template to scans whose true surface is known.
    Register(RegisterArgs),
    /// Shape spaces from registered scans and from known correspondences, side by side.
    ShapeSpace(ShapeSpaceArgs),
    /// What few latent coordinates keep of poses, and how well they tell the next one.
    Latent(LatentArgs),
    /// Trackers on a stage-like data set, against true joints.
    Stage(StageArgs),
    /// Bodies of people who trained nothing, from synthetic walks.
    Shape(ShapeArgs),
    /// Masks cut from rendered colour clips against the clean ones.
    StageMasks(StageMasksArgs),
}

/// Arguments of `umbra eval real`.
#[derive(Debug, Args)]
pub struct RealArgs {
    /// Folder with video.mp4 and background.png (or masks/), camera.toml and joints3d.csv [default: real/balance of the data folder].
    #[arg(long, value_name = "FOLDER")]
    data: Option<PathBuf>,
    /// Some frames only: the first, counted from 0, and the one after the last.
    #[arg(long, value_name = "A..B", value_parser = parse_frames)]
    frames: Option<std::ops::Range<u64>>,
    /// Number of seeds: 1, 2, and so on.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..))]
    seeds: u64,
    /// Where eval.json and the run folders go.
    #[arg(long, value_name = "FOLDER", default_value = "runs/eval-real")]
    out: PathBuf,
    /// Worker threads; the results do not depend on them [default: one a core].
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    #[command(flatten)]
    settings: SettingsArgs,
}

/// Arguments of `umbra eval stage`.
#[derive(Debug, Args)]
pub struct StageArgs {
    /// A stage-like data set [default: stage of the data folder].
    #[arg(long, value_name = "FOLDER")]
    data: Option<PathBuf>,
    /// Subjects, separated by commas [default: all].
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    subjects: Vec<String>,
    /// Activities, separated by commas [default: all].
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    activities: Vec<String>,
    /// Kinds of masks, separated by commas.
    #[arg(long, value_name = "KINDS", value_delimiter = ',', default_value = "observed")]
    masks: Vec<String>,
    /// Trackers, separated by commas; opf is left out where the sequence itself trains nothing.
    #[arg(long, value_name = "NAMES", value_enum, value_delimiter = ',', default_value = "apf,opf,jpf,jlm")]
    methods: Vec<Method>,
    /// What the trackers learn from.
    #[arg(long, value_enum, default_value_t = stage::TrainOn::Sequence)]
    train: stage::TrainOn,
    /// The folder of recorded motion that `others` learns from [default: cmu of the data folder].
    #[arg(long, value_name = "FOLDER")]
    recordings: Option<PathBuf>,
    /// Test on the last of the training frames and train on those before them: for tuning.
    #[arg(long)]
    validate: bool,
    /// What describes a mask to predictors that are trained [default: crop; histogram under the preset of the paper].
    #[arg(long, value_enum)]
    descriptor: Option<DescriptorKind>,
    /// Keep the predictors that are trained in this folder, and use those that are there.
    #[arg(long, value_name = "FOLDER")]
    models: Option<PathBuf>,
    /// Number of seeds: 1, 2, and so on.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..))]
    seeds: u64,
    /// Also replace the pose by a wrong one in the middle of each track, and count how often the tracker finds back.
    #[arg(long)]
    recovery: bool,
    /// Also let predictors learn from 1, 4 and 10 particles of each frame, and measure how far their predictions are off.
    #[arg(long)]
    updates: bool,
    /// So many of the test frames only.
    #[arg(long, value_name = "N")]
    frames: Option<usize>,
    /// A Markdown file whose tables of such results are replaced, each between its two marker lines.
    #[arg(long, value_name = "FILE")]
    results: Option<PathBuf>,
    /// Of the tables of this run only these go there, separated by commas: kinds of masks, recovery, updates [default: all].
    #[arg(long, value_name = "NAMES", value_delimiter = ',', requires = "results")]
    tables: Vec<String>,
    /// Where eval.json and the plots go.
    #[arg(long, value_name = "FOLDER", default_value = "runs/eval-stage")]
    out: PathBuf,
    /// Worker threads; the results do not depend on them [default: one a core].
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    #[command(flatten)]
    settings: SettingsArgs,
}

/// Arguments of `umbra eval latent`.
#[derive(Debug, Args)]
pub struct LatentArgs {
    /// A folder of recorded motion [default: cmu of the data folder, and its stage].
    #[arg(long, value_name = "FOLDER")]
    recordings: Option<PathBuf>,
    /// A stage-like data set.
    #[arg(long, value_name = "FOLDER")]
    stage: Option<PathBuf>,
    /// Coordinates of the models, one count after the other, separated by commas [default: as many as the shipped ones have].
    #[arg(long, value_name = "COUNTS", value_delimiter = ',', value_parser = clap::value_parser!(u64).range(1..=30))]
    dims: Vec<u64>,
    /// Where eval.json goes.
    #[arg(long, value_name = "FOLDER", default_value = "runs/eval-latent")]
    out: PathBuf,
    /// Worker threads; the results do not depend on them [default: one a core].
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
}

/// Arguments of `umbra eval shape`.
#[derive(Debug, Args)]
pub struct ShapeArgs {
    /// A folder of bodies [default: bodies of the data folder, of which only those that trained nothing count].
    #[arg(long, value_name = "FOLDER")]
    bodies: Option<PathBuf>,
    /// Number of people.
    #[arg(long, value_name = "N", default_value_t = 100)]
    people: usize,
    /// Training people instead, who walk as everybody does: for tuning.
    #[arg(long)]
    training: bool,
    /// What the program is told that they do.
    #[arg(long, value_enum, default_value_t = Activity::Walk)]
    activity: Activity,
    /// How shapes are found.
    #[arg(long, value_enum, default_value_t)]
    search: ShapeMethod,
    /// Where eval.json goes.
    #[arg(long, value_name = "FOLDER", default_value = "runs/eval-shape")]
    out: PathBuf,
    /// Worker threads; the results do not depend on them [default: one a core].
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
}

/// Arguments of `umbra eval stage-masks`.
#[derive(Debug, Args)]
pub struct StageMasksArgs {
    /// A stage-like data set, or one sequence of it [default: stage of the data folder].
    #[arg(long, value_name = "FOLDER")]
    data: Option<PathBuf>,
    /// Where eval.json goes.
    #[arg(long, value_name = "FOLDER", default_value = "runs/eval-stage-masks")]
    out: PathBuf,
}

/// Arguments of `umbra eval biosig`.
#[derive(Debug, Args)]
pub struct BiosigArgs {
    /// The data folder, with `bodies` and `ansur` [default: as UMBRA_DATA names it].
    #[arg(long, value_name = "FOLDER")]
    data: Option<PathBuf>,
    /// Where eval.json goes.
    #[arg(long, value_name = "FOLDER", default_value = "runs/eval-biosig")]
    out: PathBuf,
}

/// Arguments of `umbra eval girths`.
#[derive(Debug, Args)]
pub struct GirthsArgs {
    /// A population of bodies with truth.csv [default: bodies of the data folder].
    #[arg(long, value_name = "FOLDER")]
    bodies: Option<PathBuf>,
    /// So many of the bodies are measured without their labels, too.
    #[arg(long, value_name = "N", default_value_t = 60)]
    unlabelled: usize,
    /// Where eval.json goes.
    #[arg(long, value_name = "FOLDER", default_value = "runs/eval-girths")]
    out: PathBuf,
}

/// Arguments of `umbra eval register`.
#[derive(Debug, Args)]
pub struct RegisterArgs {
    /// Scans with landmarks and true vertices [default: scans of the data folder].
    #[arg(long, value_name = "FOLDER")]
    scans: Option<PathBuf>,
    /// The population whose mesh the true vertices are on [default: bodies of the data folder].
    #[arg(long, value_name = "FOLDER")]
    bodies: Option<PathBuf>,
    /// Register without the landmarks.
    #[arg(long)]
    without_landmarks: bool,
    /// Where eval.json goes.
    #[arg(long, value_name = "FOLDER", default_value = "runs/eval-register")]
    out: PathBuf,
}

/// Arguments of `umbra eval shape-space`.
#[derive(Debug, Args)]
pub struct ShapeSpaceArgs {
    /// Scans with landmarks [default: scans of the data folder].
    #[arg(long, value_name = "FOLDER")]
    scans: Option<PathBuf>,
    /// The population that their bodies are of [default: bodies of the data folder].
    #[arg(long, value_name = "FOLDER")]
    bodies: Option<PathBuf>,
    /// Where eval.json goes.
    #[arg(long, value_name = "FOLDER", default_value = "runs/eval-shape-space")]
    out: PathBuf,
}

/// Runs the command and prints its table.
pub fn run(command: &EvalCommand) -> anyhow::Result<()> {
    let table = match command {
        EvalCommand::Real(args) => {
            let report = real::evaluate(&real::RealEval {
                data: data_folder(args.data.as_deref(), "real/balance")?,
                frames: args.frames.clone(),
                seeds: args.seeds,
                out: args.out.clone(),
                config: args.settings.config()?,
                exec: exec_config(args.threads)?,
            })?;
            real::table(&report)
        }
        EvalCommand::Biosig(args) => {
            let data = data_folder(args.data.as_deref(), "")?;
            biosig::table(&biosig::evaluate(&biosig::BiosigEval { data, out: args.out.clone() })?)
        }
        EvalCommand::Girths(args) => {
            let report = girths::evaluate(&girths::GirthsEval {
                bodies: data_folder(args.bodies.as_deref(), "bodies")?,
                out: args.out.clone(),
                n_unlabelled: args.unlabelled,
            })?;
            girths::table(&report)
        }
        EvalCommand::Register(args) => {
            let report = register::evaluate(&register::RegisterEval {
                scans: data_folder(args.scans.as_deref(), "scans")?,
                bodies: data_folder(args.bodies.as_deref(), "bodies")?,
                out: args.out.clone(),
                without_landmarks: args.without_landmarks,
            })?;
            register::table(&report)
        }
        EvalCommand::ShapeSpace(args) => {
            let report = shape_space::evaluate(&shape_space::ShapeSpaceEval {
                scans: data_folder(args.scans.as_deref(), "scans")?,
                bodies: data_folder(args.bodies.as_deref(), "bodies")?,
                out: args.out.clone(),
            })?;
            shape_space::table(&report)
        }
        EvalCommand::Stage(args) => {
            if args.settings.names_a_method() {
                bail!("`--method` names the tracker of one run, expected `--methods`");
            }
            let report = stage::evaluate(&stage::StageEval {
                data: data_folder(args.data.as_deref(), "stage")?,
                subjects: args.subjects.clone(),
                activities: args.activities.clone(),
                masks: args.masks.clone(),
                methods: args.methods.clone(),
                train: args.train,
                descriptor: args.descriptor.unwrap_or(args.settings.descriptor()),
                validate: args.validate,
                recordings: match (args.train, &args.recordings) {
                    (stage::TrainOn::Others, None) => Some(data_folder(None, "cmu")?),
                    (_, given) => given.clone(),
                },
                models: args.models.clone(),
                seeds: args.seeds,
                recovery: args.recovery,
                updates: args.updates,
                frames: args.frames,
                out: args.out.clone(),
                results: args.results.clone().map(|path| stage::ResultsFile {
                    path,
                    command: own_command(),
                    tables: args.tables.clone(),
                }),
                config: args.settings.config_over(stage::default_config(args.train))?,
                exec: exec_config(args.threads)?,
            })?;
            stage::table(&report)
        }
        EvalCommand::Latent(args) => {
            let recordings = data_folder(args.recordings.as_deref(), "cmu")?;
            let stage = match (&args.recordings, &args.stage) {
                (Some(_), stage) => stage.clone(),
                (None, stage) => Some(data_folder(stage.as_deref(), "stage")?),
            };
            let exec = exec_config(args.threads)?;
            let dims: Vec<usize> = args.dims.iter().map(|&count| count as usize).collect();
            let evaluate = || latent::evaluate(&recordings, stage.as_deref(), &dims, &args.out);
            latent::table(&in_pool(exec, evaluate)?)
        }
        EvalCommand::Shape(args) => {
            let eval = shape::ShapeEval {
                population: data_folder(None, "bodies")?,
                bodies: args.bodies.clone(),
                stage: data_folder(None, "stage").ok(),
                motions: data_folder(None, "cmu")?,
                on_training: args.training,
                activity: args.activity,
                method: args.search,
                people: args.people,
                out: args.out.clone(),
            };
            shape::table(&in_pool(exec_config(args.threads)?, || shape::evaluate(&eval))?)
        }
        EvalCommand::StageMasks(args) => {
            let data = data_folder(args.data.as_deref(), "stage")?;
            stage_masks_table(&stage_masks::evaluate(&data, &args.out)?)
        }
    };
    std::io::stdout().write_all(table.as_bytes())?;
    Ok(())
}

/// The command as it was given, for those who have the sources.
fn own_command() -> String {
    let words = std::env::args().skip(1).map(|word| {
        let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./,=".contains(c);
        if word.chars().all(is_plain) { word } else { format!("'{word}'") }
    });
    ["cargo".to_owned(), "xtask".to_owned()].into_iter().chain(words).collect::<Vec<_>>().join(" ")
}

/// Runs `work` on so many threads.
pub fn in_pool<T: Send>(
    exec: crate::config::ExecConfig,
    work: impl FnOnce() -> anyhow::Result<T> + Send,
) -> anyhow::Result<T> {
    rayon::ThreadPoolBuilder::new().num_threads(exec.threads).build()?.install(work)
}

/// The folder asked for, else `inside` the data folder that `UMBRA_DATA` names or that lies beside the repository.
pub fn data_folder(asked: Option<&Path>, inside: &str) -> anyhow::Result<PathBuf> {
    if let Some(folder) = asked {
        return Ok(folder.to_owned());
    }
    let root = std::env::var_os("UMBRA_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
    let folder = root.join(inside);
    if !folder.is_dir() {
        bail!(
            "{}: no such folder; give --data FOLDER, or name the data folder in UMBRA_DATA",
            folder.display()
        );
    }
    Ok(folder)
}

fn stage_masks_table(report: &stage_masks::MaskReport) -> String {
    let mut text = String::from(
        "| clip | background | frames | mean IoU | worst IoU (frame) |\n|---|---|---:|---:|---:|\n",
    );
    for clip in &report.clips {
        let name = clip.clip.strip_prefix(&report.data).unwrap_or(&clip.clip).display();
        let _ = writeln!(
            text,
            "| {name} | {} | {} | {:.4} | {:.4} ({}) |",
            clip.background, clip.frames, clip.iou_mean, clip.iou_worst, clip.worst_frame
        );
    }
    text
}
