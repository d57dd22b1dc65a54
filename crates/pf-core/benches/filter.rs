//! Speed of the loop and of its parts, on one thread; `cargo bench -p pf-core`.

use std::convert::Infallible;
use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use pf_core::rng::{Draw, Purpose, particle_rng};
use pf_core::schedule::GeometricConfig;
use pf_core::{
    Euclidean, Filter, FilterConfig, FilterParams, Gaussian, GaussianDiffusion, Geometric, Likelihood,
    Multinomial, NormalizedWeights, RandomWalk, Resampler, Residual, Step, Stratified, Systematic,
};

#[path = "../examples/growth/model.rs"]
mod model;

/// One step of the growth model under a bootstrap filter; elements are particle-steps.
fn growth(criterion: &mut Criterion) {
    let (_, observations) = model::simulate(1000, 1);
    let instants = model::instants(&observations);
    let mut group = criterion.benchmark_group("growth");
    for n_particles in [1_000, 100_000] {
        let mut filter = model::filter(n_particles, 1);
        let mut instants = instants.iter().cycle();
        group.throughput(Throughput::Elements(n_particles as u64));
        group.bench_function(format!("{n_particles}_particles"), |bencher| {
            bencher.iter(|| {
                let instant = instants.next().expect("a cycle has no end");
                filter.step(instant, &mut model::Squared, &mut ()).expect("nothing fails");
            });
        });
    }
    group.finish();
}

/// A million ancestors for weights u⁴, u uniform.
fn resampling(criterion: &mut Criterion) {
    const N: usize = 1_000_000;
    let at = Draw { seed: 1, frame: 0, layer: 0, purpose: Purpose::User };
    let mut rng = particle_rng(at, 0);
    let weights =
        NormalizedWeights::from_linear((0..N).map(|_| rng.uniform().powi(4)).collect()).expect("weights");
    let mut ancestors = vec![0; N];
    let mut group = criterion.benchmark_group("resample_1e6");
    group.throughput(Throughput::Elements(N as u64)).sample_size(20);
    let schemes: [(&str, &dyn Resampler); 4] = [
        ("systematic", &Systematic),
        ("stratified", &Stratified),
        ("multinomial", &Multinomial),
        ("residual", &Residual),
    ];
    for (name, scheme) in schemes {
        group.bench_function(name, |bencher| {
            bencher.iter(|| scheme.resample(&weights, &mut rng, black_box(&mut ancestors)));
        });
    }
    group.finish();
}

/// What the loop costs beside the likelihood: 200 particles of 54 dimensions in 10 layers.
fn annealed(criterion: &mut Criterion) {
    struct Centre;
    impl Likelihood<[f64; 54]> for Centre {
        type Frame = ();
        type Error = Infallible;
        fn log_likelihoods(
            &mut self,
            (): &(),
            states: &[[f64; 54]],
            out: &mut [f64],
        ) -> Result<(), Infallible> {
            for (out, state) in out.iter_mut().zip(states) {
                *out = -state.iter().map(|x| x * x).sum::<f64>();
            }
            Ok(())
        }
    }
    let params = FilterParams::new(FilterConfig::default()).expect("defaults");
    let schedule = || Geometric::new(GeometricConfig::default()).expect("defaults");
    let walk = || RandomWalk::new(Gaussian::diagonal(vec![0.1; 54]).expect("positive"));
    let mutations = [
        ("diagonal", GaussianDiffusion::diagonal(vec![0.1; 54]).expect("positive")),
        ("survivors", GaussianDiffusion::of_survivors(vec![0.01; 54]).expect("positive")),
    ];
    let mut group = criterion.benchmark_group("annealed_200x10x54");
    for (name, mutation) in mutations {
        let mut filter = Filter::annealed(Euclidean::<54>, walk(), schedule(), mutation, params);
        filter.initialise(vec![[0.0; 54]; 200]).expect("particles");
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                filter.step(&(), &mut Centre, &mut ()).is_ok_and(|step| matches!(step, Step::Tracked(_)))
            });
        });
    }
    group.finish();
}

criterion_group!(benches, growth, resampling, annealed);
criterion_main!(benches);
