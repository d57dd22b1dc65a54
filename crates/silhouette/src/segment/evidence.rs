//! Evidence per pixel: how badly do the background, and the background in shadow, explain the colour seen?
//!
//! With frame I, background B and noise σ the distance to the background is |I − B|/σ. A shadow keeps the colour's
//! direction: I = αB with α below 1, so that only what is left of I after its projection on B counts, the
//! chromaticity distortion of `[Horprasert1999]`. Where that leaves a choice, the colours learned of the person decide.

use super::SCORE_LIMIT;
use super::appearance::Appearance;
use crate::image::RgbPlanes;
use crate::mask::Mask;

/// Settings of the evidence.
#[derive(Clone, Debug)]
pub struct EvidenceConfig {
    /// Distance at which a pixel is as likely person as background, standard deviations.
    pub threshold_sd: f32,
    /// The noise of a pixel is this times the robust noise of the frame: compression makes its tails long.
    pub noise_factor: f32,
    /// Least noise, grey levels.
    pub minimum_noise: f32,
    /// Edges of the background may move by this much (lens, compression, vibration), pixels.
    pub edge_jitter_px: f32,
    /// The darkest shadow: the least brightness left, as a share.
    pub darkest_shadow: f32,
    /// What calling a pixel shadow costs, as a share of the squared threshold: plain background is the better guess.
    pub shadow_cost: f32,
    /// What each nat by which its colour is likelier on the person than in the scene adds to that cost.
    pub shadow_appearance: f32,
    /// What each such nat adds to the distance of any pixel, standard deviations.
    pub appearance_bias: f32,
}

impl Default for EvidenceConfig {
    fn default() -> Self {
        Self {
            threshold_sd: 3.5,
            noise_factor: 2.0,
            minimum_noise: 1.0,
            edge_jitter_px: 0.35,
            darkest_shadow: 0.5,
            shadow_cost: 0.5,
            shadow_appearance: 15.0,
            appearance_bias: 0.3,
        }
    }
}

/// Computes scores and keeps the buffers that this takes.
#[derive(Clone, Debug)]
pub(crate) struct Evidence {
    /// Score of each pixel, standard deviations above the threshold, within ± [`SCORE_LIMIT`].
    pub score: Vec<f32>,
    /// Squared distance to the background, variances.
    distance: Vec<f32>,
    /// Squared distance to the background in shadow, variances; infinite where it is no shadow.
    shadow: Vec<f32>,
    /// Brightness of the background, grey levels,
    luma: Vec<f32>,
    /// and its change along one row, from the pixel before to the one after.
    across: Vec<f32>,
}

impl Evidence {
    pub fn new(n_pixels: usize) -> Self {
        let plane = vec![0.0; n_pixels];
        Self {
            score: plane.clone(),
            distance: plane.clone(),
            shadow: plane.clone(),
            luma: plane,
            across: Vec::new(),
        }
    }

    /// Measures every pixel of `frame` against `background` (under the frame's light).
    ///
    /// `pixel_noise` and `frame_noise` in grey levels.
    pub fn measure(
        &mut self,
        frame: &RgbPlanes,
        background: &RgbPlanes,
        pixel_noise: &[f32],
        frame_noise: f32,
        config: &EvidenceConfig,
    ) {
        let [red, green, blue] = &background.planes;
        for (((luma, r), g), b) in self.luma.iter_mut().zip(red).zip(green).zip(blue) {
            *luma = (r + g + b) / 3.0;
        }
        let base_noise = (frame_noise.max(config.minimum_noise) * config.noise_factor).powi(2);
        let jitter = (config.edge_jitter_px / 2.0).powi(2);
        let (width, height) = (frame.width, frame.height);
        self.across.resize(width, 0.0);
        for y in 0..height {
            let row = y * width..(y + 1) * width;
            let above = &self.luma[y.saturating_sub(1) * width..][..width];
            let below = &self.luma[(y + 1).min(height - 1) * width..][..width];
            let luma = &self.luma[row.clone()];
            // Differences along the row first: the loop below then has no neighbours to look at.
            let across = self.across.as_mut_slice();
            for (slope, pair) in across[1..].iter_mut().zip(luma.windows(3)) {
                *slope = pair[2] - pair[0];
            }
            across[0] = luma[1.min(width - 1)] - luma[0];
            across[width - 1] = luma[width - 1] - luma[width.saturating_sub(2)];
            let frame_row = frame.planes.each_ref().map(|plane| &plane[row.clone()]);
            let background_row = background.planes.each_ref().map(|plane| &plane[row.clone()]);
            let noise_row = &pixel_noise[row.clone()];
            let (distance_row, shadow_row) = (&mut self.distance[row.clone()], &mut self.shadow[row]);
            for x in 0..width {
                let (dx, dy) = (across[x], below[x] - above[x]);
                let precision =
                    1.0 / (base_noise + noise_row[x] * noise_row[x] + jitter * (dx * dx + dy * dy));
                let b = background_row.map(|plane| plane[x]);
                let d = [frame_row[0][x] - b[0], frame_row[1][x] - b[1], frame_row[2][x] - b[2]];
                let distance = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
                let along = d[0] * b[0] + d[1] * b[1] + d[2] * b[2];
                let length = b[0] * b[0] + b[1] * b[1] + b[2] * b[2] + 1.0;
                // 1 − α; what is left after projecting on the background's colour counts if α is that of a shadow.
                let darkening = -along / length;
                let is_shadow = darkening > 0.0 && darkening < 1.0 - config.darkest_shadow;
                distance_row[x] = distance * precision;
                let distortion = (distance - along * along / length).max(0.0) * precision;
                shadow_row[x] = if is_shadow { distortion } else { f32::INFINITY };
            }
        }
    }

    /// Turns what was measured into scores: the better of the two explanations counts. A shadow costs the more, the
    /// more its colour is one of the person's.
    pub fn score(&mut self, frame: &RgbPlanes, appearance: &Appearance, config: &EvidenceConfig) {
        let shadow_cost = config.shadow_cost * config.threshold_sd * config.threshold_sd;
        // Look-ups first: the loop after them then works on many pixels at once.
        appearance.log_ratios(frame, &mut self.score);
        for ((score, &distance), &shadow) in self.score.iter_mut().zip(&self.distance).zip(&self.shadow) {
            let likeness = *score;
            let cost = (shadow_cost + config.shadow_appearance * likeness).max(0.0);
            let least = distance.min(shadow + cost).sqrt() + config.appearance_bias * likeness;
            *score = (least - config.threshold_sd).clamp(-SCORE_LIMIT, SCORE_LIMIT);
        }
    }

    /// The pixels that neither background nor shadow explains, by a wide margin and whatever the person's colours are.
    pub fn clear_pixels(&self, width: usize, config: &EvidenceConfig) -> Mask {
        let least = (config.threshold_sd + 0.5 * SCORE_LIMIT).powi(2);
        Mask::from_fn(width as u32, (self.distance.len() / width) as u32, |x, y| {
            let pixel = y as usize * width + x as usize;
            self.distance[pixel].min(self.shadow[pixel]) > least
        })
    }
}
