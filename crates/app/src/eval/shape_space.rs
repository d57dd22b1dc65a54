//! Two shape spaces side by side: from scans that were registered, and from known correspondences of the same bodies.

use std::path::PathBuf;

use anyhow::{Context as _, ensure};
use body::BodyModel;
use body::build::SurfaceFit;
use body::io::bodies::BodiesData;
use body::io::{load_landmarks, load_mesh};
use body::register::{Scan, register};
use glam::DVec3;
use nalgebra::{DMatrix, SymmetricEigen};
use serde::{Deserialize, Serialize};

use super::joint_error::mean;
use super::{markdown_row, write_json};
use crate::progress::Progress;

/// Bodies are predicted from components of the others in so many parts.
const N_FOLDS: usize = 4;
/// Numbers of components in the table.
const COMPONENTS: [usize; 5] = [1, 5, 10, 20, 40];

/// What `umbra eval shape-space` is asked.
#[derive(Clone, Debug)]
pub struct ShapeSpaceEval {
    /// Folder of scans.
    pub scans: PathBuf,
    /// The population that their bodies are of.
    pub bodies: PathBuf,
    /// Where `eval.json` goes.
    pub out: PathBuf,
}

/// What came out.
#[derive(Clone, Debug, Serialize)]
pub struct ShapeSpaceReport {
    /// Folder of scans.
    pub scans: PathBuf,
    /// Bodies in both spaces.
    pub n_bodies: usize,
    /// Mean distance of registered vertices at rest to their known places, millimetres.
    pub registered_to_known_mm: f64,
    /// One for each number of components.
    pub rows: Vec<SpaceRow>,
}

/// Both spaces with one number of components.
#[derive(Clone, Debug, Serialize)]
pub struct SpaceRow {
    /// Principal components.
    pub components: usize,
    /// Share of the variance that they explain, in the space of registered scans, and of known correspondences.
    pub variance_share: [f64; 2],
    /// Mean distance of the vertices of bodies left out to their nearest bodies in the space, millimetres. The bodies left out
    /// are the known ones for both.
    pub generalisation_mm: [f64; 2],
}

#[derive(Deserialize)]
struct ScanRow {
    scan_id: String,
    body_id: String,
}

#[derive(Deserialize)]
struct BodyRow {
    body_id: String,
}

/// Registers all scans, builds both spaces and writes `eval.json`.
pub fn evaluate(eval: &ShapeSpaceEval) -> anyhow::Result<ShapeSpaceReport> {
    let model = BodyModel::builtin();
    let data = BodiesData::read(&eval.bodies)?;
    let fit = SurfaceFit::new(&data, &model.template().source_vertices, model.triangles())?;
    let scans: Vec<ScanRow> = read_table(&eval.scans.join("scans.csv"))?;
    let bodies: Vec<BodyRow> = read_table(&eval.bodies.join("truth.csv"))?;
    let (mut registered, mut known) = (Vec::new(), Vec::new());
    let mut progress = Progress::start("scans", 0, Some(scans.len() as u64));
    for scan in &scans {
        let body = bodies.iter().position(|row| row.body_id == scan.body_id).with_context(|| {
            format!("{}: no body `{}`", eval.bodies.join("truth.csv").display(), scan.body_id)
        })?;
        let cloud = load_mesh(&eval.scans.join(format!("{}.ply", scan.scan_id)))?;
        let landmarks = load_landmarks(&eval.scans.join(format!("{}_landmarks.csv", scan.scan_id)))?;
        let found = register(&model, Scan::new(&cloud.positions, &cloud.triangles)?, &landmarks)?;
        registered.push(found.rest_vertices(&model));
        known.push(fit.apply(&data.vertices(body)));
        progress.advance();
    }
    ensure!(known.len() > COMPONENTS[0] + N_FOLDS, "{}: too few scans", eval.scans.display());
    let report = compare(eval, &registered, &known);
    write_json(&eval.out, &report)?;
    Ok(report)
}

fn compare(eval: &ShapeSpaceEval, registered: &[Vec<DVec3>], known: &[Vec<DVec3>]) -> ShapeSpaceReport {
    let n = known.len();
    let least = n - n.div_ceil(N_FOLDS) - 1;
    let spaces = [registered, known];
    let shares = spaces.map(|bodies| Space::of(bodies, &(0..n).collect::<Vec<_>>()).variance_shares);
    let rows = COMPONENTS.into_iter().filter(|&components| components <= least).map(|components| SpaceRow {
        components,
        variance_share: [0, 1].map(|space| shares[space].iter().take(components).sum()),
        generalisation_mm: spaces.map(|bodies| generalisation_mm(bodies, known, components)),
    });
    let distances = registered.iter().zip(known).map(|(a, b)| mean_distance_mm(a, b));
    ShapeSpaceReport {
        scans: eval.scans.clone(),
        n_bodies: n,
        registered_to_known_mm: mean(distances),
        rows: rows.collect(),
    }
}

fn generalisation_mm(bodies: &[Vec<DVec3>], known: &[Vec<DVec3>], components: usize) -> f64 {
    let mut distances = Vec::new();
    for fold in 0..N_FOLDS {
        let train: Vec<usize> = (0..bodies.len()).filter(|body| body % N_FOLDS != fold).collect();
        let space = Space::of(bodies, &train);
        let left_out = (0..bodies.len()).filter(|body| body % N_FOLDS == fold);
        distances.extend(
            left_out.map(|body| mean_distance_mm(&space.nearest(&known[body], components), &known[body])),
        );
    }
    mean(distances)
}

fn mean_distance_mm(a: &[DVec3], b: &[DVec3]) -> f64 {
    1e3 * mean(a.iter().zip(b).map(|(a, b)| a.distance(*b)))
}

/// Principal components of a few bodies.
struct Space {
    mean: Vec<DVec3>,
    /// Orthonormal, largest variance first.
    components: Vec<Vec<DVec3>>,
    variance_shares: Vec<f64>,
}

impl Space {
    /// By the eigenvectors of the bodies' inner products: there are fewer bodies than coordinates.
    fn of(bodies: &[Vec<DVec3>], which: &[usize]) -> Self {
        let n = which.len();
        let n_vertices = bodies[which[0]].len();
        let mean: Vec<DVec3> = (0..n_vertices)
            .map(|vertex| which.iter().map(|&body| bodies[body][vertex]).sum::<DVec3>() / n as f64)
            .collect();
        let centred: Vec<Vec<DVec3>> = which
            .iter()
            .map(|&body| bodies[body].iter().zip(&mean).map(|(place, mean)| *place - *mean).collect())
            .collect();
        let gram = DMatrix::from_fn(n, n, |a, b| inner(&centred[a], &centred[b]));
        let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(gram);
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|&a, &b| eigenvalues[b].total_cmp(&eigenvalues[a]));
        order.truncate(n - 1); // the mean takes one dimension
        let component = |&k: &usize| {
            let mut sum = vec![DVec3::ZERO; n_vertices];
            for (body, weight) in centred.iter().zip(eigenvectors.column(k).iter()) {
                sum.iter_mut().zip(body).for_each(|(sum, step)| *sum += *weight * *step);
            }
            let length = inner(&sum, &sum).sqrt();
            sum.into_iter().map(|step| step / length).collect()
        };
        let total = eigenvalues.sum();
        Self {
            components: order.iter().map(component).collect(),
            variance_shares: order.iter().map(|&k| eigenvalues[k] / total).collect(),
            mean,
        }
    }

    /// The body of the space nearest to `body`.
    fn nearest(&self, body: &[DVec3], components: usize) -> Vec<DVec3> {
        let away: Vec<DVec3> = body.iter().zip(&self.mean).map(|(place, mean)| *place - *mean).collect();
        let mut nearest = self.mean.clone();
        for component in self.components.iter().take(components) {
            let along = inner(component, &away);
            nearest.iter_mut().zip(component).for_each(|(place, step)| *place += along * *step);
        }
        nearest
    }
}

fn inner(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum()
}

fn read_table<T: serde::de::DeserializeOwned>(path: &std::path::Path) -> anyhow::Result<Vec<T>> {
    let read = || csv::Reader::from_path(path)?.deserialize().collect::<Result<Vec<T>, csv::Error>>();
    read().with_context(|| format!("{}: cannot read the table", path.display()))
}

/// The table that is printed.
pub fn table(report: &ShapeSpaceReport) -> String {
    let mut text = format!(
        "{} bodies; registered vertices at rest lie {:.2} mm from their known places on average\n\n\
         | components | variance, registered | variance, known | bodies left out, registered mm | known mm |\n|---:|---:|---:|---:|---:|\n",
        report.n_bodies, report.registered_to_known_mm
    );
    for row in &report.rows {
        text += &markdown_row([
            row.components.to_string(),
            format!("{:.1} %", 100.0 * row.variance_share[0]),
            format!("{:.1} %", 100.0 * row.variance_share[1]),
            format!("{:.2}", row.generalisation_mm[0]),
            format!("{:.2}", row.generalisation_mm[1]),
        ]);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bodies_on_a_line_need_one_component() {
        let bodies: Vec<Vec<DVec3>> = (0..6)
            .map(|k| vec![DVec3::new(f64::from(k), 0.0, 1.0), DVec3::new(0.0, 2.0 * f64::from(k), 0.0)])
            .collect();
        let space = Space::of(&bodies[..5], &[0, 1, 2, 3, 4]);
        assert!((space.variance_shares[0] - 1.0).abs() < 1e-12);
        assert!(mean_distance_mm(&space.nearest(&bodies[5], 1), &bodies[5]) < 1e-9);
        assert!(mean_distance_mm(&space.nearest(&bodies[5], 0), &bodies[5]) > 1e3);
    }
}
