//! Pipelines, files and command line of Umbra; the binary is `umbra`.
//!
//! # Map
//! [`input`] frames and masks from video and folders · [`progress`] what a person who waits sees

pub mod input;
pub mod progress;
