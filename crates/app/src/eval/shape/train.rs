//! Makes the predictors that the program ships, from the population's training bodies.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use body::BodyModel;
use body::build::SurfaceFit;
use rayon::prelude::*;

use super::walks::{WalkTest, choose_people, new_walkers, training_walkers};
use crate::predict::Activity;
use crate::shape::ShapeConfig;
use crate::shape::learn::{KnownBody, KnownFit, learn};
use crate::shape::predict::PredictorFile;
use crate::synth::Studio;

/// Seed of the walks.
const SEED: u64 = 1;

/// Learns the predictor for people who do `activity` from all training bodies of `bodies` and from walks of `n_people` of them, as
/// everybody in `motions` walks in turn, and writes it into `out`. Beside it stand predictors that have not seen one of the walkers.
///
/// # Errors
/// When the data cannot be read, or the file not be written.
pub fn train(
    bodies: &Path,
    motions: &Path,
    activity: Activity,
    n_people: usize,
    out: &Path,
) -> anyhow::Result<PathBuf> {
    let studio = Studio::open(bodies)?;
    let config = ShapeConfig::of(activity);
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
    let mut walkers = training_walkers(motions, activity)?;
    walkers.extend(new_walkers(motions, activity)?);
    let test = WalkTest { studio: &studio, walkers: &walkers, seed: SEED, config: &config, n_single: 0 };
    let fits = test.fit(&people)?;
    let walks: Vec<KnownFit<'_>> = fits
        .into_iter()
        .filter_map(|found| {
            let walker = found.walker().to_owned();
            Some(KnownFit { fit: found.fit?, truth: &truths[found.person], walker })
        })
        .collect();
    let mut file = learn(&known, &walks, config.n_shape);
    let names: BTreeSet<&str> = walks.iter().map(|walk| &walk.walker[..]).collect();
    for name in names {
        let others: Vec<KnownFit<'_>> = walks.iter().filter(|walk| walk.walker != name).cloned().collect();
        file.without.insert(name.to_owned(), learn(&known, &others, config.n_shape));
    }
    let path = out.join(PredictorFile::name_for(activity));
    let json = serde_json::to_string(&file).context("the predictor as JSON")?;
    std::fs::write(&path, json + "\n").with_context(|| format!("{}: cannot write", path.display()))?;
    Ok(path)
}
