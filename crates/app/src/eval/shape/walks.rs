//! People who walk, and the bodies that the program finds for them.

use body::{BodyModel, Sex};
use rayon::prelude::*;
use silhouette::Mask;

use crate::config::TrackConfig;
use crate::progress::Progress;
use crate::shape::{ShapeConfig, ShapeFit, fit_shape, shape_from_masks};
use crate::synth::{Studio, Truth};

/// What the program found of a person.
pub struct PersonFit {
    /// Index of the person.
    pub person: usize,
    /// Name of the recording that moves them.
    pub motion: String,
    /// One body from the whole clip; none when it could not be fitted.
    pub fit: Option<ShapeFit>,
    /// Bodies from some frames, each on its own.
    pub single: Vec<ShapeFit>,
    /// Seconds of wall time for tracking and for the fit of the clip, on the threads at hand.
    pub seconds: f64,
}

/// Every person's walk with this seed, tracked and fitted, and `n_single` of its frames fitted alone; in the order of `people`.
///
/// # Errors
/// When a recording does not fit.
pub fn fit_people(
    studio: &Studio,
    people: &[usize],
    seed: u64,
    track: &TrackConfig,
    config: &ShapeConfig,
    n_single: usize,
) -> anyhow::Result<Vec<PersonFit>> {
    let model = BodyModel::builtin();
    let progress = std::sync::Mutex::new(Progress::start("people", 0, Some(people.len() as u64)));
    let fit = |&person: &usize| -> anyhow::Result<PersonFit> {
        let walk = studio.walk(person, seed)?;
        let masks: Vec<&Mask> = walk.frames.iter().map(|frame| &frame.observed).collect();
        let started = std::time::Instant::now();
        let found = shape_from_masks(&model, &walk.camera, &masks, walk.rate_hz, track, config)?;
        let seconds = started.elapsed().as_secs_f64();
        let (mut whole, mut single) = (None, Vec::new());
        if let Some((fit, frames)) = found {
            let stature_m = model.shape(&fit.shape).stature_m();
            let count = n_single.min(frames.len());
            let alone = ShapeConfig { least_frames: 1, ..config.clone() };
            for k in 0..count {
                let at = (2 * k + 1) * frames.len() / (2 * count);
                single.extend(fit_shape(
                    &model,
                    &walk.camera,
                    &frames[at..=at],
                    walk.rate_hz,
                    stature_m,
                    &alone,
                ));
            }
            whole = Some(fit);
        }
        if let Ok(mut progress) = progress.lock() {
            progress.advance();
        }
        Ok(PersonFit { person, motion: walk.motion, fit: whole, single, seconds })
    };
    people.par_iter().map(fit).collect()
}

impl PersonFit {
    /// The recorded person: the part of the recording's name before the number of the trial, as in `35_02`.
    pub fn walker(&self) -> &str {
        self.motion.split('_').next().unwrap_or(&self.motion)
    }
}

/// `count` people of `candidates`, spread over them, as many women as men.
pub fn choose_people(truths: &[Truth], candidates: &[usize], count: usize) -> Vec<usize> {
    let of_sex = |sex: Sex, count: usize| -> Vec<usize> {
        let all: Vec<usize> =
            candidates.iter().copied().filter(|&person| truths[person].sex == sex).collect();
        let count = count.min(all.len());
        (0..count).map(|k| all[k * all.len() / count]).collect()
    };
    let mut people = of_sex(Sex::Male, count.div_ceil(2));
    people.extend(of_sex(Sex::Female, count / 2));
    people.sort_unstable();
    people
}
