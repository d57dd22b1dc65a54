//! What a person who waits sees, on standard error: a bar on a terminal, plain lines elsewhere.

use std::io::{IsTerminal as _, Write as _};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

/// Time between two plain lines.
const LINE_EVERY: Duration = Duration::from_secs(5);

/// Prints one line. A closed standard error is no reason to stop a run.
pub fn note(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// How far a run over many things has come, with its rate and the time that remains.
pub struct Progress {
    what: &'static str,
    total: Option<u64>,
    done: u64,
    first: u64,
    started: Instant,
    display: Display,
}

enum Display {
    Bar(ProgressBar),
    /// When the last line was printed, and how far the run had come then.
    Lines {
        last: Instant,
        told: Option<u64>,
    },
}

impl Progress {
    /// Starts to count `what`, in the plural; `done` of them are there already, of `total` where that is known.
    pub fn start(what: &'static str, done: u64, total: Option<u64>) -> Self {
        let now = Instant::now();
        let display = if std::io::stderr().is_terminal() {
            let bar = total.map_or_else(ProgressBar::new_spinner, ProgressBar::new).with_position(done);
            bar.set_style(bar_style(total.is_some()));
            bar.set_prefix(what);
            bar.reset_eta();
            Display::Bar(bar)
        } else {
            Display::Lines { last: now, told: None }
        };
        Self { what, total, done, first: done, started: now, display }
    }

    /// One more is done.
    pub fn advance(&mut self) {
        self.done += 1;
        match &mut self.display {
            Display::Bar(bar) => bar.inc(1),
            Display::Lines { last, told } => {
                if last.elapsed() >= LINE_EVERY {
                    (*last, *told) = (Instant::now(), Some(self.done));
                    note(&self.line());
                }
            }
        }
    }

    /// Prints a line without tearing the bar.
    pub fn note(&self, text: &str) {
        match &self.display {
            Display::Bar(bar) => bar.suspend(|| note(text)),
            Display::Lines { .. } => note(text),
        }
    }

    /// Things a second since the start.
    fn rate(&self) -> f64 {
        (self.done - self.first) as f64 / self.started.elapsed().as_secs_f64().max(f64::MIN_POSITIVE)
    }

    fn line(&self) -> String {
        plain_line(self.what, self.done, self.total, self.rate())
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        match &self.display {
            Display::Bar(bar) => bar.finish_and_clear(),
            Display::Lines { told, .. } if *told != Some(self.done) => note(&self.line()),
            Display::Lines { .. } => {}
        }
    }
}

fn bar_style(with_total: bool) -> ProgressStyle {
    let template = if with_total {
        "{prefix} {wide_bar:.cyan/dim} {pos}/{len}  {per_sec}  {eta} left"
    } else {
        "{prefix} {spinner} {pos}  {per_sec}"
    };
    ProgressStyle::with_template(template).expect("the templates above are well formed")
}

fn plain_line(what: &str, done: u64, total: Option<u64>, rate: f64) -> String {
    match total {
        Some(total) if rate > 0.0 => {
            let left = total.saturating_sub(done) as f64 / rate;
            format!("{what}: {done} of {total}, {rate:.1} a second, {left:.0} s left")
        }
        Some(total) => format!("{what}: {done} of {total}"),
        None => format!("{what}: {done}, {rate:.1} a second"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_tell_rate_and_time_left() {
        assert_eq!(plain_line("frames", 40, Some(100), 6.0), "frames: 40 of 100, 6.0 a second, 10 s left");
        assert_eq!(plain_line("frames", 40, None, 6.0), "frames: 40, 6.0 a second");
        assert_eq!(plain_line("frames", 0, Some(100), 0.0), "frames: 0 of 100");
    }
}
