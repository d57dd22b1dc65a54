//! Pipelines, files and command line of Umbra; the binary is `umbra`.
//!
//! # Map
//! [`cli`] what can be asked · [`config`] settings and their bounds · [`input`] frames and masks from video and folders ·
//! [`track`] the tracker and the road of a clip · [`draw`] pictures of a tracked body · [`run_folder`] everything that a run
//! writes · [`progress`] what a person who waits sees · [`stage`] sequences with true joints · [`synth`] walks of people whose
//! bodies are known · [`survey`] people whose stature, weight and sex are known · [`eval`] accuracy against reference data ·
//! [`predict`] poses straight from a mask · [`train`] how that is learned · [`shape`] one body for a tracked person

pub mod cli;
pub mod config;
pub mod draw;
pub mod eval;
pub mod input;
pub mod predict;
pub mod progress;
pub mod run_folder;
pub mod shape;
pub mod stage;
pub mod survey;
pub mod synth;
pub mod track;
pub mod train;
pub mod whole_file;
