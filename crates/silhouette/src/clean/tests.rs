use proptest::prelude::*;

use super::*;
use crate::mask::Mask;

fn any_mask() -> impl Strategy<Value = Mask> {
    (1u32..140, 1u32..20, 0.05..0.95f64).prop_flat_map(|(width, height, density)| {
        prop::collection::vec(prop::bool::weighted(density), (width * height) as usize)
            .prop_map(move |pixels| Mask::from_bools(width, height, &pixels))
    })
}

fn any_window() -> impl Strategy<Value = Window> {
    (0u32..70, 0u32..70, 0u32..6, 0u32..6).prop_map(|(left, right, up, down)| Window {
        left,
        right,
        up,
        down,
    })
}

/// Dilation pixel by pixel.
fn plain_dilation(mask: &Mask, window: Window) -> Mask {
    let [left, right, up, down] = [window.left, window.right, window.up, window.down].map(i64::from);
    Mask::from_fn(mask.width(), mask.height(), |x, y| {
        (-up..=down)
            .any(|dy| (-left..=right).any(|dx| mask.get_or_background(i64::from(x) + dx, i64::from(y) + dy)))
    })
}

/// Pixels reached from `seeds` over neighbours for which `is_open` holds.
fn flood(
    width: u32,
    height: u32,
    seeds: Vec<(u32, u32)>,
    corners: bool,
    is_open: impl Fn(u32, u32) -> bool,
) -> Mask {
    let mut reached = Mask::new(width, height);
    let mut stack = seeds;
    while let Some((x, y)) = stack.pop() {
        if !is_open(x, y) || reached.get(x, y) {
            continue;
        }
        reached.set(x, y, true);
        for (dx, dy) in (-1i64..=1).flat_map(|dy| (-1i64..=1).map(move |dx| (dx, dy))) {
            let (next_x, next_y) = (i64::from(x) + dx, i64::from(y) + dy);
            let inside = (0..i64::from(width)).contains(&next_x) && (0..i64::from(height)).contains(&next_y);
            if inside && (corners || dx * dy == 0) {
                stack.push((next_x as u32, next_y as u32));
            }
        }
    }
    reached
}

proptest! {
    #[test]
    fn morphology_is_that_of_single_pixels(mask in any_mask(), window in any_window()) {
        prop_assert_eq!(mask.dilated(window), plain_dilation(&mask, window));
        let by_duality = plain_dilation(&mask.complement(), window).complement();
        prop_assert_eq!(mask.eroded(window), by_duality);
    }

    #[test]
    fn opening_and_closing_settle(mask in any_mask(), side in 1u32..7) {
        let (opened, closed) = (mask.opened(side), mask.closed(side));
        prop_assert_eq!(mask.overlap(&opened).both, opened.area(), "opening added a pixel");
        prop_assert_eq!(mask.overlap(&closed).both, mask.area(), "closing took a pixel");
        prop_assert_eq!(&opened.opened(side), &opened);
        prop_assert_eq!(&closed.closed(side), &closed);
    }

    #[test]
    fn components_are_those_of_a_flood_fill(mask in any_mask(), eight in any::<bool>()) {
        let connectivity = if eight { Connectivity::Eight } else { Connectivity::Four };
        let components = Components::of(&mask, connectivity);
        let mut rest = mask.clone();
        for (index, component) in components.all().iter().enumerate() {
            let piece = components.select(|other| other == index);
            let row = (0..rest.height()).find(|&y| rest.runs(y).next().is_some()).unwrap();
            let (x, _) = rest.runs(row).next().unwrap();
            let expected = flood(mask.width(), mask.height(), vec![(x, row)], eight, |x, y| mask.get(x, y));
            prop_assert_eq!(&piece, &expected, "component {} in the order of first pixels", index);
            prop_assert_eq!(component.area, piece.area());
            prop_assert_eq!(Some(component.bounding_box), piece.bounding_box());
            rest.subtract(&piece);
        }
        prop_assert!(rest.is_empty());
        let areas = components.overlap_areas(&mask);
        prop_assert!(areas.iter().zip(components.all()).all(|(&area, component)| area == component.area));
    }

    #[test]
    fn holes_are_what_a_flood_from_the_border_leaves(mask in any_mask()) {
        let (width, height) = (mask.width(), mask.height());
        let border = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)))
            .filter(|&(x, y)| x == 0 || y == 0 || x + 1 == width || y + 1 == height)
            .collect();
        let outside = flood(width, height, border, false, |x, y| !mask.get(x, y));
        prop_assert_eq!(mask.with_holes_filled(u64::MAX), outside.complement());
    }
}

#[test]
fn only_small_holes_are_filled() {
    let mask: Mask = "#######\n#.#..##\n###..##\n#######".parse().unwrap();
    assert_eq!(mask.with_holes_filled(1).to_string(), "#######\n###..##\n###..##\n#######\n");
    assert_eq!(mask.with_holes_filled(0), mask);
}

/// A body of 10 x 40 pixels at `x`, a forearm cut off it, a rival of 12 x 50 far away and a speck.
fn scene(x: u32, with_person: bool) -> Mask {
    Mask::from_fn(200, 80, |px, py| {
        let inside =
            |x0: u32, y0: u32, w: u32, h: u32| (x0..x0 + w).contains(&px) && (y0..y0 + h).contains(&py);
        let person = inside(x, 20, 10, 40) || inside(x + 11, 30, 8, 3);
        person && with_person || inside(170, 20, 12, 50) || inside(100, 5, 1, 1)
    })
}

#[test]
fn person_is_followed_past_a_larger_rival() {
    let mut tracker = PersonTracker::new(PersonTrackerConfig::default());
    let alone = Mask::from_fn(200, 80, |x, y| (20..30).contains(&x) && (20..60).contains(&y));
    assert_eq!(tracker.follow(&alone), alone);
    for x in (22..130).step_by(4) {
        let person = tracker.follow(&scene(x, true));
        assert_eq!(person.area(), 400 + 24, "body and forearm, neither rival nor speck, at {x}");
        assert_eq!(person.bounding_box().map(|rect| rect.x0), Some(x));
    }
}

#[test]
fn absence_is_an_empty_mask_and_is_forgotten() {
    let config = PersonTrackerConfig { forget_after: 3, minimum_share: 0.01, ..Default::default() };
    let mut tracker = PersonTracker::new(config);
    let nobody = Mask::new(200, 80);
    assert!(tracker.follow(&nobody).is_empty());
    assert_eq!(tracker.follow(&scene(40, false)).area(), 600, "the largest piece begins");
    for missed in 0..3 {
        assert!(tracker.previous().is_some(), "{missed} frames missed");
        assert!(tracker.follow(&nobody).is_empty());
    }
    assert!(tracker.previous().is_none());
}
