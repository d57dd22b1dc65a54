//! People who walk, and the bodies that the program finds for them.

use std::path::Path;
use std::sync::Arc;

use anyhow::ensure;
use body::pose_prior::PosePrior;
use body::{BodyModel, Sex};
use rayon::prelude::*;
use silhouette::Mask;

use crate::predict::Activity;
use crate::progress::Progress;
use crate::shape::{ShapeConfig, ShapeFit, fit_shape, fitted_as, light_tracking, shape_from_masks};
use crate::synth::{Studio, Truth, Walks, performer_of};
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

/// A performer as the program meets people in the world: what it holds for likely poses was learned from others.
pub struct Walker {
    /// The performer's walks.
    recordings: Walks,
    prior_of_others: Arc<PosePrior>,
}

/// The performers in `motions` who walk and trained nothing, under the prior that the program ships.
///
/// # Errors
/// When the recordings cannot be read.
pub fn new_walkers(motions: &Path, activity: Activity) -> anyhow::Result<Vec<Walker>> {
    let prior_of_others = ShapeConfig::of(activity).pose_prior;
    let performers = Walks::read(motions, &["validate"])?.by_performer().into_values();
    Ok(performers.map(|recordings| Walker { recordings, prior_of_others: prior_of_others.clone() }).collect())
}

/// The performers of the training recordings in `motions` who walk, each under a prior learned without them.
///
/// # Errors
/// When the recordings cannot be read, or are of one performer.
pub fn training_walkers(motions: &Path, activity: Activity) -> anyhow::Result<Vec<Walker>> {
    let all = Recordings::read(motions)?;
    let performers = Walks::read(motions, &["train"])?.by_performer();
    ensure!(performers.len() >= 2, "{}: one person walks, expected two at least", motions.display());
    let walker = |(name, recordings): (String, Walks)| -> anyhow::Result<Walker> {
        let prior_of_others = Arc::new(all.without(&[name]).prior(fitted_as(activity))?);
        Ok(Walker { recordings, prior_of_others })
    };
    performers.into_iter().map(walker).collect()
}

/// People who walk before a camera and are fitted.
pub struct WalkTest<'a> {
    /// Who, and before which cameras.
    pub studio: &'a Studio,
    /// As whom they walk: in turn.
    pub walkers: &'a [Walker],
    /// Of the walks.
    pub seed: u64,
    /// Settings of the fits, up to the prior on poses.
    pub config: &'a ShapeConfig,
    /// Frames of each walk that are fitted alone.
    pub n_single: usize,
}

impl WalkTest<'_> {
    /// Tracks and fits each of `people`; in this order.
    ///
    /// # Errors
    /// When a recording does not fit.
    pub fn fit(&self, people: &[usize]) -> anyhow::Result<Vec<PersonFit>> {
        let model = BodyModel::builtin();
        let progress = std::sync::Mutex::new(Progress::start("people", 0, Some(people.len() as u64)));
        let places = people.par_iter().enumerate();
        places
            .map(|(place, &person)| {
                let found = self.fit_person(&model, person, &self.walkers[place % self.walkers.len()]);
                if let Ok(mut progress) = progress.lock() {
                    progress.advance();
                }
                found
            })
            .collect()
    }

    fn fit_person(&self, model: &BodyModel, person: usize, walker: &Walker) -> anyhow::Result<PersonFit> {
        let walk = self.studio.walk(&walker.recordings, person, self.seed)?;
        let config = ShapeConfig { pose_prior: walker.prior_of_others.clone(), ..self.config.clone() };
        let masks: Vec<&Mask> = walk.frames.iter().map(|frame| &frame.observed).collect();
        let started = std::time::Instant::now();
        let found = shape_from_masks(model, &walk.camera, &masks, walk.rate_hz, &light_tracking(), &config)?;
        let seconds = started.elapsed().as_secs_f64();
        let (mut whole, mut single) = (None, Vec::new());
        if let Some((fit, frames)) = found {
            let stature_m = model.shape(&fit.shape).stature_m();
            let count = self.n_single.min(frames.len());
            let alone = ShapeConfig { least_frames: 1, ..config };
            for k in 0..count {
                let at = (2 * k + 1) * frames.len() / (2 * count);
                let frame = &frames[at..=at];
                single.extend(fit_shape(model, &walk.camera, frame, walk.rate_hz, stature_m, &alone));
            }
            whole = Some(fit);
        }
        Ok(PersonFit { person, motion: walk.motion, fit: whole, single, seconds })
    }
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
    fn a_prior_knows_nothing_of_the_walker_it_is_for() {
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
        let found = training_walkers(&motions, Activity::Any).unwrap();
        let shipped = PosePrior::builtin();
        let mut names = Vec::new();
        for Walker { recordings, prior_of_others } in &found {
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
