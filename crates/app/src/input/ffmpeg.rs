//! Every other container and codec, through the `ffmpeg` program.

use std::ffi::OsStr;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::thread::{self, JoinHandle};

use anyhow::{Context as _, bail, ensure};

use super::yuv::{ColourCode, Planes, rgb_from_yuv420};
use super::{FrameSource, RgbFrame, SourceInfo};

/// A running `ffmpeg` that writes YUV4MPEG2, a format whose header tells size and rate.
pub(super) struct FfmpegPipe {
    info: SourceInfo,
    child: Child,
    output: BufReader<ChildStdout>,
    /// Collects what the program complains about, so that its pipe never fills.
    complaints: Option<JoinHandle<String>>,
    picture: Vec<u8>,
    frames_given: u64,
    done: bool,
}

impl FfmpegPipe {
    /// Starts the `ffmpeg` of the search path on a local file.
    pub fn open(path: &Path) -> anyhow::Result<Self> {
        Self::open_with(OsStr::new("ffmpeg"), path)
    }

    /// As [`open`](Self::open), with another program.
    pub fn open_with(program: &OsStr, path: &Path) -> anyhow::Result<Self> {
        let name = path.display();
        let mut input = std::ffi::OsString::from("file:");
        input.push(path);
        let mut child = Command::new(program)
            .args(["-nostdin", "-v", "error", "-xerror", "-protocol_whitelist", "file,crypto", "-i"])
            .arg(input)
            .args(["-map", "0:v:0", "-vf", "scale=out_color_matrix=bt601:out_range=tv"])
            .args(["-pix_fmt", "yuv420p", "-fps_mode", "passthrough", "-f", "yuv4mpegpipe", "-"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .with_context(|| {
                format!(
                    "{name}: cannot run the program `{}`: install it, or convert the video to MP4 with H.264 \
                     or to a folder of PNG files",
                    program.display()
                )
            })?;
        let output = BufReader::new(child.stdout.take().expect("stdout was asked to be a pipe"));
        let mut stderr = child.stderr.take().expect("stderr was asked to be a pipe");
        let complaints = thread::spawn(move || {
            let mut text = Vec::new();
            // What could not be read is not there to be quoted.
            let _ = stderr.read_to_end(&mut text);
            String::from_utf8_lossy(&text).into_owned()
        });
        let info =
            SourceInfo { path: path.to_owned(), width: 0, height: 0, fps: None, n_frames: None, gap: None };
        let mut pipe = Self {
            info,
            child,
            output,
            complaints: Some(complaints),
            picture: Vec::new(),
            frames_given: 0,
            done: false,
        };
        let mut header = Vec::new();
        pipe.output
            .read_until(b'\n', &mut header)
            .with_context(|| format!("{name}: cannot read from ffmpeg"))?;
        if header.is_empty() {
            pipe.finish()?;
            bail!("{name}: has 0 frames, expected at least 1");
        }
        let header = String::from_utf8_lossy(&header);
        let (width, height, fps) = parse_header(&header).with_context(|| {
            format!("{name}: ffmpeg wrote {:?}, expected a YUV4MPEG2 header", header.trim_end())
        })?;
        pipe.info.width = width;
        pipe.info.height = height;
        pipe.info.fps = fps;
        Ok(pipe)
    }

    /// Reads the next picture's planes; `false` at the end.
    fn read_picture(&mut self) -> anyhow::Result<bool> {
        let mut marker = Vec::new();
        self.output.read_until(b'\n', &mut marker)?;
        if marker.is_empty() {
            return Ok(false);
        }
        ensure!(marker.starts_with(b"FRAME"), "ffmpeg wrote no frame marker");
        let (width, height) = (self.info.width as usize, self.info.height as usize);
        self.picture.resize(width * height + 2 * width.div_ceil(2) * height.div_ceil(2), 0);
        // A cut picture means that ffmpeg stopped: its own words tell why.
        Ok(self.output.read_exact(&mut self.picture).is_ok())
    }

    /// Waits for the program and turns its complaint into an error.
    fn finish(&mut self) -> anyhow::Result<()> {
        self.done = true;
        let status = self.child.wait().context("cannot wait for ffmpeg")?;
        let complaints = self.complaints.take().and_then(|thread| thread.join().ok()).unwrap_or_default();
        let complaint = complaints.lines().find(|line| !line.trim().is_empty()).unwrap_or("no reason given");
        ensure!(
            status.success(),
            "{}: frame {}: ffmpeg stopped: {}",
            self.info.path.display(),
            self.frames_given,
            complaint.trim(),
        );
        Ok(())
    }
}

impl FrameSource for FfmpegPipe {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn next_frame(&mut self, frame: &mut RgbFrame) -> anyhow::Result<bool> {
        if self.done {
            return Ok(false);
        }
        let at = format!("{}: frame {}", self.info.path.display(), self.frames_given);
        if !self.read_picture().context(at)? {
            self.finish()?;
            return Ok(false);
        }
        let (width, height) = (self.info.width as usize, self.info.height as usize);
        let chroma_stride = width.div_ceil(2);
        let (luma, chroma) = self.picture.split_at(width * height);
        let (u, v) = chroma.split_at(chroma_stride * height.div_ceil(2));
        let planes = Planes { width, height, luma, chroma: [u, v], luma_stride: width, chroma_stride };
        rgb_from_yuv420(&planes, ColourCode { bt709: false, full_range: false }, frame);
        self.frames_given += 1;
        Ok(true)
    }
}

impl Drop for FfmpegPipe {
    fn drop(&mut self) {
        if !self.done {
            // It may have ended by itself; either way it must not outlive this value.
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
    }
}

/// Width, height and rate of a header such as `YUV4MPEG2 W640 H480 F60:1 Ip A1:1 C420jpeg`.
fn parse_header(header: &str) -> Option<(u32, u32, Option<f64>)> {
    let mut words = header.split_ascii_whitespace();
    if words.next() != Some("YUV4MPEG2") {
        return None;
    }
    let (mut width, mut height, mut fps) = (0, 0, None);
    for word in words {
        let (key, value) = word.split_at_checked(1)?;
        match key {
            "W" => width = value.parse().ok()?,
            "H" => height = value.parse().ok()?,
            "F" => {
                let (frames, seconds) = value.split_once(':')?;
                let (frames, seconds): (f64, f64) = (frames.parse().ok()?, seconds.parse().ok()?);
                fps = (frames > 0.0 && seconds > 0.0).then(|| frames / seconds);
            }
            _ => {}
        }
    }
    (width > 0 && height > 0).then_some((width, height, fps))
}
