//! `umbra info`: prints what a run folder holds.

use std::io::Write as _;
use std::path::PathBuf;

use clap::Args;

/// Arguments of `umbra info`.
#[derive(Debug, Args)]
pub struct InfoArgs {
    /// The run folder.
    #[arg(value_name = "FOLDER")]
    run: PathBuf,
}

/// Runs the command.
pub fn run(args: &InfoArgs) -> anyhow::Result<()> {
    let text = crate::run_folder::describe(&args.run)?;
    std::io::stdout().write_all(text.as_bytes())?;
    Ok(())
}
