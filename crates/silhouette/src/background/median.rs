//! The temporal median: a background learned from frames that a person walks through.

use super::StaticModel;
use crate::image::{Geometry, RgbPlanes, RgbView};

/// Standard deviations in a median absolute deviation of normal noise, inverted.
const SD_PER_MAD: f32 = 1.4826;

/// Collects frames and takes the median of each pixel: right wherever the person stands for less than half of them.
///
/// ```
/// use silhouette::{Geometry, RgbView, background::TemporalMedian};
/// let mut median = TemporalMedian::new(Geometry::for_frames(1, 1));
/// for grey in [100, 250, 102, 101, 10] {
///     median.push(&RgbView { width: 1, height: 1, data: &[grey; 3] });
/// }
/// assert!(median.finish().is_some());
/// ```
#[derive(Clone, Debug)]
pub struct TemporalMedian {
    geometry: Geometry,
    /// Each frame reduced, rounded to whole grey levels: `[frame][3][pixels]`.
    frames: Vec<[Vec<u8>; 3]>,
}

impl TemporalMedian {
    /// No frames yet.
    pub fn new(geometry: Geometry) -> Self {
        Self { geometry, frames: Vec::new() }
    }

    /// Adds a frame. Some 30 to 60 frames spread over the clip serve; each costs three bytes a working pixel.
    ///
    /// # Panics
    /// When the frame has another size than promised.
    pub fn push(&mut self, frame: &RgbView<'_>) {
        let image = RgbPlanes::from_view(frame, self.geometry);
        self.frames.push(image.planes.map(|plane| plane.iter().map(|&value| (value + 0.5) as u8).collect()));
    }

    /// The median of each pixel, with the spread that its median absolute deviation tells. `None` without frames.
    pub fn finish(self) -> Option<StaticModel> {
        let middle = (self.frames.len().checked_sub(1)?) / 2;
        let mut mean = RgbPlanes::black(self.geometry);
        let mut noise = vec![0.0f32; self.geometry.working_pixels()];
        let mut values = vec![0u8; self.frames.len()];
        for (channel, plane) in mean.planes.iter_mut().enumerate() {
            for (pixel, median) in plane.iter_mut().enumerate() {
                values.iter_mut().zip(&self.frames).for_each(|(value, frame)| *value = frame[channel][pixel]);
                let center = *values.select_nth_unstable(middle).1;
                values.iter_mut().for_each(|value| *value = value.abs_diff(center));
                let deviation = *values.select_nth_unstable(middle).1;
                *median = f32::from(center);
                noise[pixel] += SD_PER_MAD * f32::from(deviation) / 3.0;
            }
        }
        Some(StaticModel::from_parts(self.geometry, mean, noise))
    }
}
