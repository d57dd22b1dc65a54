use rand_core::Rng;

use super::*;

const AT: Draw = Draw { seed: 0x0123_4567_89ab_cdef, frame: 5, layer: 3, purpose: Purpose::Mutate };

#[test]
fn philox_gives_the_known_answers_of_random123() {
    let cases = [
        ([0; 4], [0; 2], [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]),
        ([u32::MAX; 4], [u32::MAX; 2], [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]),
        (
            [0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344],
            [0xa409_3822, 0x299f_31d0],
            [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1],
        ),
    ];
    for (counter, key, words) in cases {
        assert_eq!(philox4x32_10(counter, key), words);
    }
}

/// Pinned, so that no change of the generator or of the address moves results unseen. The words are from a plain
/// Python version of Philox and of the address, the normal draw from a 40-digit root.
#[test]
fn first_numbers_of_a_stream_stay() {
    let mut rng = particle_rng(AT, 17);
    assert_eq!([(); 4].map(|()| rng.next_u32()), [1_715_458_618, 3_509_070_326, 302_519_731, 170_449_504]);
    let mut rng = particle_rng(AT, 17);
    assert_eq!(rng.uniform(), 0.817_019_102_722_269_4);
    assert!((rng.standard_normal() + 1.754_343_095_903_66).abs() < 1e-15);
}

#[test]
fn each_part_of_an_address_counts() {
    let first = |at, particle| particle_rng(at, particle).next_u64();
    let neighbours = [
        first(AT, 17),
        first(AT, 18),
        first(Draw { seed: AT.seed + 1, ..AT }, 17),
        first(Draw { seed: AT.seed ^ 1 << 63, ..AT }, 17),
        first(Draw { frame: AT.frame + 1, ..AT }, 17),
        first(Draw { frame: AT.frame + (1 << 32), ..AT }, 17),
        first(Draw { layer: AT.layer + 1, ..AT }, 17),
        first(Draw { purpose: Purpose::Accept, ..AT }, 17),
    ];
    let distinct: std::collections::BTreeSet<u64> = neighbours.into_iter().collect();
    assert_eq!(distinct.len(), neighbours.len());
}

#[test]
fn numbers_of_all_widths_come_from_one_stream_of_words() {
    let mut words = particle_rng(AT, 1);
    let words: Vec<u32> = (0..12).map(|_| words.next_u32()).collect();
    let pair = |i: usize| u64::from(words[i]) | u64::from(words[i + 1]) << 32;
    let mut mixed = particle_rng(AT, 1);
    assert_eq!(mixed.next_u64(), pair(0));
    assert_eq!(mixed.next_u32(), words[2]);
    assert_eq!(mixed.next_u64(), pair(3), "across two blocks");
    let mut bytes = [0; 6];
    mixed.fill_bytes(&mut bytes);
    assert_eq!(bytes[..4], words[5].to_le_bytes());
    assert_eq!(bytes[4..], words[6].to_le_bytes()[..2]);
    assert_eq!(mixed.next_u64(), pair(7), "across two blocks");
    assert_eq!(mixed.next_u32(), words[9]);
}

#[test]
#[should_panic(expected = "layer 65536 is beyond the last one, 65535")]
fn layers_beyond_the_address_are_refused() {
    particle_rng(Draw { layer: MAX_LAYERS, ..AT }, 0);
}

/// Oracle: roots of the distribution function in 40 digits (mpmath).
#[test]
fn quantiles_agree_with_forty_digit_roots() {
    let cases = [
        (2f64.powi(-53), -8.209_536_151_601_387),
        (1e-12, -7.034_483_825_301_132),
        (1e-5, -4.264_890_793_922_825),
        (0.01, -2.326_347_874_040_841),
        (0.0749, -1.440_238_267_527_963_7),
        (0.0751, -1.438_825_392_752_54),
        (0.3, -0.524_400_512_708_040_8),
        (0.5, 0.0),
        (0.6, 0.253_347_103_135_799_7),
        (0.925, 1.439_531_470_938_456),
        (0.9251, 1.440_238_267_527_964),
        (0.999, 3.090_232_306_167_813),
    ];
    for (probability, z) in cases {
        let off = (standard_normal_quantile(probability) - z).abs();
        assert!(off <= 1e-15 * z.abs().max(0.1), "{probability}: off by {off}");
    }
}

/// First numbers of neighbouring particles, as the filter uses them.
#[test]
fn neighbouring_streams_are_normal_and_independent() {
    const N: u32 = 200_000;
    const MAX_STANDARD_ERRORS: f64 = 4.0;
    let z: Vec<f64> = (0..N).map(|i| particle_rng(AT, i).standard_normal()).collect();
    let n = f64::from(N);
    let mean_of = |f: &dyn Fn(usize) -> f64| (0..z.len() - 1).map(f).sum::<f64>() / (n - 1.0);
    // Moment, its true value and the variance of one term.
    let moments = [
        ("mean", mean_of(&|i| z[i]), 0.0, 1.0),
        ("variance", mean_of(&|i| z[i].powi(2)), 1.0, 2.0),
        ("third", mean_of(&|i| z[i].powi(3)), 0.0, 15.0),
        ("fourth", mean_of(&|i| z[i].powi(4)), 3.0, 96.0),
        ("product of neighbours", mean_of(&|i| z[i] * z[i + 1]), 0.0, 1.0),
        ("product of squares of neighbours", mean_of(&|i| (z[i] * z[i + 1]).powi(2)), 1.0, 8.0),
    ];
    for (name, found, expected, variance) in moments {
        let off = (found - expected) / (variance / n).sqrt();
        assert!(off.abs() < MAX_STANDARD_ERRORS, "{name} is off by {off} standard errors");
    }
}
