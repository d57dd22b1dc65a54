//! Bit-packed person masks cut out of images, and what can be read off them.
//!
//! # Conventions
//! Pixels, origin at the top-left corner of the image, pixel centres at +0.5, y down. A mask bit of 1 is "person".
//! # Map
//! [`mask`] the bit-packed [`Mask`] · [`image`] frames · [`background`] three models of the empty scene ·
//! [`clean`] morphology, components, following the person · [`segment`] the whole road from frame to mask ·
//! [`contour`] the outline · [`distance`] how far from it · [`descriptor`] the shape in numbers
#![forbid(unsafe_code)]

pub mod background;
pub mod clean;
pub mod contour;
pub mod descriptor;
pub mod distance;
pub mod image;
pub mod mask;
pub mod segment;

pub use background::BackgroundModel;
pub use contour::Contour;
pub use descriptor::Descriptor;
pub use distance::DistanceField;
pub use image::{Geometry, RgbPlanes, RgbView};
pub use mask::{Mask, Overlap, PixelRect};
pub use segment::{Segmentation, Segmenter, SegmenterConfig, SegmenterParams};
