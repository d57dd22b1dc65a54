//! `umbra eval stage`: trackers on a stage-like data set, in the layout of Table 1 of `[Kanaujia2014]`.
//!
//! Every sequence is tracked on its test frames from the tracker's own start. Poses, dynamics and predictors are learned
//! from the training frames of the same sequence, or nothing is learned at all (`none`): then the models that the program
//! ships are scored on people they have not seen.

mod coverage;
mod plots;
mod recovery;
mod results;
mod rows;
pub mod score;
mod table;
mod updates;

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context as _, bail, ensure};
use body::pose_prior::{PosePrior, PosePriorConfig};
use body::{Body, BodyModel};
use serde::Serialize;
use silhouette::Mask;

use self::coverage::Associations;
pub use self::recovery::RecoveryRow;
pub use self::results::ResultsFile;
pub use self::rows::{SeedErrors, StageRow};
use self::score::moving_dofs;
pub use self::table::table;
pub use self::updates::UpdatesRow;
use super::write_json;
use crate::config::{ExecConfig, Method, Motion, TrackConfig, TrackParams};
use crate::predict::{Activity, LatentPoses, PosePredictor, TransitionPredictor};
use crate::progress::{Progress, note};
use crate::shape::{ShapeConfig, Told, light_tracking, shape_from_masks};
use crate::stage::{FittedSequence, Sequence, fit_sequence, personal_joints};
use crate::track::pose_model::{FreeJoints, PoseModel, pose_model};
use crate::track::refine::Refiner;
use crate::train::{
    DescriptorKind, Recordings, STATURE_SD_M, TrainConfig, TrainingFrames, first_markers, kept_predictor,
    notice_of, sequence_masks, train_on_sequence, train_transitions,
};

/// The camera of most rows.
const MAIN_CAMERA: &str = "C2";
/// The row of the other view: subject, activity and camera.
const OTHER_VIEW: (&str, &str, &str) = ("S2", "Jog", "C3");

/// What the trackers learn from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum TrainOn {
    /// The training frames of the sequence itself.
    Sequence,
    /// Other people who do the same: the recipe of the models that the program ships, without the people whose motion the
    /// sequence shows.
    Others,
    /// Nothing: the models that the program ships.
    None,
}

/// What to evaluate.
#[derive(Clone, Debug)]
pub struct StageEval {
    /// The data set.
    pub data: PathBuf,
    /// Subjects; all when empty.
    pub subjects: Vec<String>,
    /// Activities; all when empty.
    pub activities: Vec<String>,
    /// Kinds of masks: `observed`, `clean`.
    pub masks: Vec<String>,
    /// Trackers.
    pub methods: Vec<Method>,
    /// What is learned from.
    pub train: TrainOn,
    /// What describes a mask to predictors that are trained.
    pub descriptor: DescriptorKind,
    /// Whether to test on the last of the training frames and train on those before them: for tuning.
    pub validate: bool,
    /// The folder of recorded motion, for [`TrainOn::Others`].
    pub recordings: Option<PathBuf>,
    /// Where predictors that are trained are kept, and taken from where they are there.
    pub models: Option<PathBuf>,
    /// Number of seeds, 1, 2, and so on.
    pub seeds: u64,
    /// Whether to study what becomes of a pose that is suddenly wrong.
    pub recovery: bool,
    /// Whether to study what predictors learn from the tracker.
    pub updates: bool,
    /// Test frames of each sequence; all when absent.
    pub frames: Option<usize>,
    /// Where `eval.json` and the plots go.
    pub out: PathBuf,
    /// A Markdown file whose tables are replaced, and the command that stands above them.
    pub results: Option<ResultsFile>,
    /// Settings of every run, but for the seed, the stature and the motions expected.
    pub config: TrackConfig,
    /// Threads.
    pub exec: ExecConfig,
}

impl StageEval {
    /// How predictors are trained.
    fn training(&self) -> TrainConfig {
        TrainConfig { descriptor: self.descriptor, ..TrainConfig::default() }
    }
}

/// What `eval.json` holds.
#[derive(Clone, Debug, Serialize)]
pub struct StageReport {
    /// The data set.
    pub data: PathBuf,
    /// What was learned from.
    pub train: TrainOn,
    /// Mean distance of our skeleton's joints from the true ones after its fit to them, mm, by sequence.
    pub fit_residual_mm: Vec<(String, f64)>,
    /// The table.
    pub rows: Vec<StageRow>,
    /// What becomes of a pose that is suddenly wrong, where it was asked for.
    pub recovery: Vec<RecoveryRow>,
    /// Multimodality of the training examples, sum over sequences: weight of the clusters of masks that go with n clusters of
    /// poses, at index n - 1.
    pub multimodality: Vec<f64>,
    /// How predictors fare that learn from the tracker, where it was asked for.
    pub updates: Vec<UpdatesRow>,
}

/// Runs the evaluation, writes `eval.json` and returns the report.
///
/// # Errors
/// When the data cannot be read, a run fails, or the results cannot be written.
pub fn evaluate(eval: &StageEval) -> anyhow::Result<StageReport> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(eval.exec.threads)
        .build()
        .with_context(|| format!("cannot start {} threads", eval.exec.threads))?;
    if let Some(frames) = eval.frames.filter(|frames| eval.recovery && *frames < recovery::N_FRAMES) {
        bail!("`frames` is {frames}, expected {} or more for `recovery`", recovery::N_FRAMES);
    }
    let eval = StageEval { methods: possible_methods(eval)?, ..eval.clone() };
    pool.install(|| run(&eval))
}

/// The trackers that can be made of what is learned from; `opf` is what a sequence teaches of the next pose.
fn possible_methods(eval: &StageEval) -> anyhow::Result<Vec<Method>> {
    let is_possible = |method: &Method| eval.train == TrainOn::Sequence || *method != Method::Opf;
    let methods: Vec<Method> = eval.methods.iter().copied().filter(is_possible).collect();
    ensure!(
        !methods.is_empty(),
        "`methods` is opf, expected apf, jpf or jlm with `--train none` or `others`"
    );
    if methods.len() < eval.methods.len() {
        note("opf is left out: it needs what the sequence itself teaches of the next pose");
    }
    Ok(methods)
}

fn run(eval: &StageEval) -> anyhow::Result<StageReport> {
    if let Some(results) = &eval.results {
        results::check(results, eval)?;
    }
    let sequences = asked_for(eval)?;
    let recordings = match eval.train {
        TrainOn::Others => Some(recordings(eval)?),
        TrainOn::Sequence | TrainOn::None => None,
    };
    let mut progress = Progress::start("sequences prepared", 0, Some(sequences.len() as u64));
    let mut prepared = Vec::new();
    for sequence in sequences {
        prepared.push(Prepared::new(sequence, recordings.as_ref(), eval)?);
        progress.advance();
    }
    let mut jobs = Vec::new();
    for (index, prepared) in prepared.iter().enumerate() {
        for camera in cameras_of(&prepared.sequence) {
            for kind in &eval.masks {
                jobs.push((index, camera, kind.as_str()));
            }
        }
    }
    let associations: Vec<Option<Associations>> =
        prepared.iter().map(|prepared| Associations::of(prepared, eval)).collect::<anyhow::Result<_>>()?;
    let mut progress = Progress::start("views tracked", 0, Some(jobs.len() as u64));
    let mut rows = Vec::new();
    for (index, camera, kind) in jobs {
        rows.extend(prepared[index].rows(eval, camera, kind, associations[index].as_ref())?);
        progress.advance();
    }
    let mut recovery = Vec::new();
    if eval.recovery {
        let mut progress = Progress::start("sequences with wrong poses", 0, Some(prepared.len() as u64));
        for prepared in &prepared {
            recovery.extend(recovery::study(prepared, eval)?);
            progress.advance();
        }
    }
    let mut updates = Vec::new();
    if eval.updates {
        let mut progress = Progress::start("sequences learned on", 0, Some(prepared.len() as u64));
        for prepared in &prepared {
            updates.extend(updates::study(prepared, eval)?);
            progress.advance();
        }
    }
    let report = StageReport {
        data: eval.data.clone(),
        recovery,
        updates,
        multimodality: coverage::histogram(associations.iter().flatten()),
        train: eval.train,
        fit_residual_mm: prepared
            .iter()
            .map(|prepared| (prepared.sequence.title(), 1000.0 * prepared.truth.residual_m))
            .collect(),
        rows,
    };
    write_json(&eval.out, &report)?;
    plots::write(&eval.out, &report)?;
    if let Some(results) = &eval.results {
        results::write(results, eval, &report)?;
    }
    Ok(report)
}

/// The settings of every run unless others are asked for: those of somebody who does a known thing, with one filter of 200
/// particles and 10 layers, as in the paper. Poses of the person themselves hardly have to be widened.
pub fn default_config(train: TrainOn) -> TrackConfig {
    let config = Activity::Walk.over(TrackConfig { modes: 1, ..TrackConfig::default() });
    match train {
        TrainOn::Sequence => TrackConfig { least_sd: 0.005, least_step: 0.0005, ..config },
        TrainOn::Others | TrainOn::None => config,
    }
}

/// The sequences of the subjects and activities that are asked for.
fn asked_for(eval: &StageEval) -> anyhow::Result<Vec<Sequence>> {
    let all = Sequence::read_all(&eval.data)?;
    let check = |field: &str, asked: &[String], name: fn(&Sequence) -> &str| -> anyhow::Result<()> {
        let known: BTreeSet<&str> = all.iter().map(name).collect();
        match asked.iter().find(|asked| !known.contains(asked.as_str())) {
            None => Ok(()),
            Some(unknown) => {
                let known: Vec<&str> = known.into_iter().collect();
                bail!(
                    "{}: `{field}` has {unknown}, expected some of {}",
                    eval.data.display(),
                    known.join(", ")
                )
            }
        }
    };
    check("subjects", &eval.subjects, |sequence| &sequence.subject)?;
    check("activities", &eval.activities, |sequence| &sequence.activity)?;
    let is_asked = |asked: &[String], name: &String| asked.is_empty() || asked.contains(name);
    let is_kept = |sequence: &Sequence| {
        is_asked(&eval.subjects, &sequence.subject) && is_asked(&eval.activities, &sequence.activity)
    };
    let kept = all.into_iter().filter(is_kept);
    Ok(match eval.validate {
        true => kept.map(Sequence::for_validation).collect(),
        false => kept.collect(),
    })
}

/// The cameras of a sequence's rows.
fn cameras_of(sequence: &Sequence) -> Vec<&str> {
    let (subject, activity, camera) = OTHER_VIEW;
    let mut cameras = Vec::new();
    if sequence.cameras.iter().any(|name| name == MAIN_CAMERA) {
        cameras.push(MAIN_CAMERA);
    } else {
        cameras.extend(sequence.cameras.first().map(String::as_str));
    }
    if sequence.subject == subject
        && sequence.activity == activity
        && sequence.cameras.iter().any(|name| name == camera)
    {
        cameras.push(camera);
    }
    cameras
}

/// A sequence with what its trackers are made of and scored against.
struct Prepared {
    sequence: Sequence,
    /// Our skeleton on the test frames.
    truth: FittedSequence,
    /// The joint angles that are compared.
    moving_dofs: Vec<usize>,
    body: Arc<Body>,
    model: Arc<dyn PoseModel>,
    predictor: Option<Arc<PosePredictor>>,
    transitions: Option<Arc<TransitionPredictor>>,
    refiner: Arc<Refiner>,
}

/// What the trackers of a sequence are made of.
struct Learned {
    body: Body,
    prior: PosePrior,
    /// Where the settings ask for it.
    latent: Option<LatentPoses>,
    predictor: Option<PosePredictor>,
    transitions: Option<Arc<TransitionPredictor>>,
}

impl Prepared {
    fn new(sequence: Sequence, recordings: Option<&Recordings>, eval: &StageEval) -> anyhow::Result<Self> {
        let test = sequence.test.start
            ..sequence.test.start + eval.frames.unwrap_or(usize::MAX).min(sequence.test.len());
        let params = TrackParams::new(eval.config.clone())?;
        let needs_latent = params.motion == Motion::Latent;
        let Learned { body, prior, latent, predictor, transitions } = match (eval.train, recordings) {
            (TrainOn::Sequence, _) => {
                let config = eval.training();
                let frames = TrainingFrames::read(&sequence, MAIN_CAMERA, "observed")?;
                let predictor = predictor_of(&frames, &config, eval)?;
                let prior_config = PosePriorConfig { mirror: false, ..PosePriorConfig::default() };
                let motions = std::slice::from_ref(&frames.motion.motion);
                let cannot_learn =
                    || format!("{}: cannot learn from the training frames", sequence.folder.display());
                let prior = PosePrior::learn(motions, "", &prior_config).with_context(cannot_learn)?;
                let fit_latent = || LatentPoses::fit(motions, params.components as usize, false, "");
                let latent = needs_latent.then(fit_latent).transpose().with_context(cannot_learn)?;
                let transitions = match eval.methods.contains(&Method::Opf) {
                    true => Some(Arc::new(train_transitions(&frames, &predictor, &config)?)),
                    false => None,
                };
                let body = BodyModel::builtin().shape(&frames.shape);
                Learned { body, prior, latent, predictor: Some(predictor), transitions }
            }
            (_, None) => {
                let activity = Activity::called(&sequence.activity);
                Learned {
                    body: body_from_masks(&sequence, &test)?,
                    prior: activity.prior(),
                    latent: needs_latent.then(|| activity.latent()),
                    predictor: shipped_predictor(&sequence, activity)?,
                    transitions: None,
                }
            }
            (_, Some(recordings)) => {
                let others = recordings.without(&sequence.performers);
                let activity = match Activity::called(&sequence.activity) {
                    activity if others.show(activity) => activity,
                    _ => Activity::Any,
                };
                Learned {
                    body: body_from_masks(&sequence, &test)?,
                    prior: others.prior(activity)?,
                    latent: needs_latent.then(|| others.latent(activity, activity.n_latent())).transpose()?,
                    predictor: Some(predictor_of_others(&sequence, &others, activity, eval)?),
                    transitions: None,
                }
            }
        };
        let model =
            pose_model(&prior, || latent.context("latent poses were not learned, expected some"), &params)?;
        let refiner = Arc::new(Refiner::new(&body, FreeJoints::new(&prior, params.widening())));
        let rest = personal_joints(body.rest_joints(), &first_markers(&sequence, &test)?);
        let truth = fit_sequence(&sequence, test, rest, false);
        let moving_dofs = moving_dofs(&truth.motion);
        Ok(Self {
            body: Arc::new(body),
            truth,
            moving_dofs,
            model,
            predictor: predictor.map(Arc::new),
            transitions,
            refiner,
            sequence,
        })
    }
}

/// The body that the masks of `range` show before the main camera, as tall as the subject is; where they do not tell, the most
/// probable one of that stature.
fn body_from_masks(sequence: &Sequence, range: &std::ops::Range<usize>) -> anyhow::Result<Body> {
    let model = BodyModel::builtin();
    let camera = cameras_of(sequence)[0];
    let masks = sequence_masks(sequence, camera, "observed", range)?;
    let masks: Vec<&Mask> = masks.iter().collect();
    let camera = sequence.camera(camera)?;
    let (track, config) = (light_tracking(), ShapeConfig::default());
    let told = [Told { length_m: sequence.stature_m, sd_m: STATURE_SD_M }];
    Ok(match shape_from_masks(&model, &camera, &masks, sequence.fps, &track, &config)? {
        Some((fit, _)) => model.shape(&fit.given(&model, &told, |body| vec![body.stature_m()])),
        None => model.shape_for_stature(sequence.stature_m, None),
    })
}

/// The predictor that the program ships for an activity; none, said aloud, where it was not trained for such a camera.
fn shipped_predictor(sequence: &Sequence, activity: Activity) -> anyhow::Result<Option<PosePredictor>> {
    let predictor = activity.predictor();
    let height_m = sequence.camera(cameras_of(sequence)[0])?.centre_world().z;
    Ok(match predictor.training().check(height_m, activity.name()) {
        Ok(()) => Some(predictor),
        Err(reason) => {
            note(&format!("{}: nothing of the pose from a single mask: {reason}", sequence.title()));
            None
        }
    })
}

/// The predictor of a sequence: the one in the folder of models, or a new one, which goes there.
fn predictor_of(
    frames: &TrainingFrames<'_>,
    config: &TrainConfig,
    eval: &StageEval,
) -> anyhow::Result<PosePredictor> {
    let Some(folder) = &eval.models else { return train_on_sequence(frames, config) };
    let path = folder.join(frames.sequence.model_file_name());
    if path.is_file() {
        return kept_predictor(&path, &notice_of(frames), eval.descriptor);
    }
    let predictor = train_on_sequence(frames, config)?;
    predictor.write(&path)?;
    Ok(predictor)
}

/// Recorded motion of people at large, with that of the training frames of all sequences of the data set.
fn recordings(eval: &StageEval) -> anyhow::Result<Recordings> {
    let folder =
        eval.recordings.as_ref().context("`recordings` is not given, expected a folder of motion")?;
    let mut recordings = Recordings::read(folder)?;
    recordings.add_stage(&Sequence::read_all(&eval.data)?, MAIN_CAMERA)?;
    Ok(recordings)
}

/// The predictor of an activity learned from `others` than the performers of the sequence: the one in the folder of models, or
/// a new one, which goes there.
fn predictor_of_others(
    sequence: &Sequence,
    others: &Recordings,
    activity: Activity,
    eval: &StageEval,
) -> anyhow::Result<PosePredictor> {
    let config = eval.training().for_people_at_large();
    let Some(folder) = &eval.models else { return others.predictor(activity, &config) };
    let without = sequence.performers.join("-");
    let path = folder.join(format!("predict-{}-without-{without}.bin", activity.name()));
    if path.is_file() {
        return kept_predictor(&path, &others.notice(), eval.descriptor);
    }
    let predictor = others.predictor(activity, &config)?;
    predictor.write(&path)?;
    Ok(predictor)
}
