//! The scorer that runs on the processor: exact, in eight lanes.

mod target;

use crate::camera::Intrinsics;
use crate::exact::SpanFiller;
use crate::project::Projector;
use crate::rows::{RowStep, ScanLines};
use crate::scorer::{MaskView, MeshBatch, OverlapCounts, ScoreError, SilhouetteScorer, TargetError};
use crate::topology::Topology;
use target::{Target, pixels_before};

/// Counts overlaps on the processor.
#[derive(Clone, Debug)]
pub struct CpuScorer {
    target: Option<(Target, Projector)>,
    row_step: RowStep,
    topology: Topology,
    filler: SpanFiller,
}

impl Default for CpuScorer {
    fn default() -> Self {
        Self::new()
    }
}

impl CpuScorer {
    /// A scorer that works on the calling thread.
    pub fn new() -> Self {
        Self {
            target: None,
            row_step: RowStep::EVERY,
            topology: Topology::default(),
            filler: SpanFiller::default(),
        }
    }
}

impl SilhouetteScorer for CpuScorer {
    fn set_target(&mut self, mask: &MaskView<'_>, camera: &Intrinsics) -> Result<(), TargetError> {
        camera.check()?;
        let sizes = [[mask.width, mask.height], [camera.width, camera.height]];
        if sizes[0] != sizes[1] {
            return Err(TargetError::Size {
                mask: sizes[0],
                camera: sizes[1],
            });
        }
        let mut target = self.target.take().map(|(target, _)| target).unwrap_or_default();
        target.set(mask);
        self.target = Some((target, Projector::new(camera)));
        Ok(())
    }

    fn set_row_step(&mut self, step: RowStep) {
        self.row_step = step;
    }

    fn score(&mut self, batch: &MeshBatch<'_>, out: &mut [OverlapCounts]) -> Result<(), ScoreError> {
        let n_meshes = batch.n_meshes();
        assert_eq!(
            out.len(),
            n_meshes,
            "{} slots for the counts of {n_meshes} meshes",
            out.len()
        );
        let Some((target, projector)) = &self.target else {
            return Err(ScoreError::NoTarget);
        };
        if !self.topology.is_of(batch.triangles, batch.vertices_per_mesh) {
            self.topology = Topology::new(batch.triangles, batch.vertices_per_mesh)?;
        }
        let lines = ScanLines::new(target.height, self.row_step, projector.origin[1]);
        let observed = target.observed(self.row_step);
        let step = self.row_step.get() as usize;
        let meshes = batch
            .positions_camera
            .chunks_exact(batch.vertices_per_mesh.max(1));
        for (mesh, (positions, counts)) in meshes.zip(out).enumerate() {
            *counts = OverlapCounts {
                rendered: 0,
                observed,
                both: 0,
            };
            self.filler
                .spans(
                    projector,
                    &lines,
                    target.width,
                    positions,
                    batch.triangles,
                    |span| {
                        let row = target.row(span.line * step + step / 2);
                        counts.rendered += span.end - span.start;
                        counts.both += pixels_before(row, span.end) - pixels_before(row, span.start);
                    },
                )
                .map_err(|bad| ScoreError::NotFinite {
                    mesh,
                    vertex: bad.vertex,
                })?;
        }
        Ok(())
    }
}
