//! Pictures of a tracked body: shaded over the frame, with outlines and skeleton, and a strip of such pictures; charts.
//!
//! Everything here takes plain slices in pixels and metres and knows nothing of cameras, poses or files.

mod canvas;
mod chart;
mod filmstrip;
mod outline;
mod overlay;
mod raster;

pub use canvas::Canvas;
pub use chart::{Chart, Marks, Series};
pub use filmstrip::{Filmstrip, StripFrame};
pub use outline::{Outline, outlines};
pub use overlay::{Overlay, OverlayScene, paint_overlay};
pub use raster::SeenMesh;

/// Colour of the mask's outline.
pub const MASK_COLOR: [u8; 3] = [64, 220, 255];
/// Colour of the body's outline.
pub const BODY_OUTLINE_COLOR: [u8; 3] = [255, 255, 255];
/// Colour of bones and joints.
pub const BONE_COLOR: [u8; 3] = [28, 32, 48];
