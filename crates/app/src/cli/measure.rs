//! `umbra measure`: girths, stature and volume of a body mesh.

use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::path::PathBuf;

use anyhow::Context as _;
use biosig::{Girth, LabelledMesh, Measurements, MeshNotes, SoundMesh};
use body::BodyModel;
use body::io::load_landmarks;
use clap::Args;
use serde::Serialize;

use super::register::{ScanInput, warnings};
use crate::progress::note;
use crate::run_folder::WriteRunError;

/// Arguments of `umbra measure`.
#[derive(Debug, Args)]
pub struct MeasureArgs {
    /// A mesh of one person, OBJ or PLY; points alone will do.
    #[arg(value_name = "MESH")]
    mesh: PathBuf,
    /// Landmarks of the mesh, which make it surer: a table (name, x_m, y_m, z_m) or a CAESAR .lnd file.
    #[arg(long, value_name = "FILE")]
    landmarks: Option<PathBuf>,
    #[command(flatten)]
    input: ScanInput,
    /// Write the measurements to this file, too.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// What is written to a file.
#[derive(Serialize)]
struct MeasurementsFile {
    version: u32,
    mesh: PathBuf,
    unit_of_mesh: &'static str,
    quantities: Vec<Quantity>,
    warnings: Vec<String>,
}

#[derive(Serialize)]
struct Quantity {
    name: &'static str,
    value: f64,
    unit: &'static str,
    /// Of the plane above the soles, where the plane is horizontal.
    height_mm: Option<f64>,
    definition: &'static str,
}

/// Measures and prints a table.
pub fn run(args: &MeasureArgs) -> anyhow::Result<()> {
    let scan = args.input.load(&args.mesh)?;
    let at = || args.mesh.display().to_string();
    let model = BodyModel::builtin();
    let landmarks = args.landmarks.as_deref().map(load_landmarks).transpose()?.unwrap_or_default();
    let sound = if scan.mesh.triangles.is_empty() {
        None
    } else {
        Some(SoundMesh::new(&scan.mesh.positions, &scan.mesh.triangles).with_context(at)?)
    };
    let registration = scan.register(&model, &landmarks, &args.input, &args.mesh)?;
    let mut warnings = warnings(&registration);
    let of_template = LabelledMesh::of_template(&model, &registration).measure().with_context(at)?;
    let measured = match &sound {
        None => {
            warnings.push("points without triangles: the template on them was measured".to_owned());
            of_template
        }
        Some(sound) => {
            warnings.extend(mesh_warnings(&sound.notes));
            let labelled = LabelledMesh::transfer(&model, &registration, &sound.vertices, &sound.triangles);
            let mut measured = labelled.measure().with_context(at)?;
            if !sound.notes.is_closed {
                measured.volume_m3 = of_template.volume_m3;
            }
            measured
        }
    };
    warnings.iter().for_each(|text| note(&format!("{}: warning: {text}", args.mesh.display())));
    let file = MeasurementsFile {
        version: 1,
        mesh: args.mesh.clone(),
        unit_of_mesh: scan.unit.symbol(),
        quantities: quantities(&measured),
        warnings,
    };
    if let Some(path) = &args.json {
        let json = serde_json::to_string_pretty(&file).context("the measurements as JSON")?;
        fs::write(path, json + "\n").map_err(|source| WriteRunError::File { path: path.clone(), source })?;
    }
    std::io::stdout().write_all(table(&file.quantities).as_bytes())?;
    Ok(())
}

/// What was found in the mesh, and what was done about it.
fn mesh_warnings(notes: &MeshNotes) -> Vec<String> {
    let mut warnings = Vec::new();
    let mut tell = |is_so: bool, text: String| {
        if is_so {
            warnings.push(text);
        }
    };
    tell(notes.joined_vertices > 0, format!("{} repeated vertices were joined", notes.joined_vertices));
    tell(
        notes.dropped_triangles > 0,
        format!("{} triangles without area were left out", notes.dropped_triangles),
    );
    tell(
        notes.crowded_edges > 0,
        format!("{} edges have more than two triangles; all of these count in sections", notes.crowded_edges),
    );
    tell(notes.was_inside_out, "the triangles faced inwards and were turned".to_owned());
    tell(notes.open_edges > 0, format!("the mesh is open along {} edges", notes.open_edges));
    tell(!notes.is_closed, "the surface is not closed: the volume is that of the template on it".to_owned());
    warnings
}

fn quantities(measured: &Measurements) -> Vec<Quantity> {
    let girths = Girth::ALL.into_iter().map(|girth| {
        let plane = measured.plane(girth);
        Quantity {
            name: girth.name(),
            value: 1e3 * measured.girth_m(girth),
            unit: "mm",
            height_mm: (plane.normal == glam::DVec3::Y).then_some(1e3 * plane.point.y),
            definition: girth.definition(),
        }
    });
    let other = |name, value, unit, definition| Quantity { name, value, unit, height_mm: None, definition };
    girths
        .chain([
            other("stature", 1e3 * measured.stature_m, "mm", "from the lowest to the highest point, upright"),
            other(
                "crotch_height",
                1e3 * measured.crotch_height_m,
                "mm",
                "the point between the legs above the soles",
            ),
            other("volume", 1e3 * measured.volume_m3, "l", "enclosed by the surface"),
        ])
        .collect()
}

fn table(quantities: &[Quantity]) -> String {
    let mut text = String::new();
    for quantity in quantities {
        let height = quantity.height_mm.map_or_else(String::new, |height| format!("at {height:.0} mm"));
        let Quantity { name, value, unit, definition, .. } = quantity;
        let _ = writeln!(text, "{name:<16} {value:>8.1} {unit:<2}  {height:<11}  {definition}");
    }
    text
}
