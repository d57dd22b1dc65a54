//! People whose stature, weight and sex are known: what the predictors are trained on and judged by.

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::{Context as _, ensure};
use biosig::predict::{N_SHAPE_FEATURES, Predictor, Predictors, Sample};
use body::build::SurfaceFit;
use body::io::bodies::BodiesData;
use body::{BodyModel, Sex};
use serde::Deserialize;

/// A person of the girth survey, as `ansur2_public.csv` has them.
#[derive(Clone, Debug, PartialEq, Deserialize)]
struct SurveyRow {
    subject_id: String,
    sex: String,
    weight_kg: f64,
    stature_m: f64,
    chest_circumference_m: f64,
    waist_circumference_m: f64,
    hip_circumference_m: f64,
    thigh_circumference_m: f64,
    calf_circumference_m: f64,
}

/// A body of the population, as `truth.csv` has it.
#[derive(Clone, Debug, PartialEq, Deserialize)]
struct BodyRow {
    ansur_subject_id: String,
    sex: String,
    weight_kg: f64,
    stature_m: f64,
}

/// Samples with shape coefficients, and with girths; the bodies that are held out and the people they were made after are apart.
pub struct TrainingData {
    /// Bodies that may be trained on: shape coefficients.
    pub shape: Vec<Sample>,
    /// Bodies that may not.
    pub shape_held_out: Vec<Sample>,
    /// People of the survey after whom no held-out body was made: five girths.
    pub girths: Vec<Sample>,
}

impl TrainingData {
    /// Reads `bodies` and `ansur` of the data folder.
    ///
    /// # Errors
    /// Names the file at fault.
    pub fn read(folder: &Path) -> anyhow::Result<Self> {
        let bodies = folder.join("bodies");
        let data = BodiesData::read(&bodies)?;
        let truth = bodies.join("truth.csv");
        let rows: Vec<BodyRow> = read_table(&truth)?;
        let n_bodies = data.coefficients.len();
        ensure!(rows.len() == n_bodies, "{}: {} rows, expected {n_bodies}", truth.display(), rows.len());
        let model = BodyModel::builtin();
        let fit = SurfaceFit::new(&data, &model.template().source_vertices, model.triangles())?;
        let mut samples: Vec<Sample> = Vec::with_capacity(n_bodies);
        for (body, row) in rows.iter().enumerate() {
            let mut features = model.coefficients_of(&fit.apply(&data.vertices(body)));
            features.truncate(N_SHAPE_FEATURES);
            let (stature_m, weight_kg) = (row.stature_m, row.weight_kg);
            samples.push(Sample { features, stature_m, weight_kg, sex: sex_of(&row.sex, &truth)? });
        }
        let held_out = data.held_out();
        let apart: BTreeSet<&str> =
            held_out.iter().map(|&body| rows[body].ansur_subject_id.as_str()).collect();
        let samples_of = |bodies: &[usize]| bodies.iter().map(|&body| samples[body].clone()).collect();
        let (shape, shape_held_out) = (samples_of(&data.training_bodies()), samples_of(&held_out));
        Ok(Self { shape, shape_held_out, girths: survey(&folder.join("ansur/ansur2_public.csv"), &apart)? })
    }

    /// The samples with the stature as a sixth feature.
    pub fn girths_and_stature(&self) -> Vec<Sample> {
        let mut samples = self.girths.clone();
        samples.iter_mut().for_each(|sample| sample.features.push(sample.stature_m));
        samples
    }

    /// The predictors that the program ships.
    ///
    /// # Errors
    /// When the people are too few.
    pub fn predictors(&self) -> anyhow::Result<Predictors> {
        Ok(Predictors {
            shape: Predictor::fit(&self.shape).context("the shape predictor")?,
            girths: Predictor::fit(&self.girths).context("the girth predictor")?,
            girths_and_stature: Predictor::fit(&self.girths_and_stature())
                .context("the predictor from girths and stature")?,
        })
    }
}

fn survey(path: &Path, apart: &BTreeSet<&str>) -> anyhow::Result<Vec<Sample>> {
    let rows: Vec<SurveyRow> = read_table(path)?;
    let allowed = rows.into_iter().filter(|row| !apart.contains(row.subject_id.as_str()));
    allowed
        .map(|row| {
            let features = vec![
                row.chest_circumference_m,
                row.waist_circumference_m,
                row.hip_circumference_m,
                row.thigh_circumference_m,
                row.calf_circumference_m,
            ];
            let (stature_m, weight_kg) = (row.stature_m, row.weight_kg);
            Ok(Sample { features, stature_m, weight_kg, sex: sex_of(&row.sex, path)? })
        })
        .collect()
}

fn sex_of(text: &str, path: &Path) -> anyhow::Result<Sex> {
    match text {
        "female" => Ok(Sex::Female),
        "male" => Ok(Sex::Male),
        _ => anyhow::bail!("{}: `sex` is `{text}`, expected `female` or `male`", path.display()),
    }
}

fn read_table<T: serde::de::DeserializeOwned>(path: &Path) -> anyhow::Result<Vec<T>> {
    let read = || csv::Reader::from_path(path)?.deserialize().collect::<Result<Vec<T>, csv::Error>>();
    read().with_context(|| format!("{}: cannot read the table", path.display()))
}
