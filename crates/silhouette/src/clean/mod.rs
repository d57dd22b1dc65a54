//! From a raw mask to the person: morphology, holes, components, and following the person over time.

mod components;
mod holes;
mod morphology;
mod person;

pub use components::{Component, Components, Connectivity};
pub use morphology::Window;
pub use person::{PersonTracker, PersonTrackerConfig};

#[cfg(test)]
mod tests;
