//! Measurements of a body: girths as a tape takes them, stature, volume; and what they and its shape tell of a person.
//!
//! It knows nothing of images or filters.
//!
//! # Conventions
//! Metres; the body at rest in the body frame: y up, facing +z, its left at +x.
//! # Map
//! [`girth`] which girths, and their definitions · [`tape`] takes them · [`section`] planes and what they cut · [`mesh`] meshes as
//! files have them · [`label`] labels for a mesh without · [`predict`] stature, weight and gender of the person
//! # Example
//! ```
//! use biosig::{Girth, Tape};
//! let model = body::BodyModel::builtin();
//! let tape = Tape::of_model(&model);
//! let man = model.shape_for_stature(1.80, Some(body::Sex::Male));
//! let measured = tape.measure_body(&man)?;
//! assert!((measured.stature_m - 1.80).abs() < 1e-3);
//! assert!(measured.girth_m(Girth::Chest) > measured.girth_m(Girth::Waist));
//! # Ok::<(), biosig::MeasureError>(())
//! ```
//! # References
//! The keys in brackets, such as `[Brent1973]`, are listed in `docs/papers.md`.

mod extremum;
pub mod girth;
mod hull;
pub mod label;
pub mod mesh;
pub mod predict;
pub mod section;
pub mod tape;

pub use girth::Girth;
pub use label::LabelledMesh;
pub use mesh::{MeshError, MeshNotes, SoundMesh};
pub use predict::{Estimate, FiveGirths, Predictors, Profile};
pub use section::Plane;
pub use tape::{Labels, LabelsError, MeasureError, Measurements, Tape, TapeReading};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
