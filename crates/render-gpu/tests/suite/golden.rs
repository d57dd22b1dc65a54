//! Small silhouettes as text: worked out on paper from the rule of coverage.

use render_gpu::{Intrinsics, rasterize};

/// Draws triangles whose corners are given in pixels of a 12 x 6 image.
fn drawn(corners: &[[f32; 2]], triangles: &[[u32; 3]]) -> String {
    let positions: Vec<[f32; 3]> =
        corners.iter().map(|[x, y]| [(x - 6.0) / 8.0, (y - 3.0) / 8.0, 1.0]).collect();
    let image = rasterize(&positions, triangles, &Intrinsics::centred(12, 6, 8.0)).expect("it can be drawn");
    let row = |y| (0..image.width).map(|x| if image.contains(x, y) { '#' } else { '.' }).collect::<String>();
    (0..image.height).map(row).collect::<Vec<_>>().join("\n")
}

#[test]
fn centres_on_left_and_upper_edges_belong_to_the_triangle() {
    // Legs along the centres of row 1 and column 2: they count. The slanted side runs through centres too: it does not.
    let corners = [[2.5, 1.5], [6.5, 1.5], [2.5, 5.5]];
    let expected = "\
............
..####......
..###.......
..##........
..#.........
............";
    assert_eq!(drawn(&corners, &[[0, 1, 2]]), expected);
    assert_eq!(drawn(&corners, &[[2, 1, 0]]), expected, "either orientation is drawn");
}

#[test]
fn centres_on_right_and_lower_edges_do_not() {
    assert_eq!(
        drawn(&[[6.5, 1.5], [6.5, 5.5], [2.5, 5.5]], &[[0, 1, 2]]),
        "\
............
............
.....#......
....##......
...###......
............"
    );
}

#[test]
fn triangles_are_cut_at_the_image() {
    assert_eq!(
        drawn(
            &[[-20.0, 3.0], [6.0, -23.0], [6.0, 29.0], [9.0, 2.0], [40.0, 2.0], [9.0, 4.0]],
            &[[0, 1, 2], [3, 4, 5]]
        ),
        "\
######......
######......
######...###
######...###
######......
######......"
    );
}
