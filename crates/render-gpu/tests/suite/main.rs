//! The scorers from outside.

mod conformance;
#[path = "../../benches/overlap/job_a1.rs"]
mod data;
mod errors;
mod golden;
mod job_a1;
mod properties;
