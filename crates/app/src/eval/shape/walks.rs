//! People who walk, and the bodies that the program finds for them.

use std::path::Path;
use std::sync::Arc;

use anyhow::ensure;
use body::pose_prior::PosePrior;
use body::{BodyModel, Sex};
use rayon::prelude::*;
use silhouette::Mask;

use crate::config::TrackConfig;
use crate::predict::Activity;
use crate::progress::Progress;
use crate::shape::{ShapeConfig, ShapeFit, fit_shape, shape_from_masks};
use crate::synth::{Studio, SyntheticWalk, Truth, Walks, performer_of};
use crate::train::Recordings;

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
    each(people, |person, _| fit_person(&model, &studio.walk(person, seed)?, track, config, n_single))
}

/// A performer as the program meets people in the world: what it holds for likely poses was learned from others.
pub struct Stranger {
    /// The performer's walks.
    recordings: Walks,
    /// Learned from everything that the others did.
    prior_of_others: Arc<PosePrior>,
}

/// The performers of the training recordings in `motions` who walk.
///
/// # Errors
/// When the recordings cannot be read, or are of one performer.
pub fn strangers(motions: &Path) -> anyhow::Result<Vec<Stranger>> {
    let all = Recordings::read(motions)?;
    let performers = Walks::read(motions, &["train"])?.by_performer();
    ensure!(performers.len() >= 2, "{}: one person walks, expected two at least", motions.display());
    let stranger = |(name, recordings): (String, Walks)| -> anyhow::Result<Stranger> {
        let prior = all.without(&[name]).prior(Activity::Any)?;
        Ok(Stranger { recordings, prior_of_others: Arc::new(prior) })
    };
    performers.into_iter().map(stranger).collect()
}

/// As [`fit_people`], but the people walk as `strangers` do, in turn, each fitted under the prior that has seen nothing of
/// this performer: so training people and motion tell what the program does to people who trained nothing.
///
/// # Errors
/// When a recording does not fit.
pub fn fit_as_strangers(
    studio: &Studio,
    strangers: &[Stranger],
    people: &[usize],
    seed: u64,
    track: &TrackConfig,
    config: &ShapeConfig,
    n_single: usize,
) -> anyhow::Result<Vec<PersonFit>> {
    let model = BodyModel::builtin();
    each(people, |person, place| {
        let Stranger { recordings, prior_of_others } = &strangers[place % strangers.len()];
        let walk = studio.walk_as(recordings, person, seed)?;
        let config = ShapeConfig { pose_prior: prior_of_others.clone(), ..config.clone() };
        fit_person(&model, &walk, track, &config, n_single)
    })
}

/// What `fit` finds of each person, who is also told their place among `people`; in this order.
fn each(
    people: &[usize],
    fit: impl Fn(usize, usize) -> anyhow::Result<PersonFit> + Sync,
) -> anyhow::Result<Vec<PersonFit>> {
    let progress = std::sync::Mutex::new(Progress::start("people", 0, Some(people.len() as u64)));
    let places = people.par_iter().enumerate();
    places
        .map(|(place, &person)| {
            let found = fit(person, place);
            if let Ok(mut progress) = progress.lock() {
                progress.advance();
            }
            found
        })
        .collect()
}

/// A person's walk tracked and fitted, and `n_single` of its frames fitted alone.
fn fit_person(
    model: &BodyModel,
    walk: &SyntheticWalk,
    track: &TrackConfig,
    config: &ShapeConfig,
    n_single: usize,
) -> anyhow::Result<PersonFit> {
    let masks: Vec<&Mask> = walk.frames.iter().map(|frame| &frame.observed).collect();
    let started = std::time::Instant::now();
    let found = shape_from_masks(model, &walk.camera, &masks, walk.rate_hz, track, config)?;
    let seconds = started.elapsed().as_secs_f64();
    let (mut whole, mut single) = (None, Vec::new());
    if let Some((fit, frames)) = found {
        let stature_m = model.shape(&fit.shape).stature_m();
        let count = n_single.min(frames.len());
        let alone = ShapeConfig { least_frames: 1, ..config.clone() };
        for k in 0..count {
            let at = (2 * k + 1) * frames.len() / (2 * count);
            let frame = &frames[at..=at];
            single.extend(fit_shape(model, &walk.camera, frame, walk.rate_hz, stature_m, &alone));
        }
        whole = Some(fit);
    }
    Ok(PersonFit { person: walk.person, motion: walk.motion.clone(), fit: whole, single, seconds })
}

impl PersonFit {
    /// The recorded person.
    pub fn walker(&self) -> &str {
        performer_of(&self.motion)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::eval::data_folder;
    use crate::synth::WalkConfig;
    use pf_core::rng::{Draw, Purpose, particle_rng};

    #[test]
    fn a_prior_knows_nothing_of_the_stranger_it_is_for() {
        let Ok(motions) = data_folder(None, "cmu") else {
            assert!(
                std::env::var_os("UMBRA_REQUIRE_DATA").is_none_or(|value| value != "1"),
                "no data folder"
            );
            println!("SKIPPED: no data folder");
            return;
        };
        let model = BodyModel::builtin();
        let rest = *model.mean().rest_joints();
        let found = strangers(&motions).unwrap();
        let shipped = PosePrior::builtin();
        let mut names = Vec::new();
        for Stranger { recordings, prior_of_others } in &found {
            let walked: Vec<String> = (0..8)
                .map(|k| {
                    let mut rng =
                        particle_rng(Draw { seed: 1, frame: 0, layer: 0, purpose: Purpose::User }, k);
                    let motion = recordings.walk(&rest, &WalkConfig::default(), &mut rng).unwrap();
                    performer_of(&motion.name).to_owned()
                })
                .collect();
            assert!(walked.iter().all(|name| *name == walked[0]), "{walked:?}");
            names.push(walked[0].clone());
            assert!(prior_of_others.n_poses() < shipped.n_poses());
            assert_ne!(prior_of_others.mean_rad(), shipped.mean_rad());
        }
        assert_eq!(names, ["02", "07", "08", "16", "35"]);
        // Boxing, sword play and washing are all of one performer: without them the arms stay low.
        let reach = |prior: &PosePrior| {
            let dof = body::Skeleton::human().dof_index("right_shoulder_elevation").unwrap();
            prior.range_rad()[dof][1]
        };
        assert!(reach(&found[0].prior_of_others) < reach(&shipped) - 0.2);
    }
}
