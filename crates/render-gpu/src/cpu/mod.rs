//! The scorer that runs on the processor: exact, in eight lanes.
//!
//! The silhouette of a closed mesh is where its front triangles are. Their boundary, the outline, has far fewer edges
//! than the mesh: its signed crossings with each line of pixels, sorted, say by a winding number where the silhouette
//! begins and ends, and a running count over the mask says how much of the mask lies between.

mod crossings;
mod outline;
mod sweep;
mod target;

use std::sync::Mutex;

use rayon::iter::{IndexedParallelIterator, IntoParallelRefMutIterator, ParallelIterator};

use crate::camera::Intrinsics;
use crate::clip::NotFinite;
use crate::exact::SpanFiller;
use crate::project::{Projector, SUBPIXELS};
use crate::rows::{RowStep, ScanLines};
use crate::scorer::{MaskView, MeshBatch, OverlapCounts, ScoreError, SilhouetteScorer, TargetError};
use crate::topology::Topology;
use crossings::{Crossings, TooManyCrossings};
use outline::{Bounds, LANES, Outlines};
use sweep::Sweeper;
use target::Target;

/// Counts overlaps on the processor.
///
/// It keeps its memory: after the first batch of a size it allocates no more. The edges of a mesh are worked out when
/// a batch comes with other triangles than the last one.
#[derive(Clone, Debug)]
pub struct CpuScorer {
    target: Option<(Target, Projector)>,
    row_step: RowStep,
    topology: Topology,
    sweeper: Sweeper,
    workers: Vec<Worker>,
}

impl Default for CpuScorer {
    fn default() -> Self {
        Self::new()
    }
}

impl CpuScorer {
    /// A scorer that works on the calling thread.
    pub fn new() -> Self {
        Self::with_threads(1)
    }

    /// A scorer that works on up to `threads` threads of the rayon pool it is called in; the counts do not depend on
    /// it.
    ///
    /// # Panics
    /// When `threads` is zero.
    pub fn with_threads(threads: usize) -> Self {
        assert!(threads > 0, "a scorer needs a thread");
        Self {
            target: None,
            row_step: RowStep::EVERY,
            topology: Topology::default(),
            sweeper: Sweeper::new(),
            workers: vec![Worker::default(); threads],
        }
    }
}

impl SilhouetteScorer for CpuScorer {
    fn set_target(&mut self, mask: &MaskView<'_>, camera: &Intrinsics) -> Result<(), TargetError> {
        camera.check()?;
        let (size, expected) = ([mask.width, mask.height], [camera.width, camera.height]);
        if size != expected {
            return Err(TargetError::Size { mask: size, camera: expected });
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
        assert_eq!(out.len(), n_meshes, "{} slots for the counts of {n_meshes} meshes", out.len());
        let Some((target, projector)) = &self.target else {
            return Err(ScoreError::NoTarget);
        };
        if !self.topology.is_of(batch.triangles, batch.vertices_per_mesh) {
            self.topology = Topology::new(batch.triangles, batch.vertices_per_mesh)?;
        }
        if n_meshes == 0 {
            return Ok(());
        }
        let scene = Scene {
            target,
            projector,
            topology: &self.topology,
            sweeper: &self.sweeper,
            lines: ScanLines::new(target.height, self.row_step, projector.origin[1]),
            observed: target.observed(self.row_step),
        };
        let groups =
            batch.positions_camera.chunks(LANES * batch.vertices_per_mesh).zip(out.chunks_mut(LANES));
        for worker in &mut self.workers {
            worker.bad = None;
        }
        match self.workers.as_mut_slice() {
            [worker] => groups.enumerate().for_each(|(group, (positions, out))| {
                worker.score_group(&scene, group, positions, out);
            }),
            workers => {
                let queue = Mutex::new(groups.enumerate());
                let next = || queue.lock().expect("no worker panics while it holds the queue").next();
                workers.par_iter_mut().with_max_len(1).for_each(|worker| {
                    while let Some((group, (positions, out))) = next() {
                        worker.score_group(&scene, group, positions, out);
                    }
                });
            }
        }
        match self.workers.iter().filter_map(|worker| worker.bad).min() {
            Some((mesh, vertex)) => Err(ScoreError::NotFinite { mesh, vertex }),
            None => Ok(()),
        }
    }
}

/// What all workers share while a batch is scored.
struct Scene<'a> {
    target: &'a Target,
    projector: &'a Projector,
    topology: &'a Topology,
    sweeper: &'a Sweeper,
    lines: ScanLines,
    observed: u32,
}

/// The memory of one thread.
#[derive(Clone, Debug, Default)]
struct Worker {
    outlines: Outlines,
    crossings: Crossings,
    filler: SpanFiller,
    /// The first mesh, and its first vertex, that is not finite.
    bad: Option<(usize, usize)>,
}

impl Worker {
    /// Scores up to eight meshes, the `group`-th such group of the batch.
    fn score_group(
        &mut self,
        scene: &Scene<'_>,
        group: usize,
        positions: &[[f32; 3]],
        out: &mut [OverlapCounts],
    ) {
        self.crossings.set_lines(scene.lines.n);
        self.outlines.set(scene.topology, scene.projector, positions);
        for (mesh, (counts, positions)) in
            out.iter_mut().zip(positions.chunks_exact(scene.topology.vertices_per_mesh)).enumerate()
        {
            let counted = self.outlines.bounds(mesh).and_then(|bounds| self.count(scene, mesh, bounds).ok());
            match counted.map_or_else(|| self.count_plainly(scene, positions), Ok) {
                Ok([rendered, both]) => *counts = OverlapCounts { rendered, observed: scene.observed, both },
                Err(NotFinite { vertex }) => {
                    self.bad = self.bad.into_iter().chain([(group * LANES + mesh, vertex)]).min();
                }
            }
        }
    }

    /// Pixels of the silhouette, and those of them in the mask, from the outline.
    fn count(
        &mut self,
        scene: &Scene<'_>,
        mesh: usize,
        bounds: Bounds,
    ) -> Result<[u32; 2], TooManyCrossings> {
        let Scene { target, projector, topology, ref lines, .. } = *scene;
        let range = (lines.at_or_below(bounds.low[1]), lines.at_or_below(bounds.high[1]));
        let [left, right] = [0, target.width as i32].map(|column| SUBPIXELS * (column - projector.origin[0]));
        let in_view = left <= bounds.low[0] && bounds.high[0] <= right;
        self.crossings.clear();
        self.outlines
            .for_each_edge(topology, mesh, |edge| self.crossings.add(edge, lines, projector.origin[0]));
        self.crossings.list(lines, target, range, in_view)?;
        scene.sweeper.count(&self.crossings, range)
    }

    /// The same by filling every triangle: for meshes at the near plane, far out of view or with very many layers.
    fn count_plainly(&mut self, scene: &Scene<'_>, positions: &[[f32; 3]]) -> Result<[u32; 2], NotFinite> {
        let Scene { target, projector, topology, ref lines, .. } = *scene;
        let mut counts = [0; 2];
        self.filler.spans(projector, lines, target.width, positions, &topology.triangles, |span| {
            let row = lines.row(span.line);
            counts[0] += span.end - span.start;
            counts[1] += target.before(span.end, row) - target.before(span.start, row);
        })?;
        Ok(counts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance::{Case, cases};

    /// How many meshes of a case the contour path counts, and that its counts are those of the plain path.
    fn counted_by_contour(case: &Case) -> usize {
        let mut scorer = CpuScorer::new();
        let counts = case.counts(&mut scorer).unwrap_or_else(|failure| panic!("{failure}"));
        let (target, projector) = scorer.target.as_ref().expect("the target is set");
        let scene = Scene {
            target,
            projector,
            topology: &scorer.topology,
            sweeper: &scorer.sweeper,
            lines: ScanLines::new(target.height, scorer.row_step, projector.origin[1]),
            observed: target.observed(scorer.row_step),
        };
        let worker = &mut scorer.workers[0];
        let mut by_contour = 0;
        for (mesh, counts) in case.meshes.iter().zip(counts) {
            let plain = worker.count_plainly(&scene, &mesh.positions).expect("the mesh is finite");
            assert_eq!(plain, [counts.rendered, counts.both], "{}", case.name);
            worker.outlines.set(scene.topology, projector, &mesh.positions);
            let bounds = worker.outlines.bounds(0);
            by_contour += usize::from(bounds.is_some_and(|bounds| worker.count(&scene, 0, bounds).is_ok()));
        }
        by_contour
    }

    #[test]
    fn only_odd_meshes_take_the_plain_path() {
        for case in cases() {
            let plain = match case.name {
                "behind the camera" | "around the camera" | "through the near plane" => 2,
                "far beyond the range of snapped coordinates" | "a wall from far left to far right" => 2,
                "more layers than there is room for"
                | "an image wider than the range of packed coordinates" => 1,
                _ => 0,
            };
            assert_eq!(counted_by_contour(&case), case.meshes.len() - plain, "{}", case.name);
        }
    }
}
