//! Against forward-backward on a discrete hidden Markov model: filtered and smoothed probabilities, and the evidence.

mod common;

use std::convert::Infallible;

use common::{params, standard_errors_off};
use pf_core::{Filter, Genealogy, Likelihood, Multinomial, ParticleRng, Proposal, Proposed, StateSpace};

const START: [f64; 3] = [0.5, 0.3, 0.2];
/// From row to column.
const MOVE: [[f64; 3]; 3] = [[0.7, 0.2, 0.1], [0.1, 0.6, 0.3], [0.4, 0.1, 0.5]];
/// Probability of symbols 0, 1 in each state; the last state never shows symbol 0.
const SHOW: [[f64; 2]; 3] = [[0.8, 0.2], [0.4, 0.6], [0.0, 1.0]];
const SYMBOLS: [usize; 6] = [0, 1, 1, 0, 1, 1];

/// Three states without coordinates.
struct Labels;
impl StateSpace for Labels {
    type State = u8;
    fn dim(&self) -> usize {
        0
    }
    fn retract(&self, _: &mut u8, _: &[f64]) {}
    fn local(&self, _: &u8, _: &u8, _: &mut [f64]) {}
}

fn draw(probabilities: &[f64; 3], rng: &mut ParticleRng) -> u8 {
    let u = rng.uniform();
    match u {
        _ if u < probabilities[0] => 0,
        _ if u < probabilities[0] + probabilities[1] => 1,
        _ => 2,
    }
}

struct Chain;
impl Proposal<Labels> for Chain {
    type Frame = usize;
    fn propose(&self, _: &Labels, previous: &u8, _: &usize, rng: &mut ParticleRng) -> Proposed<u8> {
        Proposed { state: draw(&MOVE[usize::from(*previous)], rng), log_correction: 0.0 }
    }
}

struct Symbol;
impl Likelihood<u8> for Symbol {
    type Frame = usize;
    type Error = Infallible;
    fn log_likelihoods(&mut self, symbol: &usize, states: &[u8], out: &mut [f64]) -> Result<(), Infallible> {
        for (out, state) in out.iter_mut().zip(states) {
            *out = SHOW[usize::from(*state)][*symbol].ln();
        }
        Ok(())
    }
}

struct Exact {
    filtered: [f64; 3],
    /// Of the state before the first symbol, then with each symbol.
    smoothed: Vec<[f64; 3]>,
    log_evidence: f64,
}

fn forward_backward() -> Exact {
    let mut forward = vec![START];
    for symbol in SYMBOLS {
        let last = forward[forward.len() - 1];
        forward.push(std::array::from_fn(|j| {
            (0..3).map(|i| last[i] * MOVE[i][j]).sum::<f64>() * SHOW[j][symbol]
        }));
    }
    let mut backward = vec![[1.0; 3]];
    for symbol in SYMBOLS.iter().rev() {
        let next = backward[backward.len() - 1];
        backward.push(std::array::from_fn(|i| (0..3).map(|j| MOVE[i][j] * SHOW[j][*symbol] * next[j]).sum()));
    }
    backward.reverse();
    let last = forward[SYMBOLS.len()];
    let evidence: f64 = last.iter().sum();
    let smoothed =
        forward.iter().zip(&backward).map(|(f, b)| std::array::from_fn(|i| f[i] * b[i] / evidence));
    Exact { filtered: last.map(|f| f / evidence), smoothed: smoothed.collect(), log_evidence: evidence.ln() }
}

#[test]
fn filter_agrees_with_forward_backward() {
    const N_SEEDS: u64 = 100;
    const N_PARTICLES: usize = 1000;
    /// 25 figures: by chance one run in 600 would leave this band.
    const MAX_STANDARD_ERRORS: f64 = 4.0;
    let exact = forward_backward();
    let n_instants = SYMBOLS.len() + 1;
    let mut filtered = vec![Vec::new(); 3];
    let mut smoothed = vec![vec![Vec::new(); 3]; n_instants];
    let mut evidence_ratios = Vec::new();
    for seed in 0..N_SEEDS {
        let mut filter =
            Filter::bootstrap(Labels, Chain, params(N_PARTICLES, seed)).with_resampler(Multinomial);
        filter.initialise_with(|_, rng| draw(&START, rng));
        let mut genealogy = Genealogy::default();
        let mut history = vec![filter.particles().to_vec()];
        for symbol in &SYMBOLS {
            filter.step(symbol, &mut Symbol, &mut genealogy).expect("nothing fails");
            history.push(filter.particles().to_vec());
        }
        let mut now = [0.0; 3];
        let mut then = vec![[0.0; 3]; n_instants];
        for (i, weight) in filter.weights().as_slice().iter().enumerate() {
            now[usize::from(filter.particles()[i])] += weight;
            let line = genealogy.lineage(i as u32);
            for (k, particle) in line.iter().rev().enumerate() {
                then[k][usize::from(history[k][*particle as usize])] += weight;
            }
        }
        evidence_ratios.push((filter.log_evidence() - exact.log_evidence).exp());
        for state in 0..3 {
            filtered[state].push(now[state]);
            for (samples, then) in smoothed.iter_mut().zip(&then) {
                samples[state].push(then[state]);
            }
        }
    }
    let off = standard_errors_off(&evidence_ratios, 1.0);
    assert!(off.abs() < MAX_STANDARD_ERRORS, "the evidence is off by {off} standard errors");
    for state in 0..3 {
        let off = standard_errors_off(&filtered[state], exact.filtered[state]);
        assert!(off.abs() < MAX_STANDARD_ERRORS, "state {state}, filtered: off by {off} standard errors");
        for (k, (samples, truths)) in smoothed.iter().zip(&exact.smoothed).enumerate() {
            let (samples, truth) = (&samples[state], truths[state]);
            if truth == 0.0 {
                assert!(samples.iter().all(|s| *s == 0.0), "instant {k}, state {state} is impossible");
                continue;
            }
            let off = standard_errors_off(samples, truth);
            assert!(
                off.abs() < MAX_STANDARD_ERRORS,
                "instant {k}, state {state}: off by {off} standard errors"
            );
        }
    }
}
