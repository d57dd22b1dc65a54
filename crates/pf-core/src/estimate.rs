//! Mean and covariance of weighted states, on any state space.

use crate::scratch::with_buffer;
use crate::space::StateSpace;
use crate::weights::NormalizedWeights;

/// Steps of the mean on a curved space; each squares the error, more are not needed where a mean makes sense.
const MAX_STEPS: usize = 20;
/// Length of the last step at which the mean counts as found, in local coordinates.
const TOLERANCE: f64 = 1e-12;

/// The weighted mean: the state from which the weighted increments to all states cancel (`[Pennec2006]`).
///
/// Found by walking along the mean increment, from the heaviest state on. On a vector space that is one step.
///
/// # Panics
/// When the numbers of states and weights differ.
///
/// ```
/// use pf_core::{Euclidean, NormalizedWeights, estimate::weighted_mean};
/// let weights = NormalizedWeights::from_linear(vec![1.0, 3.0])?;
/// assert_eq!(weighted_mean(&Euclidean, &[[0.0], [4.0]], &weights), [3.0]);
/// # Ok::<(), pf_core::weights::BadWeights>(())
/// ```
pub fn weighted_mean<S: StateSpace>(space: &S, states: &[S::State], weights: &NormalizedWeights) -> S::State {
    let weights = weights.as_slice();
    assert_eq!(states.len(), weights.len(), "{} states but {} weights", states.len(), weights.len());
    let heaviest = (0..weights.len()).fold(0, |best, i| if weights[i] > weights[best] { i } else { best });
    mean_of(space, states, |i| weights[i], &states[heaviest])
}

/// The weighted covariance about `mean` in its local coordinates, `[dim, dim]`, row after row.
///
/// # Panics
/// When the numbers of states and weights differ, or `covariance` does not hold `dim * dim` numbers.
pub fn weighted_covariance<S: StateSpace>(
    space: &S,
    mean: &S::State,
    states: &[S::State],
    weights: &NormalizedWeights,
    covariance: &mut [f64],
) {
    let weights = weights.as_slice();
    assert_eq!(states.len(), weights.len(), "{} states but {} weights", states.len(), weights.len());
    covariance_about(space, mean, states, |i| weights[i], covariance);
}

pub(crate) fn mean_of<S: StateSpace>(
    space: &S,
    states: &[S::State],
    weight: impl Fn(usize) -> f64,
    start: &S::State,
) -> S::State {
    let dim = space.dim();
    let mut mean = start.clone();
    with_buffer(2 * dim, |buffer| {
        let (step, delta) = buffer.split_at_mut(dim);
        for _ in 0..MAX_STEPS {
            step.fill(0.0);
            for (i, state) in states.iter().enumerate() {
                space.local(&mean, state, delta);
                for (s, d) in step.iter_mut().zip(&*delta) {
                    *s += weight(i) * d;
                }
            }
            space.retract(&mut mean, step);
            if step.iter().all(|s| s.abs() <= TOLERANCE) {
                break;
            }
        }
    });
    mean
}

pub(crate) fn covariance_about<S: StateSpace>(
    space: &S,
    mean: &S::State,
    states: &[S::State],
    weight: impl Fn(usize) -> f64,
    covariance: &mut [f64],
) {
    let dim = space.dim();
    assert_eq!(covariance.len(), dim * dim, "a covariance of {dim} coordinates has {} entries", dim * dim);
    covariance.fill(0.0);
    with_buffer(dim, |delta| {
        for (i, state) in states.iter().enumerate() {
            space.local(mean, state, delta);
            for (j, row) in covariance.chunks_mut(dim).enumerate() {
                let scaled = weight(i) * delta[j];
                for (entry, d) in row[..=j].iter_mut().zip(&*delta) {
                    *entry += scaled * d;
                }
            }
        }
    });
    for j in 0..dim {
        for k in 0..j {
            covariance[k * dim + j] = covariance[j * dim + k];
        }
    }
}
