//! The growth model of `[Gordon1993]` under a bootstrap filter: root mean square error and particle-steps a second.
//!
//! ```text
//! cargo run --release -p pf-core --example growth -- [OBSERVATIONS.npy STATES.npy]
//! ```
//! Without files it makes 1,000 steps itself. Systematic resampling at every step, the weighted mean as estimate, one
//! thread; the time is the least of several runs, and a run with many particles stops early.

#![allow(clippy::print_stdout, reason = "a program that reports")]

mod model;

use std::error::Error;
use std::time::Instant as Clock;

use pf_core::Step;

const RUNS: u64 = 5;
/// A run stops after this many.
const PARTICLE_STEPS: usize = 4_000_000;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (states, observations) = match &arguments[..] {
        [observations, states] => (read_npy(states)?, read_npy(observations)?),
        _ => model::simulate(1000, 1),
    };
    let instants = model::instants(&observations);
    println!("{:>12} {:>8} {:>8} {:>24}", "particles", "steps", "rmse", "particle-steps/s");
    for n_particles in [1_000, 100_000] {
        let n_steps = instants.len().min(PARTICLE_STEPS / n_particles);
        let mut fastest = f64::INFINITY;
        let mut rmse = 0.0;
        for seed in 0..RUNS {
            let mut filter = model::filter(n_particles, seed);
            let mut squares = 0.0;
            let start = Clock::now();
            for (instant, truth) in instants[..n_steps].iter().zip(&states) {
                let Step::Tracked(posterior) = filter.step(instant, &mut model::Squared, &mut ())? else {
                    return Err("lost: no particle explains the observation".into());
                };
                let weighted = posterior.weights.as_slice().iter().zip(posterior.states);
                let mean: f64 = weighted.map(|(w, [x])| w * x).sum();
                squares += (mean - truth).powi(2);
            }
            fastest = fastest.min(start.elapsed().as_secs_f64());
            rmse += (squares / n_steps as f64).sqrt() / RUNS as f64;
        }
        let rate = (n_particles * n_steps) as f64 / fastest;
        println!("{n_particles:>12} {n_steps:>8} {rmse:>8.3} {:>22.1} M", rate / 1e6);
    }
    Ok(())
}

fn read_npy(path: &str) -> Result<Vec<f64>, Box<dyn Error>> {
    let bytes = std::fs::read(path).map_err(|error| format!("{path}: {error}"))?;
    Ok(numbers_of_npy(&bytes).ok_or(format!("{path}: expected a .npy file of little-endian f64"))?)
}

/// The numbers of a file of format 1.0: magic, version, length of the header, header, data.
fn numbers_of_npy(bytes: &[u8]) -> Option<Vec<f64>> {
    let (header_length, rest) = bytes.strip_prefix(b"\x93NUMPY\x01\x00")?.split_first_chunk()?;
    let (header, data) = rest.split_at_checked(u16::from_le_bytes(*header_length).into())?;
    let is_f64 = String::from_utf8_lossy(header).contains("'<f8'");
    is_f64.then(|| data.as_chunks().0.iter().map(|number| f64::from_le_bytes(*number)).collect())
}
