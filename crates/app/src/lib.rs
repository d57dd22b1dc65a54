//! Pipelines, files and command line of Umbra; the binary is `umbra`.
//!
//! # Map
//! [`input`] frames and masks from video and folders

pub mod input;
