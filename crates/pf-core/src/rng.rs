//! Random numbers by address: every draw follows from (seed, frame, layer, purpose, particle) and from nothing else.
//!
//! The generator is Philox4x32-10 `[Salmon2011]`: a keyed bijection of a 128-bit counter. The seed is the key and the
//! rest of the address is the counter, so two addresses never share a number, a generator costs nothing to make, and
//! particles can be worked on in any order by any number of threads.
//!
//! ```text
//! counter word 0   block within the stream (32 bits: 2^34 numbers of 32 bits)
//! counter word 1   particle
//! counter word 2   frame, low 32 bits
//! counter word 3   frame, next 8 bits | purpose 8 bits | layer 16 bits
//! ```

mod normal;
mod philox;

use std::convert::Infallible;

use rand_core::TryRng;

pub use normal::standard_normal_quantile;
pub use philox::philox4x32_10;

/// Layers that an address can tell apart.
pub const MAX_LAYERS: u32 = 1 << 16;
/// Frames that an address can tell apart: 34 years at 1,000 a second.
pub const MAX_FRAMES: u64 = 1 << 40;

/// What a random number is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Purpose {
    /// Drawing the first particles.
    Initialise = 0,
    /// Drawing a particle from the proposal.
    Propose = 1,
    /// Choosing ancestors.
    Resample = 2,
    /// Moving a particle between layers.
    Mutate = 3,
    /// Accepting or refusing a move.
    Accept = 4,
    /// Anything outside the filter, so that callers never meet the filter's own numbers.
    User = 255,
}

/// The address of a set of streams, one per particle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Draw {
    /// Seed of the run.
    pub seed: u64,
    /// Frame, below [`MAX_FRAMES`].
    pub frame: u64,
    /// Annealing layer, below [`MAX_LAYERS`].
    pub layer: u32,
    /// What the numbers are for.
    pub purpose: Purpose,
}

/// The generator of one particle at one address.
///
/// # Panics
/// When the frame or the layer is beyond [`MAX_FRAMES`] or [`MAX_LAYERS`].
#[inline]
pub fn particle_rng(at: Draw, particle: u32) -> ParticleRng {
    assert!(at.frame < MAX_FRAMES, "frame {} is beyond the last one, {}", at.frame, MAX_FRAMES - 1);
    assert!(at.layer < MAX_LAYERS, "layer {} is beyond the last one, {}", at.layer, MAX_LAYERS - 1);
    let frame_low = u64::from(at.frame as u32);
    let last_word = (at.frame >> 32) << 24 | u64::from(at.purpose as u8) << 16 | u64::from(at.layer);
    ParticleRng {
        key: at.seed,
        counter: [u64::from(particle) << 32, last_word << 32 | frame_low],
        block: [0; 2],
        n_used: 4,
    }
}

/// A stream of random numbers; made by [`particle_rng`].
///
/// It is a `rand_core::Rng`, so the distributions of `rand_distr` work with it. Its own methods consume a fixed
/// number of words each, so that a stream stays in step whatever the values: [`uniform`](Self::uniform) and
/// [`standard_normal`](Self::standard_normal) take 64 bits.
///
/// ```
/// use pf_core::rng::{Draw, Purpose, particle_rng};
/// let at = Draw { seed: 7, frame: 0, layer: 0, purpose: Purpose::User };
/// let (mut first, mut again, mut other) = (particle_rng(at, 3), particle_rng(at, 3), particle_rng(at, 4));
/// let x = first.uniform();
/// assert_eq!(x, again.uniform());
/// assert_ne!(x, other.uniform());
/// ```
#[derive(Clone, Debug)]
pub struct ParticleRng {
    // Pairs of words, the first one low: what is written as a pair is read as a pair, which a processor does without
    // a detour through memory.
    key: u64,
    counter: [u64; 2],
    block: [u64; 2],
    /// Words of the block that were handed out.
    n_used: usize,
}

impl ParticleRng {
    #[inline(always)]
    fn refill(&mut self) {
        let [a, b] = self.counter.map(words);
        let [c, d, e, f] = philox4x32_10([a[0], a[1], b[0], b[1]], words(self.key));
        self.block = [pair(c, d), pair(e, f)];
        self.counter[0] = pair(a[0].wrapping_add(1), a[1]);
        self.n_used = 0;
    }

    #[inline]
    fn word(&mut self) -> u32 {
        if self.n_used == 4 {
            self.refill();
        }
        let word = words(self.block[self.n_used / 2])[self.n_used % 2];
        self.n_used += 1;
        word
    }

    /// The next two words, the first one low.
    #[inline(always)]
    fn two_words(&mut self) -> u64 {
        if self.n_used == 4 {
            self.refill();
        }
        if self.n_used % 2 == 1 {
            return pair(self.word(), self.word());
        }
        let pair = self.block[self.n_used / 2];
        self.n_used += 2;
        pair
    }

    /// A number strictly between 0 and 1, one of 2^52 equally spaced and symmetric about 1/2.
    #[inline]
    pub fn uniform(&mut self) -> f64 {
        ((self.two_words() >> 12) as f64 + 0.5) * (1.0 / (1u64 << 52) as f64)
    }

    /// A draw from the standard normal distribution, by inversion: one number in, one out.
    #[inline]
    pub fn standard_normal(&mut self) -> f64 {
        standard_normal_quantile(self.uniform())
    }

    /// Fills `out` with independent draws from the standard normal distribution.
    pub fn fill_standard_normal(&mut self, out: &mut [f64]) {
        for z in out {
            *z = self.standard_normal();
        }
    }
}

#[inline(always)]
fn words(pair: u64) -> [u32; 2] {
    [pair as u32, (pair >> 32) as u32]
}

#[inline(always)]
fn pair(low: u32, high: u32) -> u64 {
    u64::from(low) | u64::from(high) << 32
}

impl TryRng for ParticleRng {
    type Error = Infallible;

    fn try_next_u32(&mut self) -> Result<u32, Infallible> {
        Ok(self.word())
    }

    fn try_next_u64(&mut self) -> Result<u64, Infallible> {
        Ok(self.two_words())
    }

    fn try_fill_bytes(&mut self, out: &mut [u8]) -> Result<(), Infallible> {
        for chunk in out.chunks_mut(4) {
            chunk.copy_from_slice(&self.word().to_le_bytes()[..chunk.len()]);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
