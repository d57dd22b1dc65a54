//! Against the Kalman filter: mean, covariance and evidence, over many seeds, in standard errors over the seeds.

mod common;

use common::*;
use pf_core::estimate::{weighted_covariance, weighted_mean};
use pf_core::schedule::{EssConfig, GeometricConfig};
use pf_core::{
    EssSchedule, Filter, FilterConfig, FilterParams, GaussianDiffusion, Geometric, MixtureConfig,
    MixtureProposal, Multinomial, Observer, Proposal, Residual, Step, Stratified, Weighting,
};

/// Many particles and fewer seeds: the bias of a filter falls with their number, faster than the standard error.
const N_PARTICLES: usize = 1000;
const N_SEEDS: u64 = 100;
/// Six figures in each of eight filters: by chance one run in 300 would leave this band.
const MAX_STANDARD_ERRORS: f64 = 4.0;

/// Runs one filter per seed and returns how far it is off: mean (2), covariance (3), evidence, in standard errors.
fn errors_of<P: Proposal<Plane, Frame = f64>>(filter_of: impl Fn(u64) -> Filter<Plane, P>) -> [f64; 6] {
    let exact = kalman();
    let mut samples: [Vec<f64>; 6] = Default::default();
    for seed in 0..N_SEEDS {
        let mut filter = filter_of(seed);
        filter.initialise_with(|_, rng| [rng.standard_normal(), rng.standard_normal()]);
        let evidence_before = filter.log_evidence();
        for y in &OBSERVATIONS {
            let step = filter.step(y, &mut Position, &mut ()).expect("nothing fails");
            assert!(matches!(step, Step::Tracked(_)));
        }
        let (space, particles, weights) = (filter.space(), filter.particles(), filter.weights());
        let mean = weighted_mean(space, particles, weights);
        let mut covariance = [0.0; 4];
        weighted_covariance(space, &exact.mean, particles, weights, &mut covariance);
        let ratio = (filter.log_evidence() - evidence_before - exact.log_evidence).exp();
        let figures = [mean[0], mean[1], covariance[0], covariance[1], covariance[3], ratio];
        for (samples, figure) in samples.iter_mut().zip(figures) {
            samples.push(figure);
        }
    }
    let c = exact.covariance;
    let truths = [exact.mean[0], exact.mean[1], c[0][0], c[0][1], c[1][1], 1.0];
    std::array::from_fn(|k| standard_errors_off(&samples[k], truths[k]))
}

fn assert_exact(errors: [f64; 6]) {
    let names = ["mean of x", "mean of v", "var x", "cov x v", "var v", "evidence / true evidence"];
    for (name, error) in names.iter().zip(errors) {
        assert!(
            error.abs() < MAX_STANDARD_ERRORS,
            "{name} is off by {error} standard errors; all: {errors:?}"
        );
    }
}

fn bootstrap(seed: u64) -> Filter<Plane, ConstantVelocity> {
    Filter::bootstrap(Plane::default(), ConstantVelocity::new(), params(N_PARTICLES, seed))
}

fn mixture(weighting: Weighting) -> MixtureProposal<ConstantVelocity, AroundMeasurement> {
    let config = MixtureConfig { weighting, ..MixtureConfig::default() };
    MixtureProposal::new(ConstantVelocity::new(), AroundMeasurement::new(), config)
        .expect("defaults are allowed")
}

fn diffusion() -> GaussianDiffusion {
    GaussianDiffusion::diagonal(vec![0.3, 0.3]).expect("both are positive")
}

#[test]
fn bootstrap_filter_agrees() {
    assert_exact(errors_of(bootstrap));
}

#[test]
fn every_resampler_agrees() {
    assert_exact(errors_of(|seed| bootstrap(seed).with_resampler(Multinomial)));
    assert_exact(errors_of(|seed| bootstrap(seed).with_resampler(Stratified)));
    assert_exact(errors_of(|seed| bootstrap(seed).with_resampler(Residual)));
}

#[test]
fn resampling_only_when_needed_agrees() {
    assert_exact(errors_of(|seed| {
        let config =
            FilterConfig { n_particles: N_PARTICLES, seed, resample_below: 0.3, ..FilterConfig::default() };
        let params = FilterParams::new(config).expect("a share of 0.3 is allowed");
        Filter::bootstrap(Plane::default(), ConstantVelocity::new(), params)
    }));
}

#[test]
fn importance_weighted_mixture_agrees() {
    assert_exact(errors_of(|seed| {
        Filter::bootstrap(Plane::default(), mixture(Weighting::Importance), params(N_PARTICLES, seed))
    }));
}

#[test]
fn likelihood_only_mixture_is_caught() {
    let errors = errors_of(|seed| {
        Filter::bootstrap(Plane::default(), mixture(Weighting::LikelihoodOnly), params(N_PARTICLES, seed))
    });
    assert!(
        errors[5].abs() > 3.0 * MAX_STANDARD_ERRORS,
        "without p / q the evidence must be wrong: {errors:?}"
    );
    assert!(errors[4].abs() > 3.0 * MAX_STANDARD_ERRORS, "and so must the variance: {errors:?}");
}

#[test]
fn tempered_filter_agrees_for_fixed_exponents() {
    assert_exact(errors_of(|seed| {
        let config = GeometricConfig { layers: 4, first_beta: 0.1, ..GeometricConfig::default() };
        let schedule = Geometric::new(config).expect("four layers are allowed");
        Filter::tempered(
            Plane::default(),
            ConstantVelocity::new(),
            schedule,
            diffusion(),
            params(N_PARTICLES, seed),
        )
    }));
}

#[test]
fn tempered_filter_agrees_for_adaptive_exponents_and_a_mixture() {
    assert_exact(errors_of(|seed| {
        let schedule = EssSchedule::new(EssConfig { ess_fraction: 0.7, ..EssConfig::default() })
            .expect("0.7 is allowed");
        let proposal = mixture(Weighting::Importance);
        Filter::tempered(Plane::default(), proposal, schedule, diffusion(), params(N_PARTICLES, seed))
    }));
}

/// The annealed filter is a search: the same comparison must refuse it.
#[test]
fn annealed_filter_is_not_a_sampler() {
    let errors = errors_of(|seed| annealed(4, seed));
    for figure in [0, 2, 5] {
        assert!(errors[figure].abs() > 3.0 * MAX_STANDARD_ERRORS, "diffusion is not undone: {errors:?}");
    }
}

#[test]
fn annealed_filter_of_one_layer_is_the_bootstrap_filter() {
    let states = |mut filter: Filter<Plane, ConstantVelocity>| {
        filter.initialise_with(|_, rng| [rng.standard_normal(), rng.standard_normal()]);
        for y in &OBSERVATIONS {
            filter.step(y, &mut Position, &mut ()).expect("nothing fails");
        }
        filter.checkpoint()
    };
    assert_eq!(states(annealed(1, 11)), states(bootstrap(11)));
}

fn annealed(layers: u32, seed: u64) -> Filter<Plane, ConstantVelocity> {
    let schedule =
        Geometric::new(GeometricConfig { layers, ..GeometricConfig::default() }).expect("few layers");
    Filter::annealed(
        Plane::default(),
        ConstantVelocity::new(),
        schedule,
        diffusion(),
        params(N_PARTICLES, seed),
    )
}

#[test]
fn mixture_share_follows_what_the_cue_brings_in() {
    struct Shares(Vec<f64>);
    impl<T> Observer<T> for Shares {
        fn frame_done(&mut self, view: &pf_core::FrameView<'_, T>) {
            self.0.push(view.source_shares[1]);
        }
    }
    let mut filter = Filter::bootstrap(Plane::default(), mixture(Weighting::LikelihoodOnly), params(1000, 5));
    filter.initialise_with(|_, rng| [rng.standard_normal(), rng.standard_normal()]);
    let mut shares = Shares(Vec::new());
    for y in [0.0, 30.0, 30.0] {
        filter.step(&y, &mut Position, &mut shares).expect("nothing fails");
    }
    let [_, jump, _] = shares.0[..] else { panic!("three frames give three shares") };
    assert!(jump > 0.999, "only the cue finds a jump of the target: {jump}");
    assert_eq!(filter.proposal().cue_share(), 0.95, "and the floor keeps the prior alive");
}
