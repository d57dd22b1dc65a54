//! The whole road from a frame to a mask of the person.

mod appearance;
mod evidence;
mod ghost;
mod outline;
mod segmenter;
mod smooth;

pub use evidence::EvidenceConfig;
pub use segmenter::{
    Diagnostics, SegmentError, Segmentation, Segmenter, SegmenterConfig, SegmenterParams,
    SegmenterParamsError,
};
pub use smooth::SmoothingConfig;

/// Scores are cut at this many standard deviations on either side of the threshold: how sure one pixel can be.
pub(crate) const SCORE_LIMIT: f32 = 4.0;

#[cfg(test)]
mod tests;
