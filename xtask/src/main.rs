//! Checks, fixtures and studies of the workspace: `cargo xtask <command>`.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a command line tool talks to its user")]

mod ci;
mod layers;
mod licences;
mod sources;
mod spdx;
mod workspace;

use std::env;
use std::process::ExitCode;

use anyhow::Result;

const USAGE: &str = "\
usage: cargo xtask <command> [arguments]

checks
  ci [--strict]   fmt, clippy, layers, licences, tests, docs and cargo-deny;
                  --strict fails when cargo-deny is not installed
  layers          which crate may import which, and what sources may not do
  licences        deny.toml against the lock file and the licences of its packages
  bench [filter]  all benchmarks

runs of `umbra`, built in release; the arguments are passed on
  assets ...            make the body model the program ships
  fixtures ...          make the clips under fixtures/
  train ...             learn poses of people at large, and their predictors
  train-shape ...       learn what a fitted body says of girths, weight and gender
  eval real ...         score tracking on a folder laid out as a recorded clip
  eval stage ...        score trackers on a stage-like data set
  eval latent ...       score what few coordinates keep of poses
  eval biosig ...       score stature, weight and gender from known shapes
  eval girths ...       score the measuring code on bodies of known girths
  eval register ...     score registration on scans of known surface
  eval shape-space ...  compare shape spaces of scans and of known meshes
  eval shape ...        score bodies of people who trained nothing
  eval stage-masks ...  score masks made from pictures against clean ones";

fn main() -> ExitCode {
    let args: Vec<String> = env::args().skip(1).collect();
    match run(&args) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &[String]) -> Result<ExitCode> {
    let words: Vec<&str> = args.iter().map(String::as_str).collect();
    match words.as_slice() {
        ["ci"] => ci::run(ci::MissingTool::Tolerated),
        ["ci", "--strict"] => ci::run(ci::MissingTool::Fails),
        ["layers"] => report("layers", &layers::check()?),
        ["licences"] => report("licences", &licences::check()?),
        ["bench", filter @ ..] => {
            // `--bench *` leaves out the unit tests' harness, which does not know criterion's options.
            let bench = ["bench", "--workspace", "--bench", "*", "--"];
            workspace::cargo(bench.iter().chain(filter))
        }
        ["assets" | "fixtures" | "train" | "train-shape", ..]
        | [
            "eval",
            "real" | "shape" | "stage" | "latent" | "stage-masks" | "girths" | "register" | "biosig"
            | "shape-space",
            ..,
        ] => {
            let umbra = ["run", "--release", "--package", "app", "--bin", "umbra", "--"];
            workspace::cargo(umbra.iter().chain(&words))
        }
        ["help" | "--help" | "-h"] => {
            println!("{USAGE}");
            Ok(ExitCode::SUCCESS)
        }
        _ => {
            eprintln!("{USAGE}");
            Ok(ExitCode::from(2))
        }
    }
}

/// Prints what a check found; anything found is a failure.
fn report(check: &str, findings: &[String]) -> Result<ExitCode> {
    for finding in findings {
        println!("{finding}");
    }
    println!(
        "{check}: {}",
        if findings.is_empty() { "ok".to_owned() } else { format!("{} found", findings.len()) }
    );
    Ok(if findings.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
