//! The figures of a shape evaluation, as JSON and as tables.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use anyhow::Context as _;
use body::Sex;
use serde::Serialize;

use super::stage::StageSubject;
use crate::eval::joint_error::mean;
use crate::shape::{Estimate, Prediction, Quantity};
use crate::synth::Truth;

/// A person with everything that was predicted of them.
pub struct Scored<'a> {
    /// What is true.
    pub truth: &'a Truth,
    /// Name of the recording that moves them.
    pub motion: &'a str,
    /// Mean distance of the vertices of the fitted body from their true places, at rest, millimetres.
    pub surface_mm: Option<f64>,
    /// From the whole clip; none when it could not be fitted.
    pub person: Option<Prediction>,
    /// The same with the stature known,
    pub with_stature: Option<Prediction>,
    /// and with stature and weight known.
    pub with_both: Option<Prediction>,
    /// From single frames.
    pub frames: Vec<Prediction>,
    /// Baselines of each quantity: sex, stature, stature and weight.
    pub baselines: [[f64; 3]; 7],
}

/// Errors of one quantity, millimetres or kilograms.
#[derive(Clone, Debug, Serialize)]
pub struct Score {
    /// Mean absolute error.
    pub mae: f64,
    /// Mean of estimate less truth.
    pub bias: f64,
    /// Share of the truths inside the 90 % intervals.
    pub coverage90: f64,
    /// Mean absolute error as a share of the truth, per cent.
    pub mae_percent: f64,
    /// Largest error.
    pub worst: f64,
    /// Mean absolute error with the stature known,
    pub mae_stature_known: f64,
    /// and with stature and weight known.
    pub mae_stature_weight_known: f64,
    /// Mean absolute error from single frames,
    pub mae_per_frame: f64,
    /// and the share of truths inside their intervals.
    pub coverage90_per_frame: f64,
    /// Mean absolute error of predicting the mean of the sex,
    pub baseline_sex: f64,
    /// of a line on stature,
    pub baseline_stature: f64,
    /// and of a line on stature and weight.
    pub baseline_stature_weight: f64,
    /// By group: women, men, thirds of stature and of body mass index.
    pub groups: BTreeMap<&'static str, GroupScore>,
}

/// Errors of one quantity in a group of people, millimetres or kilograms.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct GroupScore {
    /// Its size.
    pub people: usize,
    /// Mean absolute error.
    pub mae: f64,
    /// Mean of estimate less truth.
    pub bias: f64,
}

/// Accuracy of the sex.
#[derive(Clone, Debug, Serialize)]
pub struct GenderScore {
    /// Mean of the shares of women and of men told right.
    pub balanced_accuracy: f64,
    /// The same from single frames.
    pub balanced_accuracy_per_frame: f64,
}

/// Figures by quantity.
#[derive(Clone, Debug, Serialize)]
pub struct Quantities {
    /// `chest` and so on.
    #[serde(flatten)]
    pub scores: BTreeMap<&'static str, Score>,
    /// The sex.
    pub gender: GenderScore,
}

/// What `eval.json` holds.
#[derive(Clone, Debug, Serialize)]
pub struct ShapeReport {
    /// People tested.
    pub people: usize,
    /// People without a body: they count in no figure.
    pub without_fit: usize,
    /// Seconds a person for tracking and fit: mean.
    pub seconds_per_person: f64,
    /// Distance of the vertices of the fitted bodies from their true places, at rest: mean, millimetres.
    pub surface_mm: f64,
    /// Figures.
    pub quantities: Quantities,
    /// Subjects of a stage-like data set, who are in none of the figures above.
    pub stage: Vec<StageSubject>,
}

impl ShapeReport {
    /// The figures of all people.
    pub fn of(scored: &[Scored<'_>], stage: Vec<StageSubject>, seconds: impl Iterator<Item = f64>) -> Self {
        let fitted: Vec<&Scored<'_>> = scored.iter().filter(|scored| scored.person.is_some()).collect();
        let scores = Quantity::ALL.map(|quantity| (quantity.name(), score(&fitted, quantity)));
        let person = |scored: &&Scored<'_>| -> Vec<(Sex, f64)> {
            scored.person.iter().map(|p| (scored.truth.sex, p.male_probability)).collect()
        };
        let frames = |scored: &&Scored<'_>| -> Vec<(Sex, f64)> {
            scored.frames.iter().map(|p| (scored.truth.sex, p.male_probability)).collect()
        };
        Self {
            stage,
            people: scored.len(),
            without_fit: scored.len() - fitted.len(),
            seconds_per_person: seconds.sum::<f64>() / scored.len() as f64,
            surface_mm: mean(scored.iter().filter_map(|scored| scored.surface_mm)),
            quantities: Quantities {
                scores: scores.into_iter().collect(),
                gender: GenderScore {
                    balanced_accuracy: balanced_accuracy(fitted.iter().flat_map(person)),
                    balanced_accuracy_per_frame: balanced_accuracy(fitted.iter().flat_map(frames)),
                },
            },
        }
    }
}

fn balanced_accuracy(judged: impl Iterator<Item = (Sex, f64)>) -> f64 {
    let (mut right, mut all) = ([0.0; 2], [0.0; 2]);
    for (sex, male_probability) in judged {
        let place = usize::from(sex == Sex::Male);
        all[place] += 1.0;
        right[place] += f64::from(u8::from((male_probability > 0.5) == (sex == Sex::Male)));
    }
    0.5 * (right[0] / all[0] + right[1] / all[1])
}

fn score(fitted: &[&Scored<'_>], quantity: Quantity) -> Score {
    let scale = Score::scale(quantity);
    let mean = |values: Vec<f64>| values.iter().sum::<f64>() / values.len() as f64;
    let truth = |scored: &Scored<'_>| quantity.of(scored.truth);
    let errors = |of: &dyn Fn(&Scored<'_>) -> Option<f64>| -> Vec<f64> {
        fitted.iter().filter_map(|scored| Some(scale * (of(scored)? - truth(scored)))).collect()
    };
    let size = |errors: Vec<f64>| mean(errors.into_iter().map(f64::abs).collect());
    let value = |prediction: &Option<Prediction>| prediction.as_ref().map(|p| p.of(quantity).value);
    let own = errors(&|scored| value(&scored.person));
    let inside = |estimate: &Estimate, truth: f64| {
        let [low, high] = estimate.interval90;
        f64::from(u8::from((low..=high).contains(&truth)))
    };
    let people = fitted.iter().filter_map(|s| Some(inside(s.person.as_ref()?.of(quantity), truth(s))));
    let frames: Vec<(&Estimate, f64)> =
        fitted.iter().flat_map(|s| s.frames.iter().map(|frame| (frame.of(quantity), truth(s)))).collect();
    let baseline = |which: usize| size(errors(&|scored| Some(scored.baselines[quantity as usize][which])));
    Score {
        coverage90: mean(people.collect()),
        mae_percent: mean(
            own.iter().zip(fitted).map(|(e, s)| 100.0 * e.abs() / (scale * truth(s))).collect(),
        ),
        bias: mean(own.clone()),
        worst: own.iter().map(|e| e.abs()).fold(0.0, f64::max),
        groups: groups(fitted.iter().map(|scored| scored.truth), &own),
        mae: size(own),
        mae_stature_known: size(errors(&|scored| value(&scored.with_stature))),
        mae_stature_weight_known: size(errors(&|scored| value(&scored.with_both))),
        mae_per_frame: mean(frames.iter().map(|(e, truth)| scale * (e.value - truth).abs()).collect()),
        coverage90_per_frame: mean(frames.iter().map(|(estimate, truth)| inside(estimate, *truth)).collect()),
        baseline_sex: baseline(0),
        baseline_stature: baseline(1),
        baseline_stature_weight: baseline(2),
    }
}

/// Errors by sex and by thirds of stature and body mass index.
fn groups<'a>(
    people: impl Iterator<Item = &'a Truth> + Clone,
    errors: &[f64],
) -> BTreeMap<&'static str, GroupScore> {
    let thirds = |of: &dyn Fn(&Truth) -> f64| -> [f64; 2] {
        let mut values: Vec<f64> = people.clone().map(of).collect();
        values.sort_by(f64::total_cmp);
        [values[values.len() / 3], values[2 * values.len() / 3]]
    };
    let bmi = |truth: &Truth| truth.weight_kg / truth.stature_m.powi(2);
    let stature = |truth: &Truth| truth.stature_m;
    let [short, tall] = thirds(&stature);
    let [light, heavy] = thirds(&bmi);
    let mut members: BTreeMap<&'static str, Vec<f64>> = BTreeMap::new();
    for (truth, &error) in people.clone().zip(errors) {
        let third = |value: f64, low: f64, high: f64, names: [&'static str; 3]| {
            names[usize::from(value >= low) + usize::from(value >= high)]
        };
        for group in [
            if truth.sex == Sex::Male { "men" } else { "women" },
            third(stature(truth), short, tall, ["short", "middle", "tall"]),
            third(bmi(truth), light, heavy, ["light", "medium", "heavy"]),
        ] {
            members.entry(group).or_default().push(error);
        }
    }
    let score = |errors: Vec<f64>| GroupScore {
        people: errors.len(),
        mae: mean(errors.iter().map(|error| error.abs())),
        bias: mean(errors.iter().copied()),
    };
    members.into_iter().map(|(group, errors)| (group, score(errors))).collect()
}

/// Markdown tables.
pub fn table(report: &ShapeReport) -> String {
    let mut text = format!(
        "{} people, {} without a body; {:.1} s a person; surface off by {:.1} mm\n\n\
         | quantity | error | % | bias | worst | inside 90 % | stature known | and weight | one frame | inside 90 % | mean of sex | line on stature | on stature, weight |\n\
         |---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n",
        report.people, report.without_fit, report.seconds_per_person, report.surface_mm
    );
    for quantity in Quantity::ALL {
        let s = &report.quantities.scores[quantity.name()];
        let unit = if quantity == Quantity::Weight { "kg" } else { "mm" };
        let _ = writeln!(
            text,
            "| {}, {unit} | {:.1} | {:.1} | {:+.1} | {:.1} | {:.0} % | {:.1} | {:.1} | {:.1} | {:.0} % | {:.1} | {:.1} | {:.1} |",
            quantity.name(),
            s.mae,
            s.mae_percent,
            s.bias,
            s.worst,
            100.0 * s.coverage90,
            s.mae_stature_known,
            s.mae_stature_weight_known,
            s.mae_per_frame,
            100.0 * s.coverage90_per_frame,
            s.baseline_sex,
            s.baseline_stature,
            s.baseline_stature_weight,
        );
    }
    let gender = &report.quantities.gender;
    let _ = writeln!(
        text,
        "\nGender, balanced: {:.1} % a person, {:.1} % a frame\n",
        100.0 * gender.balanced_accuracy,
        100.0 * gender.balanced_accuracy_per_frame
    );
    const GROUPS: [&str; 8] = ["women", "men", "short", "middle", "tall", "light", "medium", "heavy"];
    let _ = writeln!(text, "| error, bias by group | {} |", GROUPS.join(" | "));
    let _ = writeln!(text, "|---|{}", "---:|".repeat(GROUPS.len()));
    for quantity in Quantity::ALL {
        let groups = &report.quantities.scores[quantity.name()].groups;
        let cells = GROUPS.map(|group| match groups.get(group) {
            Some(GroupScore { mae, bias, .. }) => format!("{mae:.1}, {bias:+.1}"),
            None => "–".to_owned(),
        });
        let _ = writeln!(text, "| {} | {} |", quantity.name(), cells.join(" | "));
    }
    if !report.stage.is_empty() {
        text.push_str(
            "\n| subject | quantity | truth | estimate | error | 90 % |\n|---|---|---:|---:|---:|---|\n",
        );
    }
    for subject in &report.stage {
        for (quantity, found) in Quantity::ALL.into_iter().zip(&subject.quantities) {
            let scale = Score::scale(quantity);
            let [truth, value, low, high] = [
                found.truth,
                found.estimate.value,
                found.estimate.interval90[0],
                found.estimate.interval90[1],
            ]
            .map(|number| scale * number);
            let _ = writeln!(
                text,
                "| {} | {} | {truth:.1} | {value:.1} | {:+.1} | {low:.0} to {high:.0} |",
                subject.subject,
                found.name,
                value - truth
            );
        }
        let _ = writeln!(
            text,
            "| {} | male | | {:.0} % | | |",
            subject.subject,
            100.0 * subject.male_probability
        );
    }
    text
}

/// One row a person and quantity: truth, estimate, error, interval.
pub fn write_people(out: &Path, scored: &[Scored<'_>]) -> anyhow::Result<()> {
    let path = out.join("people.csv");
    let mut text = String::from(
        "body,sex,motion,quantity,unit,truth,estimate,error,error_percent,low90,high90,male_probability\n",
    );
    for scored in scored {
        let Some(person) = &scored.person else { continue };
        for quantity in Quantity::ALL {
            let (truth, estimate) = (quantity.of(scored.truth), person.of(quantity));
            let _ = writeln!(
                text,
                "{},{},{},{},{},{truth:.4},{:.4},{:+.4},{:+.2},{:.4},{:.4},{:.3}",
                scored.truth.id,
                if scored.truth.sex == Sex::Male { "male" } else { "female" },
                scored.motion,
                quantity.name(),
                quantity.unit(),
                estimate.value,
                estimate.value - truth,
                100.0 * (estimate.value - truth) / truth,
                estimate.interval90[0],
                estimate.interval90[1],
                person.male_probability
            );
        }
    }
    std::fs::write(&path, text).with_context(|| format!("{}: cannot write", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_tell_which_way_they_err() {
        let person = |sex: Sex, stature_m: f64, bmi: f64| Truth {
            id: String::new(),
            sex,
            weight_kg: bmi * stature_m.powi(2),
            stature_m,
            chest_m: 1.0,
            waist_m: 0.9,
            hips_m: 1.0,
            right_thigh_m: 0.6,
            right_calf_m: 0.4,
        };
        let people =
            [person(Sex::Female, 1.6, 30.0), person(Sex::Male, 1.9, 25.0), person(Sex::Female, 1.7, 20.0)];
        let groups = groups(people.iter(), &[4.0, 1.0, -2.0]);
        let score = |people: usize, mae: f64, bias: f64| GroupScore { people, mae, bias };
        assert_eq!(groups["women"], score(2, 3.0, 1.0));
        assert_eq!(groups["men"], score(1, 1.0, 1.0));
        for (group, error) in [
            ("short", 4f64),
            ("middle", -2.0),
            ("tall", 1.0),
            ("light", -2.0),
            ("medium", 1.0),
            ("heavy", 4.0),
        ] {
            assert_eq!(groups[group], score(1, error.abs(), error), "{group}");
        }
    }
}
