//! Decodes ahead on a thread of its own.

use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::thread::{self, JoinHandle};

use super::{FrameSource, RgbFrame, SourceInfo};

/// Reads another source ahead; frames and errors come in the same order as from the source itself.
pub struct Prefetch {
    info: SourceInfo,
    /// `None` once the end or an error was given.
    frames: Option<Receiver<anyhow::Result<RgbFrame>>>,
    spares: Sender<RgbFrame>,
    worker: Option<JoinHandle<()>>,
}

impl Prefetch {
    /// Starts reading `source`, at most `depth` frames ahead.
    pub fn new(source: Box<dyn FrameSource>, depth: usize) -> Self {
        let (to_reader, frames) = sync_channel(depth);
        let (spares, from_reader) = channel();
        let info = source.info().clone();
        let worker = Some(thread::spawn(move || read_ahead(source, &to_reader, &from_reader)));
        Self { info, frames: Some(frames), spares, worker }
    }
}

fn read_ahead(
    mut source: Box<dyn FrameSource>,
    frames: &SyncSender<anyhow::Result<RgbFrame>>,
    spares: &Receiver<RgbFrame>,
) {
    loop {
        let mut frame = spares.try_recv().unwrap_or_default();
        let (message, last) = match source.next_frame(&mut frame) {
            Ok(true) => (Ok(frame), false),
            Ok(false) => return,
            Err(error) => (Err(error), true),
        };
        if frames.send(message).is_err() || last {
            return;
        }
    }
}

impl FrameSource for Prefetch {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn next_frame(&mut self, frame: &mut RgbFrame) -> anyhow::Result<bool> {
        let message = self.frames.as_ref().and_then(|frames| frames.recv().ok());
        match message {
            Some(Ok(next)) => {
                let used = std::mem::replace(frame, next);
                // The reader may be done already; then the buffer is simply freed.
                let _ = self.spares.send(used);
                Ok(true)
            }
            Some(Err(error)) => {
                self.frames = None;
                Err(error)
            }
            None => {
                self.frames = None;
                Ok(false)
            }
        }
    }
}

impl Drop for Prefetch {
    fn drop(&mut self) {
        self.frames = None;
        if let Some(worker) = self.worker.take() {
            // A panic of the reader has been reported by its thread.
            let _ = worker.join();
        }
    }
}
