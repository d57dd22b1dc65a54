//! Prototypes of shape contexts, and the histogram of a mask's contexts over them `[Agarwal2006]`.

use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};

use super::Descriptor;
use super::shape_context::{CONTEXT_BINS, ShapeContext, contour_contexts};
use crate::mask::Mask;

/// Settings of the search for prototypes.
#[derive(Clone, Debug)]
pub struct CodebookConfig {
    /// Prototypes.
    pub n_prototypes: usize,
    /// At most this many contexts are looked at, drawn without replacement.
    pub n_samples: usize,
    /// At most this many rounds of k-means.
    pub n_rounds: usize,
    /// Seed of the draws.
    pub seed: u64,
}

impl Default for CodebookConfig {
    fn default() -> Self {
        Self { n_prototypes: 400, n_samples: 20_000, n_rounds: 30, seed: 0 }
    }
}

/// Why there is no codebook.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CodebookError {
    /// Fewer contexts than prototypes.
    #[error("{found} shape contexts to learn from, expected at least {expected}, one for each prototype")]
    TooFewContexts {
        /// Contexts given, or samples allowed.
        found: usize,
        /// Prototypes wanted.
        expected: usize,
    },
    /// A number that is no share.
    #[error("`prototypes[{prototype}][{bin}]` is {value}, expected a share from 0 to 1")]
    Value {
        /// Index of the prototype.
        prototype: usize,
        /// Index of its cell.
        bin: usize,
        /// The number.
        value: f32,
    },
}

/// Prototypes of shape contexts.
#[derive(Clone, Debug, PartialEq)]
pub struct Codebook {
    prototypes: Vec<ShapeContext>,
}

impl Codebook {
    /// Learns prototypes from the contexts of many masks: k-means, started by k-means++ `[Arthur2007]`.
    ///
    /// The same contexts and seed give the same bits.
    ///
    /// # Errors
    /// When there are fewer contexts than prototypes, or no prototypes are asked for.
    pub fn learn(contexts: &[ShapeContext], config: &CodebookConfig) -> Result<Self, CodebookError> {
        let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
        let samples = draw_samples(contexts, config.n_samples, &mut rng);
        if samples.len() < config.n_prototypes.max(1) {
            return Err(CodebookError::TooFewContexts {
                found: samples.len(),
                expected: config.n_prototypes.max(1),
            });
        }
        let mut prototypes = first_prototypes(&samples, config.n_prototypes, &mut rng);
        let mut nearest = vec![usize::MAX; samples.len()];
        for _ in 0..config.n_rounds {
            let mut moved = false;
            for (sample, nearest) in samples.iter().zip(&mut nearest) {
                let index = index_of_nearest(sample, &prototypes);
                moved |= std::mem::replace(nearest, index) != index;
            }
            if !moved {
                break;
            }
            move_to_means(&mut prototypes, &samples, &nearest);
        }
        Ok(Self { prototypes })
    }

    /// A codebook of known prototypes, as read from a file.
    ///
    /// # Errors
    /// When there are none, or one holds a number outside 0 to 1.
    pub fn from_prototypes(prototypes: Vec<ShapeContext>) -> Result<Self, CodebookError> {
        if prototypes.is_empty() {
            return Err(CodebookError::TooFewContexts { found: 0, expected: 1 });
        }
        for (prototype, context) in prototypes.iter().enumerate() {
            if let Some(bin) = context.iter().position(|value| !(0.0..=1.0).contains(value)) {
                return Err(CodebookError::Value { prototype, bin, value: context[bin] });
            }
        }
        Ok(Self { prototypes })
    }

    /// The prototypes, `[n_prototypes]`.
    pub fn prototypes(&self) -> &[ShapeContext] {
        &self.prototypes
    }

    /// The mean over `contexts` of their soft assignments: each is shared out over all prototypes in proportion to
    /// 1 / distance^`sharpness`. Sums to 1. A context that is a prototype goes there as a whole.
    pub fn histogram(&self, contexts: &[ShapeContext], sharpness: i32) -> Vec<f64> {
        let mut histogram = vec![0.0; self.prototypes.len()];
        let mut weights = vec![0.0; self.prototypes.len()];
        for context in contexts {
            for (squared, prototype) in weights.iter_mut().zip(&self.prototypes) {
                *squared = squared_distance(context, prototype);
            }
            shares_of_squared_distances(&mut weights, sharpness);
            let share =
                1.0 / (weights.iter().map(|&weight| f64::from(weight)).sum::<f64>() * contexts.len() as f64);
            histogram
                .iter_mut()
                .zip(&weights)
                .for_each(|(total, &weight)| *total += share * f64::from(weight));
        }
        histogram
    }
}

/// Replaces squared distances by 1 / distance^`sharpness`, relative to the nearest, so that no power overflows; where some
/// are 0, by 1 for these and 0 for the others.
fn shares_of_squared_distances(squared: &mut [f32], sharpness: i32) {
    let nearest = squared.iter().copied().fold(f32::INFINITY, f32::min);
    if nearest == 0.0 {
        squared.iter_mut().for_each(|value| *value = f32::from(u8::from(*value == 0.0)));
        return;
    }
    squared.iter_mut().for_each(|value| *value = (nearest / *value).sqrt());
    if sharpness != 1 {
        squared.iter_mut().for_each(|value| *value = value.powi(sharpness));
    }
}

/// The histogram of a mask's shape contexts over the prototypes of a codebook.
#[derive(Clone, Debug)]
pub struct ShapeContextHistogram {
    codebook: Codebook,
    sharpness: i32,
}

impl ShapeContextHistogram {
    /// Contexts are shared out by 1 / distance^`sharpness`: 1 is the paper's, 4 tells shapes better apart.
    ///
    /// # Panics
    /// When `sharpness` is below 1.
    pub fn new(codebook: Codebook, sharpness: i32) -> Self {
        assert!(sharpness >= 1, "a sharpness of {sharpness}, expected 1 or more");
        Self { codebook, sharpness }
    }

    /// The prototypes behind it.
    pub fn codebook(&self) -> &Codebook {
        &self.codebook
    }

    /// The power of the distance that contexts are shared out by.
    pub fn sharpness(&self) -> i32 {
        self.sharpness
    }
}

impl Descriptor for ShapeContextHistogram {
    fn dimension(&self) -> usize {
        self.codebook.prototypes.len()
    }

    fn describe(&self, mask: &Mask) -> Option<Vec<f64>> {
        Some(self.codebook.histogram(&contour_contexts(mask)?, self.sharpness))
    }
}

/// `count` of `contexts` drawn without replacement, or all of them.
fn draw_samples(contexts: &[ShapeContext], count: usize, rng: &mut ChaCha8Rng) -> Vec<ShapeContext> {
    let mut indices: Vec<usize> = (0..contexts.len()).collect();
    let count = count.min(contexts.len());
    for at in 0..count {
        let left = (contexts.len() - at) as f64;
        indices.swap(at, at + (uniform(rng) * left) as usize);
    }
    indices[..count].iter().map(|&index| contexts[index]).collect()
}

/// k-means++: each next prototype is a sample drawn in proportion to its squared distance from those chosen.
fn first_prototypes(samples: &[ShapeContext], count: usize, rng: &mut ChaCha8Rng) -> Vec<ShapeContext> {
    let mut prototypes = vec![samples[(uniform(rng) * samples.len() as f64) as usize]];
    let mut distances = vec![f32::INFINITY; samples.len()];
    while prototypes.len() < count {
        let latest = prototypes[prototypes.len() - 1];
        for (distance, sample) in distances.iter_mut().zip(samples) {
            *distance = distance.min(squared_distance(sample, &latest));
        }
        let mut left = uniform(rng) * distances.iter().map(|&distance| f64::from(distance)).sum::<f64>();
        let chosen = distances.iter().position(|&distance| {
            left -= f64::from(distance);
            left < 0.0
        });
        // All samples are prototypes already, or rounding ran past the end: take the one farthest away.
        let farthest =
            || (0..samples.len()).max_by(|&a, &b| distances[a].total_cmp(&distances[b])).unwrap_or(0);
        prototypes.push(samples[chosen.unwrap_or_else(farthest)]);
    }
    prototypes
}

/// Moves each prototype to the mean of the samples nearest to it; one without samples stays.
fn move_to_means(prototypes: &mut [ShapeContext], samples: &[ShapeContext], nearest: &[usize]) {
    let mut sums = vec![[0.0f64; CONTEXT_BINS]; prototypes.len()];
    let mut counts = vec![0u32; prototypes.len()];
    for (sample, &index) in samples.iter().zip(nearest) {
        counts[index] += 1;
        sums[index].iter_mut().zip(sample).for_each(|(sum, &value)| *sum += f64::from(value));
    }
    for ((prototype, sum), &count) in prototypes.iter_mut().zip(&sums).zip(&counts) {
        if count > 0 {
            prototype.iter_mut().zip(sum).for_each(|(out, sum)| *out = (sum / f64::from(count)) as f32);
        }
    }
}

fn index_of_nearest(sample: &ShapeContext, prototypes: &[ShapeContext]) -> usize {
    let mut best = (f32::INFINITY, 0);
    for (index, prototype) in prototypes.iter().enumerate() {
        let distance = squared_distance(sample, prototype);
        if distance < best.0 {
            best = (distance, index);
        }
    }
    best.1
}

/// Summed in twelve lanes, which the compiler turns into vectors; the order is fixed.
fn squared_distance(a: &ShapeContext, b: &ShapeContext) -> f32 {
    const LANES: usize = 12;
    let mut sums = [0.0f32; LANES];
    for (a, b) in a.chunks_exact(LANES).zip(b.chunks_exact(LANES)) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += (a - b) * (a - b);
        }
    }
    sums.iter().sum()
}

/// Uniform in `[0, 1)` with 53 bits.
fn uniform(rng: &mut ChaCha8Rng) -> f64 {
    (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}
