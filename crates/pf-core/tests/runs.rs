//! What a run depends on: not on threads, not on interruptions; and how it ends when something is wrong.

mod common;

use std::error::Error;
use std::num::NonZeroUsize;

use common::*;
use pf_core::schedule::{EssConfig, GeometricConfig, SurvivalRateConfig};
use pf_core::{
    EssSchedule, ExecConfig, Filter, FilterState, GaussianDiffusion, Genealogy, Geometric, LayerView,
    Likelihood, Lost, MixtureConfig, MixtureProposal, Multinomial, Observer, Proposal, Residual, Step,
    StepError, SurvivalRate,
};

type Mixture = MixtureProposal<ConstantVelocity, AroundMeasurement>;

fn mixture() -> Mixture {
    MixtureProposal::new(ConstantVelocity::new(), AroundMeasurement::new(), MixtureConfig::default())
        .expect("defaults are allowed")
}

/// One filter of each kind, with particles.
fn filters(threads: usize) -> Vec<Filter<Plane, Mixture>> {
    let survivors = || GaussianDiffusion::of_survivors(vec![0.05, 0.05]).expect("both are positive");
    let space = Plane::default();
    let survival_rate =
        SurvivalRate::new(SurvivalRateConfig { layers: 5, ..Default::default() }).expect("five layers");
    let ess = EssSchedule::new(EssConfig::default()).expect("defaults");
    let threads = NonZeroUsize::new(threads).expect("one or more");
    let exec = ExecConfig { threads: Some(threads), chunk: NonZeroUsize::new(16).expect("not zero") };
    let filters = [
        Filter::bootstrap(space, mixture(), params(300, 1)).with_resampler(Multinomial),
        Filter::annealed(space, mixture(), survival_rate, survivors(), params(301, 2)),
        Filter::tempered(space, mixture(), ess, survivors(), params(302, 3)).with_resampler(Residual),
    ];
    filters
        .into_iter()
        .map(|filter| {
            let mut filter = filter.with_exec(exec).expect("threads start");
            filter.initialise_with(|_, rng| [rng.standard_normal(), rng.standard_normal()]);
            filter
        })
        .collect()
}

fn run<P: Proposal<Plane, Frame = f64>>(filter: &mut Filter<Plane, P>, observations: &[f64]) -> Vec<u64> {
    let mut bits = Vec::new();
    for y in observations {
        let step = filter.step(y, &mut Position, &mut ()).expect("nothing fails");
        let Step::Tracked(view) = step else { panic!("lost") };
        bits.extend(view.states.as_flattened().iter().chain(view.weights.as_slice()).map(|x| x.to_bits()));
        bits.push(view.log_evidence.to_bits());
    }
    bits
}

#[test]
fn bits_are_equal_for_any_number_of_threads() {
    for (one, (two, seven)) in filters(1).iter_mut().zip(filters(2).iter_mut().zip(filters(7).iter_mut())) {
        let bits = run(one, &OBSERVATIONS);
        assert_eq!(bits, run(two, &OBSERVATIONS));
        assert_eq!(bits, run(seven, &OBSERVATIONS));
    }
}

#[test]
fn another_seed_gives_other_bits() {
    let run_seed = |seed| {
        let mut filter = Filter::bootstrap(Plane::default(), ConstantVelocity::new(), params(50, seed));
        filter.initialise(vec![[0.0; 2]; 50]).expect("particles");
        run(&mut filter, &OBSERVATIONS)
    };
    assert_eq!(run_seed(1), run_seed(1));
    assert_ne!(run_seed(1), run_seed(2));
}

#[test]
fn resumed_run_ends_byte_equal() {
    let (before, after) = OBSERVATIONS.split_at(3);
    for (whole, (interrupted, resumed)) in
        filters(1).iter_mut().zip(filters(1).iter_mut().zip(filters(2).iter_mut()))
    {
        run(whole, &OBSERVATIONS);
        run(interrupted, before);
        let bytes = postcard::to_stdvec(&interrupted.checkpoint()).expect("plain data");
        let state: FilterState<[f64; 2]> = postcard::from_bytes(&bytes).expect("what was written");
        resumed.restore(state).expect("a sound state");
        run(resumed, after);
        let bytes =
            |filter: &Filter<Plane, Mixture>| postcard::to_stdvec(&filter.checkpoint()).expect("plain data");
        assert_eq!(bytes(whole), bytes(resumed));
    }
}

#[test]
fn survivors_are_counted_and_lines_can_be_followed() {
    struct Check(Vec<u32>);
    impl Observer<[f64; 2]> for Check {
        fn layer_done(&mut self, view: &LayerView<'_, [f64; 2]>) {
            let distinct = |indices: &[u32]| indices.iter().collect::<std::collections::BTreeSet<_>>().len();
            assert_eq!(view.stats.unique_ancestors, distinct(view.ancestors));
            assert!(view.stats.unique_parents >= view.stats.unique_ancestors);
            assert!(view.stats.effective_sample_size <= view.states.len() as f64 + 1e-9);
            self.0.push(view.stats.layer);
        }
    }
    let mut filter = filters(1).remove(1);
    let mut genealogy = Genealogy::default();
    let mut check = Check(Vec::new());
    for y in OBSERVATIONS {
        filter.step(&y, &mut Position, &mut check).expect("nothing fails");
    }
    assert_eq!(check.0, [0, 1, 2, 3, 4].repeat(OBSERVATIONS.len()));

    // Particles that keep to where they started show whose children they are.
    let still = GaussianDiffusion::diagonal(vec![0.0; 2]).expect("zeros keep still");
    let walk = pf_core::RandomWalk::new(pf_core::Gaussian::diagonal(vec![0.0; 2]).expect("zeros keep still"));
    let schedule = Geometric::new(GeometricConfig { layers: 3, ..Default::default() }).expect("three layers");
    let mut filter = Filter::annealed(Plane::default(), walk, schedule, still, params(40, 9));
    let starts: Vec<[f64; 2]> = (0..40).map(|i| [f64::from(i) / 20.0 - 1.0, 0.0]).collect();
    filter.initialise(starts.clone()).expect("particles");
    for y in [0.1, 0.2, 0.15] {
        filter.step(&y, &mut Position, &mut genealogy).expect("nothing fails");
    }
    for (i, particle) in filter.particles().iter().enumerate() {
        let line = genealogy.lineage(i as u32);
        assert_eq!(line.len(), genealogy.n_frames() + 1);
        assert_eq!(*particle, starts[line[3] as usize]);
    }
}

#[test]
fn lost_frame_leaves_the_particles_and_moves_on() {
    struct Impossible;
    impl Likelihood<[f64; 2]> for Impossible {
        type Frame = f64;
        type Error = std::convert::Infallible;
        fn log_likelihoods(&mut self, _: &f64, _: &[[f64; 2]], out: &mut [f64]) -> Result<(), Self::Error> {
            out.fill(f64::NEG_INFINITY);
            Ok(())
        }
    }
    for mut filter in filters(1) {
        run(&mut filter, &OBSERVATIONS[..1]);
        let before = filter.checkpoint();
        let step = filter.step(&0.0, &mut Impossible, &mut ()).expect("losing is no error");
        assert!(matches!(step, Step::Lost(Lost { frame: 1, layer: 0 })));
        assert_eq!(filter.checkpoint(), FilterState { frame: 2, ..before });
        run(&mut filter, &OBSERVATIONS[1..]);
    }
}

#[test]
fn prediction_moves_without_looking() {
    let mut filter = Filter::bootstrap(Plane::default(), ConstantVelocity::new(), params(20_000, 4));
    filter.initialise(vec![[1.0, 2.0]]).expect("one particle is enough to start from");
    let Ok(Step::Tracked(view)) = filter.predict(&f64::NAN) else { panic!("nothing to lose or to fail") };
    let mean = view.mean(&Plane::default());
    let standard_error = [Q[0][0], Q[1][1]].map(|q| (q / 20_000.0).sqrt());
    assert!((mean[0] - 2.0).abs() < 4.0 * standard_error[0], "{mean:?}");
    assert!((mean[1] - 1.8).abs() < 4.0 * standard_error[1], "{mean:?}");
    assert_eq!((filter.next_frame(), filter.log_evidence(), filter.particles().len()), (1, 0.0, 20_000));
}

/// NaN for one particle from the given call on.
struct Broken {
    calls: u32,
    from_call: u32,
}
impl Likelihood<[f64; 2]> for Broken {
    type Frame = f64;
    type Error = std::convert::Infallible;
    fn log_likelihoods(&mut self, _: &f64, _: &[[f64; 2]], out: &mut [f64]) -> Result<(), Self::Error> {
        out.fill(-1.0);
        if self.calls >= self.from_call {
            out[7] = f64::NAN;
        }
        self.calls += 1;
        Ok(())
    }
}

#[test]
fn nan_names_frame_layer_and_particle_and_changes_nothing() {
    for mut filter in filters(1).into_iter().skip(1) {
        run(&mut filter, &OBSERVATIONS[..2]);
        let before = filter.checkpoint();
        let error = filter.step(&0.0, &mut Broken { calls: 0, from_call: 0 }, &mut ()).expect_err("a NaN");
        assert_eq!(
            error.to_string(),
            "frame 2, layer 0, particle 7: the log likelihood is NaN, expected a number below +inf"
        );
        assert_eq!(filter.checkpoint(), before);
    }
    let mut annealed = filters(1).remove(1);
    let error = annealed.step(&0.0, &mut Broken { calls: 0, from_call: 3 }, &mut ()).expect_err("a NaN");
    assert!(matches!(error, StepError::BadLogLikelihood { frame: 0, layer: 3, particle: 7, .. }), "{error}");
}

#[test]
fn failing_likelihood_is_the_source_of_the_error() {
    #[derive(Debug, thiserror::Error)]
    #[error("no light")]
    struct NoLight;
    struct Dark;
    impl Likelihood<[f64; 2]> for Dark {
        type Frame = f64;
        type Error = NoLight;
        fn log_likelihoods(&mut self, _: &f64, _: &[[f64; 2]], _: &mut [f64]) -> Result<(), NoLight> {
            Err(NoLight)
        }
    }
    let error = filters(1)[0].step(&0.0, &mut Dark, &mut ()).expect_err("no light");
    assert_eq!(error.to_string(), "frame 0, layer 0: cannot score the particles");
    assert_eq!(error.source().expect("a source").to_string(), "no light");
}

#[test]
fn tempering_without_motion_density_says_so() {
    let schedule = Geometric::new(GeometricConfig { layers: 2, ..Default::default() }).expect("two layers");
    let diffusion = GaussianDiffusion::diagonal(vec![0.1; 2]).expect("positive");
    let mut filter =
        Filter::tempered(Plane::default(), AroundMeasurement::new(), schedule, diffusion, params(10, 1));
    filter.initialise(vec![[0.0; 2]; 10]).expect("particles");
    let error = filter.step(&0.0, &mut Position, &mut ()).expect_err("no density");
    assert_eq!(
        error.to_string(),
        "frame 0, layer 0, particle 0: the motion prior has no density here, but tempering needs one"
    );
}

#[test]
fn unusable_states_are_refused() {
    let mut filter = Filter::bootstrap(Plane::default(), ConstantVelocity::new(), params(10, 1));
    let error = filter.step(&0.0, &mut Position, &mut ()).expect_err("no particles yet");
    assert_eq!(
        error.to_string(),
        "the filter has no particles, expected a call of `initialise` or `restore` first"
    );
    assert_eq!(
        filter.initialise(Vec::new()).expect_err("empty").to_string(),
        "`particles` is empty, expected one or more"
    );
    let sound = FilterState::from_particles(vec![[0.0; 2]; 2]);
    for (weights, message) in [
        (vec![0.5], "`weights` has 1 entries, expected one for each of the 2 particles"),
        (vec![0.5, f64::NAN], "`weights` are no distribution"),
        (vec![0.5, 0.6], "`weights` are no distribution"),
    ] {
        let error = filter.restore(FilterState { weights, ..sound.clone() }).expect_err("no distribution");
        assert_eq!(error.to_string(), message);
    }
}
