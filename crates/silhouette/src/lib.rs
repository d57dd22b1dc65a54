//! Bit-packed person masks cut out of images, and what can be read off them.
//!
//! # Conventions
//! Pixels, origin at the top-left corner of the image, pixel centres at +0.5, y down. A mask bit of 1 is "person".
//! # Map
//! [`mask`] the bit-packed [`Mask`]
#![forbid(unsafe_code)]

pub mod mask;

pub use mask::{Mask, Overlap, PixelRect};
