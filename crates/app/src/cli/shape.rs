//! `umbra shape`: the body of the person of a finished run.

use std::path::{Path, PathBuf};

use clap::Args;

use super::eval::in_pool;
use super::track::exec_config;
use crate::progress::note;
use crate::shape::{Biosignatures, Known, ShapeConfig, ShapeJob, ShapeMethod, shape_of_run};

/// Arguments of `umbra shape`.
#[derive(Debug, Args)]
pub struct ShapeArgs {
    /// The run folder, of a finished run whose input is still where it was.
    #[arg(value_name = "FOLDER")]
    run: PathBuf,
    /// Stature of the person in metres, when it is known: it tightens everything else.
    #[arg(long, value_name = "M", value_parser = parse_stature)]
    stature_m: Option<f64>,
    #[command(flatten)]
    options: ShapeOptions,
    /// Worker threads; the results do not depend on them [default: one a core].
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
}

/// Options that `umbra track --shape` has too.
#[derive(Clone, Debug, Args)]
pub struct ShapeOptions {
    /// Weight of the person in kilograms, when it is known: it tightens everything else.
    #[arg(long, value_name = "KG", value_parser = parse_weight)]
    weight_kg: Option<f64>,
    /// Thickness of the clothes over the trunk and the limbs in millimetres.
    #[arg(long, value_name = "MM", default_value_t = 0.0, value_parser = parse_clothing)]
    clothing_mm: f64,
    /// How the shape is found: `adjust` is the better one, `annealed` that of the paper.
    #[arg(long, value_enum, default_value_t)]
    search: ShapeMethod,
    /// Also fit each frame on its own: shape_per_frame.csv.
    #[arg(long)]
    per_frame: bool,
}

fn parse_in(text: &str, low: f64, high: f64) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (low..=high).contains(&value) => Ok(value),
        _ => Err(format!("expected a number from {low} to {high}")),
    }
}

fn parse_stature(text: &str) -> Result<f64, String> {
    parse_in(text, 1.2, 2.3)
}

fn parse_weight(text: &str) -> Result<f64, String> {
    parse_in(text, 25.0, 300.0)
}

fn parse_clothing(text: &str) -> Result<f64, String> {
    parse_in(text, 0.0, 60.0)
}

/// Runs the command.
pub fn run(args: &ShapeArgs) -> anyhow::Result<()> {
    fit(&args.run, args.stature_m, &args.options, args.threads)
}

/// Fits the shape of the run in `folder` and says what was found.
pub fn fit(
    folder: &Path,
    stature_m: Option<f64>,
    options: &ShapeOptions,
    threads: Option<usize>,
) -> anyhow::Result<()> {
    let mut config = ShapeConfig { method: options.search, ..ShapeConfig::default() };
    config.adjust.clothing_m[0] = options.clothing_mm / 1e3;
    let known = Known { stature_m, weight_kg: options.weight_kg };
    let job = ShapeJob { config, known, per_frame: options.per_frame };
    let found = in_pool(exec_config(threads)?, || shape_of_run(folder, &job))?;
    report(folder, &found);
    Ok(())
}

fn report(folder: &Path, found: &Biosignatures) {
    for warning in &found.warnings {
        note(&format!("warning: {warning}"));
    }
    for measured in &found.measurements {
        let (scale, unit) = if measured.unit == "m" { (100.0, "cm") } else { (1.0, "kg") };
        let [low, high] = measured.estimate.interval90.map(|end| scale * end);
        let value = scale * measured.estimate.value;
        note(&format!("{:<8} {value:6.1} {unit}  (90 %: {low:.1} to {high:.1})", measured.name));
    }
    if let Some(male) = found.male_probability {
        note(&format!("gender by shape: {:.0} % male", 100.0 * male));
    }
    if !found.measurements.is_empty() {
        let out = folder.display();
        note(&format!("from {} frames; open {out}/body.png or {out}/body.glb", found.frames.len()));
    }
}
