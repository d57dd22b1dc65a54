//! What a scorer is given, what it gives back, and the trait that all scorers share.

use crate::camera::{CameraError, Intrinsics};
use crate::rows::RowStep;
use crate::topology::TopologyError;

/// A borrowed bit-packed mask: 1 = person.
///
/// Row `y` starts at word `y * words_per_row`; pixel `x` is bit `x % 64` of word `x / 64` of its row. Bits past
/// the width are ignored.
#[derive(Clone, Copy, Debug)]
pub struct MaskView<'a> {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Words from one row to the next, at least `width / 64` rounded up.
    pub words_per_row: usize,
    /// The bits, `[height * words_per_row]`.
    pub words: &'a [u64],
}

/// Many poses of one closed mesh.
#[derive(Clone, Copy, Debug)]
pub struct MeshBatch<'a> {
    /// Vertex positions, `[n_meshes * vertices_per_mesh]`, metres, camera frame, mesh after mesh.
    pub positions_camera: &'a [[f32; 3]],
    /// Vertices of one mesh.
    pub vertices_per_mesh: usize,
    /// Corners of each triangle, the same for all meshes. The surface must be closed and consistently oriented
    /// (several closed parts are fine, and parts may cross each other).
    pub triangles: &'a [[u32; 3]],
}

impl MeshBatch<'_> {
    /// How many meshes the batch holds.
    ///
    /// # Panics
    /// When the positions are not a whole number of meshes.
    pub fn n_meshes(&self) -> usize {
        let (n, per_mesh) = (self.positions_camera.len(), self.vertices_per_mesh);
        if n == 0 {
            return 0;
        }
        assert!(
            per_mesh > 0 && n.is_multiple_of(per_mesh),
            "{n} positions are not a whole number of meshes of {per_mesh} vertices"
        );
        n / per_mesh
    }
}

/// Pixels of a rendered silhouette, of the observed mask, and of both at once; over the rows that are scored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OverlapCounts {
    /// Pixels inside the silhouette of the mesh.
    pub rendered: u32,
    /// Pixels of the observed mask, the same for every mesh of a batch.
    pub observed: u32,
    /// Pixels inside both.
    pub both: u32,
}

impl OverlapCounts {
    /// Intersection over union, 0 when both silhouettes are empty.
    pub fn iou(&self) -> f64 {
        let union = f64::from(self.rendered) + f64::from(self.observed) - f64::from(self.both);
        if union > 0.0 { f64::from(self.both) / union } else { 0.0 }
    }
}

/// Why a mask and a camera cannot be a target.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TargetError {
    /// The camera has impossible numbers.
    #[error("the camera cannot be used")]
    Camera(#[from] CameraError),
    /// The mask has another size than the image of the camera.
    #[error("the mask is {} x {} px, expected {} x {} px as the image of the camera", mask[0], mask[1], camera[0], camera[1])]
    Size {
        /// Width and height of the mask, pixels.
        mask: [u32; 2],
        /// Width and height of the camera's image, pixels.
        camera: [u32; 2],
    },
}

/// Why a batch cannot be scored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ScoreError {
    /// [`SilhouetteScorer::set_target`] has not succeeded yet.
    #[error("no mask to score against: `set_target` comes first")]
    NoTarget,
    /// The triangles are not a closed, consistently oriented surface.
    #[error("the triangles have no well-defined silhouette")]
    Topology(#[from] TopologyError),
    /// A coordinate is NaN or infinite.
    #[error("mesh {mesh}: vertex {vertex} is not finite")]
    NotFinite {
        /// The first mesh of the batch with such a vertex.
        mesh: usize,
        /// Its first such vertex.
        vertex: usize,
    },
}

/// Counts, for each of many meshes, how far its silhouette and an observed mask overlap.
///
/// # Laws
/// - A pixel belongs to a silhouette when its centre does, after every vertex was projected, distorted and
///   rounded to 1/16 px; a centre on an edge belongs to the right and to the lower side (top-left rule).
///   Counts follow from this rule alone: every implementation gives the same ones, with any number of threads.
/// - Parts outside the image or nearer than [`NEAR_M`](crate::NEAR_M) do not count; a triangle that reaches
///   through the near plane is cut there.
/// - `both <= rendered`, `both <= observed`, and `observed` is the same for every mesh.
/// - The order of meshes, and what else is in the batch, does not matter.
///
/// The feature `conformance` exports cases that any implementation can be run against.
pub trait SilhouetteScorer {
    /// Takes the mask that later batches are compared with, and the camera that sees them.
    ///
    /// On an error the previous target stays.
    ///
    /// # Panics
    /// When the mask's words do not fit its size.
    fn set_target(&mut self, mask: &MaskView<'_>, camera: &Intrinsics) -> Result<(), TargetError>;

    /// Scores only every n-th row from now on; [`RowStep::EVERY`] at first. All three counts are then those of the
    /// scored rows, so that their ratios stay comparable: multiply by the step for an estimate of the full counts.
    fn set_row_step(&mut self, step: RowStep);

    /// Writes the counts of each mesh of `batch`. On an error `out` holds nothing of use.
    ///
    /// # Panics
    /// When `out` does not have one slot per mesh, or the positions are not a whole number of meshes.
    fn score(&mut self, batch: &MeshBatch<'_>, out: &mut [OverlapCounts]) -> Result<(), ScoreError>;
}
