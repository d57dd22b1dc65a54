//! `umbra track`: the arguments, and what is printed when the run is done.

use std::path::PathBuf;

use anyhow::{Context as _, bail};
use clap::Args;

use super::shape::{self, ShapeOptions};
use crate::config::{ExecConfig, Method, Motion, Preset, TrackConfig, TrackParams, Weighting};
use crate::predict::Activity;
use crate::progress::note;
use crate::run_folder::{Existing, Summary};
use crate::track::{Background, CameraChoice, ClipInput, TrackJob, TrackOutcome, track_clip};
use crate::train::DescriptorKind;

/// Arguments of `umbra track`.
#[derive(Debug, Args)]
pub struct TrackArgs {
    /// A video, a folder of PNG or JPEG frames, or (with --masks) a folder of masks.
    input: PathBuf,
    /// The run folder to write; new or empty, see --resume and --force.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// The calibrated camera: TOML, JSON, OpenCV YAML, or a 22-number .cal file.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["focal_px", "fov_deg"])]
    camera: Option<PathBuf>,
    /// Without a calibration: the focal length in pixels. A level camera 1.5 m above the floor is assumed.
    #[arg(long, value_name = "PX", conflicts_with = "fov_deg")]
    focal_px: Option<f64>,
    /// Without a calibration: the horizontal field of view in degrees. A level camera 1.5 m above the floor is assumed.
    #[arg(long, value_name = "DEG")]
    fov_deg: Option<f64>,
    /// A picture of the empty scene; without it the background is learned from the frames.
    #[arg(long, value_name = "FILE", conflicts_with = "masks")]
    background: Option<PathBuf>,
    /// How to learn the background when there is no picture of it.
    #[arg(long, value_name = "HOW", value_enum, default_value_t = Learn::Median, conflicts_with_all = ["background", "masks"])]
    learn_background: Learn,
    /// The input is a folder of ready masks: person white, everything else black.
    #[arg(long)]
    masks: bool,
    /// Some frames only: the first, counted from 0, and the one after the last.
    #[arg(long, value_name = "A..B", value_parser = parse_frames)]
    frames: Option<std::ops::Range<u64>>,
    /// Frames a second [default: as the camera file or the video says, else 60].
    #[arg(long, value_name = "RATE")]
    fps: Option<f64>,
    /// A predictor of poses that `umbra train` made [default: the one that the program carries].
    #[arg(long, value_name = "FILE")]
    predictor: Option<PathBuf>,
    /// Where to write the predictor with what it learned from the clip, see --adapt.
    #[arg(long, value_name = "FILE")]
    save_predictor: Option<PathBuf>,
    /// What the person does: poses and settings are those of such people, and a predictor that was trained for something else is
    /// refused.
    #[arg(long, value_enum, default_value_t = Activity::Any)]
    activity: Activity,
    /// Leave source frames out of everything that is written.
    #[arg(long)]
    redact: bool,
    /// Go on with the interrupted run in the folder; the other options must be as they were.
    #[arg(long)]
    resume: bool,
    /// Replace a run that is already in the folder.
    #[arg(long, conflicts_with = "resume")]
    force: bool,
    /// Find the body of the person too: girths, stature, weight, gender, as `umbra shape` does.
    #[arg(long)]
    shape: bool,
    #[command(flatten)]
    shape_options: ShapeOptions,
    /// Worker threads, beside one that decodes and one that segments; the results do not depend on them [default: one a core].
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    #[arg(long, value_name = "N", help_heading = SETTINGS, help = or_else("Seed of every random draw", defaults().seed))]
    seed: Option<u64>,
    /// Heading on the first frame in degrees, anticlockwise from world +x as seen from above; searched for when absent.
    #[arg(long, value_name = "DEG", help_heading = SETTINGS, allow_negative_numbers = true)]
    initial_heading_deg: Option<f64>,
    #[command(flatten)]
    settings: SettingsArgs,
}

/// How a background is learned.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Learn {
    /// Median over the clip: the person must stand at no place for half of it.
    Median,
    /// Running mixture of Gaussians.
    Mixture,
}

/// Heading of the settings in the help.
const SETTINGS: &str = "Settings";

/// The settings that change the answer; those not given keep the value of the settings file or the default.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = SETTINGS)]
pub struct SettingsArgs {
    /// Settings to begin with [default: best].
    #[arg(long, value_enum)]
    preset: Option<Preset>,
    /// A TOML file of settings, named as in the table `settings` of a run.toml, but without those that are options only:
    /// `activity`, `frames`, `learned_background`, `assumed_camera`.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    #[arg(long, value_name = "N", help = or_else("Particles of the filter", defaults().particles))]
    particles: Option<u32>,
    #[arg(long, value_name = "N", help = or_else("Annealing layers a frame", defaults().layers))]
    layers: Option<u32>,
    #[arg(long, value_name = "N", help = or_else("Filters side by side, each with so many particles", defaults().modes))]
    modes: Option<u32>,
    /// The tracker [default: jpf, which is apf where no predictor is at hand].
    #[arg(long, value_enum)]
    method: Option<Method>,
    /// Let the frames after one choose between its readings and steady it: the answer comes so many frames later (for a live
    /// stream, a few). A resumed run begins anew.
    #[arg(long, value_name = "FRAMES", num_args = 0..=1, default_missing_value = "15")]
    smooth: Option<u32>,
    #[arg(long, value_name = "N", help = or_else("Best particles of each frame that the predictor learns from, which makes a resumed run begin anew", defaults().adapt))]
    adapt: Option<u32>,
    /// What particles weigh under jpf [default: paper].
    #[arg(long, value_enum)]
    weighting: Option<Weighting>,
    /// Motions that are expected [default: any].
    #[arg(long, value_enum)]
    motion: Option<Motion>,
    /// Stature of the person in metres [default: as the first masks show it].
    #[arg(long, value_name = "M")]
    stature_m: Option<f64>,
}

fn defaults() -> TrackConfig {
    TrackConfig::default()
}

/// The help of an option that keeps this value when it is not given.
fn or_else(what: &str, value: impl std::fmt::Display) -> String {
    format!("{what} [default: {value}]")
}

impl SettingsArgs {
    /// The description of masks that belongs to the preset.
    pub fn descriptor(&self) -> DescriptorKind {
        match self.preset {
            Some(Preset::Paper) => DescriptorKind::Histogram,
            Some(Preset::Best) | None => DescriptorKind::Crop,
        }
    }

    /// Whether the command line says which tracker.
    pub fn names_a_method(&self) -> bool {
        self.method.is_some()
    }

    /// The settings of the preset, under those of the file if one is given, under those of the command line.
    pub fn config(&self) -> anyhow::Result<TrackConfig> {
        self.config_over(TrackConfig::default())
    }

    /// The same, with other defaults.
    pub fn config_over(&self, defaults: TrackConfig) -> anyhow::Result<TrackConfig> {
        let mut config = self.preset.unwrap_or(Preset::Best).over(defaults);
        let mut told_by_file = toml::Table::new();
        if let Some(path) = &self.config {
            let text = std::fs::read_to_string(path)
                .with_context(|| format!("{}: cannot read the settings", path.display()))?;
            let told: toml::Table =
                toml::from_str(&text).with_context(|| format!("{}: not settings", path.display()))?;
            let mut table = toml::Table::try_from(&config).context("the settings as TOML")?;
            table.extend(told.clone());
            config = table.try_into().with_context(|| format!("{}: not settings", path.display()))?;
            told_by_file = told;
        }
        set(&mut config.particles, self.particles);
        set(&mut config.layers, self.layers);
        set(&mut config.modes, self.modes);
        set(&mut config.method, self.method);
        set(&mut config.adapt, self.adapt);
        set(&mut config.smooth, self.smooth);
        set(&mut config.weighting, self.weighting);
        set(&mut config.motion, self.motion);
        config.stature_m = self.stature_m.or(config.stature_m);
        match (TrackParams::new(config.clone()), &self.config) {
            (Err(bad), Some(path)) if told_by_file.contains_key(bad.field) => {
                Err(bad).with_context(|| path.display().to_string())
            }
            _ => Ok(config),
        }
    }
}

fn set<T>(setting: &mut T, given: Option<T>) {
    if let Some(value) = given {
        *setting = value;
    }
}

/// `A..B` with A below B.
pub fn parse_frames(text: &str) -> Result<std::ops::Range<u64>, String> {
    let parsed = text.split_once("..").and_then(|(a, b)| Some(a.parse().ok()?..b.parse().ok()?));
    match parsed {
        Some(range) if range.start < range.end => Ok(range),
        _ => Err("expected A..B, the first frame and the one after the last, with A below B".to_owned()),
    }
}

/// The thread pool of the whole program, when a number of threads is asked for.
pub fn exec_config(threads: Option<usize>) -> anyhow::Result<ExecConfig> {
    match threads {
        None => Ok(ExecConfig::default()),
        Some(0) => bail!("`--threads` is 0, expected 1 or more"),
        Some(threads) => Ok(ExecConfig { threads }),
    }
}

/// Runs the command.
pub fn run(args: &TrackArgs) -> anyhow::Result<()> {
    let input = if args.masks {
        ClipInput::Masks(args.input.clone())
    } else {
        let background = match (&args.background, args.learn_background) {
            (Some(plate), _) => Background::Plate(plate.clone()),
            (None, Learn::Median) => Background::Median,
            (None, Learn::Mixture) => Background::Mixture,
        };
        ClipInput::Frames(args.input.clone(), background)
    };
    let camera = match (&args.camera, args.focal_px, args.fov_deg) {
        (Some(path), ..) => CameraChoice::File(path.clone()),
        (None, Some(focal_px), _) => CameraChoice::Focal(focal_px),
        (None, None, Some(fov_deg)) => CameraChoice::FieldOfView(fov_deg),
        (None, None, None) => {
            bail!(
                "no camera: give --camera FILE, or --focal-px or --fov-deg for one that is assumed to be level"
            )
        }
    };
    let existing = match (args.resume, args.force) {
        (true, _) => Existing::Resume,
        (_, true) => Existing::Replace,
        _ => Existing::Refuse,
    };
    let mut config = args.settings.config_over(args.activity.over(TrackConfig::default()))?;
    set(&mut config.seed, args.seed);
    config.initial_heading_deg = args.initial_heading_deg.or(config.initial_heading_deg);
    let job = TrackJob {
        input,
        camera,
        out: args.out.clone(),
        config,
        predictor: args.predictor.clone(),
        save_predictor: args.save_predictor.clone(),
        activity: args.activity,
        frames: args.frames.clone(),
        fps: args.fps,
        redact: args.redact,
        existing,
    };
    let outcome = track_clip(&job, exec_config(args.threads)?)?;
    report(&job, &outcome);
    if args.shape {
        shape::fit(&args.out, args.settings.stature_m, &args.shape_options, args.threads)?;
    }
    Ok(())
}

/// Under this mean overlap of body and mask, something is wrong with what the tracker was given: clothes and hair cost a tenth.
const LEAST_PLAUSIBLE_IOU: f64 = 0.75;

/// Says what was written, what to open, and whether to doubt it.
pub fn report(job: &TrackJob, outcome: &TrackOutcome) {
    let out = job.out.display();
    let Summary { frames, tracked, coasting, lost, iou_mean, .. } = outcome.summary;
    let overlap = iou_mean.map_or(String::new(), |iou| format!("; mean overlap of body and mask {iou:.3}"));
    note(&format!(
        "tracked {tracked} of {frames} frames ({coasting} coasting, {lost} lost) at {:.1} frames a second{overlap}",
        outcome.fps,
    ));
    if iou_mean.is_none_or(|iou| iou < LEAST_PLAUSIBLE_IOU) {
        note(
            "warning: body and mask hardly agree, so do not trust these poses. Look at the overlays: is the person cut out well",
        );
        note(
            "(`--background` with a picture of the empty scene; `--masks` where the pictures are masks), is it the right camera?",
        );
    }
    note(&format!("open {out}/filmstrip.png for a first look, {out}/overlay/ for every frame,"));
    note(&format!("{out}/run.mcap in Foxglove or Rerun; `umbra info {out}` prints the summary"));
}
