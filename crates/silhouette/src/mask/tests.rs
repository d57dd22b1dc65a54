use proptest::prelude::*;

use super::*;

fn any_mask() -> impl Strategy<Value = Mask> {
    (1u32..150, 1u32..12, 0.0..1.0f64).prop_flat_map(|(width, height, density)| {
        prop::collection::vec(prop::bool::weighted(density), (width * height) as usize)
            .prop_map(move |pixels| Mask::from_bools(width, height, &pixels))
    })
}

/// Pixels as plain booleans, the form in which the oracles count.
fn pixels(mask: &Mask) -> Vec<bool> {
    (0..mask.height())
        .flat_map(|y| (0..mask.width()).map(move |x| (x, y)))
        .map(|(x, y)| mask.get(x, y))
        .collect()
}

#[test]
fn text_round_trip_and_layout() {
    let mask: Mask = "#...#\n.....\n..##.\n".parse().unwrap();
    assert_eq!(mask.to_string(), "#...#\n.....\n..##.\n");
    assert_eq!(mask.words(), &[0b10001, 0, 0b01100]);
    let wide = Mask::from_fn(70, 2, |x, y| x == 64 && y == 1);
    assert_eq!((wide.words_per_row(), wide.words()), (2, &[0u64, 0, 0, 1][..]));
}

#[test]
fn text_errors_name_row_and_column() {
    let message = |text: &str| text.parse::<Mask>().unwrap_err().to_string();
    assert_eq!(message("..\n.x"), "row 1: column 1 is `x`, expected `#` or `.`");
    assert_eq!(message("..\n..."), "row 1 has 3 columns, expected 2 as in row 0");
}

#[test]
fn empty_masks_are_values() {
    for mask in [Mask::new(0, 0), Mask::new(5, 0), Mask::new(0, 5), Mask::new(70, 3)] {
        assert!(mask.is_empty());
        assert_eq!((mask.area(), mask.bounding_box(), mask.centroid_px()), (0, None, None));
        assert_eq!(mask.iou(&mask.clone()), 1.0);
    }
}

#[test]
#[should_panic(expected = "masks of 3 x 2 and 2 x 3 pixels cannot be combined")]
fn sizes_must_agree() {
    Mask::new(3, 2).iou(&Mask::new(2, 3));
}

#[test]
fn known_square() {
    let mask = Mask::from_fn(200, 100, |x, y| (60..140).contains(&x) && (10..50).contains(&y));
    assert_eq!(mask.area(), 80 * 40);
    assert_eq!(mask.bounding_box(), Some(PixelRect { x0: 60, y0: 10, x1: 140, y1: 50 }));
    assert_eq!(mask.centroid_px(), Some([100.0, 30.0]));
    let shifted = Mask::from_fn(200, 100, |x, y| (80..160).contains(&x) && (10..50).contains(&y));
    assert_eq!(mask.overlap(&shifted), Overlap { first: 3200, second: 3200, both: 2400 });
    assert_eq!(mask.iou(&shifted), 2400.0 / 4000.0);
}

#[test]
fn coverage_of_half_pixels() {
    let mask: Mask = "##..\n##..\n....\n....".parse().unwrap();
    assert_eq!(mask.coverage(1, 1), vec![0.25]);
    assert_eq!(mask.coverage(2, 2), vec![1.0, 0.0, 0.0, 0.0]);
    assert_eq!(mask.coverage(2, 1), vec![0.5, 0.0]);
    let thirds = mask.coverage(3, 1);
    let expected = [0.5, 0.25, 0.0];
    assert!(thirds.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{thirds:?}");
}

proptest! {
    #[test]
    fn counts_agree_with_single_pixels(mask in any_mask()) {
        let flat = pixels(&mask);
        prop_assert_eq!(mask.area(), flat.iter().filter(|&&p| p).count() as u64);
        prop_assert_eq!(&Mask::from_bools(mask.width(), mask.height(), &flat), &mask);
        prop_assert_eq!(&Mask::from_gray8(mask.width(), mask.height(), &mask.to_gray8(), 128), &mask);
        prop_assert_eq!(&Mask::from_words(mask.width(), mask.height(), mask.words().to_vec()), &mask);
        prop_assert_eq!(&mask.to_string().parse::<Mask>().unwrap(), &mask);
        prop_assert_eq!(&mask.mirrored().mirrored(), &mask);
        prop_assert_eq!(mask.complement().area() + mask.area(), u64::from(mask.width() * mask.height()));
    }

    #[test]
    fn runs_and_prefix_counts_describe_rows(mask in any_mask()) {
        let prefix = mask.row_prefix();
        for y in 0..mask.height() {
            let mut row = vec![false; mask.width() as usize];
            let mut last_end = None;
            for (x0, x1) in mask.runs(y) {
                prop_assert!(x0 < x1 && last_end.is_none_or(|end| end < x0));
                prop_assert_eq!(prefix.count(y, x0, x1), x1 - x0);
                row[x0 as usize..x1 as usize].fill(true);
                last_end = Some(x1);
            }
            for (x, &person) in row.iter().enumerate() {
                prop_assert_eq!(person, mask.get(x as u32, y));
                let left = row[..x].iter().filter(|&&p| p).count() as u32;
                prop_assert_eq!(prefix.row(y)[x], left);
            }
        }
    }

    #[test]
    fn box_is_tight(mask in any_mask()) {
        let inside: Vec<(u32, u32)> = (0..mask.height())
            .flat_map(|y| (0..mask.width()).map(move |x| (x, y)))
            .filter(|&(x, y)| mask.get(x, y))
            .collect();
        let expected = inside.first().map(|_| PixelRect {
            x0: inside.iter().map(|p| p.0).min().unwrap(),
            y0: inside.iter().map(|p| p.1).min().unwrap(),
            x1: inside.iter().map(|p| p.0).max().unwrap() + 1,
            y1: inside.iter().map(|p| p.1).max().unwrap() + 1,
        });
        prop_assert_eq!(mask.bounding_box(), expected);
    }

    #[test]
    fn crop_takes_the_named_pixels(mask in any_mask(), x0 in 0u32..160, y0 in 0u32..14, w in 0u32..100, h in 0u32..14) {
        let cut = mask.crop(PixelRect { x0, y0, x1: x0 + w, y1: y0 + h });
        prop_assert_eq!((cut.width(), cut.height()), (w, h));
        for (x, y) in (0..h).flat_map(|y| (0..w).map(move |x| (x, y))) {
            prop_assert_eq!(cut.get(x, y), mask.get_or_background(i64::from(x + x0), i64::from(y + y0)));
        }
        prop_assert_eq!(cut.area(), pixels(&cut).iter().filter(|&&p| p).count() as u64);
    }

    #[test]
    fn sizes_change_by_area_majority(mask in any_mask(), factor in 1u32..5) {
        let large = mask.enlarged(factor);
        prop_assert_eq!(&large.reduced(factor), &mask);
        prop_assert_eq!(&large.resized(mask.width(), mask.height()), &mask);
        prop_assert_eq!(large.area(), mask.area() * u64::from(factor * factor));
        let total: f32 = mask.coverage(17, 5).iter().sum();
        let expected = mask.area() as f32 / (mask.width() * mask.height()) as f32 * 85.0;
        prop_assert!((total - expected).abs() < 1e-2, "{} {}", total, expected);
    }

    #[test]
    fn set_algebra(mask in any_mask(), salt in any::<u64>()) {
        let other = Mask::from_fn(mask.width(), mask.height(), |x, y| (salt >> ((x * 7 + y * 13) % 64)) & 1 == 1);
        let counts = mask.overlap(&other);
        let combined = |combine: fn(&mut Mask, &Mask)| {
            let mut result = mask.clone();
            combine(&mut result, &other);
            result.area()
        };
        prop_assert_eq!(combined(Mask::union_with), counts.either());
        prop_assert_eq!(combined(Mask::intersect_with), counts.both);
        prop_assert_eq!(combined(Mask::subtract), counts.first - counts.both);
    }
}
