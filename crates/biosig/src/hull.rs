//! Convex hulls of points in a plane.

/// The convex hull of `points`, counter-clockwise, by Andrew's monotone chain (`[Andrew1979]`); corners only. `points` end
/// up sorted. Fewer than three points that are not in a line come back as they are, without repeats.
pub(crate) fn convex_hull(points: &mut Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    if points.len() < 3 {
        return points.clone();
    }
    let mut hull = half_hull(points.iter());
    let upper = half_hull(points.iter().rev());
    // Each half ends where the other begins.
    hull.pop();
    hull.extend_from_slice(&upper[..upper.len() - 1]);
    hull
}

/// The chain that turns left all the way from the first point to the last one.
fn half_hull<'a>(points: impl Iterator<Item = &'a [f64; 2]>) -> Vec<[f64; 2]> {
    let mut chain: Vec<[f64; 2]> = Vec::new();
    for &point in points {
        while let [.., a, b] = chain[..] {
            if turn(a, b, point) > 0.0 {
                break;
            }
            chain.pop();
        }
        chain.push(point);
    }
    chain
}

/// Twice the signed area of the triangle: positive when the way from `a` over `b` to `c` turns left.
fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Length of the closed line through `corners`.
pub(crate) fn perimeter(corners: &[[f64; 2]]) -> f64 {
    let next = corners.iter().cycle().skip(1);
    corners.iter().zip(next).map(|(a, b)| (b[0] - a[0]).hypot(b[1] - a[1])).sum()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_square_with_points_inside_and_on_its_edges() {
        let mut points = vec![
            [0.0, 0.0],
            [2.0, 0.0],
            [1.0, 1.0],
            [2.0, 2.0],
            [0.0, 2.0],
            [1.0, 0.0],
            [0.3, 0.4],
            [0.0, 0.0],
        ];
        let hull = convex_hull(&mut points);
        assert_eq!(hull, [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]);
        assert_eq!(perimeter(&hull), 8.0);
    }

    #[test]
    fn degenerate_sets() {
        assert_eq!(perimeter(&convex_hull(&mut vec![])), 0.0);
        assert_eq!(perimeter(&convex_hull(&mut vec![[1.0, 2.0]; 4])), 0.0);
        let in_a_line = convex_hull(&mut (0..5).map(|k| [f64::from(k), 2.0 * f64::from(k)]).collect());
        assert_eq!(in_a_line, [[0.0, 0.0], [4.0, 8.0]]);
    }

    proptest! {
        #[test]
        fn every_point_is_inside_and_every_corner_is_a_point(
            points in proptest::collection::vec([-1.0..1.0f64, -1.0..1.0f64], 3..60),
        ) {
            let hull = convex_hull(&mut points.clone());
            for point in &points {
                for k in 0..hull.len() {
                    prop_assert!(turn(hull[k], hull[(k + 1) % hull.len()], *point) >= -1e-12);
                }
            }
            prop_assert!(hull.iter().all(|corner| points.contains(corner)));
        }
    }
}
