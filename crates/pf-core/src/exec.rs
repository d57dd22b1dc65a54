//! Where the work is done: settings that change how long a run takes, never its result.

use std::num::NonZeroUsize;

use rayon::prelude::*;

/// How the particles are spread over threads.
///
/// The default stays on the calling thread: waking others costs more than proposing and moving some hundred particles
/// does, unless one of them is costly. Scoring is the likelihood's own affair.
#[derive(Clone, Copy, Debug)]
pub struct ExecConfig {
    /// Threads of the filter's own pool; 1 stays on the calling thread, `None` uses rayon's global pool.
    pub threads: Option<NonZeroUsize>,
    /// Particles that one task works on.
    pub chunk: NonZeroUsize,
}

impl Default for ExecConfig {
    fn default() -> Self {
        Self { threads: Some(NonZeroUsize::MIN), chunk: NonZeroUsize::new(64).expect("64 is not zero") }
    }
}

impl ExecConfig {
    /// `threads` threads, the rest as by default.
    pub fn with_threads(threads: NonZeroUsize) -> Self {
        Self { threads: Some(threads), ..Self::default() }
    }
}

/// The threads could not be started.
#[derive(Debug, thiserror::Error)]
#[error("cannot start {threads} threads")]
pub struct StartThreadsError {
    threads: usize,
    source: rayon::ThreadPoolBuildError,
}

/// Runs loops over particles; each writes to its own slot.
pub(crate) struct Exec {
    pool: Pool,
    chunk: usize,
}

enum Pool {
    CallingThread,
    Global,
    Own(rayon::ThreadPool),
}

impl Exec {
    pub(crate) fn new(config: ExecConfig) -> Result<Self, StartThreadsError> {
        let pool = match config.threads.map(NonZeroUsize::get) {
            Some(1) => Pool::CallingThread,
            Some(threads) => Pool::Own(
                rayon::ThreadPoolBuilder::new()
                    .num_threads(threads)
                    .build()
                    .map_err(|source| StartThreadsError { threads, source })?,
            ),
            None => Pool::Global,
        };
        Ok(Self { pool, chunk: config.chunk.get() })
    }

    pub(crate) fn calling_thread() -> Self {
        Self { pool: Pool::CallingThread, chunk: 1 }
    }

    /// Calls `work(i, &mut a[i])` for each `i`.
    pub(crate) fn for_each<A: Send>(&self, a: &mut [A], work: impl Fn(usize, &mut A) + Sync) {
        let serial = |start: usize, a: &mut [A]| {
            for (i, a) in a.iter_mut().enumerate() {
                work(start + i, a);
            }
        };
        let chunk = self.chunk;
        self.run(
            a,
            |a| serial(0, a),
            |a| a.par_chunks_mut(chunk).enumerate().for_each(|(k, a)| serial(k * chunk, a)),
        );
    }

    /// Calls `work(i, &mut a[i], &mut b[i], &mut c[i])` for each `i`.
    pub(crate) fn for_each3<A: Send, B: Send, C: Send>(
        &self,
        (a, b, c): (&mut [A], &mut [B], &mut [C]),
        work: impl Fn(usize, &mut A, &mut B, &mut C) + Sync,
    ) {
        let serial = |start: usize, a: &mut [A], b: &mut [B], c: &mut [C]| {
            for (i, ((a, b), c)) in a.iter_mut().zip(b).zip(c).enumerate() {
                work(start + i, a, b, c);
            }
        };
        let chunk = self.chunk;
        self.run(
            (a, b, c),
            |(a, b, c)| serial(0, a, b, c),
            |(a, b, c)| {
                (a.par_chunks_mut(chunk), b.par_chunks_mut(chunk), c.par_chunks_mut(chunk))
                    .into_par_iter()
                    .enumerate()
                    .for_each(|(k, (a, b, c))| serial(k * chunk, a, b, c));
            },
        );
    }

    fn run<D: Send>(&self, data: D, serial: impl FnOnce(D), parallel: impl FnOnce(D) + Send) {
        match &self.pool {
            Pool::CallingThread => serial(data),
            Pool::Global => parallel(data),
            Pool::Own(pool) => pool.install(|| parallel(data)),
        }
    }
}
