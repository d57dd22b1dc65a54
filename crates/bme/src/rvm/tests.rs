use rand::Rng;
use rand_distr::{Distribution, StandardNormal};

use super::laplace::{Labels, Posterior};
use super::*;
use crate::rng::{Purpose, stream};
use crate::{Expert, Gate, Gaussian, Inputs, Kernel, Rvm, RvmClassifier, RvmParams};

fn sinc(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { x.sin() / x }
}

/// Inputs over [−10, 10], and sinc with noise of standard deviation 0.1.
fn noisy_sinc(n: usize, seed: u64) -> (Vec<f64>, Vec<f64>) {
    let mut rng = stream(seed, Purpose::Experts);
    let x: Vec<f64> = (0..n).map(|_| 20.0 * (f64::from(rng.next_u32()) / 4_294_967_296.0) - 10.0).collect();
    let y =
        x.iter().map(|&x| sinc(x) + 0.1 * Distribution::<f64>::sample(&StandardNormal, &mut rng)).collect();
    (x, y)
}

fn line(x: &[f64], inverse_width: f64) -> Design {
    let inputs = Inputs::from_rows(1, x.iter().copied()).unwrap();
    Design::new(Kernel::gaussian(1, inverse_width).unwrap(), inputs)
}

#[test]
fn intervals_cover_what_they_claim() {
    let (x, y) = noisy_sinc(300, 3);
    let model = Rvm::fit(&line(&x, 0.25), &[y], &[1.0; 300], &RvmParams::default()).unwrap();
    let (x, y) = noisy_sinc(2_000, 4);
    let mut prediction = Gaussian::default();
    for (quantile, level) in [(0.6745, 0.5), (1.645, 0.9), (1.96, 0.95)] {
        let inside = x.iter().zip(&y).filter(|(x, y)| {
            model.predict(&[**x], &mut prediction);
            (**y - prediction.mean[0]).abs() < quantile * prediction.variance[0].sqrt()
        });
        let share = inside.count() as f64 / 2_000.0;
        // Three standard errors of a share of 2,000, and as much again for the 300 that σ was learnt from.
        let tolerance = 6.0 * (level * (1.0 - level) / 2_000.0_f64).sqrt();
        assert!((share - level).abs() < tolerance, "{share} inside, {level} claimed");
    }
}

#[test]
fn predictions_without_allocating_are_the_same() {
    let (x, y) = noisy_sinc(80, 9);
    let other: Vec<f64> = y.iter().map(|y| 2.0 * y - 1.0).collect();
    let model = Rvm::fit(&line(&x, 0.25), &[y, other], &[1.0; 80], &RvmParams::default()).unwrap();
    let mut expected = Gaussian::default();
    let mut room = vec![0.0; model.n_features()];
    let (mut mean, mut variance) = ([0.0; 2], [0.0; 2]);
    for x in [-12.0, -0.3, 4.0] {
        model.predict(&[x], &mut expected);
        model.predict_into(&[x], &mut room, &mut mean, &mut variance);
        for d in 0..2 {
            assert!((mean[d] - expected.mean[d]).abs() < 1e-12);
            assert!((variance[d] / expected.variance[d] - 1.0).abs() < 1e-9);
        }
    }
}

#[test]
fn weight_two_is_the_sample_twice() {
    let (mut x, mut y) = noisy_sinc(60, 5);
    let weights: Vec<f64> = (0..60).map(|i| if i < 20 { 2.0 } else { 1.0 }).collect();
    let once = Rvm::fit(&line(&x, 0.25), &[y.clone()], &weights, &RvmParams::default()).unwrap();
    for i in 0..20 {
        x.push(x[i]);
        y.push(y[i]);
    }
    let twice = Rvm::fit(&line(&x, 0.25), &[y], &[1.0; 80], &RvmParams::default()).unwrap();
    let (mut a, mut b) = (Gaussian::default(), Gaussian::default());
    for x in [-7.0, -0.5, 0.0, 3.3] {
        once.predict(&[x], &mut a);
        twice.predict(&[x], &mut b);
        assert!((a.mean[0] - b.mean[0]).abs() < 1e-6, "{a:?} {b:?}");
        assert!((a.variance[0] - b.variance[0]).abs() < 1e-6);
    }
}

#[test]
fn outputs_do_not_disturb_each_other() {
    let (x, y) = noisy_sinc(80, 6);
    let design = line(&x, 0.25);
    let doubled: Vec<f64> = x.iter().map(|x| (0.3 * x).cos() * 100.0).collect();
    let params = RvmParams::default();
    let both = Rvm::fit(&design, &[y.clone(), doubled.clone()], &[1.0; 80], &params).unwrap();
    let mut prediction = Gaussian::default();
    both.predict(&[1.7], &mut prediction);
    for (d, target) in [y, doubled].into_iter().enumerate() {
        let mut alone = Gaussian::default();
        Rvm::fit(&design, &[target], &[1.0; 80], &params).unwrap().predict(&[1.7], &mut alone);
        assert_eq!(prediction.mean[d].to_bits(), alone.mean[0].to_bits());
        assert_eq!(prediction.variance[d].to_bits(), alone.variance[0].to_bits());
    }
}

#[test]
fn bits_do_not_depend_on_threads() {
    let (x, y) = noisy_sinc(300, 7);
    let fit = |threads| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            let mirrored = y.iter().map(|y| -2.0 * y).collect();
            Rvm::fit(&line(&x, 0.25), &[y.clone(), mirrored], &[1.0; 300], &RvmParams::default()).unwrap()
        })
    };
    let one = fit(1);
    assert!(one == fit(2) && one == fit(7));
}

#[test]
fn bad_samples_are_named() {
    let design = line(&[0.0, 1.0, 2.0], 1.0);
    let fit = |y: Vec<f64>, w: Vec<f64>| {
        Rvm::fit(&design, &[y], &w, &RvmParams::default()).unwrap_err().to_string()
    };
    assert_eq!(
        fit(vec![0.0, f64::NAN, 0.0], vec![1.0; 3]),
        "the target of sample 1 is NaN, expected a finite number within ±1e100"
    );
    assert_eq!(
        fit(vec![0.0; 3], vec![1.0, 1.0, -0.5]),
        "the weight of sample 2 is -0.5, expected 0 to 1e100"
    );
    assert_eq!(fit(vec![0.0; 3], vec![0.0; 3]), "the weights of 3 samples sum to 0, expected more");
}

/// Three Gaussian blobs in the plane.
fn blobs(n: usize, seed: u64) -> (Inputs, Vec<usize>) {
    let mut rng = stream(seed, Purpose::KMeans);
    let class: Vec<usize> = (0..n).map(|i| i % 3).collect();
    let centres = [[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]];
    let values: Vec<f64> = class
        .iter()
        .flat_map(|&c| centres[c].map(|m| m + 0.6 * Distribution::<f64>::sample(&StandardNormal, &mut rng)))
        .collect();
    (Inputs::from_rows(2, values).unwrap(), class)
}

#[test]
fn classes_are_told_apart_as_well_as_they_can_be() {
    let (inputs, class) = blobs(240, 1);
    let labels: Vec<Vec<f64>> =
        (0..3).map(|k| class.iter().map(|&c| f64::from(u8::from(c == k))).collect()).collect();
    let design = Design::new(Kernel::gaussian(2, 0.3).unwrap(), inputs);
    let model = RvmClassifier::fit(&design, &labels, &RvmParams::default()).unwrap();
    let (test, class) = blobs(900, 2);
    let (mut wrong, mut bayes_wrong) = (0, 0);
    let mut gates = [0.0; 3];
    for (i, &c) in class.iter().enumerate() {
        let x = test.row_f64(i);
        model.log_gates(&x, &mut gates);
        assert!(crate::log_sum_exp(&gates).abs() < 1e-12);
        wrong += usize::from((0..3).any(|k| gates[k] > gates[c]));
        let distance = |m: [f64; 2]| (x[0] - m[0]).powi(2) + (x[1] - m[1]).powi(2);
        let distances = [[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]].map(distance);
        bayes_wrong += usize::from((0..3).any(|k| distances[k] < distances[c]));
    }
    // The nearest centre is the best rule there is; two standard errors of a difference of 900 are about 14.
    assert!(wrong <= bayes_wrong + 14, "{wrong} wrong, {bayes_wrong} by the best rule");
    assert!(model.n_bases() < 30, "{} bases", model.n_bases());
}

#[test]
fn evidence_of_a_classification_climbs_to_a_mode() {
    let (inputs, class) = blobs(120, 3);
    let labels: Vec<Vec<f64>> =
        (0..3).map(|k| class.iter().map(|&c| if c == k { 0.8 } else { 0.1 }).collect()).collect();
    let design = Design::new(Kernel::gaussian(2, 0.3).unwrap(), inputs);
    let labels = Labels::new(&design, &labels, Labels::weights(&labels));
    let mut posterior = Posterior::new(&labels);
    let start = posterior.log_evidence();
    // Without bases, the evidence is that of even odds.
    assert!((start - 120.0 * (1.0_f64 / 3.0).ln()).abs() < 1e-9);
    let course = posterior.climb(&RvmParams::default());
    assert!(course.len() > 3);
    assert!(
        std::iter::once(start).chain(course.iter().copied()).zip(&course).all(|(a, b)| *b > a || a == *b)
    );
    assert!(posterior.log_evidence() > start + 10.0);
}

#[test]
fn one_class_is_certain() {
    let design = line(&[0.0, 1.0, 2.0], 1.0);
    let model = RvmClassifier::fit(&design, &[vec![1.0; 3]], &RvmParams::default()).unwrap();
    let mut gates = [1.0];
    model.log_gates(&[0.5], &mut gates);
    assert_eq!(gates, [0.0]);
}
