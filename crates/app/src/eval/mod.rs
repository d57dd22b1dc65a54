//! Studies: how near the program comes to reference data. Each writes `eval.json` and returns what is printed.

pub mod biosig;
pub mod girths;
pub mod joint_error;
pub mod latent;
pub mod real;
pub mod reference;
pub mod register;
pub mod shape;
pub mod shape_space;
pub mod stage;
pub mod stage_masks;

use std::fs;
use std::path::Path;

use anyhow::Context as _;
use serde::Serialize;

/// A line of a table.
fn markdown_row<const N: usize>(cells: [String; N]) -> String {
    format!("| {} |\n", cells.join(" | "))
}

/// Writes `eval.json` into the folder `out`, which is made when it is not there.
fn write_json(out: &Path, report: &impl Serialize) -> anyhow::Result<()> {
    fs::create_dir_all(out).with_context(|| format!("{}: cannot make the folder", out.display()))?;
    let path = out.join("eval.json");
    let json = serde_json::to_string_pretty(report).context("the report as JSON")?;
    fs::write(&path, json + "\n").with_context(|| format!("{}: cannot write", path.display()))
}
