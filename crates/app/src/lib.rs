//! Pipelines, files and command line of Umbra; the binary is `umbra`.
//!
//! # Map
//! [`input`] frames and masks from video and folders · [`draw`] pictures of a tracked body · [`run_folder`] everything that a
//! run writes · [`progress`] what a person who waits sees

pub mod draw;
pub mod input;
pub mod progress;
pub mod run_folder;
