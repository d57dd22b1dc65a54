//! What is refused, and in what words.

use std::error::Error;

use render_gpu::conformance::{Mesh, mottled_mask};
use render_gpu::{
    CpuScorer, Intrinsics, MeshBatch, OverlapCounts, ScoreError, SilhouetteScorer, TargetError,
    TopologyError, rasterize,
};

fn ready_scorer() -> CpuScorer {
    let mut scorer = CpuScorer::new();
    let camera = Intrinsics::centred(70, 50, 60.0);
    scorer.set_target(&mottled_mask(70, 50).view(), &camera).expect("the mask fits the camera");
    scorer
}

fn score(scorer: &mut CpuScorer, mesh: &Mesh, n_meshes: usize) -> Result<Vec<OverlapCounts>, ScoreError> {
    let batch = MeshBatch {
        positions_camera: &mesh.positions.repeat(n_meshes),
        vertices_per_mesh: mesh.positions.len(),
        triangles: &mesh.triangles,
    };
    let mut counts = vec![OverlapCounts::default(); n_meshes];
    scorer.score(&batch, &mut counts).map(|()| counts)
}

/// The messages of an error and its causes.
fn text(error: &dyn Error) -> String {
    match error.source() {
        Some(cause) => format!("{error}: {}", text(cause)),
        None => error.to_string(),
    }
}

#[test]
fn a_scorer_needs_a_target() {
    let error = score(&mut CpuScorer::new(), &Mesh::cuboid([1.0; 3]), 1).expect_err("there is no target");
    assert_eq!(text(&error), "no mask to score against: `set_target` comes first");
}

#[test]
fn open_or_badly_oriented_meshes_are_refused() {
    let mut open = Mesh::cuboid([1.0; 3]);
    open.triangles.pop();
    let error = score(&mut ready_scorer(), &open, 1).expect_err("the mesh has a hole");
    assert!(matches!(error, ScoreError::Topology(TopologyError::OpenEdge { .. })), "{error}");
    assert!(text(&error).starts_with("the triangles have no well-defined silhouette: the edge from vertex"));

    let mut turned = Mesh::cuboid([1.0; 3]);
    turned.triangles[3].swap(0, 1);
    assert!(matches!(
        score(&mut ready_scorer(), &turned, 1),
        Err(ScoreError::Topology(TopologyError::OpenEdge { .. }))
    ));

    let mut stray = Mesh::cuboid([1.0; 3]);
    stray.triangles[11][2] = 8;
    assert_eq!(
        text(&score(&mut ready_scorer(), &stray, 1).expect_err("there are eight vertices")),
        "the triangles have no well-defined silhouette: triangle 11 names vertex 8, but a mesh has 8 vertices"
    );
}

#[test]
fn coordinates_that_are_not_finite_are_refused() {
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for axis in 0..3 {
            let mut scorer = CpuScorer::with_threads(3);
            scorer
                .set_target(&mottled_mask(70, 50).view(), &Intrinsics::centred(70, 50, 60.0))
                .expect("the mask fits the camera");
            let mesh = Mesh::cuboid([1.0; 3]).moved([0.0, 0.0, 2.0]);
            let mut positions = mesh.positions.repeat(40);
            positions[8 * 17 + 5][axis] = bad;
            positions[8 * 33 + 1][axis] = bad;
            let batch =
                MeshBatch { positions_camera: &positions, vertices_per_mesh: 8, triangles: &mesh.triangles };
            let error = scorer
                .score(&batch, &mut [OverlapCounts::default(); 40])
                .expect_err(&format!("{bad} at axis {axis}"));
            assert_eq!(error, ScoreError::NotFinite { mesh: 17, vertex: 5 });
            // The next batch is scored as ever.
            assert!(score(&mut scorer, &mesh, 2).is_ok());
        }
    }
}

#[test]
fn targets_must_fit_their_camera() {
    let mut scorer = ready_scorer();
    let before = score(&mut scorer, &Mesh::cuboid([1.0; 3]).moved([0.0, 0.0, 2.0]), 1);
    let mask = mottled_mask(70, 50);
    let camera = Intrinsics::centred(70, 50, 60.0);
    let mut refuse =
        |camera: Intrinsics| text(&scorer.set_target(&mask.view(), &camera).expect_err("it cannot be used"));
    assert_eq!(
        refuse(Intrinsics { width: 71, ..camera }),
        "the mask is 70 x 50 px, expected 71 x 50 px as the image of the camera"
    );
    assert_eq!(
        refuse(Intrinsics { height: 40_000, ..camera }),
        "the camera cannot be used: the image is 70 x 40000 px, expected sides of 1 to 32767 px"
    );
    assert_eq!(
        refuse(Intrinsics { focal_px: [0.0, 60.0], ..camera }),
        "the camera cannot be used: `focal_px` is [0.0, 60.0], expected two positive numbers"
    );
    assert_eq!(
        refuse(Intrinsics { principal_point_px: [f64::NAN, 0.0], ..camera }),
        "the camera cannot be used: `principal_point_px` is [NaN, 0.0], expected two finite numbers"
    );
    assert_eq!(
        refuse(Intrinsics { distortion: [0.0, f64::INFINITY, 0.0, 0.0, 0.0], ..camera }),
        "the camera cannot be used: `distortion` is [0.0, inf, 0.0, 0.0, 0.0], expected five finite numbers"
    );
    // The old target is still there.
    assert_eq!(score(&mut scorer, &Mesh::cuboid([1.0; 3]).moved([0.0, 0.0, 2.0]), 1), before);
    assert!(matches!(
        scorer.set_target(&mask.view(), &Intrinsics { width: 0, ..camera }),
        Err(TargetError::Camera(_))
    ));
}

#[test]
#[should_panic(expected = "1 slots for the counts of 2 meshes")]
fn every_mesh_needs_a_slot() {
    let mesh = Mesh::cuboid([1.0; 3]);
    let positions = mesh.positions.repeat(2);
    let batch = MeshBatch { positions_camera: &positions, vertices_per_mesh: 8, triangles: &mesh.triangles };
    let _ = ready_scorer().score(&batch, &mut [OverlapCounts::default()]);
}

#[test]
#[should_panic(expected = "9 positions are not a whole number of meshes of 8 vertices")]
fn meshes_must_be_whole() {
    let mesh = Mesh::cuboid([1.0; 3]);
    MeshBatch { positions_camera: &[[0.0; 3]; 9], vertices_per_mesh: 8, triangles: &mesh.triangles }
        .n_meshes();
}

#[test]
fn drawing_refuses_stray_triangles() {
    let error =
        rasterize(&[[0.0; 3]; 2], &[[0, 1, 2]], &Intrinsics::centred(8, 8, 8.0)).expect_err("two vertices");
    assert_eq!(
        text(&error),
        "the triangles do not fit the vertices: triangle 0 names vertex 2, but a mesh has 2 vertices"
    );
}
