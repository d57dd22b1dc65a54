//! Tempering towards a skewed target: exponents with the wrong sign, or weights of the wrong step, would show.

mod common;

use std::convert::Infallible;

use common::{params, standard_errors_off};
use pf_core::schedule::{EssConfig, GeometricConfig};
use pf_core::{
    AnnealingSchedule, EssSchedule, Euclidean, Filter, Gaussian, GaussianDiffusion, Geometric, Likelihood,
    RandomWalk, Step,
};

/// Many particles and few seeds: the bias falls with their number, faster than the standard error.
const N_PARTICLES: usize = 1000;

type Line = Euclidean<1>;

/// A log-gamma bump, steep to the right: ln p = 12 x − 4 eˣ, far into the right flank of the N(0, 1) prior.
struct Skewed;

fn log_likelihood(x: f64) -> f64 {
    12.0 * x - 4.0 * x.exp()
}

impl Likelihood<[f64; 1]> for Skewed {
    type Frame = ();
    type Error = Infallible;
    fn log_likelihoods(&mut self, (): &(), states: &[[f64; 1]], out: &mut [f64]) -> Result<(), Infallible> {
        for (out, [x]) in out.iter_mut().zip(states) {
            *out = log_likelihood(*x);
        }
        Ok(())
    }
}

struct Exact {
    mean: f64,
    variance: f64,
    third_moment: f64,
    log_evidence: f64,
}

/// Moments of prior times likelihood by the trapezoidal rule, which is exact to rounding for functions that vanish so
/// smoothly at both ends.
fn quadrature() -> Exact {
    let step = 1e-3;
    let points = || (-8_000..8_000).map(|i| f64::from(i) * step);
    let density = |x: f64| (log_likelihood(x) - 0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt();
    let integral = |f: &dyn Fn(f64) -> f64| points().map(|x| f(x) * density(x)).sum::<f64>() * step;
    let evidence = integral(&|_| 1.0);
    let mean = integral(&|x| x) / evidence;
    let variance = integral(&|x| (x - mean).powi(2)) / evidence;
    let third_moment = integral(&|x| (x - mean).powi(3)) / evidence;
    Exact { mean, variance, third_moment, log_evidence: evidence.ln() }
}

/// Mean, variance, third moment and evidence, in standard errors over seeds.
fn errors_of(filter_of: impl Fn(u64) -> Filter<Line, RandomWalk<()>>) -> [f64; 4] {
    const N_SEEDS: u64 = 100;
    let exact = quadrature();
    assert!(exact.third_moment < -0.1 * exact.variance.powf(1.5), "the target must lean to one side");
    let mut samples: [Vec<f64>; 4] = Default::default();
    for seed in 0..N_SEEDS {
        let mut filter = filter_of(seed);
        filter.initialise(vec![[0.0]]).expect("one particle to walk from");
        let Ok(Step::Tracked(view)) = filter.step(&(), &mut Skewed, &mut ()) else { panic!("lost") };
        let moment = |power: i32, centre: f64| -> f64 {
            view.weights.as_slice().iter().zip(view.states).map(|(w, [x])| w * (x - centre).powi(power)).sum()
        };
        let ratio = (view.log_evidence - exact.log_evidence).exp();
        let figures = [moment(1, 0.0), moment(2, exact.mean), moment(3, exact.mean), ratio];
        for (samples, figure) in samples.iter_mut().zip(figures) {
            samples.push(figure);
        }
    }
    let truths = [exact.mean, exact.variance, exact.third_moment, 1.0];
    std::array::from_fn(|k| standard_errors_off(&samples[k], truths[k]))
}

fn walk() -> RandomWalk<()> {
    RandomWalk::new(Gaussian::diagonal(vec![1.0]).expect("positive"))
}

fn diffusion() -> GaussianDiffusion {
    GaussianDiffusion::diagonal(vec![0.4]).expect("positive")
}

fn tempered<A: AnnealingSchedule + Clone + Send + 'static>(
    schedule: A,
) -> impl Fn(u64) -> Filter<Line, RandomWalk<()>> {
    move |seed| {
        Filter::tempered(Line::default(), walk(), schedule.clone(), diffusion(), params(N_PARTICLES, seed))
    }
}

const MAX_STANDARD_ERRORS: f64 = 4.0;

#[test]
fn adaptive_steps_reach_the_target() {
    let schedule =
        EssSchedule::new(EssConfig { ess_fraction: 0.6, ..EssConfig::default() }).expect("a share");
    let errors = errors_of(tempered(schedule));
    assert!(errors.iter().all(|e| e.abs() < MAX_STANDARD_ERRORS), "{errors:?}");
}

#[test]
fn fixed_steps_reach_the_target() {
    let config = GeometricConfig { layers: 5, first_beta: 0.05, ..GeometricConfig::default() };
    let schedule = Geometric::new(config).expect("five layers");
    let errors = errors_of(tempered(schedule));
    assert!(errors.iter().all(|e| e.abs() < MAX_STANDARD_ERRORS), "{errors:?}");
}

/// The same figures must tell when moves are not accepted or refused by the target.
#[test]
fn free_diffusion_misses_the_target() {
    let config = GeometricConfig { layers: 5, first_beta: 0.05, ..GeometricConfig::default() };
    let schedule = Geometric::new(config).expect("five layers");
    let errors = errors_of(|seed| {
        Filter::annealed(Line::default(), walk(), schedule, diffusion(), params(N_PARTICLES, seed))
    });
    assert!(errors.iter().any(|e| e.abs() > 3.0 * MAX_STANDARD_ERRORS), "{errors:?}");
}

#[test]
fn exponents_rise_to_one_and_keep_the_sample_size() {
    let schedule =
        EssSchedule::new(EssConfig { ess_fraction: 0.6, ..EssConfig::default() }).expect("a share");
    let mut filter = tempered(schedule)(1);
    filter.initialise(vec![[0.0]]).expect("one particle");
    let Ok(Step::Tracked(view)) = filter.step(&(), &mut Skewed, &mut ()) else { panic!("lost") };
    let betas: Vec<f64> = view.layers.iter().map(|l| l.beta.get()).collect();
    assert!(betas.len() > 2 && betas.is_sorted(), "{betas:?}");
    assert_eq!(betas.last(), Some(&1.0));
    for layer in &view.layers[..betas.len() - 1] {
        assert!((layer.effective_sample_size - 0.6 * N_PARTICLES as f64).abs() < 0.01, "{layer:?}");
    }
    for layer in &view.layers[1..] {
        assert!(layer.acceptance > 0.1 && layer.acceptance < 0.99, "{layer:?}");
    }
}
