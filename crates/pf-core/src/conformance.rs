//! The laws of the traits as checks that any implementation can run in its tests (feature `conformance`).
//!
//! Each function panics with what it found when a law does not hold.
//!
//! ```
//! use pf_core::{Euclidean, Systematic, conformance};
//! conformance::check_resampler(&Systematic);
//! conformance::check_state_space(&Euclidean::<2>, &[1.0, 2.0], &[0.5, 4.0], 1e-12);
//! ```

use crate::likelihood::Likelihood;
use crate::proposal::{Proposal, Proposed};
use crate::resample::Resampler;
use crate::rng::{Draw, ParticleRng, Purpose, particle_rng};
use crate::schedule::AnnealingSchedule;
use crate::space::StateSpace;
use crate::weights::{LogWeights, NormalizedWeights};

fn rng(number: u32) -> ParticleRng {
    particle_rng(Draw { seed: 0xC0FFEE, frame: 0, layer: 0, purpose: Purpose::User }, number)
}

fn distance<S: StateSpace>(space: &S, from: &S::State, to: &S::State) -> f64 {
    let mut delta = vec![0.0; space.dim()];
    space.local(from, to, &mut delta);
    delta.iter().fold(0.0, |largest: f64, d| if d.is_nan() { f64::NAN } else { largest.max(d.abs()) })
}

/// Laws of [`StateSpace`] for two states inside the limits; `tolerance` is the largest coordinate that counts as zero.
pub fn check_state_space<S: StateSpace>(space: &S, from: &S::State, to: &S::State, tolerance: f64) {
    let off = distance(space, from, from);
    assert!(off <= tolerance, "local from a state to itself is {off}, expected zero");

    let mut moved = from.clone();
    space.retract(&mut moved, &vec![0.0; space.dim()]);
    let off = distance(space, from, &moved);
    assert!(off <= tolerance, "retract by zero moves by {off}");

    let mut delta = vec![0.0; space.dim()];
    space.local(from, to, &mut delta);
    space.retract(&mut moved, &delta);
    let off = distance(space, &moved, to);
    assert!(off <= tolerance, "retract by the local increment misses the state by {off}");
}

/// Laws of [`Proposal`] for one particle and one frame.
pub fn check_proposal<S: StateSpace, P: Proposal<S>>(
    space: &S,
    proposal: &P,
    previous: &S::State,
    frame: &P::Frame,
) {
    const DRAWS: u32 = 200;
    const TOLERANCE: f64 = 1e-9;
    for number in 0..DRAWS {
        let draw = || proposal.propose_from_source(space, previous, frame, &mut rng(number));
        let (Proposed { state, log_correction }, source) = draw();
        assert!(log_correction < f64::INFINITY, "draw {number}: log_correction is {log_correction}");
        let n_sources = proposal.n_sources();
        assert!(usize::from(source) < n_sources, "draw {number}: source {source} of {n_sources}");

        let (again, _) = draw();
        assert_eq!(log_correction, again.log_correction, "draw {number} does not follow from the generator");
        assert_eq!(
            distance(space, &state, &again.state),
            0.0,
            "draw {number} does not follow from the generator"
        );

        let motion = proposal.log_motion_density(space, previous, &state);
        let density = proposal.log_density(space, previous, frame, &state);
        if let (Some(motion), Some(density)) = (motion, density) {
            let off = (motion - density - log_correction).abs();
            assert!(
                off <= TOLERANCE,
                "draw {number}: log_correction is {log_correction}, the densities give {motion} - {density}"
            );
        }
    }
}

/// Laws of [`Likelihood`] on these states.
pub fn check_likelihood<T: Clone, L: Likelihood<T>>(likelihood: &mut L, frame: &L::Frame, states: &[T]) {
    let mut scores = vec![0.0; states.len()];
    likelihood.log_likelihoods(frame, states, &mut scores).expect("the states can be scored");
    for (particle, score) in scores.iter().enumerate() {
        assert!(*score < f64::INFINITY, "state {particle}: the log likelihood is {score}");
    }
    let reversed: Vec<T> = states.iter().rev().cloned().collect();
    let mut reversed_scores = vec![0.0; states.len()];
    likelihood.log_likelihoods(frame, &reversed, &mut reversed_scores).expect("the states can be scored");
    reversed_scores.reverse();
    assert_eq!(scores, reversed_scores, "the score of a state depends on the others");
}

/// Laws of [`AnnealingSchedule`].
pub fn check_schedule(schedule: &dyn AnnealingSchedule) {
    const TOLERANCE: f64 = 1e-6;
    assert!(schedule.layers() > 0, "no layers");
    let spread: Vec<f64> = (0..100).map(|i| -0.3 * f64::from(i)).collect();
    let with_impossible: Vec<f64> =
        spread.iter().enumerate().map(|(i, w)| if i % 3 == 0 { f64::NEG_INFINITY } else { *w }).collect();
    for layer in 0..schedule.layers() {
        let scale = schedule.diffusion_scale(layer);
        assert!(scale >= 0.0 && scale.is_finite(), "layer {layer}: diffusion_scale is {scale}");
        for weights in [&spread, &with_impossible, &vec![0.0; 100]] {
            let raised = weights.iter().map(|w| w + 17.0).collect();
            let beta = schedule.beta(layer, &LogWeights::new(weights.clone())).get();
            let beta_raised = schedule.beta(layer, &LogWeights::new(raised)).get();
            let off = (beta - beta_raised).abs();
            assert!(
                off <= TOLERANCE * beta,
                "layer {layer}: a constant changes beta from {beta} to {beta_raised}"
            );
        }
    }
}

/// Laws of [`Resampler`], on a list of cases.
pub fn check_resampler(resampler: &dyn Resampler) {
    let cases: [(&[f64], usize); 6] = [
        (&[1.0; 7], 7),
        (&[0.0, 5.0, 0.0, 1.0, 2.5, 0.0], 10),
        (&[1.0, 2.0, 3.0, 4.0], 3),
        (&[0.001, 0.0, 1.0], 50),
        (&[0.0, 0.0, 3.0, 0.0], 4),
        (&[1.0], 3),
    ];
    for (weights, n_places) in cases {
        let weights = NormalizedWeights::from_linear(weights.to_vec()).expect("the cases are weights");
        check_resampler_on(resampler, &weights, n_places);
    }
}

fn check_resampler_on(resampler: &dyn Resampler, weights: &NormalizedWeights, n_places: usize) {
    const REPEATS: u32 = 4000;
    /// About 20 particles in the list and four schemes: 4.5 would fail by chance once in 2,000 lists.
    const MAX_STANDARD_ERRORS: f64 = 4.5;
    let mut counts = vec![0u32; weights.as_slice().len()];
    let (mut ancestors, mut again) = (vec![0; n_places], vec![u32::MAX; n_places]);
    for number in 0..REPEATS {
        resampler.resample(weights, &mut rng(number), &mut ancestors);
        resampler.resample(weights, &mut rng(number), &mut again);
        assert_eq!(ancestors, again, "the ancestors do not follow from weights and generator");
        assert!(ancestors.is_sorted(), "ancestors are not in rising order: {ancestors:?}");
        for &ancestor in &ancestors {
            counts[ancestor as usize] += 1;
        }
    }
    for (particle, (&count, &weight)) in counts.iter().zip(weights.as_slice()).enumerate() {
        if weight == 0.0 {
            assert_eq!(count, 0, "particle {particle} has weight zero and offspring");
            continue;
        }
        let expected = n_places as f64 * weight;
        let mean = f64::from(count) / f64::from(REPEATS);
        // No scheme varies more than independent draws do.
        let standard_error = (expected * (1.0 - weight) / f64::from(REPEATS)).sqrt();
        let off = (mean - expected).abs();
        let rounding = 1e-9 * expected;
        assert!(
            off <= MAX_STANDARD_ERRORS * standard_error + rounding,
            "particle {particle} has {mean} offspring on average, expected {expected} +- {standard_error}",
        );
    }
}
