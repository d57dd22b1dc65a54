//! A running mixture of Gaussians per pixel `[Stauffer1999]`, with the updates of `[Zivkovic2004]`.

use super::{BackgroundModel, Expected};
use crate::image::{Geometry, RgbPlanes, RgbView};
use crate::mask::Mask;

/// Gaussians a pixel.
const MODES: usize = 3;

/// Settings of the running mixture.
#[derive(Clone, Debug)]
pub struct MixtureConfig {
    /// Weight of a new frame: the model forgets in about `1 / learning_rate` frames.
    pub learning_rate: f32,
    /// A value belongs to a mode within this many standard deviations.
    pub match_sd: f32,
    /// Standard deviation of a fresh mode, grey levels.
    pub initial_sd: f32,
    /// Least standard deviation of a mode, grey levels.
    pub minimum_sd: f32,
    /// The heaviest modes that together hold this share are background.
    pub background_share: f32,
}

impl Default for MixtureConfig {
    fn default() -> Self {
        Self { learning_rate: 0.01, match_sd: 4.0, initial_sd: 8.0, minimum_sd: 1.5, background_share: 0.7 }
    }
}

/// A setting of the mixture outside its range.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("`{field}` is {value}, expected {expected}")]
pub struct MixtureParamsError {
    /// Name of the setting.
    pub field: &'static str,
    /// Its value.
    pub value: f32,
    /// Its range.
    pub expected: &'static str,
}

/// Checked settings of the running mixture.
#[derive(Clone, Debug)]
pub struct MixtureParams(MixtureConfig);

impl MixtureParams {
    /// Checks the settings.
    ///
    /// # Errors
    /// When a share is not inside (0, 1) or a length not above zero.
    pub fn new(config: MixtureConfig) -> Result<Self, MixtureParamsError> {
        let shares = [("learning_rate", config.learning_rate), ("background_share", config.background_share)];
        for (field, value) in shares {
            if !(value > 0.0 && value < 1.0) {
                return Err(MixtureParamsError { field, value, expected: "a share between 0 and 1" });
            }
        }
        let lengths = [
            ("match_sd", config.match_sd),
            ("initial_sd", config.initial_sd),
            ("minimum_sd", config.minimum_sd),
        ];
        for (field, value) in lengths {
            if !(value > 0.0 && value.is_finite()) {
                return Err(MixtureParamsError { field, value, expected: "a number above 0" });
            }
        }
        Ok(Self(config))
    }
}

/// One Gaussian of one pixel: isotropic, as in the papers.
#[derive(Clone, Copy, Debug, Default)]
struct Mode {
    weight: f32,
    mean: [f32; 3],
    variance: f32,
}

impl Mode {
    fn squared_distance(&self, color: [f32; 3]) -> f32 {
        self.mean.iter().zip(color).map(|(mean, value)| (value - mean) * (value - mean)).sum()
    }
}

/// Up to three Gaussians a pixel, heaviest first, each updated by the values that fall to it.
#[derive(Clone, Debug)]
pub struct MixtureModel {
    geometry: Geometry,
    params: MixtureParams,
    modes: Vec<[Mode; MODES]>,
    n_learned: u32,
    mean: RgbPlanes,
    noise: Vec<f32>,
}

impl MixtureModel {
    /// A mixture that has seen nothing: [`BackgroundModel::expected`] gives back the frame itself until it has learned.
    pub fn new(params: MixtureParams, geometry: Geometry) -> Self {
        Self {
            geometry,
            params,
            modes: vec![[Mode::default(); MODES]; geometry.working_pixels()],
            n_learned: 0,
            mean: RgbPlanes::black(geometry),
            noise: vec![0.0; geometry.working_pixels()],
        }
    }

    /// Learns from a frame of which nothing is known.
    ///
    /// # Panics
    /// When the frame has another size than promised.
    pub fn learn_view(&mut self, frame: &RgbView<'_>) {
        let image = RgbPlanes::from_view(frame, self.geometry);
        let nobody = Mask::new(self.geometry.working_width(), self.geometry.working_height());
        self.learn(&image, &nobody);
    }
}

impl BackgroundModel for MixtureModel {
    fn geometry(&self) -> Geometry {
        self.geometry
    }

    fn expected(&mut self, frame: &RgbPlanes) -> Expected<'_> {
        let share = self.params.0.background_share;
        for (pixel, modes) in self.modes.iter().enumerate() {
            let color = frame.color(pixel);
            let nearest = background_modes(modes, share)
                .min_by(|a, b| a.squared_distance(color).total_cmp(&b.squared_distance(color)));
            let (mean, variance) = nearest.map_or((color, 0.0), |mode| (mode.mean, mode.variance));
            self.mean.planes.iter_mut().zip(mean).for_each(|(plane, value)| plane[pixel] = value);
            self.noise[pixel] = variance.sqrt();
        }
        Expected { mean: &self.mean, noise: &self.noise }
    }

    fn learn(&mut self, frame: &RgbPlanes, person: &Mask) {
        self.n_learned = self.n_learned.saturating_add(1);
        // The first frames weigh as in a plain mean, so that the start is quick.
        let rate = self.params.0.learning_rate.max(1.0 / self.n_learned as f32);
        let background = person.complement();
        for y in 0..background.height() {
            for (x0, x1) in background.runs(y) {
                let row = y as usize * frame.width;
                for pixel in row + x0 as usize..row + x1 as usize {
                    update(&mut self.modes[pixel], frame.color(pixel), rate, &self.params.0);
                }
            }
        }
    }
}

/// The heaviest modes that together hold `share` of the weight; `[Stauffer1999]` eq. (9).
fn background_modes(modes: &[Mode; MODES], share: f32) -> impl Iterator<Item = &Mode> {
    let mut held = 0.0;
    modes.iter().take_while(move |mode| {
        let needed = held < share && mode.weight > 0.0;
        held += mode.weight;
        needed
    })
}

/// `[Zivkovic2004]` eqs. (4) to (6), without the prior that removes modes: their number is fixed.
fn update(modes: &mut [Mode; MODES], color: [f32; 3], rate: f32, config: &MixtureConfig) {
    let reach = config.match_sd * config.match_sd;
    // Three channels of variance each: the distance is compared per channel on average.
    let matched =
        modes.iter().position(|m| m.weight > 0.0 && m.squared_distance(color) < 3.0 * reach * m.variance);
    modes.iter_mut().for_each(|mode| mode.weight *= 1.0 - rate);
    let index = matched.unwrap_or(MODES - 1);
    let mode = &mut modes[index];
    if matched.is_some() {
        mode.weight += rate;
        let step = rate / mode.weight;
        let spread = mode.squared_distance(color) / 3.0;
        mode.mean.iter_mut().zip(color).for_each(|(mean, value)| *mean += step * (value - *mean));
        let least = config.minimum_sd * config.minimum_sd;
        mode.variance = (mode.variance + step * (spread - mode.variance)).max(least);
    } else {
        *mode = Mode { weight: rate, mean: color, variance: config.initial_sd * config.initial_sd };
    }
    let total: f32 = modes.iter().map(|mode| mode.weight).sum();
    modes.iter_mut().for_each(|mode| mode.weight /= total);
    modes.sort_by(|a, b| b.weight.total_cmp(&a.weight));
}
