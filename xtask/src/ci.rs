//! `cargo xtask ci`: every check there is, cheap ones first, all of them even when one fails.

use std::process::{Command, ExitCode};
use std::time::Instant;

use anyhow::{Context, Result};

use crate::workspace::{cargo_program, root};
use crate::{layers, licences};

/// What to do about a check whose program is not installed.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum MissingTool {
    Tolerated,
    Fails,
}

enum Outcome {
    Passed,
    Failed,
    NotInstalled,
}

type Step = fn() -> Result<Outcome>;

/// Runs all checks and prints a line on each.
pub fn run(missing_tool: MissingTool) -> Result<ExitCode> {
    let steps: [(&str, Step); 7] = [
        ("fmt", || cargo(&["fmt", "--all", "--check"])),
        ("layers", || findings(&layers::check()?)),
        ("licences", || findings(&licences::check()?)),
        ("clippy", || cargo(&["clippy", "--workspace", "--all-targets", "--", "--deny", "warnings"])),
        ("test", || cargo(&["test", "--workspace"])),
        ("doc", || cargo(&["doc", "--workspace", "--no-deps"])),
        ("deny", deny),
    ];
    let mut summary = Vec::new();
    let mut all_well = true;
    for (name, step) in steps {
        println!("== {name}");
        let start = Instant::now();
        let word = match step()? {
            Outcome::Passed => "ok",
            Outcome::NotInstalled if missing_tool == MissingTool::Tolerated => "not installed",
            Outcome::NotInstalled | Outcome::Failed => {
                all_well = false;
                "FAILED"
            }
        };
        summary.push(format!("{name:<9} {word:<13} {:>5.0} s", start.elapsed().as_secs_f64()));
    }
    println!("\n{}", summary.join("\n"));
    Ok(if all_well { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn cargo(args: &[&str]) -> Result<Outcome> {
    let mut command = Command::new(cargo_program());
    // Only rustdoc reads RUSTDOCFLAGS, so setting it rebuilds nothing else.
    command.args(args).current_dir(root()).env("RUSTDOCFLAGS", "--deny warnings");
    let status = command.status().context("cannot start cargo")?;
    Ok(if status.success() { Outcome::Passed } else { Outcome::Failed })
}

fn findings(findings: &[String]) -> Result<Outcome> {
    for finding in findings {
        println!("{finding}");
    }
    Ok(if findings.is_empty() { Outcome::Passed } else { Outcome::Failed })
}

fn deny() -> Result<Outcome> {
    let installed =
        Command::new(cargo_program()).args(["deny", "--version"]).output().context("cannot start cargo")?;
    if !installed.status.success() {
        println!("cargo-deny is not installed; to install it: cargo install --locked cargo-deny");
        return Ok(Outcome::NotInstalled);
    }
    cargo(&["deny", "--offline", "check", "licenses", "bans", "sources"])
}
