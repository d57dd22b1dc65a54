use super::*;
use crate::{Design, Gaussian, Kernel};

fn line(x: &[f64]) -> Design {
    let inputs = Inputs::from_rows(1, x.iter().copied()).unwrap();
    Design::new(Kernel::gaussian(1, 0.5).unwrap(), inputs)
}

fn wave(x: f64) -> f64 {
    (1.3 * x).sin() + 0.3 * x
}

/// Deterministic "noise" of standard deviation near 0.1.
fn jitter(i: usize) -> f64 {
    0.1 * ((i * 7919 % 101) as f64 / 29.0 - 1.72)
}

fn trained(n: usize) -> (Rvm, Vec<f64>, Vec<f64>) {
    let x: Vec<f64> = (0..n).map(|i| -5.0 + 5.0 * i as f64 / n as f64).collect();
    let y: Vec<f64> = x.iter().enumerate().map(|(i, &x)| wave(x) + jitter(i)).collect();
    let model = Rvm::fit(&line(&x), std::slice::from_ref(&y), &vec![1.0; n], &RvmParams::default()).unwrap();
    (model, x, y)
}

#[test]
fn absorbing_is_fitting_with_one_sample_more() {
    let (mut model, mut x, mut y) = trained(60);
    let before = model.clone();
    model.absorb(&[-2.2], &[Answer { y: &[0.4], responsibility: 0.7 }], 0);
    x.push(-2.2);
    y.push(0.4);
    let mut weights = vec![1.0; 60];
    weights.push(0.7);
    // The normal equations of all samples, from the kernel itself.
    let function = &before.outputs[0];
    let phi = |i: usize, x: f64| match function.bases[i] {
        basis if basis < before.centres.len() => before.kernel.value(&[x], &before.centres.row_f64(basis)),
        _ => 1.0,
    };
    let n = function.bases.len();
    for i in 0..n {
        let (mut left, mut right) = (function.precisions[i] * model.outputs[0].mean[i], 0.0);
        for ((&x, &y), &w) in x.iter().zip(&y).zip(&weights) {
            let fitted: f64 = (0..n).map(|j| phi(j, f64::from(x as f32)) * model.outputs[0].mean[j]).sum();
            left += w * phi(i, f64::from(x as f32)) * fitted;
            right += w * phi(i, f64::from(x as f32)) * y;
        }
        assert!((left - right).abs() < 1e-5 * (1.0 + right.abs()), "row {i}: {left} against {right}");
    }
    assert!((model.outputs[0].total_weight - 60.7).abs() < 1e-9);
    assert_eq!(model.centres, before.centres);
}

#[test]
fn answers_to_one_input_count_like_samples() {
    // Without changes of bases, all at once is one after the other.
    let (one_by_one, x, _) = trained(60);
    let (mut one_by_one, mut at_once) = (one_by_one.clone(), one_by_one);
    let ys = [[0.4], [0.7], [-0.1]];
    let answers: Vec<Answer<'_>> = ys.iter().map(|y| Answer { y, responsibility: 0.5 }).collect();
    for answer in &answers {
        one_by_one.absorb(&x[7..8], &[*answer], 0);
    }
    at_once.absorb(&x[7..8], &answers, 0);
    let (a, b) = (&one_by_one.outputs[0], &at_once.outputs[0]);
    assert!(a.mean.iter().zip(&b.mean).all(|(a, b)| (a - b).abs() < 1e-8), "{:?} {:?}", a.mean, b.mean);
    assert!((a.noise_variance - b.noise_variance).abs() < 1e-9 * a.noise_variance);
    assert!((a.total_weight - b.total_weight).abs() < 1e-12);
    // And no answer changes nothing.
    let before = at_once.clone();
    assert_eq!(at_once.update_all(&[0.0], &[]).unwrap(), UpdateReport::default());
    assert_eq!(at_once, before);
}

#[test]
fn learns_where_it_knew_nothing() {
    let (mut model, _, _) = trained(80);
    let error = |model: &Rvm, from: f64| {
        let squares = (0..50)
            .map(|i| (model.mean(&[from + 0.1 * f64::from(i)])[0] - wave(from + 0.1 * f64::from(i))).powi(2));
        (squares.sum::<f64>() / 50.0).sqrt()
    };
    let (old_before, new_before) = (error(&model, -5.0), error(&model, 0.0));
    let mut total = UpdateReport::default();
    for i in 0..80 {
        let x = 5.0 * ((i * 31) % 80) as f64 / 80.0;
        let report = model.update(&[x], &[wave(x) + jitter(i + 3)], 1.0).unwrap();
        assert!(report.log_evidence_gain >= 0.0);
        total += report;
    }
    let (old_after, new_after) = (error(&model, -5.0), error(&model, 0.0));
    assert!(total.added > 3, "{total:?}");
    assert!(new_after < 0.15 && new_before > 0.5, "error {new_before} before, {new_after} after");
    assert!(old_after < old_before + 0.05, "forgot: {old_before} before, {old_after} after");
    assert!(model.n_bases() < 40);
    let mut prediction = Gaussian::default();
    model.predict(&[2.0], &mut prediction);
    assert!(prediction.variance[0] > 0.0);
}

#[test]
fn a_class_border_moves_with_the_examples() {
    let x: Vec<f64> = (0..80).map(|i| f64::from(i) * 0.1 - 4.0).collect();
    let left: Vec<f64> = x.iter().map(|&x| f64::from(u8::from(x < 0.0))).collect();
    let right: Vec<f64> = left.iter().map(|l| 1.0 - l).collect();
    let mut model = RvmClassifier::fit(&line(&x), &[left, right], &RvmParams::default()).unwrap();
    let left_at = |model: &RvmClassifier, x: f64| {
        let mut gates = [0.0; 2];
        model.log_gates(&[x], &mut gates);
        assert!(log_sum_exp(&gates).abs() < 1e-12);
        gates[0].exp()
    };
    let before = (left_at(&model, 7.0), left_at(&model, -2.0));
    for i in 0..12 {
        let report = model.update(&[6.8 + 0.03 * f64::from(i)], &[0.9, 0.1], 1.0).unwrap();
        assert!(report.log_evidence_gain >= 0.0);
    }
    let after = (left_at(&model, 7.0), left_at(&model, -2.0));
    assert!(before.0 < 0.6 && after.0 > 0.7, "{before:?} {after:?}");
    assert!(after.1 > 0.8);
}

#[test]
fn a_bad_example_changes_nothing() {
    let (mut model, _, _) = trained(40);
    let before = model.clone();
    let cases = [
        (model.update(&[0.0, 1.0], &[0.0], 1.0), "`x` has 2 numbers, expected 1"),
        (model.update(&[0.0], &[], 1.0), "`y` has 0 numbers, expected 1"),
        (model.update(&[0.0], &[f64::NAN], 1.0), "`y[0]` is NaN, expected a finite number within ±1e100"),
        (model.update(&[0.0], &[0.0], 0.0), "`responsibility` is 0, expected a number above 0 and at most 1"),
    ];
    for (result, text) in cases {
        assert_eq!(result.unwrap_err().to_string(), text);
    }
    assert_eq!(model, before);
}
