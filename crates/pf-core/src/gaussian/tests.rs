use super::*;
use crate::rng::{Draw, Purpose, particle_rng};

const COVARIANCE: [f64; 4] = [0.5, 0.2, 0.2, 0.3];

/// Oracle: scipy.stats.
#[test]
fn log_densities_agree_with_scipy() {
    let full = Gaussian::full(&COVARIANCE, 2).expect("positive definite");
    assert!((full.log_density(&[0.4, -0.7]) + 2.575_148_700_723_575_6).abs() < 1e-13);
    let diagonal = Gaussian::diagonal(vec![0.5, 2.0]).expect("positive");
    assert!((diagonal.log_density(&[0.4, -0.7]) + 2.219_127_066_409_345_4).abs() < 1e-13);
    let one_still = Gaussian::diagonal(vec![0.0, 2.0]).expect("zero keeps still");
    assert_eq!(one_still.log_density(&[0.1, 0.0]), f64::NEG_INFINITY);
}

#[test]
fn draws_have_the_covariance_times_the_square_of_the_scale() {
    const N: u32 = 100_000;
    const MAX_STANDARD_ERRORS: f64 = 4.0;
    let full = Gaussian::full(&COVARIANCE, 2).expect("positive definite");
    let at = Draw { seed: 3, frame: 0, layer: 0, purpose: Purpose::User };
    let mut products = [0.0; 4];
    for i in 0..N {
        let mut delta = [0.0; 2];
        full.sample(2.0, &mut particle_rng(at, i), &mut delta);
        for (k, product) in products.iter_mut().enumerate() {
            *product += delta[k / 2] * delta[k % 2] / f64::from(N);
        }
    }
    for (k, product) in products.iter().enumerate() {
        let [v_i, v_j, v_ij] = [COVARIANCE[k / 2 * 3], COVARIANCE[k % 2 * 3], COVARIANCE[k]].map(|c| 4.0 * c);
        let standard_error = ((v_i * v_j + v_ij * v_ij) / f64::from(N)).sqrt();
        assert!(
            (product - v_ij).abs() < MAX_STANDARD_ERRORS * standard_error,
            "entry {k} is {product}, not {v_ij}"
        );
    }
}

#[test]
fn what_is_no_covariance_is_refused() {
    let message = |result: Result<Gaussian, BadCovariance>| result.expect_err("no covariance").to_string();
    assert_eq!(
        message(Gaussian::full(&[1.0, 2.0, 2.0, 1.0], 2)),
        "the covariance has pivot -3 at coordinate 1, expected a positive definite matrix"
    );
    assert_eq!(
        message(Gaussian::diagonal(vec![1.0, f64::NAN])),
        "standard deviation 1 is NaN, expected a finite number, zero or more in fixed noise, above zero as a floor"
    );
}
