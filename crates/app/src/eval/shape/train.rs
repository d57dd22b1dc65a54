//! Makes the predictor that the program ships, from the population's training bodies.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use body::BodyModel;
use body::build::SurfaceFit;
use rayon::prelude::*;

use super::walks::{choose_people, fit_people};
use crate::shape::learn::{KnownBody, KnownFit, learn};
use crate::shape::{ShapeConfig, light_tracking};
use crate::synth::Studio;

/// Seed of the walks.
const SEED: u64 = 1;

/// Learns the predictor from all training bodies of `bodies` and from walks of `n_people` of them, and writes
/// `umbra-shape.json` into `out`.
///
/// # Errors
/// When the data cannot be read, or the file not be written.
pub fn train(bodies: &Path, motions: &Path, n_people: usize, out: &Path) -> anyhow::Result<PathBuf> {
    let studio = Studio::open(bodies, motions, &["train"])?;
    let config = ShapeConfig::default();
    let model = BodyModel::builtin();
    let (data, truths) = (studio.people.data(), studio.people.truths());
    let training = data.training_bodies();
    let surface = SurfaceFit::new(data, &model.template().source_vertices, model.triangles())?;
    let known: Vec<KnownBody<'_>> = training
        .par_iter()
        .map(|&person| {
            let mut shape = model.coefficients_of(&surface.apply(&data.vertices(person)));
            shape.truncate(config.n_shape);
            KnownBody { shape, truth: &truths[person] }
        })
        .collect();
    let people = choose_people(truths, &training, n_people);
    let fits = fit_people(&studio, &people, SEED, &light_tracking(), &config, 0)?;
    let walks: Vec<KnownFit<'_>> = fits
        .into_iter()
        .filter_map(|found| {
            let walker = found.walker().to_owned();
            Some(KnownFit { fit: found.fit?, truth: &truths[found.person], walker })
        })
        .collect();
    let file = learn(&known, &walks, config.n_shape);
    let path = out.join("umbra-shape.json");
    let json = serde_json::to_string_pretty(&file).context("the predictor as JSON")?;
    std::fs::write(&path, json + "\n").with_context(|| format!("{}: cannot write", path.display()))?;
    Ok(path)
}
