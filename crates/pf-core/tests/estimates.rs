//! Mean and covariance of particles, and the noise made from them.

mod common;

use common::Plane;
use pf_core::estimate::{weighted_covariance, weighted_mean};
use pf_core::rng::{Draw, Purpose, particle_rng};
use pf_core::{GaussianDiffusion, LayerStep, Mutation, NormalizedWeights, StateSpace};

struct Circle;
impl StateSpace for Circle {
    type State = f64;
    fn dim(&self) -> usize {
        1
    }
    fn retract(&self, angle: &mut f64, delta: &[f64]) {
        let turned = *angle + delta[0];
        *angle = turned.sin().atan2(turned.cos());
    }
    fn local(&self, from: &f64, to: &f64, delta: &mut [f64]) {
        delta[0] = (to - from).sin().atan2((to - from).cos());
    }
}

#[test]
fn mean_on_a_circle_goes_the_short_way_round() {
    let weights = NormalizedWeights::from_linear(vec![3.0, 1.0]).expect("weights");
    let mean = weighted_mean(&Circle, &[3.1, -3.1], &weights);
    let gap = std::f64::consts::TAU - 6.2;
    assert!((mean - (3.1 + 0.25 * gap)).abs() < 1e-12, "{mean}");
    let mut variance = [0.0];
    weighted_covariance(&Circle, &mean, &[3.1, -3.1], &weights, &mut variance);
    assert!((variance[0] - 3.0 / 16.0 * gap * gap).abs() < 1e-12, "weights 3/4, 1/4 of points a gap apart");
}

#[test]
fn survivors_spread_as_they_are_spread_already() {
    const N: u32 = 100_000;
    const MAX_STANDARD_ERRORS: f64 = 4.0;
    let survivors = [[0.0, 0.0], [2.0, 1.0], [2.0, 0.0], [4.0, 1.0]];
    // Mean (2, 1/2); squares 8/4 and 1/4, product 2/4; and the floor 0.5² on the diagonal.
    let (variances, covariance) = ([2.0 + 0.25, 0.25 + 0.25], 0.5);
    let step = LayerStep { layer: 0, layers: 2, diffusion_scale: 0.5 };
    let mut diffusion = GaussianDiffusion::of_survivors(vec![0.5, 0.5]).expect("above zero");
    Mutation::<Plane, ()>::prepare(&mut diffusion, &Plane::default(), &survivors, &step);
    let at = Draw { seed: 1, frame: 0, layer: 0, purpose: Purpose::User };
    let (mut squares, mut product) = ([0.0; 2], 0.0);
    for i in 0..N {
        let mut state = [0.0; 2];
        diffusion.mutate(&Plane::default(), &(), &step, &mut state, &mut particle_rng(at, i));
        squares[0] += state[0] * state[0] / f64::from(N);
        squares[1] += state[1] * state[1] / f64::from(N);
        product += state[0] * state[1] / f64::from(N);
    }
    for (square, variance) in squares.iter().zip(variances) {
        let expected = 0.25 * variance;
        let standard_error = expected * (2.0 / f64::from(N)).sqrt();
        assert!((square - expected).abs() < MAX_STANDARD_ERRORS * standard_error, "{square}, not {expected}");
    }
    let (expected, both) = (0.25 * covariance, variances[0] * variances[1] + covariance * covariance);
    let standard_error = 0.25 * (both / f64::from(N)).sqrt();
    assert!((product - expected).abs() < MAX_STANDARD_ERRORS * standard_error, "{product}, not {expected}");
    assert!(GaussianDiffusion::of_survivors(vec![0.0]).is_err(), "survivors that are alike must part");
}
