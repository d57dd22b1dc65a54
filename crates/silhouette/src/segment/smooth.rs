//! Edge-aware smoothing of scores: the recursive domain transform filter `[Gastal2011]`.
//!
//! Scores flow between neighbours that look alike. An edge that the background has too is no outline of a person and
//! does not stop them, as in background cut `[Sun2006]`.

use crate::image::RgbPlanes;

/// Settings of the smoothing.
#[derive(Clone, Debug)]
pub struct SmoothingConfig {
    /// Reach where nothing stops it, pixels (standard deviation).
    pub reach_px: f32,
    /// Contrast of an edge that halves the reach or more, grey levels.
    pub contrast: f32,
    /// Passes over rows and columns; more leave fewer streaks.
    pub passes: u32,
}

impl Default for SmoothingConfig {
    fn default() -> Self {
        Self { reach_px: 4.0, contrast: 30.0, passes: 2 }
    }
}

/// Contrast steps between neighbours, whole grey levels.
#[derive(Clone, Debug)]
pub(crate) struct Smoother {
    width: usize,
    /// Contrast of each pixel with the one to its left, and with the one above.
    contrast: [Vec<u8>; 2],
}

impl Smoother {
    pub fn new(width: usize, height: usize) -> Self {
        let plane = vec![0; width * height];
        Self { width, contrast: [plane.clone(), plane] }
    }

    /// Smooths `score` in place, guided by the edges of `frame` that `background` has not.
    pub fn smooth(
        &mut self,
        score: &mut [f32],
        frame: &RgbPlanes,
        background: &RgbPlanes,
        config: &SmoothingConfig,
    ) {
        let width = self.width;
        for (contrast, offset) in self.contrast.iter_mut().zip([1, width]) {
            fill_contrast(contrast, frame, background, offset);
        }
        for pass in 0..config.passes {
            let keep = carry_table(config, pass);
            smooth_rows(score, &self.contrast[0], width, &keep);
            smooth_columns(score, &self.contrast[1], width, &keep);
        }
    }
}

/// Largest difference of the channels between each pixel and the one `offset` before it, less that of the background.
fn fill_contrast(contrast: &mut [u8], frame: &RgbPlanes, background: &RgbPlanes, offset: usize) {
    // Slices of one length: without an index to check, the loop works on many pixels at once.
    let n = contrast.len() - offset;
    let [fr, fg, fb] = frame.planes.each_ref().map(|plane| [&plane[offset..][..n], &plane[..n]]);
    let [br, bg, bb] = background.planes.each_ref().map(|plane| [&plane[offset..][..n], &plane[..n]]);
    let contrast = &mut contrast[offset..][..n];
    for at in 0..n {
        let step = |[later, earlier]: [&[f32]; 2]| (later[at] - earlier[at]).abs();
        let in_frame = step(fr).max(step(fg)).max(step(fb));
        let in_background = step(br).max(step(bg)).max(step(bb));
        contrast[at] = whole_level((in_frame - in_background).clamp(0.0, 255.0));
    }
}

/// The whole part of a grey level from 0 to 255. Of a number added to 2^23 the lowest bits are its integer; unlike a cast,
/// that is done for many numbers at once.
fn whole_level(level: f32) -> u8 {
    (level.floor() + 8_388_608.0).to_bits() as u8
}

/// For each contrast the share of a neighbour's value that is carried over: a^(1 + reach/contrast * step) with
/// a = exp(−√2/σ) of this pass; `[Gastal2011]` eqs. (14), (21).
fn carry_table(config: &SmoothingConfig, pass: u32) -> [f32; 256] {
    let passes = config.passes as i32;
    let sigma = config.reach_px * 3f32.sqrt() * 2f32.powi(passes - pass as i32 - 1)
        / (4f32.powi(passes) - 1.0).sqrt();
    std::array::from_fn(|step| {
        let distance = 1.0 + config.reach_px / config.contrast * step as f32;
        (-std::f32::consts::SQRT_2 / sigma * distance).exp()
    })
}

/// Rows that are worked on side by side: along a row each pixel waits for the one before.
const ROWS_ABREAST: usize = 8;

fn smooth_rows(score: &mut [f32], contrast: &[u8], width: usize, keep: &[f32; 256]) {
    let mut abreast = score.chunks_exact_mut(ROWS_ABREAST * width);
    let mut contrasts = contrast.chunks_exact(ROWS_ABREAST * width);
    for (rows, contrast) in abreast.by_ref().zip(contrasts.by_ref()) {
        smooth_abreast::<ROWS_ABREAST>(rows, contrast, width, keep);
    }
    let rest = abreast.into_remainder().chunks_exact_mut(width);
    for (row, contrast) in rest.zip(contrasts.remainder().chunks_exact(width)) {
        smooth_abreast::<1>(row, contrast, width, keep);
    }
}

/// Smooths `N` rows, each on its own.
fn smooth_abreast<const N: usize>(rows: &mut [f32], contrast: &[u8], width: usize, keep: &[f32; 256]) {
    let (rows, contrast) = (&mut rows[..N * width], &contrast[..N * width]);
    let mut last: [f32; N] = std::array::from_fn(|row| rows[row * width]);
    for x in 1..width {
        for (row, last) in last.iter_mut().enumerate() {
            let at = row * width + x;
            let value = rows[at];
            *last = value + keep[usize::from(contrast[at])] * (*last - value);
            rows[at] = *last;
        }
    }
    for x in (1..width).rev() {
        for (row, last) in last.iter_mut().enumerate() {
            let at = row * width + x;
            let value = rows[at - 1];
            *last = value + keep[usize::from(contrast[at])] * (*last - value);
            rows[at - 1] = *last;
        }
    }
}

fn smooth_columns(score: &mut [f32], contrast: &[u8], width: usize, keep: &[f32; 256]) {
    let mut blend = |from: usize, to: usize, edge: usize| {
        for x in 0..width {
            score[to + x] += keep[usize::from(contrast[edge + x])] * (score[from + x] - score[to + x]);
        }
    };
    let rows = contrast.len() / width;
    (1..rows).for_each(|y| blend((y - 1) * width, y * width, y * width));
    (1..rows).rev().for_each(|y| blend(y * width, (y - 1) * width, y * width));
}
