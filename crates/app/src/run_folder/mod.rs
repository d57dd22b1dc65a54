//! The run folder: everything that a run writes.
//!
//! Frame after frame goes to a journal that survives a crash; the tables, the log and the pictures are made from
//! it at the end, so that a run that was interrupted and resumed ends with the same bytes as one that was not. No file
//! holds a time of day. A finished run can be read back, and a shape fit adds its files to it.

mod files;
mod finished;
mod foxglove;
mod journal;
mod mcap_file;
mod record;
mod run_file;
mod scene;
mod strip;
mod summary;
mod tables;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, bail};
use body::{Body, Camera};
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use silhouette::Mask;

use crate::input::RgbFrame;
use journal::Journal;
use record::{Entry, Outlines};
use run_file::{BodyFile, CameraFile, RunFile, VERSION};
use scene::Scene;

pub use files::{WriteRunError, write_private};
pub use finished::FinishedRun;
pub use record::{FrameRecord, Learned, Status};
pub use run_file::RunInput;
pub use summary::{Summary, describe};

const RUN_FILE: &str = "run.toml";
const JOURNAL: &str = "journal.bin";
const SUMMARY: &str = "summary.json";
const POSES: &str = "poses.csv";
const JOINTS: &str = "joints.csv";
const LOG: &str = "run.mcap";
const FILMSTRIP: &str = "filmstrip.png";
const OVERLAY: &str = "overlay";
/// What a shape fit adds.
const SHAPE_FILES: [&str; 5] =
    ["biosignatures.json", "body.obj", "body.glb", "body.png", "shape_per_frame.csv"];
const JPEG_QUALITY: u8 = 88;

/// What a finished run consists of.
const PRODUCTS: [(&str, &str); 12] = [
    (RUN_FILE, "settings, inputs and versions"),
    (SUMMARY, "these results"),
    (POSES, "position, orientation and joint angles of every frame"),
    (JOINTS, "joint positions of every frame and their standard deviations"),
    (LOG, "everything over time, for Foxglove and Rerun"),
    (FILMSTRIP, "some frames side by side"),
    (OVERLAY, "the body drawn over every frame"),
    (SHAPE_FILES[0], "girths, stature, weight and gender with their intervals"),
    (SHAPE_FILES[1], "the fitted body at rest, metres, y up"),
    (SHAPE_FILES[2], "the same for viewers of glTF"),
    (SHAPE_FILES[3], "the fitted body and where it was measured"),
    (SHAPE_FILES[4], "what each frame says on its own"),
];

/// What to do with a run that is already in the folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// Leave it alone and stop.
    Refuse,
    /// Remove it.
    Replace,
    /// Go on with it where it was interrupted; start anew when there is none.
    Resume,
}

/// What a run is, before its first frame.
#[derive(Clone, Debug)]
pub struct RunHeader {
    /// The files and folders it reads; they are hashed.
    pub inputs: Vec<RunInput>,
    /// Every setting that changes the result.
    pub settings: toml::Table,
    /// What was assumed because the user did not say it, a line each.
    pub assumptions: Vec<String>,
    /// Frames a second.
    pub fps: f64,
    /// Leave source frames out of everything that is written.
    pub redact: bool,
    /// The camera at the resolution of the frames.
    pub camera: Camera,
    /// The tracked body.
    pub body: Arc<Body>,
}

/// Where an interrupted run goes on.
#[derive(Clone, Debug)]
pub struct Resumed {
    /// The frames that need not be computed again, all up to the checkpoint.
    pub frames: Vec<FrameRecord>,
    /// The tracker's state after the last of them, as it was given to [`RunWriter::push`].
    pub checkpoint: Vec<u8>,
}

/// Writes a run folder.
pub struct RunWriter {
    folder: PathBuf,
    journal: Journal,
    program: String,
    scene: Scene,
    fps: f64,
    redact: bool,
}

impl RunWriter {
    /// Opens the folder for a run. With [`Existing::Resume`] also tells where to go on, unless the run starts anew.
    ///
    /// # Errors
    /// When the folder holds something else, or a run that is in the way, or to be resumed with other settings or inputs;
    /// [`WriteRunError`] when it cannot be written.
    pub fn open(
        folder: &Path,
        existing: Existing,
        header: RunHeader,
    ) -> anyhow::Result<(Self, Option<Resumed>)> {
        let state = FolderState::of(folder)?;
        check_may_write(folder, state, existing)?;
        let run = run_file(&header)?;
        if existing == Existing::Resume
            && let FolderState::Interrupted = state
        {
            let path = folder.join(RUN_FILE);
            if let Some((field, there, now)) = RunFile::read(&path)?.difference(&run)? {
                bail!(
                    "{}: `{field}` is {there}, now it is {now}: expected the same run to resume",
                    path.display()
                );
            }
            let (journal, entries) = Journal::reopen(&folder.join(JOURNAL))?;
            let checkpoint = entries.last().and_then(|entry| entry.checkpoint.clone());
            let frames = entries.into_iter().map(|entry| entry.record).collect();
            let resumed = checkpoint.map(|checkpoint| Resumed { frames, checkpoint });
            return Ok((Self::new(folder, journal, run.program, header), resumed));
        }
        if state != FolderState::Free {
            remove_run(folder)?;
        }
        files::create_private_folder(folder)?;
        files::create_private_folder(&folder.join(OVERLAY))?;
        files::write_whole(&folder.join(RUN_FILE), run.to_text()?.as_bytes())?;
        let journal = Journal::create(&folder.join(JOURNAL))?;
        Ok((Self::new(folder, journal, run.program, header), None))
    }

    fn new(folder: &Path, journal: Journal, program: String, header: RunHeader) -> Self {
        Self {
            folder: folder.to_owned(),
            journal,
            program,
            scene: Scene::new(header.body, &header.camera),
            fps: header.fps,
            redact: header.redact,
        }
    }

    /// Keeps the result of the next frame and paints its overlay from the picture, if there is one, and the mask. A run
    /// can be resumed after the last frame that came with a `checkpoint`: bytes that mean something to the caller.
    ///
    /// # Errors
    /// When the disk is full, say; all frames before this one are kept.
    pub fn push(
        &mut self,
        record: &FrameRecord,
        picture: Option<&RgbFrame>,
        mask: &Mask,
        checkpoint: Option<&[u8]>,
    ) -> Result<(), WriteRunError> {
        let picture = picture.filter(|_| !self.redact);
        let overlay = self.scene.paint(record, picture, mask);
        let path = overlay_path(&self.folder, record.frame);
        let jpeg = encode_jpeg(&overlay.picture).map_err(WriteRunError::file(&path))?;
        files::write_whole(&path, &jpeg)?;
        let outlines = Outlines { mask: overlay.mask_outlines, body: overlay.body_outlines };
        self.journal.push(&Entry {
            record: record.clone(),
            outlines,
            checkpoint: checkpoint.map(<[u8]>::to_vec),
        })
    }

    /// Makes the tables, the log and the pictures of all frames so far. A run that ends before its input does says why in
    /// `cut_short_by`, and can still be resumed.
    ///
    /// # Errors
    /// When a file cannot be written; the run can be resumed then.
    pub fn finish(self, cut_short_by: Option<&str>) -> anyhow::Result<Summary> {
        let (entries, _) = journal::read_entries(&self.folder.join(JOURNAL))?;
        let at = |name: &str| self.folder.join(name);
        let overlay_of = |frame| overlay_path(&self.folder, frame);
        let summary = Summary::of(&entries, self.fps, cut_short_by);
        files::write_whole(&at(POSES), tables::poses_csv(&entries, self.fps).as_bytes())?;
        files::write_whole(&at(JOINTS), tables::joints_csv(&entries, self.fps).as_bytes())?;
        mcap_file::write(&at(LOG), &self.program, &self.scene, self.fps, &entries, overlay_of)?;
        if let Some(png) = strip::paint(&self.scene, self.fps, &entries, &summary, overlay_of)? {
            files::write_whole(&at(FILMSTRIP), &png)?;
        }
        let json =
            serde_json::to_string_pretty(&summary).context("summary.json: a number has no form in JSON")?;
        files::write_whole(&at(SUMMARY), format!("{json}\n").as_bytes())?;
        if cut_short_by.is_none() {
            let journal = at(JOURNAL);
            fs::remove_file(&journal).map_err(|source| WriteRunError::Remove { path: journal, source })?;
        }
        Ok(summary)
    }

    /// Takes back a run of which nothing came, so that the folder is free for the next.
    ///
    /// # Errors
    /// When a file cannot be removed.
    pub fn discard(self) -> Result<(), WriteRunError> {
        remove_run(&self.folder)?;
        for folder in [self.folder.join(OVERLAY), self.folder] {
            // It stays where somebody else's files lie in it.
            fs::remove_dir(folder).ok();
        }
        Ok(())
    }
}

/// What a folder holds before a run is written to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FolderState {
    /// Nothing, or there is no such folder.
    Free,
    /// A run that did not come to its end.
    Interrupted,
    /// A finished run.
    Finished,
    /// Something else.
    Foreign,
}

impl FolderState {
    fn of(folder: &Path) -> anyhow::Result<Self> {
        if folder.join(JOURNAL).is_file() && folder.join(RUN_FILE).is_file() {
            return Ok(Self::Interrupted);
        }
        if folder.join(RUN_FILE).is_file() {
            return Ok(Self::Finished);
        }
        match fs::read_dir(folder) {
            Ok(mut entries) => Ok(if entries.next().is_none() { Self::Free } else { Self::Foreign }),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Self::Free),
            Err(error) => {
                Err(error).with_context(|| format!("{}: cannot use it as a run folder", folder.display()))
            }
        }
    }
}

fn check_may_write(folder: &Path, state: FolderState, existing: Existing) -> anyhow::Result<()> {
    let name = folder.display();
    match (state, existing) {
        (FolderState::Free, _)
        | (FolderState::Interrupted, Existing::Resume)
        | (FolderState::Interrupted | FolderState::Finished, Existing::Replace) => Ok(()),
        (FolderState::Foreign, _) => {
            bail!("{name}: holds other files than a run, expected a new or empty folder")
        }
        (FolderState::Interrupted, Existing::Refuse) => {
            bail!(
                "{name}: holds an interrupted run, expected a new folder, --resume to go on or --force to replace it"
            )
        }
        (FolderState::Finished, Existing::Refuse) => {
            bail!("{name}: holds a finished run, expected a new folder or --force to replace it")
        }
        (FolderState::Finished, Existing::Resume) => {
            bail!(
                "{name}: holds a finished run, expected an interrupted one to resume, or --force to replace it"
            )
        }
    }
}

fn run_file(header: &RunHeader) -> anyhow::Result<RunFile> {
    Ok(RunFile {
        version: VERSION,
        program: concat!("umbra ", env!("CARGO_PKG_VERSION")).to_owned(),
        fps: header.fps,
        redacted: header.redact,
        assumptions: header.assumptions.clone(),
        inputs: header.inputs.iter().map(run_file::hash_input).collect::<anyhow::Result<_>>()?,
        camera: CameraFile::from_camera(&header.camera),
        body: BodyFile { stature_m: header.body.stature_m(), vertices: header.body.n_vertices() as u64 },
        settings: header.settings.clone(),
    })
}

fn overlay_path(folder: &Path, frame: u64) -> PathBuf {
    folder.join(OVERLAY).join(format!("{frame:06}.jpg"))
}

fn encode_jpeg(picture: &RgbFrame) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, JPEG_QUALITY);
    // Thin lines keep their colours.
    encoder.set_sampling_factor(SamplingFactor::R_4_4_4);
    let side = |pixels: u32| u16::try_from(pixels).expect("overlays are small");
    let (width, height) = (side(picture.width), side(picture.height));
    encoder.encode(&picture.pixels, width, height, ColorType::Rgb).map_err(std::io::Error::other)?;
    Ok(bytes)
}

/// Removes the files of an earlier run and nothing else; `run.toml` goes last, for without it the rest is foreign.
fn remove_run(folder: &Path) -> Result<(), WriteRunError> {
    let overlay = folder.join(OVERLAY);
    let numbered = |path: &Path| {
        let stem = path.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
        !stem.is_empty() && stem.bytes().all(|byte| byte.is_ascii_digit())
    };
    let mut files: Vec<PathBuf> = fs::read_dir(&overlay)
        .map(|entries| {
            entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| numbered(path)).collect()
        })
        .unwrap_or_default();
    files.extend(SHAPE_FILES.map(|name| folder.join(name)));
    files.extend([JOURNAL, SUMMARY, POSES, JOINTS, LOG, FILMSTRIP, RUN_FILE].map(|name| folder.join(name)));
    for path in files {
        match fs::remove_file(&path) {
            Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
                return Err(WriteRunError::Remove { path, source });
            }
            _ => {}
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
