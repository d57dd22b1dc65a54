//! `umbra eval stage`: trackers on a stage-like data set, in the layout of Table 1 of `[Kanaujia2014]`.
//!
//! Every sequence is tracked on its test frames from the tracker's own start. Poses, dynamics and predictors are learned
//! from the training frames of the same sequence, or nothing is learned at all (`none`): then the models that the program
//! ships are scored on people they have not seen.

mod recovery;
pub mod score;
mod table;

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context as _, bail, ensure};
use body::pose_prior::{PosePrior, PosePriorConfig};
use body::{Body, BodyModel};
use rayon::prelude::*;
use serde::Serialize;
use silhouette::Mask;

pub use self::recovery::RecoveryRow;
use self::score::{TrackErrors, TrueFrame, moving_dofs, score};
pub use self::table::table;
use super::joint_error::mean;
use super::write_json;
use crate::config::{ExecConfig, Method, TrackConfig, TrackParams};
use crate::predict::{Activity, ActivityModel, PosePredictor, TransitionPredictor};
use crate::progress::Progress;
use crate::run_folder::FrameRecord;
use crate::shape::{ShapeConfig, Told, light_tracking, shape_from_masks};
use crate::stage::{FittedSequence, Sequence, fit_sequence, personal_joints};
use crate::track::follower::Follower;
use crate::track::pose_model::{FreeJoints, PoseModel, pose_model};
use crate::track::refine::Refiner;
use crate::track::tracker::Scene;
use crate::train::{
    Recordings, STATURE_SD_M, TrainConfig, TrainingFrames, first_markers, sequence_masks, train_on_sequence,
    train_transitions,
};

/// Masks beyond the current one that a tracker is shown.
const LOOK_AHEAD: usize = 12;
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
    /// Test frames of each sequence; all when absent.
    pub frames: Option<usize>,
    /// Where `eval.json` goes.
    pub out: PathBuf,
    /// Settings of every run, but for the seed, the stature and the motions expected.
    pub config: TrackConfig,
    /// Threads.
    pub exec: ExecConfig,
}

/// One line of the table: means over seeds and their spread (standard deviation).
#[derive(Clone, Debug, Serialize)]
pub struct StageRow {
    /// Subject.
    pub subject: String,
    /// Activity.
    pub activity: String,
    /// Camera.
    pub camera: String,
    /// Tracker.
    pub method: Method,
    /// Kind of masks.
    pub masks: String,
    /// Means over seeds.
    #[serde(flatten)]
    pub mean: TrackErrors,
    /// Standard deviations over seeds.
    pub spread: TrackErrors,
    /// Each seed.
    pub seeds: Vec<SeedErrors>,
}

/// The errors of one run.
#[derive(Clone, Debug, Serialize)]
pub struct SeedErrors {
    /// Means over frames.
    #[serde(flatten)]
    pub mean: TrackErrors,
    /// The root-relative error of each frame, mm.
    pub frames_root_mm: Vec<f64>,
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
    pool.install(|| run(eval))
}

fn run(eval: &StageEval) -> anyhow::Result<StageReport> {
    let sequences = asked_for(eval)?;
    let recordings = match eval.train {
        TrainOn::Others => Some(recordings(eval)?),
        TrainOn::Sequence | TrainOn::None => None,
    };
    let mut progress = Progress::start("fitting the truth", 0, Some(sequences.len() as u64));
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
    let mut progress = Progress::start("tracking", 0, Some(jobs.len() as u64));
    let mut rows = Vec::new();
    for (index, camera, kind) in jobs {
        rows.extend(prepared[index].rows(eval, camera, kind)?);
        progress.advance();
    }
    let mut recovery = Vec::new();
    if eval.recovery {
        let mut progress = Progress::start("recovering", 0, Some(prepared.len() as u64));
        for prepared in &prepared {
            recovery.extend(recovery::study(prepared, eval)?);
            progress.advance();
        }
    }
    let report = StageReport {
        data: eval.data.clone(),
        recovery,
        train: eval.train,
        fit_residual_mm: prepared
            .iter()
            .map(|prepared| (prepared.sequence.title(), 1000.0 * prepared.truth.residual_m))
            .collect(),
        rows,
    };
    write_json(&eval.out, &report)?;
    Ok(report)
}

/// The settings of every run unless others are asked for: one filter of 200 particles and 10 layers, as in the paper. Poses of
/// other people who do the same have to be widened a little, those of the person themselves hardly.
pub fn default_config(train: TrainOn) -> TrackConfig {
    let config = TrackConfig { modes: 1, ..TrackConfig::default() };
    match train {
        TrainOn::Sequence => TrackConfig {
            prior_widening: 1.1,
            least_sd: 0.005,
            least_step: 0.0005,
            frees_clavicles: false,
            ..config
        },
        TrainOn::Others | TrainOn::None => Activity::Walk.over(config),
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

/// The records of the frames of `range`; `masks` are those of all frames.
fn follow(
    follower: &mut Follower,
    masks: &[Mask],
    range: std::ops::Range<usize>,
) -> anyhow::Result<Vec<FrameRecord>> {
    let mut records = Vec::with_capacity(range.len());
    for frame in range {
        let window: Vec<&Mask> = masks[frame..].iter().take(LOOK_AHEAD).collect();
        records.extend(follower.step(frame as u64, &window)?);
    }
    Ok(records)
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

impl Prepared {
    fn new(sequence: Sequence, recordings: Option<&Recordings>, eval: &StageEval) -> anyhow::Result<Self> {
        let test = sequence.test.start
            ..sequence.test.start + eval.frames.unwrap_or(usize::MAX).min(sequence.test.len());
        let config = TrainConfig::default();
        let (body, prior, predictor, transitions): (Body, _, _, _) = match (eval.train, recordings) {
            (TrainOn::Sequence, _) => {
                let frames = TrainingFrames::read(&sequence, MAIN_CAMERA, "observed")?;
                let predictor = predictor_of(&frames, &config, eval)?;
                let prior_config = PosePriorConfig { mirror: false, ..PosePriorConfig::default() };
                let prior = PosePrior::learn(std::slice::from_ref(&frames.motion.motion), "", &prior_config)
                    .with_context(|| {
                        format!("{}: cannot learn from the training frames", sequence.folder.display())
                    })?;
                let transitions = match eval.methods.contains(&Method::Opf) {
                    true => Some(Arc::new(train_transitions(&frames, &predictor, &config)?)),
                    false => None,
                };
                let body = BodyModel::builtin().shape(&frames.shape);
                (body, prior, Some(Arc::new(predictor)), transitions)
            }
            (_, None) => {
                let ActivityModel { prior, predictor } =
                    ActivityModel::builtin(Activity::called(&sequence.activity));
                (body_from_masks(&sequence, &test)?, prior, Some(Arc::new(predictor)), None)
            }
            (_, Some(recordings)) => {
                let others = recordings.without(&sequence.performers);
                let activity = match Activity::called(&sequence.activity) {
                    activity if others.show(activity) => activity,
                    _ => Activity::Any,
                };
                let predictor = predictor_of_others(&sequence, &others, activity, eval)?;
                let body = body_from_masks(&sequence, &test)?;
                (body, others.prior(activity)?, Some(Arc::new(predictor)), None)
            }
        };
        let params = TrackParams::new(eval.config.clone())?;
        let model = pose_model(&prior, &params);
        let refiner = Arc::new(Refiner::new(&body, FreeJoints::new(&prior, params.widening())));
        let rest = personal_joints(body.rest_joints(), &first_markers(&sequence, &test)?);
        let truth = fit_sequence(&sequence, test, rest, false);
        let moving_dofs = moving_dofs(&truth.motion);
        Ok(Self {
            body: Arc::new(body),
            truth,
            moving_dofs,
            model,
            predictor,
            transitions,
            refiner,
            sequence,
        })
    }

    /// The rows of one camera and kind of masks: one for each tracker.
    fn rows(&self, eval: &StageEval, camera: &str, kind: &str) -> anyhow::Result<Vec<StageRow>> {
        let masks = self.masks(camera, kind)?;
        let runs: Vec<(Method, u64)> =
            eval.methods.iter().flat_map(|method| (1..=eval.seeds).map(|seed| (*method, seed))).collect();
        let errors: Vec<SeedErrors> = runs
            .into_par_iter()
            .map(|(method, seed)| {
                let config = TrackConfig { seed, method, ..eval.config.clone() };
                let records = self.track(config, camera, &masks)?;
                let frames_root_mm = (0..records.len())
                    .filter(|frame| self.sequence.markers[self.sequence.test.start + frame].is_some())
                    .map(|frame| self.score_from(&records[frame..=frame], frame).root_mm)
                    .collect();
                Ok(SeedErrors { mean: self.score_from(&records, 0), frames_root_mm })
            })
            .collect::<anyhow::Result<_>>()?;
        let by_method = eval.methods.iter().zip(errors.chunks(eval.seeds as usize));
        let rows = by_method.map(|(method, seeds)| {
            let (mean, spread) = mean_and_spread(seeds);
            StageRow {
                subject: self.sequence.subject.clone(),
                activity: self.sequence.activity.clone(),
                camera: camera.to_owned(),
                method: *method,
                masks: kind.to_owned(),
                mean,
                spread,
                seeds: seeds.to_vec(),
            }
        });
        Ok(rows.collect())
    }

    fn n_frames(&self) -> usize {
        self.truth.motion.poses.len()
    }

    /// The masks of the test frames.
    fn masks(&self, camera: &str, kind: &str) -> anyhow::Result<Vec<Mask>> {
        let start = self.sequence.test.start;
        sequence_masks(&self.sequence, camera, kind, &(start..start + self.n_frames()))
    }

    /// A follower of the person before `camera` that has seen nothing yet.
    fn follower(&self, config: TrackConfig, camera: &str) -> anyhow::Result<Follower> {
        let config = TrackConfig { stature_m: Some(self.sequence.stature_m), ..config };
        Ok(Follower::new(Scene {
            body: self.body.clone(),
            camera: self.sequence.camera(camera)?,
            model: self.model.clone(),
            predictor: self.predictor.clone(),
            transitions: self.transitions.clone(),
            refiner: Some(self.refiner.clone()),
            fps: self.sequence.fps,
            params: TrackParams::new(config)?,
        }))
    }

    fn track(&self, config: TrackConfig, camera: &str, masks: &[Mask]) -> anyhow::Result<Vec<FrameRecord>> {
        let mut follower = self.follower(config, camera)?;
        let records = follow(&mut follower, masks, 0..masks.len())?;
        ensure!(
            records.len() == masks.len(),
            "{}: nobody was seen on {} frames",
            self.sequence.folder.display(),
            masks.len() - records.len()
        );
        Ok(records)
    }

    /// The errors of `records`, the first of which is about test frame `first`.
    fn score_from(&self, records: &[FrameRecord], first: usize) -> TrackErrors {
        let (mut kept, mut truth) = (Vec::new(), Vec::new());
        for (index, record) in (first..).zip(records) {
            let frame = self.sequence.test.start + index;
            if let Some(markers) = &self.sequence.markers[frame] {
                kept.push(record.clone());
                truth.push(TrueFrame {
                    markers,
                    rotations: &self.sequence.rotations[frame],
                    fitted: &self.truth.motion.poses[index],
                });
            }
        }
        score(&kept, &truth, self.body.rest_joints(), &self.moving_dofs)
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

/// The predictor of a sequence: the one in the folder of models, or a new one, which goes there.
fn predictor_of(
    frames: &TrainingFrames<'_>,
    config: &TrainConfig,
    eval: &StageEval,
) -> anyhow::Result<PosePredictor> {
    let Some(folder) = &eval.models else { return train_on_sequence(frames, config) };
    let path = folder.join(frames.sequence.model_file_name());
    if path.is_file() {
        return PosePredictor::read(&path);
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
    let config = TrainConfig::for_people_at_large();
    let Some(folder) = &eval.models else { return others.predictor(activity, &config) };
    let without = sequence.performers.join("-");
    let path = folder.join(format!("predict-{}-without-{without}.bin", activity.name()));
    if path.is_file() {
        return PosePredictor::read(&path);
    }
    let predictor = others.predictor(activity, &config)?;
    predictor.write(&path)?;
    Ok(predictor)
}

fn mean_and_spread(seeds: &[SeedErrors]) -> (TrackErrors, TrackErrors) {
    let over = |figure: fn(&TrackErrors) -> f64| {
        let average = mean(seeds.iter().map(|seed| figure(&seed.mean)));
        let variance = seeds.iter().map(|seed| (figure(&seed.mean) - average).powi(2)).sum::<f64>();
        (average, (variance / (seeds.len().max(2) - 1) as f64).sqrt())
    };
    let figures: [(f64, f64); 7] = [
        over(|e| e.root_mm),
        over(|e| e.abs_mm),
        over(|e| e.aligned_mm),
        over(|e| e.euler_deg),
        over(|e| e.geodesic_deg),
        over(|e| e.lost),
        over(|e| e.far_off),
    ];
    let errors = |pick: fn(&(f64, f64)) -> f64| {
        let [root_mm, abs_mm, aligned_mm, euler_deg, geodesic_deg, lost, far_off] =
            [0, 1, 2, 3, 4, 5, 6].map(|i| pick(&figures[i]));
        TrackErrors { root_mm, abs_mm, aligned_mm, euler_deg, geodesic_deg, lost, far_off }
    };
    (errors(|f| f.0), errors(|f| f.1))
}
