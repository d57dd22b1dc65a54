//! Stature, weight and gender from known shapes and girths: the predictors alone, cross-validated by person.

use std::path::PathBuf;

use biosig::predict::{Predictor, Sample};
use body::Sex;
use serde::Serialize;

use super::joint_error::mean;
use super::{markdown_row, write_json};
use crate::survey::TrainingData;

/// Parts of the people, each predicted from the others.
const N_FOLDS: usize = 5;

/// What `umbra eval biosig` is asked.
#[derive(Clone, Debug)]
pub struct BiosigEval {
    /// The data folder.
    pub data: PathBuf,
    /// Where `eval.json` goes.
    pub out: PathBuf,
}

/// What came out.
#[derive(Clone, Debug, Serialize)]
pub struct BiosigReport {
    /// The data folder.
    pub data: PathBuf,
    /// One for each kind of features and way of testing.
    pub studies: Vec<Study>,
}

/// Errors of one kind of features.
#[derive(Clone, Debug, Serialize)]
pub struct Study {
    /// What is predicted from what, and how it is tested.
    pub name: String,
    /// People judged.
    pub n_people: usize,
    /// Errors by quantity and group.
    pub rows: Vec<Row>,
    /// Mean absolute error of the mean of the person's sex: stature mm, weight kg.
    pub mean_of_sex: [f64; 2],
    /// Share of women and of men recognised, averaged.
    pub gender_balanced_accuracy: f64,
    /// Mean of -ln(probability of the true gender).
    pub gender_log_loss: f64,
}

/// Errors of one quantity in one group.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// `stature` (mm) or `weight` (kg).
    pub quantity: &'static str,
    /// As in `women` or `BMI, upper third`.
    pub group: String,
    /// People in it.
    pub n_people: usize,
    /// Mean absolute error.
    pub mae: f64,
    /// Mean signed error: positive is predicted too large.
    pub bias: f64,
    /// Share whose 90 % interval holds the truth.
    pub coverage90: f64,
    /// Share of the group whose gender is recognised.
    pub gender_accuracy: f64,
}

/// A prediction beside the truth.
struct Judged {
    sample: Sample,
    profile: biosig::predict::Profile,
}

/// Runs all studies and writes `eval.json`.
pub fn evaluate(eval: &BiosigEval) -> anyhow::Result<BiosigReport> {
    let data = TrainingData::read(&eval.data)?;
    let shipped = Predictor::fit(&data.shape)?;
    let held_out = data
        .shape_held_out
        .iter()
        .map(|sample| Judged { profile: shipped.predict(&sample.features), sample: sample.clone() })
        .collect::<Vec<_>>();
    let studies = vec![
        study("shape, five folds of the training bodies", cross_validated(&data.shape)?),
        study("shape, bodies held out", held_out),
        study("five girths, five folds of the survey", cross_validated(&data.girths)?),
        study(
            "five girths and stature, five folds of the survey",
            cross_validated(&data.girths_and_stature())?,
        ),
    ];
    let report = BiosigReport { data: eval.data.clone(), studies };
    write_json(&eval.out, &report)?;
    Ok(report)
}

/// Every person predicted by a machine that has not seen them. Rows are dealt to the folds in turn, in pairs: the
/// bodies alternate between men and women.
fn cross_validated(samples: &[Sample]) -> anyhow::Result<Vec<Judged>> {
    let mut judged = Vec::with_capacity(samples.len());
    for fold in 0..N_FOLDS {
        let is_held = |row: usize| (row / 2) % N_FOLDS == fold;
        let train: Vec<Sample> =
            (0..samples.len()).filter(|&row| !is_held(row)).map(|row| samples[row].clone()).collect();
        let predictor = Predictor::fit(&train)?;
        for row in (0..samples.len()).filter(|&row| is_held(row)) {
            let sample = samples[row].clone();
            judged.push(Judged { profile: predictor.predict(&sample.features), sample });
        }
    }
    Ok(judged)
}

fn study(name: &str, judged: Vec<Judged>) -> Study {
    let all: Vec<&Judged> = judged.iter().collect();
    let of_sex = |sex: Sex| all.iter().copied().filter(|j| j.sample.sex == sex).collect::<Vec<_>>();
    let (women, men) = (of_sex(Sex::Female), of_sex(Sex::Male));
    let mut groups =
        vec![("all".to_owned(), all.clone()), ("women".to_owned(), women), ("men".to_owned(), men)];
    groups.extend(thirds("stature", &all, |sample| sample.stature_m));
    groups.extend(thirds("BMI", &all, |sample| sample.weight_kg / sample.stature_m.powi(2)));
    let accuracy = |group: &[&Judged]| mean(group.iter().map(|j| f64::from(u8::from(is_recognised(j)))));
    let mut rows = Vec::new();
    for (group, people) in &groups {
        for quantity in ["stature", "weight"] {
            let errors = people.iter().map(|j| error(j, quantity)).collect::<Vec<_>>();
            rows.push(Row {
                quantity,
                group: group.clone(),
                n_people: people.len(),
                mae: mean(errors.iter().map(|e| e.abs())),
                bias: mean(errors.iter().copied()),
                coverage90: mean(people.iter().map(|j| f64::from(u8::from(is_covered(j, quantity))))),
                gender_accuracy: accuracy(people),
            });
        }
    }
    let log_loss = all.iter().map(|j| {
        let female = j.profile.female;
        -(if j.sample.sex == Sex::Female { female } else { 1.0 - female }).max(1e-12).ln()
    });
    Study {
        name: name.to_owned(),
        n_people: all.len(),
        rows,
        mean_of_sex: ["stature", "weight"].map(|quantity| mean_of_sex_error(&groups[1..3], quantity)),
        gender_balanced_accuracy: accuracy(&groups[1].1).midpoint(accuracy(&groups[2].1)),
        gender_log_loss: mean(log_loss),
    }
}

/// Three groups of equal size, by `value`.
fn thirds<'a>(
    name: &str,
    people: &[&'a Judged],
    value: impl Fn(&Sample) -> f64,
) -> Vec<(String, Vec<&'a Judged>)> {
    let mut sorted = people.to_vec();
    sorted.sort_by(|a, b| value(&a.sample).total_cmp(&value(&b.sample)));
    let n = sorted.len();
    let third = |k: usize| sorted[k * n / 3..(k + 1) * n / 3].to_vec();
    ["lower", "middle", "upper"]
        .into_iter()
        .enumerate()
        .map(|(k, which)| (format!("{name}, {which} third"), third(k)))
        .collect()
}

/// Millimetres or kilograms.
fn error(judged: &Judged, quantity: &str) -> f64 {
    match quantity {
        "stature" => 1e3 * (judged.profile.stature_m.value - judged.sample.stature_m),
        _ => judged.profile.weight_kg.value - judged.sample.weight_kg,
    }
}

fn is_covered(judged: &Judged, quantity: &str) -> bool {
    let (interval, truth) = match quantity {
        "stature" => (judged.profile.stature_m.interval90, judged.sample.stature_m),
        _ => (judged.profile.weight_kg.interval90, judged.sample.weight_kg),
    };
    (interval[0]..=interval[1]).contains(&truth)
}

fn is_recognised(judged: &Judged) -> bool {
    (judged.profile.female > 0.5) == (judged.sample.sex == Sex::Female)
}

/// Mean absolute difference to the mean of the own sex, over both.
fn mean_of_sex_error(sexes: &[(String, Vec<&Judged>)], quantity: &str) -> f64 {
    let value =
        |j: &&Judged| if quantity == "stature" { 1e3 * j.sample.stature_m } else { j.sample.weight_kg };
    let errors = sexes.iter().flat_map(|(_, people)| {
        let middle = mean(people.iter().map(value));
        people.iter().map(value).map(move |v| (v - middle).abs()).collect::<Vec<_>>()
    });
    mean(errors)
}

/// The tables that are printed.
pub fn table(report: &BiosigReport) -> String {
    let mut text = String::new();
    for study in &report.studies {
        text += &format!(
            "{} ({} people): gender balanced accuracy {:.1} %, log loss {:.3}; mean of the sex: stature {:.1} mm, weight {:.2} kg\n\n",
            study.name,
            study.n_people,
            100.0 * study.gender_balanced_accuracy,
            study.gender_log_loss,
            study.mean_of_sex[0],
            study.mean_of_sex[1]
        );
        text += "| group | people | stature mm | bias | in 90 % | weight kg | bias | in 90 % | gender |\n|---|---:|---:|---:|---:|---:|---:|---:|---:|\n";
        for pair in study.rows.chunks(2) {
            let [stature, weight] = pair else { continue };
            text += &markdown_row([
                stature.group.clone(),
                stature.n_people.to_string(),
                format!("{:.1}", stature.mae),
                format!("{:+.1}", stature.bias),
                format!("{:.0} %", 100.0 * stature.coverage90),
                format!("{:.2}", weight.mae),
                format!("{:+.2}", weight.bias),
                format!("{:.0} %", 100.0 * weight.coverage90),
                format!("{:.1} %", 100.0 * stature.gender_accuracy),
            ]);
        }
        text.push('\n');
    }
    text
}
