//! One body per person: the shape of a tracked person, from many frames together, with its uncertainty.
//!
//! # Map
//! [`mod@survey`] what the masks tell at first sight · [`figure`] a body that is linear in its shape · [`rim`] where its silhouette ends ·
//! [`adjust`] shape and poses fitted together · [`mod@search`] the annealed search of the paper · [`fit`] one body for tracked frames · [`Told`] what else is known of it · [`clip`] the road from masks to a body ·
//! [`predict`] girths, stature, weight, gender · [`learn`] where the predictor comes from · [`run`] the body of a run folder, with its
//! [`picture`] and mesh ([`mod@glb`])

pub mod adjust;
pub mod clip;
mod equations;
pub mod figure;
pub mod fit;
mod given;
pub mod glb;
pub mod learn;
pub mod picture;
pub mod predict;
pub mod rim;
pub mod run;
pub mod search;
pub mod survey;

pub use clip::{light_tracking, shape_from_masks};
pub use fit::{NoShape, ShapeConfig, ShapeFit, ShapeFrame, ShapeMethod, fit_shape, fitted_as};
pub use given::Told;
pub use predict::{Estimate, Known, Prediction, Predictor, Quantity};
pub use run::{Biosignatures, ShapeJob, shape_of_run};
pub use survey::{Sighting, Survey, survey};
