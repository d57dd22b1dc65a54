//! Silhouettes of many posed triangle meshes, and how far each overlaps an observed mask.
//!
//! Give a [`SilhouetteScorer`] a mask and a camera once a frame, then batches of posed meshes: it counts, for each, the
//! pixels of its silhouette, of the mask, and of both. It knows nothing of skeletons, poses or weights.
//!
//! # Conventions
//! Vertices in metres in the camera frame (x right, y down, z forward); images in pixels, pixel centres at +0.5.
//! Vertices are rounded to 1/16 px; from there on all arithmetic is exact.
//! # Map
//! [`SilhouetteScorer`] what a scorer promises · [`CpuScorer`] on the processor · [`rasterize`] whole silhouettes
//! # Example
//! ```
//! use render_gpu::{CpuScorer, Intrinsics, MeshBatch, OverlapCounts, SilhouetteScorer, rasterize};
//!
//! // A tetrahedron two metres ahead, and the same one 5 cm to the right.
//! let tetrahedron = [[0.0, -0.4, 2.0], [0.4, 0.4, 2.0], [-0.4, 0.4, 2.0], [0.0, 0.0, 2.4]];
//! let triangles = [[0, 1, 2], [1, 0, 3], [2, 1, 3], [0, 2, 3]];
//! let positions: Vec<[f32; 3]> = [0.0, 0.05].iter().flat_map(|dx| tetrahedron.map(|[x, y, z]| [x + dx, y, z])).collect();
//!
//! let camera = Intrinsics::centred(320, 240, 300.0);
//! let observed = rasterize(&tetrahedron, &triangles, &camera)?;
//! let mut scorer = CpuScorer::new();
//! scorer.set_target(&observed.view(), &camera)?;
//! let batch = MeshBatch { positions_camera: &positions, vertices_per_mesh: 4, triangles: &triangles };
//! let mut counts = [OverlapCounts::default(); 2];
//! scorer.score(&batch, &mut counts)?;
//! assert_eq!(counts[0].iou(), 1.0);
//! assert!(0.7 < counts[1].iou() && counts[1].iou() < 0.9);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//! # References
//! `[OpenCV]`; the keys are in `docs/papers.md`.

mod camera;
mod clip;
#[cfg(any(test, feature = "conformance"))]
pub mod conformance;
mod cpu;
mod exact;
mod project;
mod raster;
#[cfg(any(test, feature = "conformance"))]
mod reference;
mod rows;
mod scorer;
mod topology;

pub use camera::{CameraError, Intrinsics, MAX_IMAGE_SIDE};
pub use cpu::CpuScorer;
pub use project::NEAR_M;
pub use raster::{RasterizeError, Silhouette, rasterize};
#[cfg(any(test, feature = "conformance"))]
pub use reference::ReferenceScorer;
pub use rows::{BadRowStep, RowStep};
pub use scorer::{MaskView, MeshBatch, OverlapCounts, ScoreError, SilhouetteScorer, TargetError};
pub use topology::TopologyError;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExamples;
