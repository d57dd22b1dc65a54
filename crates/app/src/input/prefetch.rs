//! Reads ahead on a thread of its own.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{self, JoinHandle};

/// Takes items from a source ahead of their use; items and errors come in the order in which the source gave them.
pub struct Prefetch<T> {
    /// `None` once the end or an error was given.
    items: Option<Receiver<anyhow::Result<T>>>,
    worker: Option<JoinHandle<()>>,
}

impl<T: Send + 'static> Prefetch<T> {
    /// Starts to call `next`, which gives `None` at the end, and holds at most `depth` items and one that waits for its place.
    pub fn new(depth: usize, next: impl FnMut() -> anyhow::Result<Option<T>> + Send + 'static) -> Self {
        let (to_reader, items) = sync_channel(depth);
        Self { items: Some(items), worker: Some(thread::spawn(move || read_ahead(next, &to_reader))) }
    }
}

impl<T> Iterator for Prefetch<T> {
    type Item = anyhow::Result<T>;

    /// The next item; `None` at the end, and after an error.
    fn next(&mut self) -> Option<Self::Item> {
        let item = self.items.as_ref().and_then(|items| items.recv().ok());
        if !matches!(item, Some(Ok(_))) {
            self.items = None;
        }
        item
    }
}

fn read_ahead<T>(mut next: impl FnMut() -> anyhow::Result<Option<T>>, items: &SyncSender<anyhow::Result<T>>) {
    while let Some(message) = next().transpose() {
        let is_last = message.is_err();
        if items.send(message).is_err() || is_last {
            return;
        }
    }
}

impl<T> Drop for Prefetch<T> {
    fn drop(&mut self) {
        self.items = None;
        if let Some(worker) = self.worker.take() {
            // A panic of the source has been reported by its thread.
            let _ = worker.join();
        }
    }
}
