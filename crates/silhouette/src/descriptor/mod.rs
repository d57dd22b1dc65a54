//! Numbers that describe the shape of a mask, for regression: two rivals behind one trait.

mod codebook;
mod crop;
mod shape_context;

pub use codebook::{Codebook, CodebookConfig, CodebookError, ShapeContextHistogram};
pub use crop::{
    CROP_HEIGHT, CROP_WIDTH, CropComponents, CropComponentsConfig, CropComponentsError, FARTHEST_PX,
    crop_distances,
};
pub use shape_context::{
    ANGULAR_BINS, CONTEXT_BINS, CONTOUR_POINTS, RADIAL_BINS, ShapeContext, contour_contexts, shape_contexts,
};

use crate::mask::Mask;

/// Turns a mask into a fixed number of numbers.
///
/// Laws: the answer depends neither on where the person stands in the image (exactly) nor on the size in which he is
/// seen (up to what pixels allow); it is `None` for an empty mask and finite otherwise.
pub trait Descriptor: Send + Sync {
    /// How many numbers describe a mask.
    fn dimension(&self) -> usize;

    /// The description of `mask`, `[dimension]`; `None` when there is no person in it.
    fn describe(&self, mask: &Mask) -> Option<Vec<f64>>;
}

#[cfg(test)]
mod tests;
