//! The laws of the traits, run on everything the crate provides; and on planted faults, which must be caught.

mod common;

use common::{AroundMeasurement, ConstantVelocity, Plane, Position};
use pf_core::conformance::{
    check_likelihood, check_proposal, check_resampler, check_schedule, check_state_space,
};
use pf_core::schedule::{EssConfig, GeometricConfig, SurvivalRateConfig};
use pf_core::{
    AnnealingSchedule, Beta, EssSchedule, Gaussian, Geometric, Likelihood, LogWeights, MixtureConfig,
    MixtureProposal, Multinomial, NormalizedWeights, ParticleRng, Proposal, Proposed, RandomWalk, Resampler,
    Residual, StateSpace, Stratified, SurvivalRate, Systematic, Weighting,
};
use proptest::prelude::*;

/// Directions in the plane, radians.
struct Circle;
impl StateSpace for Circle {
    type State = f64;
    fn dim(&self) -> usize {
        1
    }
    fn retract(&self, angle: &mut f64, delta: &[f64]) {
        *angle = (*angle + delta[0]).sin().atan2((*angle + delta[0]).cos());
    }
    fn local(&self, from: &f64, to: &f64, delta: &mut [f64]) {
        delta[0] = (to - from).sin().atan2((to - from).cos());
    }
}

fn mixture(weighting: Weighting) -> MixtureProposal<ConstantVelocity, AroundMeasurement> {
    let config = MixtureConfig { weighting, initial_cue_share: 0.3, ..MixtureConfig::default() };
    MixtureProposal::new(ConstantVelocity::new(), AroundMeasurement::new(), config).expect("0.3 is allowed")
}

proptest! {
    #[test]
    fn euclidean_space(from: [i16; 2], to: [i16; 2]) {
        check_state_space(&Plane::default(), &from.map(f64::from), &to.map(f64::from), 1e-9);
    }

    #[test]
    fn circle(from in -3.1..3.1, to in -3.1..3.1) {
        check_state_space(&Circle, &from, &to, 1e-9);
    }

    #[test]
    fn proposals(position in -5.0..5.0, velocity in -2.0..2.0, y in -5.0..5.0) {
        let previous = [position, velocity];
        let walk = RandomWalk::new(Gaussian::full(&[0.5, 0.2, 0.2, 0.3], 2).expect("positive definite"));
        check_proposal(&Plane::default(), &walk, &previous, &y);
        check_proposal(&Plane::default(), &ConstantVelocity::new(), &previous, &y);
        check_proposal(&Plane::default(), &mixture(Weighting::Importance), &previous, &y);
    }

    #[test]
    fn log_weights_are_a_distribution_once_normalised(
        log_weights in prop::collection::vec(prop_oneof![Just(f64::NEG_INFINITY), -1e6..1e6f64, -3.0..3.0], 1..40)
    ) {
        let log_weights = LogWeights::new(log_weights);
        let mut weights = NormalizedWeights::default();
        match log_weights.normalize_into(&mut weights) {
            None => prop_assert_eq!(log_weights.n_possible(), 0),
            Some(log_sum) => {
                let sum: f64 = weights.as_slice().iter().sum();
                prop_assert!((sum - 1.0).abs() < 1e-12);
                prop_assert!((log_sum - log_weights.log_sum_exp()).abs() <= 1e-9 * log_sum.abs().max(1.0));
                let ess = weights.effective_sample_size();
                prop_assert!(ess >= 1.0 - 1e-9 && ess <= log_weights.n_possible() as f64 + 1e-9);
                prop_assert!((ess - log_weights.effective_sample_size(Beta::ONE)).abs() <= 1e-9 * ess);
            }
        }
    }

    #[test]
    fn survival_rate_is_met(scale in 0.1..50.0f64, rate in 0.1..0.9f64) {
        let log_weights = LogWeights::new((0..100).map(|i| -scale * f64::from(i * i) / 1e3).collect());
        let schedule = SurvivalRate::new(SurvivalRateConfig { survival_rate: rate, ..Default::default() }).expect("a rate");
        let ess = log_weights.effective_sample_size(schedule.beta(0, &log_weights));
        prop_assert!((ess - rate * 100.0).abs() < 1e-3, "{ess}");
    }
}

#[test]
fn schedules() {
    check_schedule(&Geometric::new(GeometricConfig::default()).expect("defaults"));
    check_schedule(&SurvivalRate::new(SurvivalRateConfig::default()).expect("defaults"));
    check_schedule(&EssSchedule::new(EssConfig::default()).expect("defaults"));
}

#[test]
fn resamplers() {
    check_resampler(&Multinomial);
    check_resampler(&Stratified);
    check_resampler(&Systematic);
    check_resampler(&Residual);
}

#[test]
fn likelihood() {
    check_likelihood(&mut Position, &0.5, &[[0.0, 1.0], [0.7, 0.0], [9.0, 9.0]]);
}

/// Rounds down where the particle's share should round by chance.
struct Unfair;
impl Resampler for Unfair {
    fn resample(&self, weights: &NormalizedWeights, rng: &mut ParticleRng, ancestors: &mut [u32]) {
        Stratified.resample(weights, rng, ancestors);
        ancestors[0] = ancestors[ancestors.len() - 1];
        ancestors.sort_unstable();
    }
}

#[test]
#[should_panic(expected = "offspring on average")]
fn unfair_resampler_is_caught() {
    check_resampler(&Unfair);
}

#[test]
#[should_panic(expected = "the densities give")]
fn missing_correction_is_caught() {
    check_proposal(&Plane::default(), &mixture(Weighting::LikelihoodOnly), &[0.0, 0.0], &1.0);
}

#[test]
#[should_panic(expected = "misses the state")]
fn wrong_way_round_is_caught() {
    struct Backwards;
    impl StateSpace for Backwards {
        type State = f64;
        fn dim(&self) -> usize {
            1
        }
        fn retract(&self, state: &mut f64, delta: &[f64]) {
            *state += delta[0];
        }
        fn local(&self, from: &f64, to: &f64, delta: &mut [f64]) {
            delta[0] = from - to;
        }
    }
    check_state_space(&Backwards, &0.0, &1.0, 1e-9);
}

#[test]
#[should_panic(expected = "a constant changes beta")]
fn schedule_that_sees_constants_is_caught() {
    struct Absolute;
    impl AnnealingSchedule for Absolute {
        fn layers(&self) -> u32 {
            1
        }
        fn beta(&self, _: u32, log_weights: &LogWeights) -> Beta {
            Beta::new(1.0 + log_weights.max().abs()).expect("a positive number")
        }
        fn diffusion_scale(&self, _: u32) -> f64 {
            1.0
        }
    }
    check_schedule(&Absolute);
}

#[test]
#[should_panic(expected = "depends on the others")]
fn likelihood_that_looks_at_neighbours_is_caught() {
    struct Relative;
    impl Likelihood<f64> for Relative {
        type Frame = ();
        type Error = std::convert::Infallible;
        fn log_likelihoods(&mut self, (): &(), states: &[f64], out: &mut [f64]) -> Result<(), Self::Error> {
            for (out, state) in out.iter_mut().zip(states) {
                *out = state - states[0];
            }
            Ok(())
        }
    }
    check_likelihood(&mut Relative, &(), &[1.0, 2.0]);
}

#[test]
#[should_panic(expected = "does not follow from the generator")]
fn hidden_state_is_caught() {
    struct Counting(std::sync::atomic::AtomicU32);
    impl Proposal<Circle> for Counting {
        type Frame = ();
        fn propose(&self, _: &Circle, previous: &f64, (): &(), _: &mut ParticleRng) -> Proposed<f64> {
            let n = self.0.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            Proposed { state: previous + 0.1 * f64::from(n), log_correction: 0.0 }
        }
    }
    check_proposal(&Circle, &Counting(Default::default()), &0.0, &());
}
