//! `umbra register`: the template onto scans, one or a folder of them.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use body::io::{LengthUnit, MeshFile, WriteMeshError, load_landmarks, load_mesh, write_obj};
use body::register::{RegisterError, Registration, STRAY_M, Scan, ScanLandmark, register};
use body::{BodyModel, Skeleton};
use clap::{Args, ValueEnum};
use glam::{DQuat, DVec3};
use serde::Serialize;

use crate::eval::joint_error::mean;
use crate::progress::{Progress, note};
use crate::run_folder::WriteRunError;

/// Arguments of `umbra register`.
#[derive(Debug, Args)]
pub struct RegisterArgs {
    /// A scan (PLY or OBJ; points alone will do), or a folder of scans.
    #[arg(value_name = "SCAN")]
    scan: PathBuf,
    /// Landmarks: a table (name, x_m, y_m, z_m) or a CAESAR .lnd file. For a folder of scans, and without this option, the file beside
    /// each scan that has its name and _landmarks.csv, .csv or .lnd behind it is taken.
    #[arg(long, value_name = "FILE")]
    landmarks: Option<PathBuf>,
    #[command(flatten)]
    input: ScanInput,
    /// Where the registered meshes and their descriptions go. Scans that are done there already are passed over.
    #[arg(long, value_name = "FOLDER", default_value = "registered")]
    out: PathBuf,
}

/// How the numbers of a scan are to be read.
#[derive(Clone, Copy, Debug, Args)]
pub struct ScanInput {
    /// Unit of the scan's lengths [default: by its size].
    #[arg(long, value_enum)]
    unit: Option<UnitArg>,
    /// Axis of the scan that points from the feet to the head.
    #[arg(long, value_enum, default_value = "y", allow_hyphen_values = true)]
    up: UpArg,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum UnitArg {
    M,
    Cm,
    Mm,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum UpArg {
    X,
    Y,
    Z,
    #[value(name = "-x")]
    MinusX,
    #[value(name = "-y")]
    MinusY,
    #[value(name = "-z")]
    MinusZ,
}

impl UpArg {
    fn axis(self) -> DVec3 {
        match self {
            Self::X => DVec3::X,
            Self::Y => DVec3::Y,
            Self::Z => DVec3::Z,
            Self::MinusX => -DVec3::X,
            Self::MinusY => -DVec3::Y,
            Self::MinusZ => -DVec3::Z,
        }
    }

    /// Turns the scan upright.
    fn body_from_scan(self) -> DQuat {
        DQuat::from_rotation_arc(self.axis(), DVec3::Y)
    }
}

/// A scan in metres, upright along y.
pub struct UprightScan {
    /// Points and triangles.
    pub mesh: MeshFile,
    /// Unit of the file.
    pub unit: LengthUnit,
    body_from_scan: DQuat,
}

impl ScanInput {
    /// Reads a scan; says which unit was taken when it was not asked for.
    pub fn load(&self, path: &Path) -> anyhow::Result<UprightScan> {
        let mut mesh = load_mesh(path)?;
        let extent = largest_extent(&mesh.positions);
        let unit = match self.unit {
            Some(UnitArg::M) => LengthUnit::Metre,
            Some(UnitArg::Cm) => LengthUnit::Centimetre,
            Some(UnitArg::Mm) => LengthUnit::Millimetre,
            None => LengthUnit::of_person(extent).with_context(|| {
                format!(
                    "{}: the largest extent is {extent:.3}, which is a person's in no unit; give --unit",
                    path.display()
                )
            })?,
        };
        if self.unit.is_none() && unit != LengthUnit::Metre {
            note(&format!("{}: taken as {}, since it is {extent:.0} large", path.display(), unit.symbol()));
        }
        let body_from_scan = self.up.body_from_scan();
        for position in &mut mesh.positions {
            let metres = DVec3::from_array(position.map(f64::from)) * unit.metres();
            *position = (body_from_scan * metres).to_array().map(|x| x as f32);
        }
        Ok(UprightScan { mesh, unit, body_from_scan })
    }

    /// What to do about a scan that does not stand, when something can be said.
    fn hint(&self, scan: &UprightScan, error: &RegisterError) -> Option<String> {
        match error {
            RegisterError::NotAPerson { .. } => {
                let [low, high] = bounds(&scan.mesh.positions);
                let size = scan.body_from_scan.inverse() * (high - low);
                let axes = [("x", size.x.abs()), ("y", size.y.abs()), ("z", size.z.abs())];
                let (axis, length) = axes.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).expect("three axes");
                Some(format!(
                    "the file is longest along {axis} ({length:.2} m): it may lie; try --up {axis} or --up=-{axis}"
                ))
            }
            RegisterError::UpsideDown => Some("give the axis from feet to head with --up".to_owned()),
            _ => None,
        }
    }
}

impl UprightScan {
    /// Registers the template; the landmarks are in the scan's own axes.
    pub fn register(
        &self,
        model: &BodyModel,
        landmarks: &[ScanLandmark],
        input: &ScanInput,
        path: &Path,
    ) -> anyhow::Result<Registration> {
        let at = || path.display().to_string();
        let upright: Vec<ScanLandmark> = landmarks
            .iter()
            .map(|mark| ScanLandmark {
                name: mark.name.clone(),
                position: self.body_from_scan * mark.position,
            })
            .collect();
        let scan = Scan::new(&self.mesh.positions, &self.mesh.triangles).with_context(at)?;
        register(model, scan, &upright).map_err(|error| match input.hint(self, &error) {
            Some(hint) => anyhow::anyhow!("{}: {error}; {hint}", at()),
            None => anyhow::Error::new(error).context(at()),
        })
    }
}

fn bounds(positions: &[[f32; 3]]) -> [DVec3; 2] {
    let points = positions.iter().map(|p| DVec3::from_array(p.map(f64::from)));
    points.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)])
}

fn largest_extent(positions: &[[f32; 3]]) -> f64 {
    let [low, high] = bounds(positions);
    (high - low).max_element()
}

/// Description of a registered mesh, beside its OBJ file.
#[derive(Serialize)]
struct RegistrationFile<'a> {
    version: u32,
    scan: &'a Path,
    unit_of_scan: &'static str,
    landmarks: usize,
    unknown_landmarks: &'a [String],
    surface_mean_mm: f64,
    covered_share: f64,
    stray_share: f64,
    flipped_triangles: usize,
    crossing_triangle_pairs: usize,
    shape_sd: &'a [f64],
    /// In the scan's frame, turned upright (y up), metres.
    root_position_m: [f64; 3],
    root_orientation_xyzw: [f64; 4],
    angles_rad: std::collections::BTreeMap<&'a str, f64>,
    warnings: &'a [String],
}

/// What a user should know of a registration.
pub fn warnings(found: &Registration) -> Vec<String> {
    let mut warnings = Vec::new();
    if !found.unknown_landmarks.is_empty() {
        warnings.push(format!("landmarks not known and not used: {}", found.unknown_landmarks.join(", ")));
    }
    if found.stray_share > 0.005 {
        warnings.push(format!(
            "{:.0} % of the points lie more than {:.0} cm from the body: another person or things; they were left out",
            100.0 * found.stray_share,
            100.0 * STRAY_M
        ));
    }
    let covered = found.distances_m.iter().flatten().count() as f64 / found.distances_m.len() as f64;
    if covered < 0.85 {
        warnings.push(format!("the scan covers {:.0} % of the body; the rest is guessed", 100.0 * covered));
    }
    let spoilt = found.flipped.len() + found.crossing.len();
    if spoilt > 0 {
        warnings.push(format!("{spoilt} triangles are flipped or cross others"));
    }
    warnings
}

/// Registers a scan or a folder of scans.
pub fn run(args: &RegisterArgs) -> anyhow::Result<()> {
    let scans = scans_of(&args.scan)?;
    if args.scan.is_dir() && args.landmarks.is_some() {
        bail!("--landmarks names one file, but {} is a folder of scans", args.scan.display());
    }
    fs::create_dir_all(&args.out)
        .map_err(|source| WriteRunError::Folder { path: args.out.clone(), source })?;
    let model = BodyModel::builtin();
    let is_done = |scan: &PathBuf| output(&args.out, scan, "json").is_file();
    let n_done = scans.iter().filter(|scan| is_done(scan)).count();
    if n_done > 0 {
        note(&format!("{n_done} of {} scans are done already in {}", scans.len(), args.out.display()));
    }
    let mut progress = Progress::start("scans", n_done as u64, Some(scans.len() as u64));
    let mut failures = 0;
    for scan in scans.iter().filter(|scan| !is_done(scan)) {
        match register_one(args, &model, scan) {
            Ok(warnings) => warnings
                .iter()
                .for_each(|text| progress.note(&format!("{}: warning: {text}", scan.display()))),
            // One bad scan does not keep a folder from being done.
            Err(error) if scans.len() > 1 && error.downcast_ref::<WriteRunError>().is_none() => {
                failures += 1;
                progress.note(&format!("error: {error:#}"));
            }
            Err(error) => return Err(error),
        }
        progress.advance();
    }
    if failures > 0 {
        bail!("{failures} of {} scans could not be registered", scans.len());
    }
    Ok(())
}

fn scans_of(path: &Path) -> anyhow::Result<Vec<PathBuf>> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let entries =
        fs::read_dir(path).with_context(|| format!("{}: cannot read the folder", path.display()))?;
    let mut scans = Vec::new();
    for entry in entries {
        let file = entry.with_context(|| format!("{}: cannot read the folder", path.display()))?.path();
        let extension = file.extension().unwrap_or_default().to_ascii_lowercase();
        if extension == "ply" || extension == "obj" {
            scans.push(file);
        }
    }
    if scans.is_empty() {
        bail!("{}: no .ply or .obj files in it", path.display());
    }
    scans.sort();
    Ok(scans)
}

fn register_one(args: &RegisterArgs, model: &BodyModel, path: &Path) -> anyhow::Result<Vec<String>> {
    let scan = args.input.load(path)?;
    let landmarks = match args.landmarks.clone().or_else(|| landmarks_beside(path)) {
        Some(file) => load_landmarks(&file)?,
        None => Vec::new(),
    };
    let found = scan.register(model, &landmarks, &args.input, path)?;
    let mut warnings = warnings(&found);
    if landmarks.is_empty() {
        warnings.push("no landmarks: the pose was guessed from the shape of the scan".to_owned());
    }
    let scan_from_body = scan.body_from_scan.inverse();
    let in_scan: Vec<[f32; 3]> =
        found.vertices.iter().map(|v| (scan_from_body * *v).to_array().map(|x| x as f32)).collect();
    let mesh = output(&args.out, path, "obj");
    write_obj(&mesh, &in_scan, model.triangles()).map_err(unwritten)?;
    let angles = Skeleton::human().dofs().iter().zip(&found.pose.angles);
    let description = RegistrationFile {
        version: 1,
        scan: path,
        unit_of_scan: scan.unit.symbol(),
        landmarks: landmarks.len() - found.unknown_landmarks.len(),
        unknown_landmarks: &found.unknown_landmarks,
        surface_mean_mm: 1e3 * mean(found.distances_m.iter().flatten().copied()),
        covered_share: found.distances_m.iter().flatten().count() as f64 / found.distances_m.len() as f64,
        stray_share: found.stray_share,
        flipped_triangles: found.flipped.len(),
        crossing_triangle_pairs: found.crossing.len(),
        shape_sd: &found.coefficients_sd,
        root_position_m: found.pose.root_position.to_array(),
        root_orientation_xyzw: found.pose.root_orientation.to_array(),
        angles_rad: angles.map(|(dof, angle)| (dof.name.as_str(), *angle)).collect(),
        warnings: &warnings,
    };
    let json = serde_json::to_string_pretty(&description).context("the description as JSON")?;
    // Written last: a scan with a description is done.
    let file = output(&args.out, path, "json");
    fs::write(&file, json + "\n").map_err(|source| WriteRunError::File { path: file, source })?;
    Ok(warnings)
}

fn unwritten(error: WriteMeshError) -> anyhow::Error {
    match error {
        WriteMeshError::Write { path, source } => WriteRunError::File { path, source }.into(),
        other => other.into(),
    }
}

fn output(folder: &Path, scan: &Path, extension: &str) -> PathBuf {
    folder.join(scan.file_stem().unwrap_or_default()).with_extension(extension)
}

fn landmarks_beside(scan: &Path) -> Option<PathBuf> {
    let stem = scan.file_stem()?.to_str()?;
    let endings = ["_landmarks.csv", ".csv", ".lnd"];
    endings.iter().map(|ending| scan.with_file_name(format!("{stem}{ending}"))).find(|file| file.is_file())
}

#[cfg(test)]
mod tests {
    use body::Pose;

    use super::*;

    #[test]
    fn a_user_is_told_of_others_in_the_scan_and_of_what_it_does_not_show() {
        let model = BodyModel::builtin();
        let sound = Registration {
            vertices: Vec::new(),
            coefficients_sd: Vec::new(),
            pose: Pose::rest(model.mean().rest_joints()),
            distances_m: vec![Some(0.001); 100],
            unknown_landmarks: Vec::new(),
            stray_share: 0.0,
            flipped: Vec::new(),
            crossing: Vec::new(),
        };
        assert!(warnings(&sound).is_empty());
        let mut distances_m = sound.distances_m.clone();
        distances_m[..30].fill(None);
        let spoilt = Registration {
            distances_m,
            unknown_landmarks: vec!["Butt Block".to_owned()],
            stray_share: 0.42,
            flipped: vec![7],
            ..sound
        };
        assert_eq!(
            warnings(&spoilt),
            [
                "landmarks not known and not used: Butt Block",
                "42 % of the points lie more than 10 cm from the body: another person or things; they were left out",
                "the scan covers 70 % of the body; the rest is guessed",
                "1 triangles are flipped or cross others",
            ]
        );
    }
}
