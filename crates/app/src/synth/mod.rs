//! Walks of people whose bodies are known, as a camera would see them: for training and for tests.
//!
//! A person is a body on the population's own full mesh, never on the template that the tracker fits. Recorded walking is
//! bent onto an arc, carried over to the person's skeleton, skinned, drawn through a camera with a distorting lens, and
//! spoiled as background subtraction spoils silhouettes. Everything follows from the seed.
//!
//! # Map
//! [`people`] bodies and what is true of them · [`walk`] motion · [`studio`] camera and silhouettes · [`noise`] what is wrong
//! with them

pub mod noise;
pub mod people;
mod polygon;
pub mod studio;
pub mod walk;

pub use people::{FullBody, People, Truth};
pub use studio::{Studio, SyntheticWalk, WalkFrame};
pub use walk::{WalkConfig, Walks, performer_of};
