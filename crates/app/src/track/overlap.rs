//! Poses of one body laid over a mask: the join of the body model and the silhouette scorer.

use std::sync::Arc;

use body::skin::LANES;
use body::{Body, Camera, Pose};
use rayon::prelude::*;
use render_gpu::{
    CpuScorer, MaskView, MeshBatch, OverlapCounts, RowStep, ScoreError, SilhouetteScorer, TargetError,
};
use silhouette::Mask;

/// Every second row is scored: at working resolution that changes the intersection over union by 0.0003 (root mean
/// square) and nearly halves the work.
const SCORED_ROWS: u32 = 2;

/// Counts how far the silhouettes of a posed body overlap a mask. Buffers live across calls.
pub struct BodyOverlap {
    body: Arc<Body>,
    camera: Camera,
    scorer: CpuScorer,
    positions_camera: Vec<[f32; 3]>,
    counts: Vec<OverlapCounts>,
}

impl BodyOverlap {
    /// Overlaps of `body` as `camera` sees it.
    pub fn new(body: Arc<Body>, camera: Camera) -> Self {
        let mut scorer = CpuScorer::with_threads(rayon::current_num_threads());
        scorer.set_row_step(RowStep::new(SCORED_ROWS).expect("it is a power of two"));
        Self { body, camera, scorer, positions_camera: Vec::new(), counts: Vec::new() }
    }

    /// The body that is posed.
    pub fn body(&self) -> &Body {
        &self.body
    }

    /// The camera that sees it.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Takes the mask that the next counts are about.
    ///
    /// # Errors
    /// When the mask has another size than the image of the camera.
    pub fn set_mask(&mut self, mask: &Mask) -> Result<(), TargetError> {
        self.scorer.set_target(&scorer_mask(mask), &scorer_intrinsics(self.camera.intrinsics()))
    }

    /// The counts of each pose, `[n_poses]`.
    ///
    /// # Errors
    /// When no mask was set, or a pose is not finite.
    pub fn counts(&mut self, poses: &[Pose]) -> Result<&[OverlapCounts], ScoreError> {
        let body = &*self.body;
        let vertices_per_mesh = body.n_vertices();
        self.positions_camera.resize(poses.len() * vertices_per_mesh, [0.0; 3]);
        let camera_from_world = self.camera.camera_from_world();
        self.positions_camera
            .par_chunks_mut(LANES * vertices_per_mesh)
            .zip(poses.par_chunks(LANES))
            .for_each(|(positions, poses)| body.skin_batch_into(&camera_from_world, poses, positions));
        self.counts.resize(poses.len(), OverlapCounts::default());
        let batch = MeshBatch {
            positions_camera: &self.positions_camera,
            vertices_per_mesh,
            triangles: body.triangles(),
        };
        self.scorer.score(&batch, &mut self.counts)?;
        Ok(&self.counts)
    }
}

/// The same mask in the scorer's type.
pub fn scorer_mask(mask: &Mask) -> MaskView<'_> {
    MaskView {
        width: mask.width(),
        height: mask.height(),
        words_per_row: mask.words_per_row(),
        words: mask.words(),
    }
}

/// The same camera in the scorer's type.
pub fn scorer_intrinsics(intrinsics: &body::Intrinsics) -> render_gpu::Intrinsics {
    render_gpu::Intrinsics {
        width: intrinsics.width,
        height: intrinsics.height,
        focal_px: intrinsics.focal_px,
        principal_point_px: intrinsics.principal_point_px,
        distortion: intrinsics.distortion,
    }
}
