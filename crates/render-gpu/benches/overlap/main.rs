//! Overlap counts of 200 posed bodies with one mask, on one thread and on two, on all rows and on fewer: job A1 of the
//! benchmark data, or bodies made of balls where that is not at hand.

mod job_a1;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use job_a1::JobA1;
use render_gpu::conformance::Mesh;
use render_gpu::{CpuScorer, Intrinsics, MeshBatch, OverlapCounts, RowStep, SilhouetteScorer, rasterize};

/// 200 bodies of 17 balls (1,258 vertices), some 350 px tall, each ball a little elsewhere in each of them.
fn ball_bodies() -> JobA1 {
    let camera = Intrinsics::centred(640, 480, 1000.0);
    let ball = Mesh::sphere(0.14, 10, 8);
    let body = |pose: usize| {
        let sway = |part: usize, phase: f32| 0.06 * (phase + (pose * part) as f32).sin();
        let parts = (0..17).map(|part| {
            let [column, row] = [part % 3, part / 3].map(|i| i as f32);
            ball.moved([0.2 * column - 0.2 + sway(part, 0.0), 0.28 * row - 0.7 + sway(part, 1.5), 5.0])
        });
        Mesh::joined(&parts.collect::<Vec<_>>())
    };
    let (observed, bodies) = (body(0), (1..=200).map(body).collect::<Vec<_>>());
    let mask = rasterize(&observed.positions, &observed.triangles, &camera).expect("the body can be drawn");
    JobA1 {
        camera,
        positions_camera: bodies.iter().flat_map(|body| body.positions.clone()).collect(),
        vertices_per_mesh: observed.positions.len(),
        triangles: observed.triangles,
        words_per_row: mask.words_per_row,
        mask_words: mask.words,
        iou_reference: Vec::new(),
    }
}

fn overlaps(criterion: &mut Criterion) {
    let (name, job) = JobA1::load().map_or_else(|| ("balls", ball_bodies()), |job| ("job_a1", job));
    let batch: MeshBatch<'_> = job.batch();
    let mut counts = vec![OverlapCounts::default(); batch.n_meshes()];
    let mut group =
        criterion.benchmark_group(format!("overlap/{name}_{}x{}", counts.len(), job.vertices_per_mesh));
    group.throughput(Throughput::Elements(counts.len() as u64));
    for (threads, step) in [(1, 1), (2, 1), (1, 2)] {
        let mut scorer = CpuScorer::with_threads(threads);
        scorer.set_target(&job.mask(), &job.camera).expect("the mask fits the camera");
        scorer.set_row_step(RowStep::new(step).expect("a power of two"));
        // Speed counts only with right answers.
        scorer.score(&batch, &mut counts).expect("the meshes can be scored");
        for (counts, iou) in counts.iter().zip(&job.iou_reference) {
            assert!(
                (counts.iou() - iou).abs() < 0.005,
                "{counts:?}, expected an intersection over union of {iou}"
            );
        }
        group.bench_function(
            BenchmarkId::new(format!("threads_{threads}"), format!("row_step_{step}")),
            |bencher| {
                bencher.iter(|| scorer.score(&batch, &mut counts).expect("the meshes can be scored"));
            },
        );
    }
    group.finish();
}

criterion_group!(benches, overlaps);
criterion_main!(benches);
