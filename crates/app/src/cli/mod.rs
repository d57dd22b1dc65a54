//! The command line: what can be asked of `umbra`, and with which exit status it answers.

mod demo;
pub(crate) mod eval;
mod info;
mod make;
mod measure;
mod register;
mod shape;
mod track;
mod train;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// 3D pose of a person from the silhouettes of one calibrated camera.
#[derive(Debug, Parser)]
#[command(name = "umbra", version, after_help = EXIT_STATUS)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

const EXIT_STATUS: &str = "Exit status: 0 done; 1 the input or a file cannot be used (one message says which file, field and value); \
2 the command line is wrong; 3 no frame shows a person; 4 the results could not be written.";

#[derive(Debug, Subcommand)]
enum Command {
    /// Track the bundled silhouettes of a real man and write a run folder.
    Demo(demo::DemoArgs),
    /// Track the person in a video, a folder of frames or a folder of masks.
    Track(track::TrackArgs),
    /// Find the body of the person of a finished run: girths, stature, weight, gender.
    Shape(shape::ShapeArgs),
    /// Print what a run folder holds.
    Info(info::InfoArgs),
    /// Measure girths, stature and volume of a body mesh.
    Measure(measure::MeasureArgs),
    /// Bring the template onto a scan of a person, or a folder of scans.
    Register(register::RegisterArgs),
    /// Measure accuracy against reference data.
    #[command(subcommand)]
    Eval(eval::EvalCommand),
    /// Train pose predictors on sequences with known poses.
    Train(train::TrainArgs),
    /// Build the body model and the pose prior from their source data.
    Assets(make::AssetsArgs),
    /// Learn from synthetic walks what a fitted body says of girths, weight and gender.
    TrainShape(make::TrainShapeArgs),
    /// Make the bundled test input from its source data.
    Fixtures(make::FixturesArgs),
}

/// Runs the program on the arguments of the process.
pub fn main() -> ExitCode {
    crate::input::hide_panics_that_become_errors();
    let result = match Cli::parse().command {
        Command::Demo(args) => demo::run(&args),
        Command::Track(args) => track::run(&args),
        Command::Shape(args) => shape::run(&args),
        Command::Info(args) => info::run(&args),
        Command::Measure(args) => measure::run(&args),
        Command::Register(args) => register::run(&args),
        Command::Eval(command) => eval::run(&command),
        Command::Train(args) => train::run(&args),
        Command::Assets(args) => make::assets(&args),
        Command::TrainShape(args) => make::train_shape(&args),
        Command::Fixtures(args) => make::fixtures(&args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            crate::progress::note(&format!("error: {error:#}"));
            ExitCode::from(exit_status(&error))
        }
    }
}

/// 3 when there was nobody to track, 4 when a result could not be written, 1 for everything else.
fn exit_status(error: &anyhow::Error) -> u8 {
    if error.downcast_ref::<crate::track::NobodyFound>().is_some() {
        3
    } else if error.downcast_ref::<crate::run_folder::WriteRunError>().is_some() {
        4
    } else {
        1
    }
}
