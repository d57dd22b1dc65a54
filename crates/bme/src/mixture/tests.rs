use rand::Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use crate::rng::{Purpose, stream};
use crate::{Answer, Inputs, Kernel, OnlineUpdate as _};

fn normal(rng: &mut impl Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// The branches y = ±(1 + x/2) over x in [0, 2], with noise of standard deviation 0.1; 70 % of the samples are above.
fn two_branches(n: usize, seed: u64) -> (Vec<f64>, Vec<f64>) {
    let mut rng = stream(seed, Purpose::Experts);
    let x: Vec<f64> = (0..n).map(|i| 2.0 * i as f64 / n as f64).collect();
    let y = x.iter().enumerate().map(|(i, x)| {
        let side = if i % 10 < 7 { 1.0 } else { -1.0 };
        side * (1.0 + 0.5 * x) + 0.1 * normal(&mut rng)
    });
    let y = y.collect();
    (x, y)
}

fn design(x: &[f64], inverse_width: f64) -> Design {
    Design::new(Kernel::gaussian(1, inverse_width).unwrap(), Inputs::from_rows(1, x.iter().copied()).unwrap())
}

fn params(n_experts: usize) -> MixtureParams {
    MixtureParams::new(MixtureConfig { n_experts, ..MixtureConfig::default() }).unwrap()
}

#[test]
fn density_approaches_the_one_that_made_the_samples() {
    let (x, y) = two_branches(400, 1);
    let (model, report) = MixtureOfExperts::fit(&design(&x, 0.5), &[y], &vec![1.0; 400], &params(2)).unwrap();
    assert!(report.log_likelihood.windows(2).all(|pair| pair[1] >= pair[0]));
    let (x, y) = two_branches(2_000, 2);
    let score = x.iter().zip(&y).map(|(x, y)| model.density(&[*x]).log_density(&[*y])).sum::<f64>() / 2_000.0;
    // Entropy of the truth: −(0.7 ln 0.7 + 0.3 ln 0.3) + ½ ln(2πe 0.01).
    let truth = 0.7 * 0.7_f64.ln() + 0.3 * 0.3_f64.ln()
        - 0.5 * (std::f64::consts::TAU * std::f64::consts::E * 0.01).ln();
    assert!(score > truth - 0.05, "{score} against {truth}");
    let modes = model.density(&[1.0]).modes();
    assert_eq!(modes.len(), 2);
    assert!((modes[0].at[0] - 1.5).abs() < 0.05 && (modes[1].at[0] + 1.5).abs() < 0.05);
}

#[test]
fn gates_follow_the_input() {
    // Left of 0 the one line, right of it the other.
    let x: Vec<f64> = (0..200).map(|i| f64::from(i) * 0.02 - 2.0).collect();
    let mut rng = stream(4, Purpose::Experts);
    let y = x.iter().map(|x| if *x < 0.0 { -3.0 } else { 3.0 } + 0.2 * normal(&mut rng)).collect();
    let (model, _) = MixtureOfExperts::fit(&design(&x, 1.0), &[y], &vec![1.0; 200], &params(2)).unwrap();
    let mut moments = Gaussian::default();
    for (at, expected) in [(-1.0, -3.0), (1.0, 3.0)] {
        model.predict(&[at], &mut moments);
        assert!((moments.mean[0] - expected).abs() < 0.15, "{moments:?}");
        assert!(moments.variance[0] < 0.5);
    }
}

#[test]
fn a_product_kernel_conditions_on_both_blocks() {
    // y depends on the first coordinate; the sign of the second chooses the branch.
    let mut rng = stream(5, Purpose::Experts);
    let mut rows = Vec::new();
    let mut y = Vec::new();
    for i in 0..300 {
        let (state, cue) = (f64::from(i % 60) / 30.0 - 1.0, normal(&mut rng));
        rows.extend([state, cue]);
        y.push((1.0 + state * state) * cue.signum() + 0.05 * normal(&mut rng));
    }
    let kernel = Kernel::product(&[(1, 1.0), (1, 4.0)]).unwrap();
    let design = Design::new(kernel, Inputs::from_rows(2, rows).unwrap());
    let (model, _) = MixtureOfExperts::fit(&design, &[y], &vec![1.0; 300], &params(5)).unwrap();
    for (state, cue, expected) in [(0.5, 1.0, 1.25), (0.5, -1.0, -1.25), (-0.8, 0.6, 1.64)] {
        let best = model.density(&[state, cue]).modes().swap_remove(0);
        assert!(
            (best.at[0] - expected).abs() < 0.15,
            "{} at ({state}, {cue}), expected {expected}",
            best.at[0]
        );
    }
}

#[test]
fn more_experts_than_answers_do_no_harm() {
    let x: Vec<f64> = (0..40).map(f64::from).collect();
    let design = design(&x, 0.01);
    let (model, _) = MixtureOfExperts::fit(&design, &[vec![2.5; 40]], &[1.0; 40], &params(5)).unwrap();
    assert_eq!(model.experts().len(), 1);
    assert!((model.density(&[3.0]).mean()[0] - 2.5).abs() < 1e-3);
}

#[test]
fn hierarchy_answers_with_heading_and_latent() {
    // The input shows the heading; the latent is ambiguous in sign, as a depth flip is.
    let mut rng = stream(6, Purpose::Experts);
    let (mut rows, mut headings, mut latent) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..480 {
        let heading = std::f64::consts::TAU * f64::from(i) / 480.0;
        headings.push(heading);
        rows.extend([heading.cos() + 0.02 * normal(&mut rng), heading.sin() + 0.02 * normal(&mut rng)]);
        latent.push(if i % 2 == 0 { 1.0 } else { -1.0 } + 0.05 * normal(&mut rng));
    }
    let params =
        HierarchicalParams::new(HierarchicalConfig { n_views: 4, ..HierarchicalConfig::default() }).unwrap();
    let kernel = Kernel::gaussian(2, 1.0).unwrap();
    let inputs = Inputs::from_rows(2, rows).unwrap();
    let model = HierarchicalMixture::fit(&kernel, &inputs, &headings, &[latent], &params).unwrap();
    assert_eq!(model.n_views(), 4);
    for heading in [0.1_f64, 0.7, 2.0, 3.3, 5.9] {
        let density = model.density(&[heading.cos(), heading.sin()]);
        let modes = density.modes(4);
        let apart = (heading_of(&modes[0].at) - heading).rem_euclid(std::f64::consts::TAU);
        assert!(apart.min(std::f64::consts::TAU - apart) < 0.1, "{modes:?} at {heading}");
        assert!(
            modes.iter().any(|m| (m.at[0] - 1.0).abs() < 0.1)
                && modes.iter().any(|m| (m.at[0] + 1.0).abs() < 0.1)
        );
        assert!(modes.windows(2).all(|pair| pair[0].log_density >= pair[1].log_density));
        assert!(density.log_density(&modes[0].at) > density.log_density(&density.sample(&mut rng)));
        let mean = density.mean();
        assert!(mean[0].abs() < 0.3 && (mean[1] - heading.cos()).abs() < 0.1);
    }
}

#[test]
fn a_mixture_learns_both_answers_of_an_input_at_once() {
    // Trained on the branch +1 alone; told at x = 2 that −1 is an answer, too.
    let x: Vec<f64> = (0..60).map(|i| f64::from(i) / 20.0).collect();
    let y: Vec<f64> = (0..60).map(|i| if i < 30 { 1.0 } else { 1.3 } + 0.02 * f64::from(i % 5)).collect();
    let (mut model, _) = MixtureOfExperts::fit(&design(&x, 1.0), &[y], &[1.0; 60], &params(2)).unwrap();
    let density = |model: &MixtureOfExperts, y: f64| model.density(&[2.0]).log_density(&[y]);
    let before = density(&model, 0.6);
    let answers = [[0.6], [1.3]];
    for _ in 0..8 {
        let answers: Vec<Answer<'_>> = answers.iter().map(|y| Answer { y, responsibility: 0.5 }).collect();
        let report = model.update_all(&[2.0], &answers).unwrap();
        assert!(report.log_evidence_gain >= 0.0);
    }
    assert!(density(&model, 0.6) > before + 1.0, "{before} before, {} after", density(&model, 0.6));
    assert!(density(&model, 1.3) > -1.0, "forgot: {}", density(&model, 1.3));
}
