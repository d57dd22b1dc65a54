//! The measuring code alone: girths of bodies whose girths are known.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context as _;
use biosig::{Girth, LabelledMesh, Labels, Measurements, Tape};
use body::build::{SurfaceFit, heel_vertices};
use body::io::bodies::BodiesData;
use body::model::Landmark;
use body::register::{Scan, register};
use body::{BodyModel, RestJoints};
use glam::DVec3;
use serde::Serialize;

use super::joint_error::{largest, mean};
use super::{markdown_row, write_json};
use crate::progress::Progress;

/// What `umbra eval girths` is asked.
#[derive(Clone, Debug)]
pub struct GirthsEval {
    /// Folder of bodies on one mesh with `truth.csv`.
    pub bodies: PathBuf,
    /// Where `eval.json` goes.
    pub out: PathBuf,
    /// Bodies that are measured without labels, too.
    pub n_unlabelled: usize,
}

/// What came out.
#[derive(Clone, Debug, Serialize)]
pub struct GirthsReport {
    /// Folder of bodies.
    pub bodies: PathBuf,
    /// How many.
    pub n_bodies: usize,
    /// On the full mesh with its own labels.
    pub full: Vec<QuantityErrors>,
    /// On the template of the program, fitted to each body.
    pub template: Vec<QuantityErrors>,
    /// On the full mesh, labels by registration without landmarks.
    pub unlabelled: Vec<QuantityErrors>,
    /// How many bodies that was.
    pub n_unlabelled: usize,
    /// All girths of one body on the full mesh, milliseconds, the least of all bodies' times and their mean.
    pub milliseconds_least: f64,
    /// See `milliseconds_least`.
    pub milliseconds_mean: f64,
}

/// Errors of one quantity over all bodies, millimetres.
#[derive(Clone, Debug, Serialize)]
pub struct QuantityErrors {
    /// As in `right_thigh`, or `stature`.
    pub quantity: &'static str,
    /// Mean absolute error.
    pub mae_mm: f64,
    /// Mean signed error: positive is measured too large.
    pub bias_mm: f64,
    /// Largest absolute error.
    pub largest_mm: f64,
    /// Share of bodies within 3 mm.
    pub within_3mm: f64,
}

/// Errors by quantity, in the order of [`QUANTITIES`].
type Errors = Vec<Vec<f64>>;

const STATURE: usize = Girth::ALL.len();

fn quantities() -> impl Iterator<Item = &'static str> {
    Girth::ALL.into_iter().map(Girth::name).chain(["stature", "crotch_height"])
}

/// Measures all bodies and writes `eval.json`.
pub fn evaluate(eval: &GirthsEval) -> anyhow::Result<GirthsReport> {
    let data = BodiesData::read(&eval.bodies)?;
    let truth = read_truth(&eval.bodies.join("truth.csv"), data.coefficients.len())?;
    let heels = heel_vertices(&data)?;
    let landmarks: Vec<Landmark> = data.landmarks.iter().map(at_vertex).collect();
    let tape = Tape::new(Labels {
        triangles: &data.triangles,
        parts: &data.parts,
        part_names: &data.part_names,
        landmarks: &landmarks,
    })?;
    let model = BodyModel::builtin();
    let template_tape = Tape::of_model(&model);
    let template_fit = SurfaceFit::new(&data, &model.template().source_vertices, model.triangles())?;
    let n_bodies = data.coefficients.len();
    let every = n_bodies.div_ceil(eval.n_unlabelled.max(1));
    let [mut full, mut template, mut unlabelled] = [(); 3].map(|()| vec![Vec::new(); STATURE + 2]);
    let mut milliseconds = Vec::new();
    let mut progress = Progress::start("bodies", 0, Some(n_bodies as u64));
    for (body, truth) in truth.iter().enumerate() {
        let vertices = data.vertices(body);
        let joints = rest_joints(&data, body, &vertices, heels);
        let mesh = single(&vertices);
        let started = Instant::now();
        let measured = tape.measure(&mesh, &joints)?;
        milliseconds.push(1e3 * started.elapsed().as_secs_f64());
        add(&mut full, &measured, truth);
        let on_template = single(&template_fit.apply(&vertices));
        add(&mut template, &template_tape.measure(&on_template, &joints)?, truth);
        if eval.n_unlabelled > 0 && body % every == 0 {
            let registration = register(&model, Scan::new(&mesh, &data.triangles)?, &[])?;
            let labelled = LabelledMesh::transfer(&model, &registration, &mesh, &data.triangles);
            add(&mut unlabelled, &labelled.measure()?, truth);
        }
        progress.advance();
    }
    let report = GirthsReport {
        bodies: eval.bodies.clone(),
        n_bodies,
        n_unlabelled: unlabelled[0].len(),
        full: summaries(&full),
        template: summaries(&template),
        unlabelled: summaries(&unlabelled),
        milliseconds_least: milliseconds.iter().copied().fold(f64::INFINITY, f64::min),
        milliseconds_mean: mean(milliseconds),
    };
    write_json(&eval.out, &report)?;
    Ok(report)
}

/// The tables that are printed.
pub fn table(report: &GirthsReport) -> String {
    let mut text = format!(
        "{} bodies; all girths of one on its full mesh in {:.2} ms (mean {:.2} ms), one thread\n\n",
        report.n_bodies, report.milliseconds_least, report.milliseconds_mean
    );
    let n_unlabelled = format!("full mesh without labels ({} bodies)", report.n_unlabelled);
    for (name, rows) in [
        ("full mesh", &report.full),
        ("the program's template", &report.template),
        (&n_unlabelled, &report.unlabelled),
    ] {
        if rows.iter().all(|row| row.mae_mm.is_nan()) {
            continue;
        }
        text += &format!(
            "| {name} | mean abs. mm | bias mm | largest mm | within 3 mm |\n|---|---:|---:|---:|---:|\n"
        );
        for row in rows {
            text += &markdown_row([
                row.quantity.to_owned(),
                format!("{:.2}", row.mae_mm),
                format!("{:+.2}", row.bias_mm),
                format!("{:.1}", row.largest_mm),
                format!("{:.1} %", 100.0 * row.within_3mm),
            ]);
        }
        text.push('\n');
    }
    text
}

fn add(errors: &mut Errors, measured: &Measurements, truth_m: &[f64]) {
    let girths = measured.girths.iter().map(|reading| reading.girth_m);
    let all = girths.chain([measured.stature_m, measured.crotch_height_m]);
    for ((errors, measured_m), truth_m) in errors.iter_mut().zip(all).zip(truth_m) {
        errors.push(1e3 * (measured_m - truth_m));
    }
}

fn summaries(errors: &Errors) -> Vec<QuantityErrors> {
    quantities()
        .zip(errors)
        .map(|(quantity, errors)| {
            let absolute: Vec<f64> = errors.iter().map(|error| error.abs()).collect();
            QuantityErrors {
                quantity,
                mae_mm: mean(absolute.iter().copied()),
                bias_mm: mean(errors.iter().copied()),
                largest_mm: largest(&absolute),
                within_3mm: mean(absolute.iter().map(|error| f64::from(u8::from(*error <= 3.0)))),
            }
        })
        .collect()
}

/// The quantities of each body, metres, `[n_bodies]`, in the order of [`quantities`].
fn read_truth(path: &Path, n_bodies: usize) -> anyhow::Result<Vec<Vec<f64>>> {
    let mut reader =
        csv::Reader::from_path(path).with_context(|| format!("{}: cannot read", path.display()))?;
    let header = reader.headers()?.clone();
    let places = quantities()
        .map(|quantity| {
            let column = format!("{quantity}_m");
            let place = header.iter().position(|known| known == column);
            place.with_context(|| format!("{}: the column `{column}` is missing", path.display()))
        })
        .collect::<anyhow::Result<Vec<usize>>>()?;
    let mut rows = Vec::new();
    for (row, record) in reader.records().enumerate() {
        let record = record.with_context(|| format!("{}: cannot read", path.display()))?;
        let number = |&place: &usize| {
            let cell = &record[place];
            cell.parse::<f64>().ok().filter(|x| x.is_finite()).with_context(|| {
                let column = &header[place];
                format!("{}: row {}, `{column}` is `{cell}`, expected metres", path.display(), row + 1)
            })
        };
        rows.push(places.iter().map(number).collect::<anyhow::Result<Vec<f64>>>()?);
    }
    anyhow::ensure!(
        rows.len() == n_bodies,
        "{}: {} rows below the header, expected {n_bodies}, one a body",
        path.display(),
        rows.len()
    );
    Ok(rows)
}

/// A landmark at a vertex.
fn at_vertex((name, vertex): &(String, u32)) -> Landmark {
    Landmark { name: name.clone(), vertices: [*vertex; 3], barycentric: [1.0, 0.0, 0.0] }
}

fn rest_joints(data: &BodiesData, body: usize, vertices: &[DVec3], heels: [u32; 2]) -> RestJoints {
    let joints: Vec<DVec3> =
        data.joints(body).into_iter().chain(heels.map(|heel| vertices[heel as usize])).collect();
    joints.try_into().expect("the population's joints and the heels")
}

fn single(points: &[DVec3]) -> Vec<[f32; 3]> {
    points.iter().map(|p| p.to_array().map(|x| x as f32)).collect()
}
