//! `umbra shape`: one body for the person of a finished run, and the files that say what was found.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Context as _;
use biosig::Tape;
use body::io::meshes::write_obj;
use body::{BodyModel, Camera};
use rayon::prelude::*;
use serde::Serialize;
use silhouette::Mask;

use super::clip::frames_of;
use super::fit::{NoShape, ShapeConfig, ShapeFit, ShapeFrame, fit_shape};
use super::predict::{Estimate, Known, Prediction, Predictor, Quantity};
use super::{glb, picture, survey};
use crate::run_folder::{FinishedRun, Status, write_private};
use crate::track::ClipReader;

/// The person is brought to this height before outlines are compared, pixels: what the settings of the fit are for.
const WORKING_HEIGHT_PX: f64 = 320.0;
/// Version of `biosignatures.json`.
const VERSION: u32 = 1;
/// The body turns by less than this before the camera on most frames: one side only was seen.
const LEAST_TURN_RAD: f64 = 0.65;
/// So many of the frames are most: the others may be fitted with a wrong heading.
const MOST: f64 = 0.8;
/// What that does to the intervals: the fit does not know how wrong it may be about the side it did not see.
const ONE_SIDE_WIDENING: f64 = 1.5;
/// Outlines that lie so far apart, pixels at working height, are a poor fit: synthetic walks lie at 1.0 to 1.3.
const POOR_MISFIT_PX: f64 = 1.5;
const POOR_FIT_WIDENING: f64 = 1.5;
/// Fewer frames than this widen the intervals.
const FEW_FRAMES: usize = 8;
const FEW_FRAMES_WIDENING: f64 = 1.3;
/// Root mean square of the shape coefficients beyond which a body is unlike those of the population.
const STRANGE_SHAPE: f64 = 1.8;

/// Feet that are so far off the floor on average say that floor and camera do not agree, metres.
const FLOOR_OFF_M: f64 = 0.02;

/// What no silhouette shows and no synthetic walk has: shoes, hair, clothes and the errors of a calibration. Standard deviations in
/// metres and kilograms, in the order of [`Quantity::ALL`]; judged, not measured.
const UNMODELLED_SD: [f64; 7] = [0.015, 0.015, 0.015, 0.01, 0.006, 0.015, 2.0];

/// What to do.
#[derive(Clone, Debug)]
pub struct ShapeJob {
    /// Settings of the fit, up to the prior on poses, which is that of the run's activity.
    pub config: ShapeConfig,
    /// What is known of the person.
    pub known: Known,
    /// Also fit every frame on its own.
    pub per_frame: bool,
}

/// `biosignatures.json`.
#[derive(Clone, Debug, Serialize)]
pub struct Biosignatures {
    /// Version of this file.
    pub version: u32,
    /// The program.
    pub program: &'static str,
    /// Frames that the body was fitted to.
    pub frames: Vec<u64>,
    /// Root mean square distance of the body's rim and the outlines, pixels at working height, mean over the frames.
    pub misfit_px: Option<f64>,
    /// What to be careful about, a line each.
    pub warnings: Vec<String>,
    /// What was known beforehand.
    pub known_stature_m: Option<f64>,
    /// See [`known_stature_m`](Self::known_stature_m).
    pub known_weight_kg: Option<f64>,
    /// What was measured; empty when the clip cannot carry a shape.
    pub measurements: Vec<Measurement>,
    /// Probability that the person is a man by the shape of their body: an estimate, no label.
    pub male_probability: Option<f64>,
    /// Shape coefficients in standard deviations of the population: mean
    pub shape: Vec<f64>,
    /// and standard deviation.
    pub shape_sd: Vec<f64>,
}

/// One measured quantity.
#[derive(Clone, Debug, Serialize)]
pub struct Measurement {
    /// Which.
    pub name: &'static str,
    /// `m` or `kg`.
    pub unit: &'static str,
    /// Value and uncertainty.
    #[serde(flatten)]
    pub estimate: Estimate,
    /// How it is defined.
    pub definition: &'static str,
    /// Frames behind it.
    pub n_frames: usize,
}

/// Fits one body to the person of the run in `folder` and writes `biosignatures.json`, `body.obj`, `body.glb` and `body.png` into
/// it, and `shape_per_frame.csv` when asked. A clip that cannot carry a shape gets a `biosignatures.json` that says so.
///
/// # Errors
/// When the run or its input cannot be read, or the results not be written.
pub fn shape_of_run(folder: &Path, job: &ShapeJob) -> anyhow::Result<Biosignatures> {
    let run = FinishedRun::read(folder)?;
    let (frames, camera) = read_frames(&run)?;
    let model = BodyModel::builtin();
    let stature_m = job.known.stature_m.unwrap_or(frames.stature_m);
    let pose_prior = ShapeConfig::of(run.activity).pose_prior;
    let job = &ShapeJob { config: ShapeConfig { pose_prior, ..job.config.clone() }, ..job.clone() };
    let fitted = fit_shape(&model, &camera, &frames.all, run.fps, stature_m, &job.config);
    let predictor = Predictor::of(run.activity);
    let found = match &fitted {
        Ok(fit) => {
            let prediction = predictor.predict(fit, &job.known);
            let found = biosignatures(fit, prediction, &job.known, &camera, &frames.warnings);
            write_body(folder, &model, fit)?;
            found
        }
        Err(reason) => without_shape(reason, &job.known, frames.warnings),
    };
    let json =
        serde_json::to_string_pretty(&found).context("biosignatures.json: a number has no form in JSON")?;
    write_private(&folder.join("biosignatures.json"), format!("{json}\n").as_bytes())?;
    if job.per_frame && fitted.is_ok() {
        let table = per_frame(&model, &camera, &frames.all, run.fps, stature_m, job, &predictor);
        write_private(&folder.join("shape_per_frame.csv"), table.as_bytes())?;
    }
    Ok(found)
}

/// The frames of a run at working resolution.
struct RunFrames {
    all: Vec<ShapeFrame>,
    stature_m: f64,
    warnings: Vec<String>,
}

/// Reads the masks of the tracked frames again.
fn read_frames(run: &FinishedRun) -> anyhow::Result<(RunFrames, Camera)> {
    let mut reader = ClipReader::open(&run.input)?;
    let mut masks: Vec<(Mask, body::Pose)> = Vec::new();
    let mut numbers = Vec::new();
    let mut wanted = run.frames.iter();
    let mut next = wanted.next();
    while let Some((index, status, pose)) = next {
        let Some(frame) = reader.next_frame()? else { break };
        if frame.index == *index {
            if *status == Status::Tracked {
                masks.push((frame.mask, pose.clone()));
                numbers.push(*index);
            }
            next = wanted.next();
        }
    }
    let mut heights: Vec<u32> =
        masks.iter().filter_map(|(mask, _)| Some(mask.bounding_box()?.height())).collect();
    heights.sort_unstable();
    let height_px = f64::from(heights.get(heights.len() / 2).copied().unwrap_or(1));
    let camera = run.camera.scaled((WORKING_HEIGHT_PX / height_px).min(1.0));
    let [width, height] = [camera.intrinsics().width, camera.intrinsics().height];
    let masks: Vec<(Mask, body::Pose)> =
        masks.into_par_iter().map(|(mask, pose)| (mask.resized(width, height), pose)).collect();
    let survey = survey(&masks.iter().map(|(mask, _)| mask).collect::<Vec<_>>(), &camera, run.fps);
    let mut warnings = Vec::new();
    let all = match &survey {
        Some(survey) => {
            let poses = masks.into_iter().enumerate().map(|(place, (mask, pose))| (place, mask, pose));
            let mut frames = frames_of(survey, poses.collect());
            frames.iter_mut().for_each(|frame| frame.index = numbers[frame.index as usize]);
            frames
        }
        None => {
            warnings.push("no frame shows a whole person with the feet on the floor".to_owned());
            Vec::new()
        }
    };
    let stature_m = survey.map_or(1.7, |survey| super::clip::stature_from(&survey));
    Ok((RunFrames { all, stature_m, warnings }, camera))
}

fn biosignatures(
    fit: &ShapeFit,
    prediction: Prediction,
    known: &Known,
    camera: &Camera,
    warnings: &[String],
) -> Biosignatures {
    let mut warnings = warnings.to_vec();
    let mut widening = 1.0;
    if turn_seen_rad(fit, camera) < LEAST_TURN_RAD {
        warnings.push("the person was seen from about one side only: intervals are wider".to_owned());
        widening *= ONE_SIDE_WIDENING;
    }
    if fit.frames.len() < FEW_FRAMES {
        warnings.push(format!("only {} frames could be used: intervals are wider", fit.frames.len()));
        widening *= FEW_FRAMES_WIDENING;
    }
    let misfit_px = fit.misfit_px.iter().sum::<f64>() / fit.misfit_px.len() as f64;
    if misfit_px > POOR_MISFIT_PX {
        warnings.push(format!(
            "the body does not fit the outlines well (off by {misfit_px:.1} pixels): intervals are wider"
        ));
        widening *= POOR_FIT_WIDENING;
    }
    let lowest_m = fit.lowest_m.iter().sum::<f64>() / fit.lowest_m.len() as f64;
    if lowest_m.abs() > FLOOR_OFF_M {
        warnings.push(format!(
            "the feet stay {:+.0} cm off the floor: floor and camera do not agree, stature is less sure",
            100.0 * lowest_m
        ));
        widening *= POOR_FIT_WIDENING;
    }
    let square = fit.shape.iter().map(|c| c * c).sum::<f64>() / fit.shape.len() as f64;
    if square.sqrt() > STRANGE_SHAPE {
        warnings.push("the body is unlike those that the program knows".to_owned());
    }
    let measurements = Quantity::ALL.map(|quantity| {
        let Estimate { value, sd, interval90: [low, high] } = *prediction.of(quantity);
        // A known stature or weight is exact enough.
        let is_known = matches!(quantity, Quantity::Stature) && known.stature_m.is_some()
            || matches!(quantity, Quantity::Weight) && known.weight_kg.is_some();
        let unmodelled = if is_known { 0.0 } else { UNMODELLED_SD[quantity as usize] };
        let total = (widening * sd).hypot(unmodelled);
        let widened = |end: f64| value + total / sd * (end - value);
        Measurement {
            name: quantity.name(),
            unit: quantity.unit(),
            estimate: Estimate { value, sd: total, interval90: [widened(low), widened(high)] },
            definition: quantity.definition(),
            n_frames: fit.frames.len(),
        }
    });
    let n = fit.shape.len();
    Biosignatures {
        version: VERSION,
        program: concat!("umbra ", env!("CARGO_PKG_VERSION")),
        frames: fit.frames.iter().map(|(frame, _)| *frame).collect(),
        misfit_px: Some(misfit_px),
        warnings,
        known_stature_m: known.stature_m,
        known_weight_kg: known.weight_kg,
        measurements: measurements.to_vec(),
        male_probability: Some(less_sure(prediction.male_probability, widening)),
        shape: fit.shape.clone(),
        shape_sd: fit.covariance.diagonal().iter().take(n).map(|variance| variance.sqrt()).collect(),
    }
}

/// A probability when the standard deviation behind it is `widening` times as large: its log-odds go with the inverse of the variance.
fn less_sure(probability: f64, widening: f64) -> f64 {
    let probability = probability.clamp(f64::EPSILON, 1.0 - f64::EPSILON);
    let log_odds = (probability / (1.0 - probability)).ln() / widening.powi(2);
    1.0 / (1.0 + (-log_odds).exp())
}

fn without_shape(reason: &NoShape, known: &Known, mut warnings: Vec<String>) -> Biosignatures {
    warnings.push(format!("no shape: {reason}"));
    Biosignatures {
        version: VERSION,
        program: concat!("umbra ", env!("CARGO_PKG_VERSION")),
        frames: Vec::new(),
        misfit_px: None,
        warnings,
        known_stature_m: known.stature_m,
        known_weight_kg: known.weight_kg,
        measurements: Vec::new(),
        male_probability: None,
        shape: Vec::new(),
        shape_sd: Vec::new(),
    }
}

/// How far the person turned before the camera, radians: the least arc that holds the headings of [`MOST`] frames. Front and back
/// look alike, so that half a turn is all.
fn turn_seen_rad(fit: &ShapeFit, camera: &Camera) -> f64 {
    let half_turn = std::f64::consts::PI;
    let mut seen: Vec<f64> = fit
        .frames
        .iter()
        .map(|(_, pose)| {
            let away = (pose.root_position - camera.centre_world()).truncate().to_angle();
            (pose.heading_rad() - away).rem_euclid(half_turn)
        })
        .collect();
    seen.sort_by(f64::total_cmp);
    let n = seen.len();
    let held = (MOST * n as f64).ceil() as usize;
    let arc = |first: usize| (seen[(first + held - 1) % n] - seen[first]).rem_euclid(half_turn);
    (0..n).map(arc).fold(half_turn, f64::min)
}

fn write_body(folder: &Path, model: &BodyModel, fit: &ShapeFit) -> anyhow::Result<()> {
    let body = model.shape(&fit.shape);
    let vertices = body.rest_vertices();
    let obj = folder.join("body.obj");
    write_private(&obj, b"")?; // the mesh's writer keeps the permissions of a file that is there
    write_obj(&obj, vertices, body.triangles())?;
    write_private(&folder.join("body.glb"), &glb::glb("body", vertices, body.triangles()))?;
    let tape = Tape::of_model(model);
    let measured = tape.measure_body(&body).context("the fitted body cannot be measured")?;
    let picture = picture::picture(&body, &tape, &measured)?;
    let mut png = std::io::Cursor::new(Vec::new());
    image::write_buffer_with_format(
        &mut png,
        &picture.pixels,
        picture.width,
        picture.height,
        image::ExtendedColorType::Rgb8,
        image::ImageFormat::Png,
    )?;
    write_private(&folder.join("body.png"), png.get_ref())?;
    Ok(())
}

/// Every frame fitted on its own: a row each.
fn per_frame(
    model: &BodyModel,
    camera: &Camera,
    frames: &[ShapeFrame],
    fps: f64,
    stature_m: f64,
    job: &ShapeJob,
    predictor: &Predictor,
) -> String {
    let config = ShapeConfig { least_frames: 1, ..job.config.clone() };
    let rows: Vec<Option<(u64, Prediction)>> = frames
        .par_iter()
        .map(|frame| {
            let fit = fit_shape(model, camera, std::slice::from_ref(frame), fps, stature_m, &config).ok()?;
            Some((frame.index, predictor.predict(&fit, &job.known)))
        })
        .collect();
    let mut text = String::from("frame");
    for quantity in Quantity::ALL {
        let (name, unit) = (quantity.name(), quantity.unit());
        let _ = write!(text, ",{name}_{unit},{name}_low90_{unit},{name}_high90_{unit}");
    }
    text.push_str(",male_probability\n");
    for (frame, prediction) in rows.into_iter().flatten() {
        let _ = write!(text, "{frame}");
        for Estimate { value, interval90: [low, high], .. } in prediction.quantities {
            let _ = write!(text, ",{value:.4},{low:.4},{high:.4}");
        }
        let _ = writeln!(text, ",{:.3}", prediction.male_probability);
    }
    text
}

#[cfg(test)]
mod tests;
