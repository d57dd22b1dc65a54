//! Random numbers with an address: one stream per seed and purpose.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::density::draw;

/// What a stream of random numbers is for; streams of two purposes have nothing in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Purpose {
    /// First centres of a k-means clustering.
    KMeans = 1,
    /// First responsibilities of a mixture of experts.
    Experts = 2,
    /// Which samples a cross-validation holds out.
    CrossValidation = 3,
    /// First components of a mixture of normal distributions.
    Components = 4,
    /// Which samples may carry a basis.
    Centres = 5,
}

/// The generator for a seed and a purpose.
pub fn stream(seed: u64, purpose: Purpose) -> ChaCha8Rng {
    let mut key = [0u8; 32];
    key[..8].copy_from_slice(&seed.to_le_bytes());
    key[8..12].copy_from_slice(&(purpose as u32).to_le_bytes());
    ChaCha8Rng::from_seed(key)
}

/// At most `limit` of `n` rows, in rising order, drawn without bias.
pub(crate) fn some_rows(n: usize, limit: usize, seed: u64) -> Vec<usize> {
    let mut rows: Vec<usize> = (0..n).collect();
    if n > limit {
        let mut rng = stream(seed, Purpose::Centres);
        for i in 0..limit {
            let j = i + draw(&vec![0.0; n - i], &mut rng);
            rows.swap(i, j);
        }
        rows.truncate(limit);
        rows.sort_unstable();
    }
    rows
}

#[cfg(test)]
mod tests {
    use rand::Rng;

    use super::*;

    #[test]
    fn first_numbers_stay_what_they_are() {
        let mut rng = stream(1, Purpose::KMeans);
        assert_eq!([rng.next_u32(), rng.next_u32()], [1_489_600_331, 1_011_583_306]);
        assert_ne!(stream(1, Purpose::Experts).next_u32(), stream(1, Purpose::KMeans).next_u32());
    }
}
