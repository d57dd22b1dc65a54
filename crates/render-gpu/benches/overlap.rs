//! Overlap counts of 200 posed bodies with one mask (job A1), on one thread and on two, on all rows and on fewer.

mod job_a1;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use job_a1::JobA1;
use render_gpu::{CpuScorer, OverlapCounts, RowStep, SilhouetteScorer};

fn overlaps(criterion: &mut Criterion) {
    let job = JobA1::load().expect("no data");
    let n = job.batch().n_meshes();
    let mut counts = vec![OverlapCounts::default(); n];
    let mut group = criterion.benchmark_group("overlap_200x1202");
    group.throughput(Throughput::Elements(n as u64));
    for (threads, step) in [(1, 1), (2, 1), (1, 2), (1, 4)] {
        let mut scorer = CpuScorer::with_threads(threads);
        scorer.set_target(&job.mask(), &job.camera).expect("the mask fits the camera");
        scorer.set_row_step(RowStep::new(step).expect("a power of two"));
        group.bench_function(format!("threads_{threads}/step_{step}"), |bencher| {
            bencher.iter(|| scorer.score(&job.batch(), &mut counts).expect("the meshes can be scored"));
        });
    }
    group.finish();
}

criterion_group!(benches, overlaps);
criterion_main!(benches);
