//! MP4 files with H.264, decoded by the bundled OpenH264.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{BufReader, Read as _, Seek as _, SeekFrom};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use anyhow::{Context as _, anyhow, bail, ensure};
use openh264::OpenH264API;
use openh264::decoder::{DecodedYUV, Decoder, DecoderConfig, Flush};
use openh264::formats::YUVSource as _;

use super::h264::{self, SequenceHeader};
use super::yuv::{Planes, rgb_from_yuv420};
use super::{FrameSource, RgbFrame, SourceInfo};

/// The video track of an MP4 file.
///
/// Edit lists are not applied: every coded picture is given. A rotation by quarter turns is, as in players.
pub(super) struct Mp4Video {
    info: SourceInfo,
    file: BufReader<File>,
    samples: VecDeque<re_mp4::Sample>,
    length_size: usize,
    decoder: Decoder,
    header: SequenceHeader,
    rotation: Rotation,
    /// Parameter sets that still have to go before the next sample, in the byte stream format.
    stream: Vec<u8>,
    encoded: Vec<u8>,
    unrotated: RgbFrame,
    /// Pictures that the decoder still held when the samples ended.
    tail: Option<VecDeque<RgbFrame>>,
    frames_given: u64,
}

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
        let video = mp4
            .tracks()
            .values()
            .find(|track| track.kind == Some(re_mp4::TrackKind::Video));
        let track = video.with_context(|| format!("{name}: has no video track that can be read"))?;
        ensure!(
            !track.samples.is_empty(),
            "{name}: has 0 frames, expected at least 1"
        );

        let trak = track.trak(&mp4);
        let re_mp4::StsdBoxContent::Avc1(avc1) = &trak.mdia.minf.stbl.stsd.contents else {
            let codec = track.codec_string(&mp4).unwrap_or_else(|| "unknown".to_owned());
            return Ok(Opened::Unsupported(format!("its codec is {codec}, not H.264")));
        };
        let avcc = &avc1.avcc.contents;
        let mut stream = Vec::new();
        for nal in avcc
            .sequence_parameter_sets
            .iter()
            .chain(&avcc.picture_parameter_sets)
        {
            h264::push_nal(&mut stream, &nal.bytes);
        }
        let header = avcc
            .sequence_parameter_sets
            .first()
            .and_then(|nal| SequenceHeader::parse(&nal.bytes));
        let header = header.with_context(|| format!("{name}: cannot read the H.264 sequence header"))?;
        if let Some(reason) = header.unsupported() {
            return Ok(Opened::Unsupported(reason));
        }

        let rotation = Rotation::from_track(&trak.tkhd);
        let (width, height) = rotation.size(header.width, header.height);
        let info = SourceInfo {
            path: path.to_owned(),
            width,
            height,
            fps: mean_rate(track),
            n_frames: Some(track.samples.len() as u64),
        };
        // Pictures come out in presentation order; asking for each at once would undo the reordering of B pictures.
        let config = DecoderConfig::new().flush_after_decode(Flush::NoFlush);
        let decoder = Decoder::with_api_config(OpenH264API::from_source(), config)
            .with_context(|| format!("{name}: cannot start the H.264 decoder"))?;
        Ok(Opened::Video(Box::new(Self {
            info,
            file,
            samples: track.samples.iter().copied().collect(),
            length_size: usize::from(avcc.length_size_minus_one) + 1,
            decoder,
            header,
            rotation,
            stream,
            encoded: Vec::new(),
            unrotated: RgbFrame::default(),
            tail: None,
            frames_given: 0,
        })))
    }

    /// Decodes samples until a picture comes out; `false` when the decoder has no more.
    fn decode_next(&mut self, frame: &mut RgbFrame) -> anyhow::Result<bool> {
        while let Some(sample) = self.samples.pop_front() {
            let length = self.file.get_ref().metadata()?.len();
            let end = sample.offset.saturating_add(sample.size);
            ensure!(
                end <= length,
                "the file ends at byte {length}, expected {end} or more: it is cut off"
            );
            self.encoded.resize(usize::try_from(sample.size)?, 0);
            self.file.seek(SeekFrom::Start(sample.offset))?;
            self.file
                .read_exact(&mut self.encoded)
                .context("cannot read the file")?;
            if !h264::push_sample(&mut self.stream, &self.encoded, self.length_size) {
                bail!(
                    "sample {} is damaged: a unit in it is longer than the sample",
                    sample.id
                );
            }
            let picture = self.decoder.decode(&self.stream);
            self.stream.clear();
            let picture =
                picture.map_err(|error| anyhow!("sample {} cannot be decoded: {error}", sample.id))?;
            if let Some(picture) = picture {
                convert(&picture, &self.header, self.rotation, &mut self.unrotated, frame)?;
                return Ok(true);
            }
        }
        if self.tail.is_none() {
            let rest = self
                .decoder
                .flush_remaining()
                .map_err(|error| anyhow!("cannot be decoded: {error}"))?;
            let mut tail = VecDeque::with_capacity(rest.len());
            for picture in &rest {
                let mut frame = RgbFrame::default();
                convert(
                    picture,
                    &self.header,
                    self.rotation,
                    &mut self.unrotated,
                    &mut frame,
                )?;
                tail.push_back(frame);
            }
            self.tail = Some(tail);
        }
        let last = self.tail.as_mut().and_then(VecDeque::pop_front);
        last.map_or(Ok(false), |last| {
            *frame = last;
            Ok(true)
        })
    }
}

impl FrameSource for Mp4Video {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn next_frame(&mut self, frame: &mut RgbFrame) -> anyhow::Result<bool> {
        let at = || format!("{}: frame {}", self.info.path.display(), self.frames_given);
        let at = at();
        let more = self.decode_next(frame).context(at)?;
        self.frames_given += u64::from(more);
        Ok(more)
    }
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
    let parsed = catch_unwind(AssertUnwindSafe(|| re_mp4::Mp4::read(&mut *file, intact)));
    Ok(parsed.map_err(|_| anyhow!("its tables contradict each other"))??)
}

/// Frames over the time from the first to the last, in frames a second.
fn mean_rate(track: &re_mp4::Track) -> Option<f64> {
    let times = track.samples.iter().map(|sample| sample.composition_timestamp);
    let (first, last) = (times.clone().min()?, times.max()?);
    let ticks = if track.samples.len() > 1 {
        last - first
    } else {
        i64::try_from(track.duration).ok()?
    };
    let intervals = (track.samples.len() - 1).max(1) as f64;
    (ticks > 0 && track.timescale > 0).then(|| intervals * track.timescale as f64 / ticks as f64)
}

fn convert(
    picture: &DecodedYUV<'_>,
    header: &SequenceHeader,
    rotation: Rotation,
    unrotated: &mut RgbFrame,
    frame: &mut RgbFrame,
) -> anyhow::Result<()> {
    let (width, height) = picture.dimensions();
    ensure!(
        (width, height) == (header.width as usize, header.height as usize),
        "is {width}x{height}, expected {}x{} as in the header",
        header.width,
        header.height,
    );
    let (luma_stride, chroma_stride, _) = picture.strides();
    let planes = Planes {
        width,
        height,
        luma: picture.y(),
        chroma: [picture.u(), picture.v()],
        luma_stride,
        chroma_stride,
    };
    if rotation == Rotation::None {
        rgb_from_yuv420(&planes, header.colour, frame);
    } else {
        rgb_from_yuv420(&planes, header.colour, unrotated);
        rotation.turn(unrotated, frame);
    }
    Ok(())
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
        match [
            matrix.a.signum(),
            matrix.b.signum(),
            matrix.c.signum(),
            matrix.d.signum(),
        ] {
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
        for (index, out) in to.pixels.chunks_exact_mut(3).enumerate() {
            let (x, y) = (index % width as usize, index / width as usize);
            let (from_x, from_y) = match self {
                Self::None => (x, y),
                Self::Quarter => (y, rows - 1 - x),
                Self::Half => (columns - 1 - x, rows - 1 - y),
                Self::ThreeQuarters => (columns - 1 - y, x),
            };
            out.copy_from_slice(&from.pixels[3 * (from_y * columns + from_x)..][..3]);
        }
    }
}
