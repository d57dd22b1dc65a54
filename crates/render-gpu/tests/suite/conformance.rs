//! Every scorer against every case of the conformance list, and the list against planted errors.

use render_gpu::conformance::{Failure, cases, check_all};
use render_gpu::{
    CpuScorer, Intrinsics, MaskView, MeshBatch, OverlapCounts, RowStep, ScoreError, SilhouetteScorer,
    TargetError,
};

#[test]
fn cpu_scorer_conforms() {
    for threads in [1, 2, 7] {
        check_all(&mut CpuScorer::with_threads(threads)).unwrap_or_else(|failure| panic!("{failure}"));
    }
}

#[test]
fn counts_do_not_depend_on_the_rest_of_the_batch() {
    for case in cases() {
        let together = case.counts(&mut CpuScorer::new()).expect("the case can be scored");
        for (mesh, counts) in case.meshes.iter().zip(together) {
            let alone = render_gpu::conformance::Case { meshes: vec![mesh.clone()], ..case.clone() };
            assert_eq!(alone.counts(&mut CpuScorer::new()), Ok(vec![counts]), "{}", case.name);
        }
    }
}

/// Counts one pixel too many in one mesh of one size of image.
struct OffByOne(CpuScorer, bool);

impl SilhouetteScorer for OffByOne {
    fn set_target(&mut self, mask: &MaskView<'_>, camera: &Intrinsics) -> Result<(), TargetError> {
        self.1 = mask.width == 1;
        self.0.set_target(mask, camera)
    }
    fn set_row_step(&mut self, step: RowStep) {
        self.0.set_row_step(step);
    }
    fn score(&mut self, batch: &MeshBatch<'_>, out: &mut [OverlapCounts]) -> Result<(), ScoreError> {
        self.0.score(batch, out)?;
        out.iter_mut().skip(1).for_each(|counts| counts.rendered += u32::from(self.1));
        Ok(())
    }
}

#[test]
fn a_wrong_count_fails() {
    let failure = check_all(&mut OffByOne(CpuScorer::new(), false)).expect_err("one count is wrong");
    assert!(matches!(failure, Failure::Counts { case: "one pixel", mesh: 1, .. }), "{failure}");
}
