//! The fixed background: a clean plate, or the mean and spread of empty frames.

use super::{BackgroundModel, Expected};
use crate::image::{Geometry, RgbPlanes, RgbView};
use crate::mask::Mask;

/// A background that does not change but for the light on it, which [`super::IlluminationMatch`] follows.
#[derive(Clone, Debug)]
pub struct StaticModel {
    geometry: Geometry,
    mean: RgbPlanes,
    noise: Vec<f32>,
}

impl StaticModel {
    /// The scene as one picture shows it. Its noise is unknown: zero.
    ///
    /// # Panics
    /// When the plate has another size than `geometry` says.
    pub fn from_plate(plate: &RgbView<'_>, geometry: Geometry) -> Self {
        let mean = RgbPlanes::from_view(plate, geometry);
        Self { geometry, mean, noise: vec![0.0; geometry.working_pixels()] }
    }

    /// The scene as frames without a person show it: their mean and standard deviation. `None` without frames.
    ///
    /// # Panics
    /// When a frame has another size than `geometry` says.
    pub fn from_empty_frames<'a>(
        frames: impl IntoIterator<Item = RgbView<'a>>,
        geometry: Geometry,
    ) -> Option<Self> {
        let mut sums = RgbPlanes::black(geometry);
        let mut squares = RgbPlanes::black(geometry);
        let mut image = RgbPlanes::black(geometry);
        let mut count = 0u32;
        for frame in frames {
            image.fill_from(&frame, geometry);
            count += 1;
            for channel in 0..3 {
                let totals = sums.planes[channel].iter_mut().zip(&mut squares.planes[channel]);
                for ((sum, square), &value) in totals.zip(&image.planes[channel]) {
                    *sum += value;
                    *square += value * value;
                }
            }
        }
        let share = (count > 0).then(|| 1.0 / count as f32)?;
        let mut variance = vec![0.0f32; geometry.working_pixels()];
        for (sum_plane, square_plane) in sums.planes.iter_mut().zip(&squares.planes) {
            for ((total, sum), square) in variance.iter_mut().zip(sum_plane).zip(square_plane) {
                *sum *= share;
                *total += (square * share - *sum * *sum).max(0.0) / 3.0;
            }
        }
        let noise = variance.into_iter().map(f32::sqrt).collect();
        Some(Self { geometry, mean: sums, noise })
    }

    /// A background of known mean and noise, working size.
    pub(super) fn from_parts(geometry: Geometry, mean: RgbPlanes, noise: Vec<f32>) -> Self {
        Self { geometry, mean, noise }
    }
}

impl BackgroundModel for StaticModel {
    fn geometry(&self) -> Geometry {
        self.geometry
    }

    fn expected(&mut self, _frame: &RgbPlanes) -> Expected<'_> {
        Expected { mean: &self.mean, noise: &self.noise }
    }

    fn learn(&mut self, _frame: &RgbPlanes, _person: &Mask) {}
}
