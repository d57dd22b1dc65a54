//! The 200 posed bodies of the benchmark data: equal counts, and the intersection over union of an outside rasteriser.

use crate::data::JobA1;
use render_gpu::{CpuScorer, OverlapCounts, ReferenceScorer, SilhouetteScorer};

fn counts(scorer: &mut dyn SilhouetteScorer, job: &JobA1) -> Vec<OverlapCounts> {
    let mut counts = vec![OverlapCounts::default(); job.batch().n_meshes()];
    scorer.set_target(&job.mask(), &job.camera).expect("the mask fits the camera");
    scorer.score(&job.batch(), &mut counts).expect("the meshes can be scored");
    counts
}

#[test]
fn all_bodies_agree_with_the_references() {
    let Some(job) = JobA1::load() else {
        assert!(
            std::env::var_os("UMBRA_REQUIRE_DATA").is_none(),
            "UMBRA_REQUIRE_DATA is set, but there is no data folder"
        );
        println!("SKIPPED: no data folder");
        return;
    };
    let counts_cpu = counts(&mut CpuScorer::new(), &job);
    assert_eq!(counts_cpu, counts(&mut ReferenceScorer::default(), &job));
    let worst = counts_cpu
        .iter()
        .zip(&job.iou_reference)
        .map(|(counts, iou)| (counts.iou() - iou).abs())
        .fold(0.0, f64::max);
    println!("largest difference of the intersection over union: {worst:.1e}");
    // Snapping moves an outline by at most 1/32 px.
    assert!(worst < 5e-4, "{worst}");
}
