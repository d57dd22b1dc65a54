//! Registration against scans whose true surface is known.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, ensure};
use body::BodyModel;
use body::io::bodies::BodiesData;
use body::io::{load_landmarks, load_mesh};
use body::mesh::TriangleTree;
use body::register::{Registration, Scan, register};
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::joint_error::{largest, mean, median};
use super::{markdown_row, write_json};
use crate::progress::Progress;

/// What `umbra eval register` is asked.
#[derive(Clone, Debug)]
pub struct RegisterEval {
    /// Folder with `scans.csv`, clouds, landmarks and true vertices.
    pub scans: PathBuf,
    /// The bodies whose mesh the true vertices are on.
    pub bodies: PathBuf,
    /// Where `eval.json` goes.
    pub out: PathBuf,
    /// Scans are registered without their landmarks.
    pub without_landmarks: bool,
}

/// What came out; lengths in millimetres.
#[derive(Clone, Debug, Serialize)]
pub struct RegisterReport {
    /// Folder of scans.
    pub scans: PathBuf,
    /// Mean distance from the vertices to the scan's surface, where it has one near them; mean over scans.
    pub surface_mean_mm: f64,
    /// Mean distance from all vertices to the true surface, holes included; mean over scans.
    pub true_surface_mean_mm: f64,
    /// Median over vertices of the distance to the true place; mean over scans.
    pub correspondence_median_mm: f64,
    /// Largest of the scans' medians.
    pub correspondence_median_worst_mm: f64,
    /// Time of one registration on one thread, file reading left out; mean.
    pub seconds_per_scan: f64,
    /// The longest.
    pub seconds_worst: f64,
    /// Share of scans without flipped or crossing triangles.
    pub sound_share: f64,
    /// By body part.
    pub parts: Vec<PartErrors>,
    /// Scans of bodies that the program's shape space was not made from, and of those that it was; none when unknown.
    pub groups: Vec<GroupErrors>,
    /// One by one.
    pub each: Vec<ScanErrors>,
}

/// Errors on one part of the body over all scans, millimetres.
#[derive(Clone, Debug, Serialize)]
pub struct PartErrors {
    /// As in `left_hand`.
    pub part: String,
    /// Mean distance to the true surface.
    pub true_surface_mean_mm: f64,
    /// Median distance to the true place.
    pub correspondence_median_mm: f64,
    /// Share of its vertices that have scan near them.
    pub covered_share: f64,
}

/// Means over a group of scans, millimetres.
#[derive(Clone, Debug, Serialize)]
pub struct GroupErrors {
    /// Which.
    pub group: String,
    /// Scans in it.
    pub n_scans: usize,
    /// As in the whole report.
    pub surface_mean_mm: f64,
    /// As in the whole report.
    pub true_surface_mean_mm: f64,
    /// As in the whole report.
    pub correspondence_median_mm: f64,
}

/// Errors of one scan, millimetres.
#[derive(Clone, Debug, Serialize)]
pub struct ScanErrors {
    /// Name of the scan.
    pub scan: String,
    /// `rest` or `varied`.
    pub pose: String,
    /// As in the whole report.
    pub surface_mean_mm: f64,
    /// As in the whole report.
    pub true_surface_mean_mm: f64,
    /// As in the whole report.
    pub correspondence_median_mm: f64,
    /// The largest distance of a vertex to its true place.
    pub correspondence_largest_mm: f64,
    /// Flipped triangles.
    pub flipped: usize,
    /// Pairs of crossing triangles.
    pub crossing: usize,
    /// Time of the registration.
    pub seconds: f64,
}

#[derive(Deserialize)]
struct ScanRow {
    scan_id: String,
    body_id: String,
    pose: String,
}

/// Where each template vertex lies on the population's mesh: a triangle and weights of its corners.
type Places = Vec<([u32; 3], [f64; 3])>;

/// Registers all scans and writes `eval.json`.
pub fn evaluate(eval: &RegisterEval) -> anyhow::Result<RegisterReport> {
    let model = BodyModel::builtin();
    let data = BodiesData::read(&eval.bodies)?;
    let places = places_on(&data, &model);
    let rows = read_rows(&eval.scans.join("scans.csv"))?;
    let known_bodies = read_ids(&eval.bodies.join("truth.csv"))?;
    let mut by_part: BTreeMap<u8, [Vec<f64>; 3]> = BTreeMap::new();
    let (mut each, mut seen) = (Vec::new(), Vec::new());
    let mut progress = Progress::start("scans", 0, Some(rows.len() as u64));
    for row in rows {
        let file = |ending: &str| eval.scans.join(format!("{}{ending}", row.scan_id));
        let cloud = load_mesh(&file(".ply"))?;
        let landmarks =
            if eval.without_landmarks { Vec::new() } else { load_landmarks(&file("_landmarks.csv"))? };
        let truth = read_points(&file("_truth_vertices.npy"), data.mean.len())?;
        let started = Instant::now();
        let scan = Scan::new(&cloud.positions, &cloud.triangles).with_context(|| row.scan_id.clone())?;
        let found = register(&model, scan, &landmarks).with_context(|| row.scan_id.clone())?;
        let seconds = started.elapsed().as_secs_f64();
        let errors = errors(&found, &truth, &data.triangles, &places);
        for (vertex, part) in model.template().parts.iter().enumerate() {
            let [surface, correspondence, covered] = by_part.entry(*part).or_default();
            surface.push(errors.true_surface_mm[vertex]);
            correspondence.push(errors.correspondence_mm[vertex]);
            covered.push(f64::from(u8::from(found.distances_m[vertex].is_some())));
        }
        seen.push(
            known_bodies.iter().position(|id| *id == row.body_id).map(|b| !data.held_out().contains(&b)),
        );
        each.push(ScanErrors {
            scan: row.scan_id,
            pose: row.pose,
            surface_mean_mm: 1e3 * mean(found.distances_m.iter().flatten().copied()),
            true_surface_mean_mm: mean(errors.true_surface_mm),
            correspondence_median_mm: median(&errors.correspondence_mm),
            correspondence_largest_mm: largest(&errors.correspondence_mm),
            flipped: found.flipped.len(),
            crossing: found.crossing.len(),
            seconds,
        });
        progress.advance();
    }
    ensure!(!each.is_empty(), "{}: no scans", eval.scans.join("scans.csv").display());
    let report = summary(eval, &model, each, &seen, by_part);
    write_json(&eval.out, &report)?;
    Ok(report)
}

fn summary(
    eval: &RegisterEval,
    model: &BodyModel,
    each: Vec<ScanErrors>,
    seen: &[Option<bool>],
    by_part: BTreeMap<u8, [Vec<f64>; 3]>,
) -> RegisterReport {
    let over = |value: fn(&ScanErrors) -> f64| each.iter().map(value).collect::<Vec<f64>>();
    let parts = by_part.into_iter().map(|(part, [surface, correspondence, covered])| PartErrors {
        part: model.template().part_names[usize::from(part)].clone(),
        true_surface_mean_mm: mean(surface),
        correspondence_median_mm: median(&correspondence),
        covered_share: mean(covered),
    });
    let group = |name: &str, is_in: &dyn Fn(usize) -> bool| {
        let scans: Vec<&ScanErrors> =
            each.iter().enumerate().filter(|(index, _)| is_in(*index)).map(|(_, scan)| scan).collect();
        (!scans.is_empty()).then(|| GroupErrors {
            group: name.to_owned(),
            n_scans: scans.len(),
            surface_mean_mm: mean(scans.iter().map(|scan| scan.surface_mean_mm)),
            true_surface_mean_mm: mean(scans.iter().map(|scan| scan.true_surface_mean_mm)),
            correspondence_median_mm: mean(scans.iter().map(|scan| scan.correspondence_median_mm)),
        })
    };
    let groups = [
        group("rest pose", &|scan| each[scan].pose == "rest"),
        group("varied pose", &|scan| each[scan].pose == "varied"),
        group("bodies the shape space was made from", &|scan| seen[scan] == Some(true)),
        group("bodies it was not made from", &|scan| seen[scan] == Some(false)),
    ];
    let medians = over(|scan| scan.correspondence_median_mm);
    let seconds = over(|scan| scan.seconds);
    RegisterReport {
        scans: eval.scans.clone(),
        surface_mean_mm: mean(over(|scan| scan.surface_mean_mm)),
        true_surface_mean_mm: mean(over(|scan| scan.true_surface_mean_mm)),
        correspondence_median_worst_mm: largest(&medians),
        correspondence_median_mm: mean(medians),
        seconds_worst: largest(&seconds),
        seconds_per_scan: mean(seconds),
        sound_share: mean(over(|scan| f64::from(u8::from(scan.flipped + scan.crossing == 0)))),
        parts: parts.collect(),
        groups: groups.into_iter().flatten().collect(),
        each,
    }
}

/// The tables that are printed.
pub fn table(report: &RegisterReport) -> String {
    let mut text = format!(
        "{} scans: {:.2} mm to the scan, {:.2} mm to the true surface, median {:.2} mm to the true place (worst scan {:.2}); \
         {:.2} s a scan (worst {:.2}); {:.0} % without flipped or crossing triangles\n\n",
        report.each.len(),
        report.surface_mean_mm,
        report.true_surface_mean_mm,
        report.correspondence_median_mm,
        report.correspondence_median_worst_mm,
        report.seconds_per_scan,
        report.seconds_worst,
        100.0 * report.sound_share
    );
    text += "| group | scans | to the scan mm | to the true surface mm | to the true place, median mm |\n|---|---:|---:|---:|---:|\n";
    for row in &report.groups {
        text += &markdown_row([
            row.group.clone(),
            row.n_scans.to_string(),
            format!("{:.2}", row.surface_mean_mm),
            format!("{:.2}", row.true_surface_mean_mm),
            format!("{:.2}", row.correspondence_median_mm),
        ]);
    }
    text += "\n| part | to the true surface, mean mm | to the true place, median mm | vertices with scan near them |\n|---|---:|---:|---:|\n";
    for row in &report.parts {
        text += &markdown_row([
            row.part.clone(),
            format!("{:.2}", row.true_surface_mean_mm),
            format!("{:.2}", row.correspondence_median_mm),
            format!("{:.0} %", 100.0 * row.covered_share),
        ]);
    }
    text
}

/// Errors of each vertex, millimetres.
struct VertexErrors {
    true_surface_mm: Vec<f64>,
    correspondence_mm: Vec<f64>,
}

fn errors(found: &Registration, truth: &[DVec3], triangles: &[[u32; 3]], places: &Places) -> VertexErrors {
    let surface = TriangleTree::new(truth, triangles);
    let true_surface_mm =
        found.vertices.iter().map(|place| 1e3 * surface.nearest(*place).distance_m).collect();
    let correspondence = |(vertex, (corners, weights)): (&DVec3, &([u32; 3], [f64; 3]))| {
        let place: DVec3 = corners.iter().zip(weights).map(|(&v, w)| truth[v as usize] * *w).sum();
        1e3 * place.distance(*vertex)
    };
    VertexErrors {
        true_surface_mm,
        correspondence_mm: found.vertices.iter().zip(places).map(correspondence).collect(),
    }
}

/// The point of the population's mesh that each template vertex stands for: the nearest one, on the mean of the bodies that
/// the shape space was made from.
fn places_on(data: &BodiesData, model: &BodyModel) -> Places {
    let training = data.training_bodies();
    let mut mean = data.mean.clone();
    for (k, direction) in data.basis.iter().enumerate() {
        let along =
            training.iter().map(|&body| data.coefficients[body][k]).sum::<f64>() / training.len() as f64;
        mean.iter_mut().zip(direction).for_each(|(point, step)| *point += along * *step);
    }
    let tree = TriangleTree::new(&mean, &data.triangles);
    let place = |vertex: &[f32; 3]| {
        let nearest = tree.nearest(DVec3::from_array(vertex.map(f64::from)));
        (data.triangles[nearest.triangle as usize], nearest.barycentric)
    };
    model.mean().rest_vertices().iter().map(place).collect()
}

fn read_rows(path: &Path) -> anyhow::Result<Vec<ScanRow>> {
    let read = || csv::Reader::from_path(path)?.deserialize().collect::<Result<Vec<ScanRow>, csv::Error>>();
    read().with_context(|| format!("{}: cannot read the table", path.display()))
}

fn read_ids(path: &Path) -> anyhow::Result<Vec<String>> {
    #[derive(Deserialize)]
    struct Row {
        body_id: String,
    }
    let read = || csv::Reader::from_path(path)?.deserialize().collect::<Result<Vec<Row>, csv::Error>>();
    let rows = read().with_context(|| format!("{}: cannot read the table", path.display()))?;
    Ok(rows.into_iter().map(|row| row.body_id).collect())
}

fn read_points(path: &Path, count: usize) -> anyhow::Result<Vec<DVec3>> {
    let points = body::io::bodies::read_points(path)?;
    ensure!(points.len() == count, "{}: {} points, expected {count}", path.display(), points.len());
    Ok(points)
}
