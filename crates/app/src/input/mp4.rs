//! MP4 files with H.264, decoded in Rust: memory-safe but for SIMD kernels behind checked calls.

use std::cell::Cell;
use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::{BufReader, Read as _, Seek as _, SeekFrom};
use std::panic::{self, AssertUnwindSafe, catch_unwind};
use std::path::Path;

use anyhow::{Context as _, anyhow, ensure};
use rusty_h264_decoder::Decoder;

use super::h264::{self, SequenceHeader};
use super::yuv::{Planes, rgb_from_yuv420};
use super::{FrameSource, RgbFrame, SourceInfo};

/// The video track of an MP4 file.
///
/// Edit lists are not applied: every coded picture is given. A rotation by quarter turns is, as in players.
pub(super) struct Mp4Video {
    info: SourceInfo,
    file: BufReader<File>,
    /// Coded pictures still to be read, in decoding order.
    samples: VecDeque<re_mp4::Sample>,
    /// The same pictures in the order in which they are shown.
    to_show: VecDeque<ShowTime>,
    /// Decoded pictures that wait for one shown earlier.
    waiting: BTreeMap<ShowTime, RgbFrame>,
    decoder: Decoder,
    header: SequenceHeader,
    rotation: Rotation,
    /// Bytes of the length before each unit of a sample.
    length_size: usize,
    /// What the decoder gets next, in the byte stream format; at first the parameter sets.
    stream: Vec<u8>,
    sample_bytes: Vec<u8>,
    unrotated: RgbFrame,
    /// Freed picture buffers.
    spares: Vec<RgbFrame>,
    frames_given: u64,
}

/// When a picture is shown: composition time in ticks, then its place in the file.
type ShowTime = (i64, u32);

/// An MP4 file that could be parsed.
pub(super) enum Opened {
    /// The bundled decoder can read it.
    Video(Box<Mp4Video>),
    /// It cannot, for this reason.
    Unsupported(String),
}

impl Mp4Video {
    /// Reads the index of an MP4 file and gets its first video track ready.
    pub fn open(path: &Path) -> anyhow::Result<Opened> {
        let name = path.display();
        let file = File::open(path).with_context(|| format!("{name}: cannot read the file"))?;
        let mut file = BufReader::new(file);
        let mp4 = read_index(&mut file).with_context(|| {
            format!("{name}: cannot read the MP4 index, expected a complete file (it may be cut off)")
        })?;
        let video = mp4.tracks().values().find(|track| track.kind == Some(re_mp4::TrackKind::Video));
        let track = video.with_context(|| format!("{name}: has no video track that can be read"))?;
        ensure!(!track.samples.is_empty(), "{name}: has 0 frames, expected at least 1");

        let trak = track.trak(&mp4);
        let re_mp4::StsdBoxContent::Avc1(avc1) = &trak.mdia.minf.stbl.stsd.contents else {
            let codec = track.codec_string(&mp4).unwrap_or_else(|| "unknown".to_owned());
            return Ok(Opened::Unsupported(format!("its codec is {codec}, not H.264")));
        };
        let avcc = &avc1.avcc.contents;
        let header = avcc.sequence_parameter_sets.first().and_then(|nal| SequenceHeader::parse(&nal.bytes));
        let header = header.with_context(|| format!("{name}: cannot read the H.264 sequence header"))?;
        if let Some(reason) = header.unsupported() {
            return Ok(Opened::Unsupported(reason));
        }
        let mut stream = Vec::new();
        for nal in avcc.sequence_parameter_sets.iter().chain(&avcc.picture_parameter_sets) {
            h264::push_nal(&mut stream, &nal.bytes);
        }

        let rotation = Rotation::from_track(&trak.tkhd);
        let (width, height) = rotation.size(header.width, header.height);
        let info = SourceInfo {
            path: path.to_owned(),
            width,
            height,
            fps: mean_rate(track),
            n_frames: Some(track.samples.len() as u64),
            gap: None,
        };
        let mut to_show: Vec<ShowTime> = track.samples.iter().map(show_time).collect();
        to_show.sort_unstable();
        Ok(Opened::Video(Box::new(Self {
            info,
            file,
            samples: track.samples.iter().copied().collect(),
            to_show: to_show.into(),
            waiting: BTreeMap::new(),
            decoder: Decoder::new(),
            header,
            rotation,
            length_size: usize::from(avcc.length_size_minus_one) + 1,
            stream,
            sample_bytes: Vec::new(),
            unrotated: RgbFrame::default(),
            spares: Vec::new(),
            frames_given: 0,
        })))
    }

    /// Decodes one sample, which holds one picture, into `frame`.
    fn decode(&mut self, sample: &re_mp4::Sample, frame: &mut RgbFrame) -> anyhow::Result<()> {
        let length = self.file.get_ref().metadata()?.len();
        let end = sample.offset.saturating_add(sample.size);
        ensure!(end <= length, "the file ends at byte {length}, expected {end} or more: it is cut off");
        self.sample_bytes.resize(usize::try_from(sample.size)?, 0);
        self.file.seek(SeekFrom::Start(sample.offset))?;
        self.file.read_exact(&mut self.sample_bytes).context("cannot read the file")?;
        let whole = h264::push_sample(&mut self.stream, &self.sample_bytes, self.length_size);
        ensure!(whole, "sample {} is damaged: a unit in it is longer than the sample", sample.id);
        let picture = self.decoder.decode(&self.stream);
        self.stream.clear();
        let picture = picture.with_context(|| format!("sample {} cannot be decoded", sample.id))?;
        let picture = picture.with_context(|| format!("sample {} holds no picture", sample.id))?;
        ensure!(
            (picture.width, picture.height) == (self.header.width as usize, self.header.height as usize),
            "is {}x{}, expected {}x{} as in the header",
            picture.width,
            picture.height,
            self.header.width,
            self.header.height,
        );
        let planes = Planes {
            width: picture.width,
            height: picture.height,
            luma: &picture.y,
            chroma: [&picture.u, &picture.v],
            luma_stride: picture.width,
            chroma_stride: picture.width / 2,
        };
        if self.rotation == Rotation::None {
            rgb_from_yuv420(&planes, self.header.colour, frame);
        } else {
            rgb_from_yuv420(&planes, self.header.colour, &mut self.unrotated);
            self.rotation.turn(&self.unrotated, frame);
        }
        Ok(())
    }
}

impl FrameSource for Mp4Video {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn next_frame(&mut self, frame: &mut RgbFrame) -> anyhow::Result<bool> {
        let Some(&shown_next) = self.to_show.front() else { return Ok(false) };
        loop {
            if let Some(next) = self.waiting.remove(&shown_next) {
                self.spares.push(std::mem::replace(frame, next));
                self.to_show.pop_front();
                self.frames_given += 1;
                return Ok(true);
            }
            let sample = self.samples.pop_front().expect("a picture to show is still to be read or waits");
            let mut picture = self.spares.pop().unwrap_or_default();
            let at = format!("{}: frame {}", self.info.path.display(), self.frames_given);
            if let Err(error) = self.decode(&sample, &mut picture) {
                // Later pictures build on this one.
                self.samples.clear();
                self.to_show.clear();
                return Err(error.context(at));
            }
            self.waiting.insert(show_time(&sample), picture);
        }
    }
}

fn show_time(sample: &re_mp4::Sample) -> ShowTime {
    (sample.composition_timestamp, sample.id)
}

/// Reads the boxes up to the first that reaches past the end of the file, so that a file whose index stands before
/// its pictures can be read as far as it goes.
fn read_index(file: &mut BufReader<File>) -> anyhow::Result<re_mp4::Mp4> {
    let length = file.get_ref().metadata()?.len();
    let mut intact = 0;
    while intact < length {
        file.seek(SeekFrom::Start(intact))?;
        let size = match re_mp4::BoxHeader::read(file) {
            Ok(header) => header.size,
            Err(_) => break,
        };
        match intact.checked_add(size) {
            Some(end) if size > 0 && end <= length => intact = end,
            _ => break,
        }
    }
    file.seek(SeekFrom::Start(0))?;
    // The parser indexes its tables unchecked: a damaged table ends in a panic there, here in an error.
    TURNS_PANICS_INTO_ERRORS.set(true);
    let parsed = catch_unwind(AssertUnwindSafe(|| re_mp4::Mp4::read(&mut *file, intact)));
    TURNS_PANICS_INTO_ERRORS.set(false);
    Ok(parsed.map_err(|_| anyhow!("its tables contradict each other"))??)
}

thread_local! {
    /// Whether a panic of this thread is about to become an error.
    static TURNS_PANICS_INTO_ERRORS: Cell<bool> = const { Cell::new(false) };
}

/// Keeps the texts of panics that become errors off the screen. For the start of a program: the hook is one for all.
pub fn hide_panics_that_become_errors() {
    let usual = panic::take_hook();
    panic::set_hook(Box::new(move |info| {
        if !TURNS_PANICS_INTO_ERRORS.get() {
            usual(info);
        }
    }));
}

/// Frames over the time from the first to the last, in frames a second.
fn mean_rate(track: &re_mp4::Track) -> Option<f64> {
    let times = track.samples.iter().map(|sample| sample.composition_timestamp);
    let (first, last) = (times.clone().min()?, times.max()?);
    let ticks = if track.samples.len() > 1 { last - first } else { i64::try_from(track.duration).ok()? };
    let intervals = (track.samples.len() - 1).max(1) as f64;
    (ticks > 0 && track.timescale > 0).then(|| intervals * track.timescale as f64 / ticks as f64)
}

/// How far a picture is turned clockwise for display.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Rotation {
    None,
    Quarter,
    Half,
    ThreeQuarters,
}

impl Rotation {
    /// From the matrix of the track header; anything but a quarter turn is left alone.
    fn from_track(track: &re_mp4::TkhdBox) -> Self {
        let matrix = &track.matrix;
        match [matrix.a.signum(), matrix.b.signum(), matrix.c.signum(), matrix.d.signum()] {
            [0, 1, -1, 0] => Self::Quarter,
            [-1, 0, 0, -1] => Self::Half,
            [0, -1, 1, 0] => Self::ThreeQuarters,
            _ => Self::None,
        }
    }

    fn size(self, width: u32, height: u32) -> (u32, u32) {
        match self {
            Self::None | Self::Half => (width, height),
            Self::Quarter | Self::ThreeQuarters => (height, width),
        }
    }

    fn turn(self, from: &RgbFrame, to: &mut RgbFrame) {
        let (width, height) = self.size(from.width, from.height);
        to.resize(width, height);
        let (columns, rows) = (from.width as usize, from.height as usize);
        let pixels: &[[u8; 3]] = from.pixels.as_chunks().0;
        for (index, out) in to.pixels.as_chunks_mut().0.iter_mut().enumerate() {
            let (x, y) = (index % width as usize, index / width as usize);
            let (from_x, from_y) = match self {
                Self::None => (x, y),
                Self::Quarter => (y, rows - 1 - x),
                Self::Half => (columns - 1 - x, rows - 1 - y),
                Self::ThreeQuarters => (columns - 1 - y, x),
            };
            *out = pixels[from_y * columns + from_x];
        }
    }
}
