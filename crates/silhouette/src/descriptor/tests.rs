use proptest::prelude::*;

use super::*;
use crate::mask::Mask;

/// A figure of a trunk and four limbs at the given angles, `scale` pixels a unit, with its middle at `center`.
fn figure(angles: [f64; 4], scale: f64, center: [f64; 2], width: u32, height: u32) -> Mask {
    let limb = |from: [f64; 2], angle: f64, length: f64| {
        (from, [from[0] + length * angle.sin(), from[1] + length * angle.cos()])
    };
    let segments = [
        ([0.0, -4.0], [0.0, 4.0], 2.0),
        ([0.0, -7.0], [0.0, -6.0], 1.5),
        (limb([-1.5, -3.5], angles[0], 7.0).0, limb([-1.5, -3.5], angles[0], 7.0).1, 0.8),
        (limb([1.5, -3.5], angles[1], 7.0).0, limb([1.5, -3.5], angles[1], 7.0).1, 0.8),
        (limb([-1.0, 3.5], angles[2], 9.0).0, limb([-1.0, 3.5], angles[2], 9.0).1, 1.0),
        (limb([1.0, 3.5], angles[3], 9.0).0, limb([1.0, 3.5], angles[3], 9.0).1, 1.0),
    ];
    Mask::from_fn(width, height, |x, y| {
        let p = [(f64::from(x) + 0.5 - center[0]) / scale, (f64::from(y) + 0.5 - center[1]) / scale];
        segments.iter().any(|(a, b, radius)| {
            let (ab, ap) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
            let along = ((ap[0] * ab[0] + ap[1] * ab[1]) / (ab[0] * ab[0] + ab[1] * ab[1])).clamp(0.0, 1.0);
            (ap[0] - along * ab[0]).hypot(ap[1] - along * ab[1]) <= *radius
        })
    })
}

fn any_angles() -> impl Strategy<Value = [f64; 4]> {
    [-2.5..2.5f64, -2.5..2.5f64, -0.9..0.9f64, -0.9..0.9f64]
}

/// Figures that a descriptor can learn from.
fn training_figures() -> Vec<Mask> {
    let pose = |index: usize| {
        let phase = index as f64 * 0.37;
        [phase.sin() * 2.0, (1.7 * phase).cos() * 2.0, (0.9 * phase).sin() * 0.8, (1.3 * phase).cos() * 0.8]
    };
    (0..40).map(|index| figure(pose(index), 6.0, [80.0, 80.0], 160, 180)).collect()
}

fn histogram_descriptor() -> ShapeContextHistogram {
    let contexts: Vec<ShapeContext> =
        training_figures().iter().filter_map(contour_contexts).flatten().collect();
    let config = CodebookConfig { n_prototypes: 50, n_rounds: 10, ..CodebookConfig::default() };
    ShapeContextHistogram::new(Codebook::learn(&contexts, &config).unwrap(), 1)
}

fn crop_descriptor() -> CropComponents {
    let crops: Vec<Vec<f32>> = training_figures().iter().filter_map(crop_distances).collect();
    CropComponents::learn(&crops, &CropComponentsConfig { n_components: 10, seed: 0 }).unwrap()
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

/// The laws of the trait, for any implementation.
fn check_laws(
    descriptor: &dyn Descriptor,
    angles: [f64; 4],
    shift: (u32, u32),
    factor: u32,
) -> Result<(), TestCaseError> {
    let mask = figure(angles, 4.0, [60.0, 60.0], 120, 130);
    let reference = descriptor.describe(&mask).unwrap();
    prop_assert_eq!(reference.len(), descriptor.dimension());
    prop_assert!(reference.iter().all(|value| value.is_finite()));
    let moved = Mask::from_fn(320, 300, |x, y| {
        mask.get_or_background(i64::from(x) - i64::from(shift.0), i64::from(y) - i64::from(shift.1))
    });
    prop_assert_eq!(&descriptor.describe(&moved).unwrap(), &reference, "the place matters");
    // Against the yardstick of another pose, a change of size is small.
    let other = figure(angles.map(|angle| angle + 0.7), 4.0, [60.0, 60.0], 120, 130);
    let yardstick = distance(&descriptor.describe(&other).unwrap(), &reference);
    let enlarged = distance(&descriptor.describe(&mask.enlarged(factor)).unwrap(), &reference);
    prop_assert!(enlarged < 0.35 * yardstick, "enlarged {} against {}", enlarged, yardstick);
    let again = figure(angles, 9.3, [150.0, 140.0], 320, 300);
    let rendered = distance(&descriptor.describe(&again).unwrap(), &reference);
    prop_assert!(rendered < 0.5 * yardstick, "rendered {} against {}", rendered, yardstick);
    prop_assert_eq!(descriptor.describe(&Mask::new(50, 40)), None);
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn laws_of_the_histogram(angles in any_angles(), dx in 0u32..180, dy in 0u32..160, factor in 2u32..4) {
        thread_local!(static DESCRIPTOR: ShapeContextHistogram = histogram_descriptor());
        DESCRIPTOR.with(|descriptor| check_laws(descriptor, angles, (dx, dy), factor))?;
    }

    #[test]
    fn laws_of_the_components(angles in any_angles(), dx in 0u32..180, dy in 0u32..160, factor in 2u32..4) {
        thread_local!(static DESCRIPTOR: CropComponents = crop_descriptor());
        DESCRIPTOR.with(|descriptor| check_laws(descriptor, angles, (dx, dy), factor))?;
    }

    #[test]
    fn histograms_are_distributions(angles in any_angles(), sharpness in 1i32..6) {
        thread_local!(static CODEBOOK: Codebook = histogram_descriptor().codebook().clone());
        let contexts = contour_contexts(&figure(angles, 5.0, [70.0, 70.0], 150, 150)).unwrap();
        CODEBOOK.with(|codebook| {
            let histogram = codebook.histogram(&contexts, sharpness);
            prop_assert!(histogram.iter().all(|share| (0.0..=1.0).contains(share)));
            prop_assert!((histogram.iter().sum::<f64>() - 1.0).abs() < 1e-9);
            Ok(())
        })?;
    }
}

#[test]
fn points_of_a_circle_see_the_same() {
    // Every twelfth of the circle the view is the same, turned by one sector.
    const COUNT: usize = 96;
    let points: Vec<[f64; 2]> = (0..COUNT)
        .map(|index| {
            // A quarter of a step aside, so that no direction falls onto the border of a sector.
            let angle = std::f64::consts::TAU * (index as f64 + 0.25) / COUNT as f64;
            [100.0 + 40.0 * angle.cos(), 50.0 + 40.0 * angle.sin()]
        })
        .collect();
    let contexts = shape_contexts(&points);
    for (index, context) in contexts.iter().enumerate() {
        assert!(
            (context.iter().sum::<f32>() - 1.0).abs() < 1e-5,
            "nothing of a circle lies beyond 3 mean distances"
        );
        let next = &contexts[(index + COUNT / ANGULAR_BINS) % COUNT];
        for (ring, turned) in context.chunks_exact(ANGULAR_BINS).zip(next.chunks_exact(ANGULAR_BINS)) {
            for sector in 0..ANGULAR_BINS {
                assert!((ring[sector] - turned[(sector + 1) % ANGULAR_BINS]).abs() < 1e-6, "point {index}");
            }
        }
        // By rings alone all points see the same: the other points lie at chords of 2 R sin(πk/n).
        let expected = ring_shares_of_circle(COUNT);
        for (ring, expected) in context.chunks_exact(ANGULAR_BINS).zip(expected) {
            assert!((ring.iter().sum::<f32>() - expected as f32).abs() < 1e-5, "point {index}");
        }
    }
}

/// Shares of the chords of a regular polygon in the rings; their mean length is 2 R cot(π/2n) / (n − 1).
fn ring_shares_of_circle(count: usize) -> [f64; RADIAL_BINS] {
    let half_step = std::f64::consts::PI / count as f64;
    let mean = 2.0 / (half_step / 2.0).tan() / (count as f64 - 1.0);
    let edges: Vec<f64> =
        (0..=RADIAL_BINS).map(|edge| 0.125 * 24f64.powf(edge as f64 / RADIAL_BINS as f64)).collect();
    let mut shares = [0.0; RADIAL_BINS];
    for k in 1..count {
        let chord = 2.0 * (half_step * k as f64).sin() / mean;
        let ring = (1..=RADIAL_BINS).find(|&edge| chord < edges[edge]).unwrap();
        shares[ring - 1] += 1.0 / (count as f64 - 1.0);
    }
    shares
}

#[test]
fn context_of_three_points_by_hand() {
    // A right angle with legs 3 (to the right) and 4 (down): distances 3, 4, 5, mean 4.
    let contexts = shape_contexts(&[[0.0, 0.0], [3.0, 0.0], [0.0, 4.0]]);
    // Ring edges 0.125 * 24^(k/5): 0.125, 0.236, 0.446, 0.842, 1.589, 3. Distances 0.75, 1, 1.25: rings 2, 3, 3.
    let cell = |ring: usize, sector: usize| ring * ANGULAR_BINS + sector;
    assert_eq!(contexts[0][cell(2, 0)], 0.5, "3 to the right");
    assert_eq!(contexts[0][cell(3, 3)], 0.5, "4 down: a quarter turn is 3 sectors");
    assert_eq!(contexts[1][cell(2, 6)], 0.5, "3 to the left");
    // From (3, 0) to (0, 4): 126.9 degrees, sector (126.9 + 15) / 30 = 4.
    assert_eq!(contexts[1][cell(3, 4)], 0.5);
}

#[test]
fn separate_clusters_are_found() {
    // Four well separated centres with small scatter: the prototypes are the means of their samples.
    let sample = |index: usize| {
        let mut context = [0.0f32; CONTEXT_BINS];
        context[15 * (index % 4)] = 0.9;
        context[15 * (index % 4) + 1 + index / 4 % 3] = 0.1;
        context
    };
    let samples: Vec<ShapeContext> = (0..120).map(sample).collect();
    let config = CodebookConfig { n_prototypes: 4, ..CodebookConfig::default() };
    let codebook = Codebook::learn(&samples, &config).unwrap();
    for cluster in 0..4 {
        let mean = codebook.prototypes().iter().find(|prototype| prototype[15 * cluster] > 0.5).unwrap();
        assert!((mean[15 * cluster] - 0.9).abs() < 1e-6);
        assert!((1..4).all(|spread| (mean[15 * cluster + spread] - 0.1 / 3.0).abs() < 1e-6));
    }
    assert_eq!(codebook, Codebook::learn(&samples, &config).unwrap());
    let other = Codebook::learn(&samples, &CodebookConfig { seed: 7, ..config.clone() }).unwrap();
    assert_eq!(other.prototypes().len(), 4);
    let message = Codebook::learn(&samples[..3], &config).unwrap_err().to_string();
    assert_eq!(message, "3 shape contexts to learn from, expected at least 4, one for each prototype");
}

#[test]
fn assignment_by_hand() {
    let prototype = |bin: usize| {
        let mut context = [0.0f32; CONTEXT_BINS];
        context[bin] = 1.0;
        context
    };
    let codebook = Codebook::from_prototypes(vec![[0.0; CONTEXT_BINS], prototype(3)]).unwrap();
    let mut context = [0.0f32; CONTEXT_BINS];
    context[3] = 0.25;
    // Distances 0.25 and 0.75: shares 3 : 1, and 81 : 1 with the fourth power.
    let close =
        |histogram: Vec<f64>, first: f64| assert!((histogram[0] - first).abs() < 1e-6, "{histogram:?}");
    close(codebook.histogram(&[context], 1), 0.75);
    close(codebook.histogram(&[context], 4), 81.0 / 82.0);
    close(codebook.histogram(&[context, prototype(3)], 1), 0.375);
    let mut bad = prototype(0);
    bad[7] = f32::NAN;
    let message = Codebook::from_prototypes(vec![prototype(1), bad]).unwrap_err().to_string();
    assert_eq!(message, "`prototypes[1][7]` is NaN, expected a share from 0 to 1");
}

#[test]
fn components_are_those_of_the_covariance() {
    let crops: Vec<Vec<f32>> = training_figures().iter().filter_map(crop_distances).collect();
    let learned = crop_descriptor();
    let components: Vec<&[f32]> = learned.components().collect();
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
    let centered: Vec<Vec<f32>> =
        crops.iter().map(|crop| crop.iter().zip(learned.mean()).map(|(a, b)| a - b).collect()).collect();
    let mut last_variance = f64::INFINITY;
    for (index, component) in components.iter().enumerate() {
        for (other, neighbour) in components.iter().enumerate() {
            let expected = f64::from(u8::from(index == other));
            assert!((dot(component, neighbour) - expected).abs() < 1e-4);
        }
        // C v = λ v for the covariance C, up to the tail that so few rounds leave.
        let mut image = vec![0.0f32; component.len()];
        let mut variance = 0.0;
        for crop in &centered {
            let along = dot(crop, component);
            variance += along * along;
            image.iter_mut().zip(crop).for_each(|(sum, value)| *sum += along as f32 * value);
        }
        let rest: f64 = image
            .iter()
            .zip(*component)
            .map(|(a, b)| (f64::from(*a) - variance * f64::from(*b)).powi(2))
            .sum();
        assert!(rest.sqrt() < 0.02 * variance, "component {index}: {} of {variance}", rest.sqrt());
        assert!(variance <= last_variance * (1.0 + 1e-6));
        last_variance = variance;
    }
    let parts: Vec<Vec<f32>> = components.iter().map(|component| component.to_vec()).collect();
    assert_eq!(CropComponents::from_parts(learned.mean().to_vec(), &parts).unwrap(), learned);
    let message = CropComponents::from_parts(vec![0.0; 3], &parts).unwrap_err().to_string();
    assert_eq!(message, "the mean holds 3 numbers, expected 4608, the pixels of a crop");
}
