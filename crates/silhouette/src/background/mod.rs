//! What the camera sees when nobody is there: three models behind one trait.

mod illumination;
mod median;
mod mixture;
mod plate;

pub use illumination::{IlluminationMatch, IlluminationReport};
pub use median::TemporalMedian;
pub use mixture::{MixtureConfig, MixtureModel, MixtureParams, MixtureParamsError};
pub use plate::StaticModel;

use crate::image::{Geometry, RgbPlanes};
use crate::mask::Mask;

/// The background that a model expects behind one frame.
#[derive(Clone, Copy, Debug)]
pub struct Expected<'a> {
    /// Colour of each working pixel, grey levels.
    pub mean: &'a RgbPlanes,
    /// Standard deviation of each working pixel about `mean`, mean of the channels, grey levels. Zero where the model
    /// knows nothing of it: the segmenter adds the noise that it sees in the frame.
    pub noise: &'a [f32],
}

/// A model of the scene without the person.
///
/// Laws: `expected` answers in the working size of `geometry`; a model shown the same empty scene again and again
/// expects that scene; `learn` never takes in the pixels marked as person.
pub trait BackgroundModel: Send {
    /// The frames that the model is for.
    fn geometry(&self) -> Geometry;

    /// The background behind `frame`. A model with several guesses a pixel gives the one nearest to the frame.
    fn expected(&mut self, frame: &RgbPlanes) -> Expected<'_>;

    /// Takes the frame in, away from `person` (working size). A fixed model does nothing.
    fn learn(&mut self, frame: &RgbPlanes, person: &Mask);
}

#[cfg(test)]
mod tests;
