//! Laws that hold for any mesh, camera and mask.

use proptest::prelude::*;
use render_gpu::conformance::{Case, Mesh, mottled_mask};
use render_gpu::{CpuScorer, Intrinsics, OverlapCounts, RowStep, Silhouette, rasterize};

/// A ball with every vertex moved at random: closed, but it crosses itself.
fn crumpled_ball() -> impl Strategy<Value = Mesh> {
    let ball = Mesh::sphere(0.5, 5, 6);
    let n = ball.positions.len();
    prop::collection::vec(prop::array::uniform3(-0.4_f32..0.4), n).prop_map(move |offsets| {
        let mut mesh = ball.clone();
        for (p, offset) in mesh.positions.iter_mut().zip(offsets) {
            *p = [0, 1, 2].map(|axis| p[axis] + offset[axis]);
        }
        mesh
    })
}

/// Small images, principal points up to one image size outside, lenses with up to moderate distortion.
fn cameras() -> impl Strategy<Value = Intrinsics> {
    let size = (1_u32..150, 1_u32..100);
    let distortion = (-0.3..0.3, -0.1..0.1, -0.01..0.01, -0.01..0.01, -0.05..0.05);
    let lens = prop_oneof![Just([0.0; 5]), distortion.prop_map(|(k1, k2, p1, p2, k3)| [k1, k2, p1, p2, k3])];
    (size, prop::array::uniform2(20.0..300.0), prop::array::uniform2(-0.5..1.5), lens).prop_map(
        |((width, height), focal_px, principal, distortion)| Intrinsics {
            focal_px,
            principal_point_px: [principal[0] * f64::from(width), principal[1] * f64::from(height)],
            distortion,
            ..Intrinsics::centred(width, height, 1.0)
        },
    )
}

/// Positions in front of, around and behind the camera.
fn places() -> impl Strategy<Value = [f32; 3]> {
    (-1.5_f32..1.5, -1.5_f32..1.5, -0.5_f32..3.0).prop_map(<[f32; 3]>::from)
}

/// A block whose silhouette is this rectangle of pixels: its far side is as much larger as it is further away. Focal
/// length 128 px and whole or half principal points make all coordinates exact.
fn block(camera: &Intrinsics, columns: [i32; 2], rows: [i32; 2]) -> Mesh {
    let mut mesh = Mesh::cuboid([2.0, 2.0, 2.0]);
    for p in &mut mesh.positions {
        let [column, row] =
            [(p[0], columns), (p[1], rows)].map(|(side, range)| range[usize::from(side > 0.0)]);
        let z = if p[2] > 0.0 { 2.0 } else { 1.0 };
        let at =
            |pixel: i32, axis: usize| (f64::from(pixel) - camera.principal_point_px[axis]) as f32 / 128.0 * z;
        *p = [at(column, 0), at(row, 1), z];
    }
    mesh
}

fn ranges() -> impl Strategy<Value = [i32; 2]> {
    (-40_i32..140, 0_i32..180).prop_map(|(start, length)| [start, start + length])
}

/// How many of the pixels `0..n` are in all ranges.
fn common(ranges: &[[i32; 2]], n: u32) -> u32 {
    (0..n as i32).filter(|pixel| ranges.iter().all(|range| (range[0]..range[1]).contains(pixel))).count()
        as u32
}

fn rectangle(width: u32, height: u32, columns: [i32; 2], rows: [i32; 2]) -> Silhouette {
    let mut mask = mottled_mask(width, height);
    mask.words.fill(0);
    for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
        let inside =
            (columns[0]..columns[1]).contains(&(x as i32)) && (rows[0]..rows[1]).contains(&(y as i32));
        mask.words[y as usize * mask.words_per_row + x as usize / 64] |= u64::from(inside) << (x % 64);
    }
    mask
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn any_mesh_is_counted_as_by_the_reference(
        mesh in crumpled_ball(),
        places in prop::collection::vec(places(), 1..4),
        camera in cameras(),
        step in 0_u32..4,
    ) {
        let case = Case {
            name: "random",
            camera,
            mask: mottled_mask(camera.width, camera.height),
            row_step: RowStep::new(1 << step).expect("a power of two"),
            meshes: places.iter().map(|&place| mesh.moved(place)).collect(),
        };
        prop_assert_eq!(case.check(&mut CpuScorer::new()), Ok(()));
    }

    #[test]
    fn a_mesh_covers_its_own_silhouette(mesh in crumpled_ball(), place in places(), camera in cameras()) {
        let mesh = mesh.moved(place);
        let mask = rasterize(&mesh.positions, &mesh.triangles, &camera).expect("the mesh can be drawn");
        let case = Case { name: "itself", camera, mask, row_step: RowStep::EVERY, meshes: vec![mesh] };
        let counts = case.counts(&mut CpuScorer::new()).expect("the mesh can be scored")[0];
        prop_assert_eq!([counts.rendered, counts.both], [counts.observed; 2]);
    }

    #[test]
    fn blocks_have_the_area_of_their_rectangle(
        (width, height) in (1_u32..120, 1_u32..120),
        columns in ranges(), rows in ranges(), mask_columns in ranges(), mask_rows in ranges(),
    ) {
        let camera = Intrinsics::centred(width, height, 128.0);
        let case = Case {
            name: "block",
            camera,
            mask: rectangle(width, height, mask_columns, mask_rows),
            row_step: RowStep::EVERY,
            meshes: vec![block(&camera, columns, rows)],
        };
        let expected = OverlapCounts {
            rendered: common(&[columns], width) * common(&[rows], height),
            observed: common(&[mask_columns], width) * common(&[mask_rows], height),
            both: common(&[columns, mask_columns], width) * common(&[rows, mask_rows], height),
        };
        prop_assert_eq!(case.counts(&mut CpuScorer::new()), Ok(vec![expected]));
    }
}

#[test]
fn a_ball_has_the_area_of_its_disc() {
    // A ball of radius r at distance d on the axis is seen as a disc of radius f r / sqrt(d² - r²).
    let camera = Intrinsics::centred(640, 480, 500.0);
    let ball = Mesh::sphere(0.6, 60, 120).moved([0.0, 0.0, 2.0]);
    let case = Case {
        name: "ball",
        camera,
        mask: mottled_mask(640, 480),
        row_step: RowStep::EVERY,
        meshes: vec![ball],
    };
    let rendered = case.counts(&mut CpuScorer::new()).expect("the ball can be scored")[0].rendered;
    let radius = 500.0 * 0.6 / (2.0_f64.powi(2) - 0.6_f64.powi(2)).sqrt();
    let area = std::f64::consts::PI * radius.powi(2);
    // The facets cut off up to 0.2 % of it.
    let share = f64::from(rendered) / area;
    assert!((0.997..1.0005).contains(&share), "{rendered} of {area:.0} pixels");
}

#[test]
fn fewer_rows_estimate_the_same_overlap() {
    let camera = Intrinsics::centred(640, 480, 500.0);
    let mask = {
        let ball = Mesh::sphere(0.6, 20, 30).moved([0.05, 0.0, 2.0]);
        rasterize(&ball.positions, &ball.triangles, &camera).expect("the ball can be drawn")
    };
    let mut scorer = CpuScorer::new();
    let mut iou = |n: u32| {
        let row_step = RowStep::new(n).expect("a power of two");
        let meshes = vec![Mesh::sphere(0.6, 20, 30).moved([0.0, 0.0, 2.0])];
        let case = Case { name: "ball", camera, mask: mask.clone(), row_step, meshes };
        let counts = case.counts(&mut scorer).expect("the ball can be scored")[0];
        (counts.iou(), counts.rendered * n)
    };
    let (exact, area) = iou(1);
    for n in [2, 4, 8] {
        let (estimate, estimated_area) = iou(n);
        assert!((estimate - exact).abs() < 2e-3, "step {n}: {estimate} for {exact}");
        assert!(estimated_area.abs_diff(area) < area / 100, "step {n}: {estimated_area} for {area}");
    }
}
