//! `umbra assets` and `umbra fixtures`: what the repository ships, made anew from its source data.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use body::BodyModel;
use body::build::prior::build_pose_prior;
use body::build::{BuildConfig, build_body_asset};
use body::io::bodies::BodiesData;
use clap::Args;
use image::{ExtendedColorType, ImageEncoder as _};
use silhouette::Mask;

use super::eval::data_folder;
use crate::eval::shape::train::train;
use crate::predict::Activity;
use crate::progress::{Progress, note};
use crate::survey::TrainingData;
use crate::track::{Background, ClipInput, ClipReader};

/// Frames of the stage sequence that is bundled.
const STAGE_FRAMES: u64 = 40;

/// Arguments of `umbra assets`.
#[derive(Debug, Args)]
pub struct AssetsArgs {
    /// The data folder, with `bodies` and `cmu` [default: as UMBRA_DATA names it].
    #[arg(long, value_name = "FOLDER")]
    data: Option<PathBuf>,
    /// Where the assets go.
    #[arg(long, value_name = "FOLDER", default_value = "crates/body/assets")]
    out: PathBuf,
    /// Where the predictors of stature, weight and gender go.
    #[arg(long, value_name = "FOLDER", default_value = "crates/biosig/assets")]
    biosig_out: PathBuf,
    /// Only the predictors, for the body model that the program has.
    #[arg(long)]
    biosig_only: bool,
}

/// Arguments of `umbra train-shape`.
#[derive(Debug, Args)]
pub struct TrainShapeArgs {
    /// The data folder, with `bodies` and `cmu` [default: as UMBRA_DATA names it].
    #[arg(long, value_name = "FOLDER")]
    data: Option<PathBuf>,
    /// Training people who walk.
    #[arg(long, value_name = "N", default_value_t = 240)]
    people: usize,
    /// Where umbra-shape.json and umbra-shape-walk.json go.
    #[arg(long, value_name = "FOLDER", default_value = "crates/app/assets")]
    out: PathBuf,
}

/// Arguments of `umbra fixtures`.
#[derive(Debug, Args)]
pub struct FixturesArgs {
    /// The data folder, with `real/balance` and `stage` [default: as UMBRA_DATA names it].
    #[arg(long, value_name = "FOLDER")]
    data: Option<PathBuf>,
    /// Where the fixtures go.
    #[arg(long, value_name = "FOLDER", default_value = "fixtures")]
    out: PathBuf,
}

/// Builds the body model and the pose prior.
pub fn assets(args: &AssetsArgs) -> anyhow::Result<()> {
    let data = data_folder(args.data.as_deref(), "")?;
    if args.biosig_only {
        return predictors(&data, &args.biosig_out);
    }
    make_folder(&args.out)?;
    let file =
        build_body_asset(&BodiesData::read(&data.join("bodies"))?.training(), &BuildConfig::default())?;
    write(&args.out.join("umbra-body.bin"), &file.to_bytes())?;
    let model = BodyModel::from_file(file)?;
    let prior = build_pose_prior(&data.join("cmu"), model.mean().rest_joints())?;
    write(&args.out.join("umbra-prior.bin"), &prior.to_bytes())?;
    note(
        "build the program anew and run `umbra assets --biosig-only`: the predictors are of the body model in the program",
    );
    Ok(())
}

/// Trains the predictors of stature, weight and gender.
fn predictors(data: &Path, out: &Path) -> anyhow::Result<()> {
    make_folder(out)?;
    let predictors = TrainingData::read(data)?.predictors()?;
    for (name, predictor) in [
        ("shape", &predictors.shape),
        ("girths", &predictors.girths),
        ("girths and stature", &predictors.girths_and_stature),
    ] {
        let [stature, weight, gender] = predictor.n_bases();
        note(&format!("{name}: {stature} bases for stature, {weight} for weight, {gender} for gender"));
    }
    write(&out.join("umbra-biosig.bin"), &predictors.to_bytes())
}

/// Learns the predictors of a fitted body.
pub fn train_shape(args: &TrainShapeArgs) -> anyhow::Result<()> {
    let data = data_folder(args.data.as_deref(), "")?;
    make_folder(&args.out)?;
    for activity in [Activity::Any, Activity::Walk] {
        let path = train(&data.join("bodies"), &data.join("cmu"), activity, args.people, &args.out)?;
        note(&format!("{}: written", path.display()));
    }
    Ok(())
}

/// Makes the bundled clips: silhouettes and reference joints, no pictures.
pub fn fixtures(args: &FixturesArgs) -> anyhow::Result<()> {
    let data = data_folder(args.data.as_deref(), "")?;
    balance(&data.join("real/balance"), &args.out.join("balance"))?;
    stage_mini(&data.join("stage"), &args.out.join("stage-mini"))
}

fn balance(source: &Path, out: &Path) -> anyhow::Result<()> {
    let masks = out.join("masks");
    make_folder(&masks)?;
    let background = Background::Plate(source.join("background.png"));
    let mut reader = ClipReader::open(&ClipInput::Frames(source.join("video.mp4"), background))?;
    let mut progress = Progress::start("silhouettes", 0, reader.info().n_frames);
    while let Some(frame) = reader.next_frame()? {
        write(&masks.join(format!("{:04}.png", frame.index)), &mask_png(&frame.mask)?)?;
        progress.advance();
    }
    for name in ["camera.toml", "joints3d.csv", "LICENSE-BSD-3-Clause-Pose2Sim.txt"] {
        copy(&source.join(name), &out.join(name))?;
    }
    note(&format!("{}: written", out.display()));
    Ok(())
}

fn stage_mini(source: &Path, out: &Path) -> anyhow::Result<()> {
    let sequence = source.join("S1/Walking_1");
    make_folder(&out.join("masks"))?;
    for frame in 0..STAGE_FRAMES {
        let name = format!("{frame:04}.png");
        copy(&sequence.join("C2/observed").join(&name), &out.join("masks").join(&name))?;
    }
    copy(&source.join("calibration/C2.json"), &out.join("C2.json"))?;
    copy(&source.join("LICENSE-CC0-1.0.md"), &out.join("LICENSE-CC0-1.0.md"))?;
    let table = sequence.join("joints.csv");
    let text = fs::read_to_string(&table).with_context(|| format!("{}: cannot read", table.display()))?;
    let head: Vec<&str> = text.lines().take(1 + STAGE_FRAMES as usize).collect();
    if head.len() != 1 + STAGE_FRAMES as usize {
        bail!("{}: {} lines, expected a header and {STAGE_FRAMES} frames", table.display(), head.len());
    }
    write(&out.join("joints.csv"), (head.join("\n") + "\n").as_bytes())?;
    note(&format!("{}: written", out.display()));
    Ok(())
}

/// A mask as a PNG file: person 255, everything else 0.
fn mask_png(mask: &Mask) -> anyhow::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    image::codecs::png::PngEncoder::new_with_quality(
        &mut bytes,
        image::codecs::png::CompressionType::Best,
        image::codecs::png::FilterType::NoFilter,
    )
    .write_image(&mask.to_gray8(), mask.width(), mask.height(), ExtendedColorType::L8)
    .context("a mask as PNG")?;
    Ok(bytes)
}

fn make_folder(folder: &Path) -> anyhow::Result<()> {
    fs::create_dir_all(folder).with_context(|| format!("{}: cannot make the folder", folder.display()))
}

fn copy(from: &Path, to: &Path) -> anyhow::Result<()> {
    let bytes = fs::read(from).with_context(|| format!("{}: cannot read", from.display()))?;
    write(to, &bytes)
}

fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    fs::write(path, bytes).with_context(|| format!("{}: cannot write", path.display()))
}
