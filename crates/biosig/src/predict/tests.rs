//! People made by simple rules, and the predictors in the program.

use body::BodyModel;

use super::*;
use crate::tape::Tape;

/// Numbers of mean 0 and variance 1: sums of twelve uniform ones of a linear congruential generator.
struct Normal(u64);

impl Normal {
    fn next(&mut self) -> f64 {
        let mut uniform = || {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }
}

/// Stature, weight and sex follow from three numbers, with noise of 2 cm and 5 %.
fn people(n: usize) -> Vec<Sample> {
    let mut normal = Normal(1);
    (0..n)
        .map(|k| {
            let (is_male, tall, fat) = (k % 2 == 0, normal.next(), normal.next());
            let stature_m = if is_male { 1.76 } else { 1.63 } + 0.06 * tall;
            let weight = 24.0 * stature_m.powi(2) * (0.15 * fat).exp();
            Sample {
                features: vec![
                    stature_m + 0.02 * normal.next(),
                    fat,
                    f64::from(u8::from(is_male)) + 0.3 * normal.next(),
                ],
                stature_m,
                weight_kg: weight * (0.05 * normal.next()).exp(),
                sex: if is_male { Sex::Male } else { Sex::Female },
            }
        })
        .collect()
}

#[test]
fn rules_with_noise_are_learnt_with_honest_intervals() {
    let samples = people(800);
    let (train, test) = samples.split_at(500);
    let predictor = Predictor::fit(train).unwrap();
    let (mut stature, mut weight, mut covered, mut right) = (0.0, 0.0, [0, 0], 0);
    for sample in test {
        let profile = predictor.predict(&sample.features);
        stature += (profile.stature_m.value - sample.stature_m).abs() / test.len() as f64;
        weight += (profile.weight_kg.value / sample.weight_kg).ln().abs() / test.len() as f64;
        let holds = |estimate: Estimate, truth: f64| {
            usize::from((estimate.interval90[0]..=estimate.interval90[1]).contains(&truth))
        };
        covered[0] += holds(profile.stature_m, sample.stature_m);
        covered[1] += holds(profile.weight_kg, sample.weight_kg);
        right += usize::from((profile.female > 0.5) == (sample.sex == Sex::Female));
    }
    // The mean absolute value of normal noise is 0.8 of its standard deviation; the stature in the weight has noise, too.
    assert!(stature < 0.8 * 0.02 * 1.15, "{stature}");
    assert!(weight < 0.8 * 0.055 * 1.15, "{weight}");
    assert!(right as f64 > 0.95 * test.len() as f64, "{right}");
    // 90 % of 300, five standard errors of 5.2 to either side.
    assert!(covered.iter().all(|&n| (244..=296).contains(&n)), "{covered:?}");
}

#[test]
fn samples_that_teach_nothing_are_refused() {
    let message = |samples: &[Sample]| Predictor::fit(samples).unwrap_err().to_string();
    let mut samples = people(40);
    let text = "10 samples, expected 20 or more with women and men among them";
    assert_eq!(message(&samples[..10]), text);
    let women: Vec<Sample> = samples.iter().filter(|s| s.sex == Sex::Female).cloned().collect();
    assert!(message(&women).starts_with("20 samples, expected"));
    samples[7].weight_kg = 0.0;
    assert_eq!(
        message(&samples),
        "sample 7 has a number that is not finite or a weight that is not positive"
    );
    samples[7] = samples[9].clone();
    samples.iter_mut().for_each(|sample| sample.features[1] = 3.0);
    assert_eq!(message(&samples), "feature 1 is the same in all samples");
}

#[test]
fn the_file_says_the_same_and_holds_nobody() {
    let predictors = Predictors::builtin();
    let bytes = predictors.to_bytes();
    assert_eq!(bytes, BUILTIN);
    assert_eq!(Predictors::from_bytes(&bytes).unwrap(), predictors);
    let text = Predictors::from_bytes(&bytes[..bytes.len() - 1]).unwrap_err().to_string();
    assert!(!text.is_empty());
    // A file of other features, sealed as it should be.
    let other = Predictors { shape: predictors.girths.clone(), ..predictors };
    let text = Predictors::from_bytes(&other.to_bytes()).unwrap_err().to_string();
    assert_eq!(text, "`shape` takes 5 features, expected 30");
}

#[test]
fn shape_and_girths_of_the_model_tell_about_the_same() {
    let (model, predictors) = (BodyModel::builtin(), Predictors::builtin());
    let tape = Tape::of_model(&model);
    for (stature_m, sex) in [(1.60, Sex::Female), (1.70, Sex::Female), (1.72, Sex::Male), (1.85, Sex::Male)] {
        let coefficients = model.coefficients_for_stature(stature_m, Some(sex));
        let girths = FiveGirths::from(&tape.measure_body(&model.shape(&coefficients)).unwrap());
        let by_shape = predictors.from_shape(&coefficients);
        let by_girths = predictors.from_girths(&girths, Some(stature_m));
        assert_eq!(by_shape.female > 0.5, sex == Sex::Female, "{}", by_shape.female);
        assert_eq!(by_girths.female > 0.5, sex == Sex::Female, "{}", by_girths.female);
        assert!((by_shape.stature_m.value - stature_m).abs() < 0.015, "{}", by_shape.stature_m.value);
        let (one, other) = (by_shape.weight_kg.value, by_girths.weight_kg.value);
        assert!((one / other).ln().abs() < 0.08, "{one} kg by shape, {other} kg by girths");
    }
}
