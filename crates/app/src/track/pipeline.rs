//! The road of a clip: frames, masks, tracker, run folder.

use std::collections::VecDeque;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, bail, ensure};
use body::{BodyModel, Camera};
use silhouette::Mask;

use super::camera_choice::CameraChoice;
use super::clip::{Background, ClipFrame, ClipInput, ClipReader};
use super::follower::Follower;
use super::pose_model::{FreeJoints, pose_model};
use super::refine::Refiner;
use super::tracker::Scene;
use crate::config::{ExecConfig, Method, TrackConfig, TrackParams};
use crate::predict::{Activity, PosePredictor};
use crate::progress::Progress;
use crate::run_folder::{Existing, FrameRecord, RunHeader, RunInput, RunWriter, Summary, WriteRunError};
use crate::shape::clip::stature_from;
use crate::shape::survey::survey;

/// Rate of a clip that does not say.
const DEFAULT_FPS: f64 = 60.0;
/// Masks beyond the current one that a start looks at.
const START_MASKS: usize = 12;
/// Frames from one checkpoint to the next.
const CHECKPOINT_EVERY: u64 = 10;

/// A run to be made.
#[derive(Clone, Debug)]
pub struct TrackJob {
    /// Where masks come from.
    pub input: ClipInput,
    /// The camera.
    pub camera: CameraChoice,
    /// The run folder.
    pub out: PathBuf,
    /// Settings.
    pub config: TrackConfig,
    /// The file of a predictor of poses; the one that the program ships when absent.
    pub predictor: Option<PathBuf>,
    /// Where the predictor goes with what it learned.
    pub save_predictor: Option<PathBuf>,
    /// What the person does.
    pub activity: Activity,
    /// Frames to track; all when absent.
    pub frames: Option<std::ops::Range<u64>>,
    /// Frames a second, where the input does not say.
    pub fps: Option<f64>,
    /// Leave source frames out of what is written.
    pub redact: bool,
    /// What to do with a run that is already there.
    pub existing: Existing,
}

/// No mask of the clip showed a person.
#[derive(Debug, thiserror::Error)]
#[error("{input}: none of the {frames} frames shows a person, expected a mask of one on at least one frame")]
pub struct NobodyFound {
    /// The input.
    pub input: String,
    /// Frames looked at.
    pub frames: u64,
}

/// What a run came to.
pub struct TrackOutcome {
    /// Every frame, in order.
    pub frames: Vec<FrameRecord>,
    /// What `summary.json` says of them.
    pub summary: Summary,
    /// The camera, at full resolution.
    pub camera: Camera,
    /// Frames a second of the whole job: reading the inputs, decoding, the start and the finished run folder included.
    pub fps: f64,
}

/// Tracks the person of a clip and writes the run folder.
///
/// # Errors
/// When an input cannot be used, the results cannot be written, or [nobody](NobodyFound) is on any frame. What was
/// computed before stays in the run folder for a resumed run.
pub fn track_clip(job: &TrackJob, exec: ExecConfig) -> anyhow::Result<TrackOutcome> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(exec.threads)
        .build()
        .with_context(|| format!("cannot start {} threads", exec.threads))?;
    pool.install(|| run(job))
}

fn run(job: &TrackJob) -> anyhow::Result<TrackOutcome> {
    let started = Instant::now();
    let params = TrackParams::new(job.config.clone())?;
    if params.method == Method::Opf {
        bail!(
            "settings: `method` is opf, expected apf, jpf or jlm: opf needs what a sequence teaches of the next pose, as `umbra eval stage` learns it"
        );
    }
    if let Some(path) = job.save_predictor.as_ref().filter(|path| path.is_dir()) {
        bail!("{}: is a folder, expected a file that the predictor can be saved to", path.display());
    }
    let reader = ClipReader::open(&job.input)?;
    let info = reader.info().clone();
    let known = job.camera.resolve(&info)?;
    let fps = job.fps.or(known.fps).or(info.fps).unwrap_or(DEFAULT_FPS);
    if !(fps > 0.0 && fps.is_finite()) {
        bail!("`fps` is {fps}, expected a number above 0");
    }
    let range = job.frames.clone().unwrap_or(0..u64::MAX);
    if let Some(n_frames) = info.n_frames.filter(|n_frames| range.start >= *n_frames) {
        bail!(
            "{}: `frames` begins at {}, expected less than {n_frames}, their number",
            info.path.display(),
            range.start
        );
    }
    let mut assumptions = known.assumptions;
    if let Some([before, after]) = &info.gap {
        assumptions.push(format!(
            "one frame after the other though {after} follows {before}: frames are counted in order"
        ));
    }
    let mut window = Window::new(reader, range.clone());
    window.fill();
    if let Some(share) = window.frames.front().map(|frame| share_of_person(&frame.mask))
        && share > LARGEST_SHARE
    {
        let percent = 100.0 * share;
        assumptions.push(format!(
            "a person who fills {percent:.0} % of the first picture, for so much is white in its mask"
        ));
    }
    let stature_m = params.stature_m.unwrap_or_else(|| {
        let (stature_m, source) = first_stature(&window, &known.camera, fps);
        assumptions.push(format!("a person {stature_m:.2} m tall, {source}"));
        stature_m
    });
    let predictor = predictor_for(job, &known.camera, &mut assumptions)?;
    if params.adapt > 0 && predictor.is_none() {
        let reason = match params.method {
            Method::Jpf | Method::Jlm => assumptions.last().cloned().unwrap_or_default(),
            method => format!("the method is {}", method.name()),
        };
        bail!("settings: `adapt` is {}, expected 0 without a predictor of poses: {reason}", params.adapt);
    }
    let body = Arc::new(BodyModel::builtin().shape_for_stature(stature_m, None));
    let header = RunHeader {
        inputs: inputs(job),
        settings: settings_table(job)?,
        assumptions: assumptions.clone(),
        fps,
        redact: job.redact,
        camera: known.camera,
        body: body.clone(),
    };
    let (mut writer, resumed) = RunWriter::open(&job.out, job.existing, header)?;
    let prior = job.activity.prior();
    let mut follower = Follower::new(Scene {
        body: body.clone(),
        camera: known.camera,
        model: pose_model(&prior, || Ok(job.activity.latent()), &params)?,
        refiner: Some(Arc::new(Refiner::new(&body, FreeJoints::new(&prior, params.widening())))),
        predictor,
        transitions: None,
        fps,
        params,
    });
    let mut frames = Vec::new();
    if let Some(resumed) = resumed {
        follower.restore(&resumed.checkpoint)?;
        frames = resumed.frames;
    }
    let n_resumed = frames.len();

    let total = info.n_frames.map(|n| n.min(range.end).saturating_sub(range.start));
    let mut progress = Progress::start("frames", n_resumed as u64, total);
    for assumption in &assumptions {
        progress.note(&format!("assumed: {assumption}"));
    }
    let first = frames.last().map_or(range.start, |last: &FrameRecord| last.frame + 1);
    window.skip_to(first);
    // Frames whose records are still to come.
    let mut held = VecDeque::new();
    let mut unwritten: Option<Unwritten> = None;
    while let Some(frame) = window.frames.front() {
        let index = frame.index;
        let masks: Vec<&Mask> = window.frames.iter().map(|frame| &frame.mask).collect();
        // Two things at once: this frame's poses, and the pictures of the last one.
        let (record, written) = rayon::join(
            || follower.step(index, &masks),
            || unwritten.take().map_or(Ok(()), |last| last.write(&mut writer)),
        );
        written?;
        let record = record?;
        let frame = window.frames.pop_front().expect("it was worked on");
        window.fill();
        if follower.has_started() {
            held.push_back(frame);
        }
        if let Some(record) = record {
            let is_due = (index + 1).is_multiple_of(CHECKPOINT_EVERY);
            // What a predictor has learned is too large for a journal: such a run is resumed from its beginning.
            let checkpoint =
                if is_due && follower.fits_a_checkpoint() { follower.checkpoint()? } else { None };
            frames.push(record.clone());
            unwritten = Some(Unwritten { frame: taken(&mut held, &record), record, checkpoint });
        }
        progress.advance();
    }
    if let Some(last) = unwritten {
        last.write(&mut writer)?;
    }
    while let Some(record) = follower.finish()? {
        frames.push(record.clone());
        Unwritten { frame: taken(&mut held, &record), record, checkpoint: None }.write(&mut writer)?;
    }
    let cut_short_by = window.reader.broken;
    drop(progress);
    if frames.is_empty() {
        // Why nothing came is the news, not what is left behind.
        writer.discard().ok();
        return Err(match cut_short_by {
            Some(error) => error,
            None => {
                NobodyFound { input: info.path.display().to_string(), frames: window.reader.n_read }.into()
            }
        });
    }
    let summary = writer.finish(cut_short_by.as_ref().map(|error| format!("{error:#}")).as_deref())?;
    if let (Some(path), Some(predictor)) = (&job.save_predictor, follower.learned_predictor()) {
        predictor.write(path)?;
    }
    match cut_short_by {
        Some(error) => Err(error.context(format!(
            "{}: stopped after {} frames, which are kept",
            job.out.display(),
            frames.len()
        ))),
        None => {
            let fps = (frames.len() - n_resumed) as f64 / started.elapsed().as_secs_f64();
            Ok(TrackOutcome { frames, summary, camera: known.camera, fps })
        }
    }
}

/// The predictor of poses that the tracker asks: the one of the job, or the one that the program ships. Where it was not trained
/// for such a camera, none, and the assumptions say so; a predictor that was asked for by name must fit.
fn predictor_for(
    job: &TrackJob,
    camera: &Camera,
    assumptions: &mut Vec<String>,
) -> anyhow::Result<Option<Arc<PosePredictor>>> {
    if !job.config.method.asks_predictor() {
        ensure!(
            job.predictor.is_none(),
            "settings: `method` is {}, expected jpf or jlm with a predictor",
            job.config.method.name().to_lowercase()
        );
        return Ok(None);
    }
    let height_m = camera.centre_world().z;
    if let Some(path) = &job.predictor {
        let predictor = PosePredictor::read(path)?;
        predictor
            .training()
            .check(height_m, job.activity.name())
            .with_context(|| format!("{}", path.display()))?;
        return Ok(Some(Arc::new(predictor)));
    }
    let shipped = job.activity.predictor();
    match shipped.training().check(height_m, job.activity.name()) {
        Ok(()) => Ok(Some(Arc::new(shipped))),
        Err(reason) => {
            assumptions.push(format!("nothing of the pose from a single mask: {reason}"));
            Ok(None)
        }
    }
}

/// A person seldom fills a larger share of the picture; the white of an inverted mask does.
const LARGEST_SHARE: f64 = 0.6;

fn share_of_person(mask: &Mask) -> f64 {
    mask.area() as f64 / (f64::from(mask.width()) * f64::from(mask.height()))
}

/// Stature of a person of whom nothing is known, metres.
const DEFAULT_STATURE_M: f64 = 1.78;

/// The stature that the first masks show, or one as good as any, and where it comes from.
fn first_stature(window: &Window, camera: &Camera, fps: f64) -> (f64, &'static str) {
    let masks: Vec<&Mask> = window.frames.iter().map(|frame| &frame.mask).collect();
    match survey(&masks, camera, fps) {
        Some(survey) => (stature_from(&survey), "measured on the first masks"),
        None => (DEFAULT_STATURE_M, "as good as any: no first mask shows somebody whole on the floor"),
    }
}

/// The frame of `record`; those before it have none.
fn taken(held: &mut VecDeque<ClipFrame>, record: &FrameRecord) -> ClipFrame {
    loop {
        let frame = held.pop_front().expect("a record is of a frame that was worked on");
        if frame.index == record.frame {
            return frame;
        }
    }
}

/// A frame whose result is known and not yet in the run folder.
struct Unwritten {
    record: FrameRecord,
    frame: ClipFrame,
    checkpoint: Option<Vec<u8>>,
}

impl Unwritten {
    fn write(self, writer: &mut RunWriter) -> Result<(), WriteRunError> {
        writer.push(&self.record, self.frame.picture.as_ref(), &self.frame.mask, self.checkpoint.as_deref())
    }
}

/// The frame that is worked on and those after it that are read already.
struct Window {
    reader: RangeReader,
    frames: VecDeque<ClipFrame>,
}

impl Window {
    fn new(reader: ClipReader, range: Range<u64>) -> Self {
        let reader = RangeReader { reader, range, is_at_end: false, broken: None, n_read: 0 };
        Self { reader, frames: VecDeque::new() }
    }

    fn fill(&mut self) {
        while self.frames.len() < START_MASKS && !self.reader.is_at_end {
            self.frames.extend(self.reader.read());
        }
    }

    /// Leaves out the frames before `first`.
    fn skip_to(&mut self, first: u64) {
        self.reader.range.start = self.reader.range.start.max(first);
        self.frames.retain(|frame| frame.index >= first);
        self.fill();
    }
}

/// Reads the frames of a range.
struct RangeReader {
    reader: ClipReader,
    range: Range<u64>,
    is_at_end: bool,
    /// Why no more can be read.
    broken: Option<anyhow::Error>,
    n_read: u64,
}

impl RangeReader {
    /// The next frame of the range; none at its end, or where the source is broken. Frames before the range are read too,
    /// for the background model of a resumed run must have seen what it saw before.
    fn read(&mut self) -> Option<ClipFrame> {
        while !self.is_at_end {
            match self.reader.next_frame() {
                Ok(Some(frame)) if frame.index < self.range.end => {
                    if frame.index >= self.range.start {
                        self.n_read += 1;
                        return Some(frame);
                    }
                }
                Ok(_) => self.is_at_end = true,
                Err(error) => (self.is_at_end, self.broken) = (true, Some(error)),
            }
        }
        None
    }
}

/// The files and folders that a job reads.
fn inputs(job: &TrackJob) -> Vec<RunInput> {
    let mut inputs = Vec::new();
    match &job.input {
        ClipInput::Masks(path) => inputs.push(RunInput { role: "masks", path: path.clone() }),
        ClipInput::Frames(path, background) => {
            inputs.push(RunInput { role: "video", path: path.clone() });
            if let Background::Plate(plate) = background {
                inputs.push(RunInput { role: "background", path: plate.clone() });
            }
        }
    }
    if let Some(path) = &job.predictor {
        inputs.push(RunInput { role: "predictor", path: path.clone() });
    }
    if let CameraChoice::File(path) = &job.camera {
        inputs.push(RunInput { role: "camera", path: path.clone() });
    }
    inputs
}

/// Everything a job was told, as it stands in `run.toml`.
fn settings_table(job: &TrackJob) -> anyhow::Result<toml::Table> {
    let mut table = toml::Table::try_from(&job.config).context("the settings as TOML")?;
    table.insert("activity".to_owned(), job.activity.name().into());
    if let Some(frames) = &job.frames {
        table.insert("frames".to_owned(), format!("{}..{}", frames.start, frames.end).into());
    }
    let background = match &job.input {
        ClipInput::Frames(_, Background::Median) => Some("median".to_owned()),
        ClipInput::Frames(_, Background::Mixture) => Some("mixture".to_owned()),
        _ => None,
    };
    let camera = match job.camera {
        CameraChoice::File(_) => None,
        CameraChoice::Focal(focal_px) => Some(format!("focal length {focal_px} px")),
        CameraChoice::FieldOfView(fov_deg) => Some(format!("field of view {fov_deg} degrees")),
    };
    for (key, value) in [("learned_background", background), ("assumed_camera", camera)] {
        if let Some(value) = value {
            table.insert(key.to_owned(), value.into());
        }
    }
    Ok(table)
}
