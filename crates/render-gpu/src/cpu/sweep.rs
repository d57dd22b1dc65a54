//! Sorts the crossings of eight lines at a time and sweeps over them.

use wide::i32x8;

use super::crossings::{COLUMN_SHIFT, Crossings, LEAVES, MAX_CROSSINGS, NONE, TooManyCrossings};

/// Sorting networks for lists of any length up to [`MAX_CROSSINGS`].
#[derive(Clone, Debug)]
pub(super) struct Sweeper {
    /// `networks[n]` sorts the first n slots: which two to compare, in order.
    networks: Vec<Vec<[u8; 2]>>,
}

impl Sweeper {
    pub fn new() -> Self {
        // A network for all slots sorts n of them too if the rest are larger than all: comparisons with those do nothing.
        let full = batcher_network(MAX_CROSSINGS as u8);
        let upto = |n| full.iter().copied().filter(|&[_, high]| usize::from(high) < n).collect();
        Self { networks: (0..=MAX_CROSSINGS).map(upto).collect() }
    }

    /// The pixels inside the outline in lines `first..end`, and those of them that are in the mask.
    pub fn count(
        &self,
        crossings: &Crossings,
        (first, end): (usize, usize),
    ) -> Result<[u32; 2], TooManyCrossings> {
        let mut slots = [i32x8::ZERO; MAX_CROSSINGS];
        let (mut inside, mut in_mask) = (i32x8::ZERO, i32x8::ZERO);
        for line in (first / 8 * 8..end).step_by(8) {
            let slots = crossings.read(line, &mut slots)?;
            for &[low, high] in &self.networks[slots.len()] {
                let (a, b) = (slots[usize::from(low)], slots[usize::from(high)]);
                slots[usize::from(low)] = a.min(b);
                slots[usize::from(high)] = a.max(b);
            }
            let sums = sweep(slots);
            inside += sums.unbounded_shr_scalar(COLUMN_SHIFT);
            in_mask += sums & i32x8::splat((1 << COLUMN_SHIFT) - 1);
        }
        Ok([inside, in_mask].map(|lanes| lanes.to_array().iter().sum::<i32>() as u32))
    }
}

/// Walks along eight lines of sorted crossings. Between a crossing where the winding number leaves zero and the one
/// where it comes back lie pixels of the silhouette: the differences of their keys count them (upper half) and those
/// of them in the mask (lower half).
#[inline(always)]
fn sweep(sorted: &[i32x8]) -> i32x8 {
    let (mut winding, mut sums) = (i32x8::ZERO, i32x8::ZERO);
    for &key in sorted {
        let leaves = (key & i32x8::splat(LEAVES)).simd_eq(i32x8::splat(LEAVES)); // -1 or 0
        let counts = key & i32x8::splat(!LEAVES);
        let starts = winding.simd_eq(i32x8::ZERO) & key.simd_ne(NONE);
        winding += i32x8::ONE + leaves + leaves;
        let ends = winding.simd_eq(i32x8::ZERO);
        sums += (counts & ends) - (counts & starts);
    }
    sums
}

/// Batcher's odd-even merge sort of n = 2^t elements, `[Knuth1998]` algorithm 5.2.2M with its loops unrolled.
fn batcher_network(n: u8) -> Vec<[u8; 2]> {
    let mut network = Vec::new();
    let mut p = n / 2;
    while p > 0 {
        let (mut q, mut r, mut d) = (n / 2, 0, p);
        loop {
            network.extend((0..n - d).filter(|i| i & p == r).map(|i| [i, i + d]));
            if q == p {
                break;
            }
            (d, q, r) = (q - p, q / 2, p);
        }
        p /= 2;
    }
    network
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn networks_sort() {
        // A network that sorts all sequences of zeros and ones sorts everything ([Knuth1998] 5.3.4 theorem Z).
        let sweeper = Sweeper::new();
        for n in 0..=16 {
            for bits in 0..1_u32 << n {
                let mut sorted = bits;
                for &[low, high] in &sweeper.networks[n] {
                    let swap = sorted >> low & !(sorted >> high) & 1;
                    sorted ^= swap << low | swap << high;
                }
                let ones = bits.count_ones();
                assert_eq!(sorted, ((1 << ones) - 1) << (n as u32 - ones), "{n} slots, {bits:b}");
            }
        }
    }
}
