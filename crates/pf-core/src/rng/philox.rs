//! Philox4x32-10, a counter-based generator.

/// Multipliers of the two products of a round.
const MULTIPLIERS: [u32; 2] = [0xD251_1F53, 0xCD9E_8D57];
/// What is added to the key after each round: the golden ratio and √3 − 1.
const KEY_STEPS: [u32; 2] = [0x9E37_79B9, 0xBB67_AE85];
const ROUNDS: usize = 10;

/// Four random words for a counter under a key. `[Salmon2011]`; for one key a bijection of counters.
///
/// ```
/// // A known answer of the authors' Random123 library.
/// let words = pf_core::rng::philox4x32_10([0; 4], [0; 2]);
/// assert_eq!(words, [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]);
/// ```
#[inline(always)]
pub fn philox4x32_10(counter: [u32; 4], key: [u32; 2]) -> [u32; 4] {
    let (mut words, mut key) = (counter, key);
    for _ in 0..ROUNDS {
        let product_0 = u64::from(MULTIPLIERS[0]) * u64::from(words[0]);
        let product_1 = u64::from(MULTIPLIERS[1]) * u64::from(words[2]);
        words = [
            (product_1 >> 32) as u32 ^ words[1] ^ key[0],
            product_1 as u32,
            (product_0 >> 32) as u32 ^ words[3] ^ key[1],
            product_0 as u32,
        ];
        key = [key[0].wrapping_add(KEY_STEPS[0]), key[1].wrapping_add(KEY_STEPS[1])];
    }
    words
}
