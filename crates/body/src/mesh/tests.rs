use proptest::prelude::*;

use super::*;

const TETRAHEDRON: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];

fn corner_of_unit_cube() -> Vec<DVec3> {
    vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z]
}

#[test]
fn a_flipped_triangle_is_not_closed() {
    let mut flipped = TETRAHEDRON;
    flipped[2].swap(0, 1);
    assert!(is_closed(&TETRAHEDRON) && !is_closed(&flipped));
}

#[test]
fn volume_of_a_cube_corner_is_a_sixth() {
    assert!((volume_m3(&corner_of_unit_cube(), &TETRAHEDRON) - 1.0 / 6.0).abs() < 1e-15);
}

#[test]
fn triangles_that_pass_through_each_other_cross() {
    let flat = [DVec3::ZERO, DVec3::X, DVec3::Y];
    let stab = |x: f64| [DVec3::new(x, 0.2, -1.0), DVec3::new(x, 0.2, 1.0), DVec3::new(x + 5.0, 0.2, 3.0)];
    assert!(triangles_cross(flat, stab(0.2)));
    assert!(triangles_cross(stab(0.2), flat));
    assert!(!triangles_cross(flat, stab(0.9)));
}

#[test]
fn crossing_finds_a_planted_spike() {
    let mut vertices = corner_of_unit_cube();
    let apart: Vec<DVec3> = vertices.iter().map(|&p| p + DVec3::splat(2.0)).collect();
    let mut triangles = TETRAHEDRON.to_vec();
    triangles.extend(TETRAHEDRON.map(|t| t.map(|v| v + 4)));
    vertices.extend(apart);
    assert!(crossing_triangles(&vertices, &triangles).is_empty());
    vertices[4] = DVec3::splat(0.1);
    assert!(!crossing_triangles(&vertices, &triangles).is_empty());
}

fn soup() -> impl Strategy<Value = Vec<DVec3>> {
    prop::collection::vec(prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from_array), 30..90)
}

proptest! {
    /// The nearest point is never farther than any of many points sampled on the triangles, and lies on its triangle.
    #[test]
    fn nearest_is_no_farther_than_samples(vertices in soup(), p in prop::array::uniform3(-2.0..2.0f64)) {
        let triangles: Vec<[u32; 3]> = (0..vertices.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let p = DVec3::from_array(p);
        let found = TriangleTree::new(&vertices, &triangles).nearest(p);
        prop_assert!((found.barycentric.iter().sum::<f64>() - 1.0).abs() < 1e-9);
        prop_assert!(found.barycentric.iter().all(|&weight| weight >= 0.0));
        for &triangle in &triangles {
            let [a, b, c] = corners(&vertices, triangle);
            for (i, j) in (0..=10).flat_map(|i| (0..=10 - i).map(move |j| (i, j))) {
                let (u, v) = (f64::from(i) / 10.0, f64::from(j) / 10.0);
                prop_assert!((a + (b - a) * u + (c - a) * v).distance(p) >= found.distance_m - 1e-12);
            }
        }
    }

    /// The tree finds a hit exactly when one of the triangles alone is hit.
    #[test]
    fn rays_agree_with_a_plain_loop(vertices in soup(), o in prop::array::uniform3(-2.0..2.0f64), d in prop::array::uniform3(-1.0..1.0f64)) {
        let triangles: Vec<[u32; 3]> = (0..vertices.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let (o, d) = (DVec3::from_array(o), DVec3::from_array(d));
        let plain = triangles.iter().any(|&t| tree::ray_hit(o, d, corners(&vertices, t)).is_some_and(|s| s > 0.01));
        prop_assert_eq!(TriangleTree::new(&vertices, &triangles).is_hit(o, d, 0.01), plain);
    }
}
