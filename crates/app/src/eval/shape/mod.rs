//! `umbra eval shape`: bodies of people who trained nothing, from synthetic walks that the program tracks itself.
//!
//! Nobody meets what was learned from them: the prior on poses has not seen the walker, and numbers are told by a predictor that
//! was learned from the walks of all others. Where another folder of bodies is given, all of them are tested. Baselines predict a
//! quantity without a look at the person: the mean of the true sex, and lines on the true stature, or stature and weight, learned
//! on the training bodies.

mod baseline;
mod report;
mod stage;
pub mod train;
pub mod walks;

use std::path::PathBuf;

use anyhow::bail;
use body::BodyModel;
use body::build::SurfaceFit;
use glam::Vec3;

use super::joint_error::mean;
use super::write_json;
use crate::predict::Activity;
use crate::shape::{Known, Predictor, Quantity, ShapeConfig, ShapeFit, ShapeMethod};
use crate::synth::{People, Studio};
use baseline::Baselines;
use report::{Score, Scored};
pub use report::{ShapeReport, table};
use walks::{WalkTest, choose_people, new_walkers, training_walkers};

/// Seed of the walks.
const SEED: u64 = 2;

/// Frames of each person that are fitted on their own.
const SINGLE_FRAMES: usize = 3;

/// What to evaluate.
#[derive(Clone, Debug)]
pub struct ShapeEval {
    /// The population.
    pub population: PathBuf,
    /// Another folder of bodies; the held-out part of the population when absent.
    pub bodies: Option<PathBuf>,
    /// A stage-like data set whose subjects are fitted too, where it is there.
    pub stage: Option<PathBuf>,
    /// Folder of recorded motion.
    pub motions: PathBuf,
    /// Take training people instead, who walk as those of the training recordings and of the others: for tuning.
    pub on_training: bool,
    /// What the program is told that they do.
    pub activity: Activity,
    /// How shapes are found.
    pub method: ShapeMethod,
    /// Number of people.
    pub people: usize,
    /// Where `eval.json` goes.
    pub out: PathBuf,
}

/// Runs the evaluation, writes `eval.json` and returns the report.
///
/// # Errors
/// When the data cannot be read, or the results not be written.
pub fn evaluate(eval: &ShapeEval) -> anyhow::Result<ShapeReport> {
    let population = People::read(&eval.population)?;
    let folder = eval.bodies.as_ref().unwrap_or(&eval.population);
    let studio = Studio::open(folder)?;
    let is_population = studio.people.data().coefficients == population.data().coefficients;
    let candidates = match (is_population, eval.on_training) {
        (true, false) => population.data().held_out(),
        (true, true) => population.data().training_bodies(),
        (false, _) => (0..studio.people.len()).collect(),
    };
    let truths = studio.people.truths();
    let people = choose_people(truths, &candidates, eval.people);
    if people.len() < 2 {
        bail!("{}: {} people to test, expected 2 at least", folder.display(), people.len());
    }
    let config = ShapeConfig { method: eval.method, ..ShapeConfig::of(eval.activity) };
    let mut walkers = new_walkers(&eval.motions, eval.activity)?;
    if eval.on_training {
        walkers.extend(training_walkers(&eval.motions, eval.activity)?);
    }
    let model = BodyModel::builtin();
    let test =
        WalkTest { studio: &studio, walkers: &walkers, seed: SEED, config: &config, n_single: SINGLE_FRAMES };
    let fits = test.fit(&people)?;
    let training = population.data().training_bodies();
    let baselines = Baselines::learn(training.iter().map(|&person| &population.truths()[person]));
    let predictor = Predictor::of(eval.activity);
    let bodies = studio.people.data();
    let surface = SurfaceFit::new(bodies, &model.template().source_vertices, model.triangles())?;
    let mut scored = Vec::new();
    for found in &fits {
        let truth = &truths[found.person];
        let true_body = surface.apply(&bodies.vertices(found.person));
        let surface_mm = |fit: &ShapeFit| {
            let body = model.shape(&fit.shape);
            let vertices = body.rest_vertices().iter().map(|vertex| Vec3::from_array(*vertex).as_dvec3());
            let distances = vertices.zip(&true_body).map(|(vertex, place)| 1e3 * vertex.distance(*place));
            mean(distances)
        };
        let known = |stature: bool, weight: bool| Known {
            stature_m: stature.then_some(truth.stature_m),
            weight_kg: weight.then_some(truth.weight_kg),
        };
        let predictor = predictor.without(found.walker());
        let predict = |known: Known| found.fit.as_ref().map(|fit| predictor.predict(fit, &known));
        scored.push(Scored {
            truth,
            motion: &found.motion,
            surface_mm: found.fit.as_ref().map(surface_mm),
            person: predict(Known::default()),
            with_stature: predict(known(true, false)),
            with_both: predict(known(true, true)),
            frames: found.single.iter().map(|fit| predictor.predict(fit, &Known::default())).collect(),
            baselines: Quantity::ALL.map(|quantity| baselines.of(quantity, truth)),
        });
    }
    let stage = match &eval.stage {
        Some(data) => stage::subjects(data, eval.method)?,
        None => Vec::new(),
    };
    let report = ShapeReport::of(&scored, stage, fits.iter().map(|found| found.seconds));
    write_json(&eval.out, &report)?;
    report::write_people(&eval.out, &scored)?;
    Ok(report)
}

impl Score {
    /// Errors are told in millimetres and kilograms.
    fn scale(quantity: Quantity) -> f64 {
        if quantity == Quantity::Weight { 1.0 } else { 1e3 }
    }
}
