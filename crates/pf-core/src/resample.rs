//! Choosing who has offspring: four schemes, all unbiased, ancestors in rising order.

use crate::rng::ParticleRng;
use crate::weights::NormalizedWeights;

/// Draws an ancestor for each place in `ancestors`.
///
/// # Laws
/// - The expected number of places of particle `i` is `ancestors.len()` times its weight.
/// - A particle of weight zero gets no place.
/// - Ancestors come in rising order, so that the copies of a particle stand together.
/// - The result follows from the weights and the generator alone.
///
/// The numbers of weights and of places may differ.
pub trait Resampler {
    /// Fills `ancestors` with indices into `weights`.
    fn resample(&self, weights: &NormalizedWeights, rng: &mut ParticleRng, ancestors: &mut [u32]);
}

/// Independent draws: the largest variance, the simplest theory.
#[derive(Clone, Copy, Debug, Default)]
pub struct Multinomial;

/// One draw in each of the equal strata of the unit interval.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stratified;

/// One draw for all: points at equal distances. Each particle gets its expected number of places rounded up or down.
#[derive(Clone, Copy, Debug, Default)]
pub struct Systematic;

/// The whole part of each expected number for certain, the rest by independent draws.
#[derive(Clone, Copy, Debug, Default)]
pub struct Residual;

impl Resampler for Multinomial {
    fn resample(&self, weights: &NormalizedWeights, rng: &mut ParticleRng, ancestors: &mut [u32]) {
        let mut walk = Walk::new(weights.as_slice().iter().copied(), 1.0);
        for_each_sorted_uniform(ancestors.len(), rng, |place, u| ancestors[place] = walk.particle_at(u));
    }
}

impl Resampler for Stratified {
    fn resample(&self, weights: &NormalizedWeights, rng: &mut ParticleRng, ancestors: &mut [u32]) {
        let mut walk = Walk::new(weights.as_slice().iter().copied(), ancestors.len() as f64);
        for (place, ancestor) in ancestors.iter_mut().enumerate() {
            *ancestor = walk.particle_at(place as f64 + rng.uniform());
        }
    }
}

impl Resampler for Systematic {
    /// Each particle writes its number where its places begin; who has none is overwritten by the next; a running
    /// maximum fills the gaps. No branch depends on the weights.
    fn resample(&self, weights: &NormalizedWeights, rng: &mut ParticleRng, ancestors: &mut [u32]) {
        let n = ancestors.len();
        let (offset, scale) = (rng.uniform(), n as f64);
        let mut cumulative = 0.0;
        let mut possible = 0;
        ancestors.fill(0);
        for (particle, &weight) in weights.as_slice().iter().enumerate() {
            if weight > 0.0 {
                possible = particle as u32;
            }
            // The first place whose point, place + offset, is not below the cumulative weight.
            let first = (cumulative - offset).ceil() as usize;
            if first < n {
                ancestors[first] = possible;
            }
            cumulative += weight * scale;
        }
        let mut last = 0;
        for ancestor in ancestors {
            last = last.max(*ancestor);
            *ancestor = last;
        }
    }
}

impl Resampler for Residual {
    fn resample(&self, weights: &NormalizedWeights, rng: &mut ParticleRng, ancestors: &mut [u32]) {
        let weights = weights.as_slice();
        let n = ancestors.len() as f64;
        let mut n_certain = 0;
        for (i, w) in weights.iter().enumerate() {
            let copies = (n * w) as usize;
            // Rounding may promise a place more than there is.
            let copies = copies.min(ancestors.len() - n_certain);
            ancestors[n_certain..n_certain + copies].fill(i as u32);
            n_certain += copies;
        }
        let rest = &mut ancestors[n_certain..];
        let fractions = weights.iter().map(|w| (n * w).fract());
        let total: f64 = fractions.clone().sum();
        let mut walk = Walk::new(fractions, 1.0 / total);
        for_each_sorted_uniform(rest.len(), rng, |place, u| rest[place] = walk.particle_at(u));
        ancestors.sort_unstable();
    }
}

/// A walk along the cumulative weights, for points in rising order.
struct Walk<I> {
    weights: I,
    scale: f64,
    /// Number of weights added so far.
    n_added: u32,
    /// The last particle so far with a weight above zero.
    possible: u32,
    cumulative: f64,
}

impl<I: Iterator<Item = f64>> Walk<I> {
    fn new(weights: I, scale: f64) -> Self {
        Self { weights, scale, n_added: 0, possible: 0, cumulative: 0.0 }
    }

    /// The particle on whose stretch `point` lies. Past the end (by rounding): the last one that is possible.
    #[inline]
    fn particle_at(&mut self, point: f64) -> u32 {
        while self.cumulative <= point {
            let Some(weight) = self.weights.next() else { break };
            if weight > 0.0 {
                self.possible = self.n_added;
            }
            self.n_added += 1;
            self.cumulative += weight * self.scale;
        }
        self.possible
    }
}

/// Hands `n` independent uniform numbers to `visit` in rising order, without storing them: normalised sums of
/// exponential spacings `[Devroye1986]` chapter V. The stream is read twice, from a copy of the generator first.
fn for_each_sorted_uniform(n: usize, rng: &mut ParticleRng, mut visit: impl FnMut(usize, f64)) {
    let spacing = |rng: &mut ParticleRng| -rng.uniform().ln();
    let mut ahead = rng.clone();
    let mut total = 0.0;
    for _ in 0..=n {
        total += spacing(&mut ahead);
    }
    let mut sum = 0.0;
    for place in 0..n {
        sum += spacing(rng);
        visit(place, sum / total);
    }
    *rng = ahead;
}
