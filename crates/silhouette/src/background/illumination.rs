//! Bringing a background model under the light of the frame: gain and offset per channel, then a slow field of gains.

use crate::image::RgbPlanes;
use crate::mask::Mask;

/// About this many pixels of a frame are looked at for gain, offset and noise.
const SAMPLES: usize = 20_000;
/// Rounds of reweighted least squares.
const ROUNDS: usize = 5;
/// Tukey's biweight gives residuals beyond this many standard deviations no weight.
const BIWEIGHT_SD: f32 = 4.7;
/// Standard deviations in a median absolute deviation of normal noise, inverted.
const SD_PER_MAD: f32 = 1.4826;
/// Grey levels near black and white are clipped by the camera: they tell nothing of the gain.
const UNCLIPPED: std::ops::RangeInclusive<f32> = 4.0..=250.0;
/// Spread of grey levels, in grey levels, below which a slope is not trusted and gives way to a pure gain.
const SLOPE_PRIOR_SD: f32 = 20.0;
/// Cells of the light field along the longer side of the image.
const FIELD_CELLS: usize = 16;
/// The light field may change a gain by this share, no more: a person is not a change of light.
const FIELD_LIMIT: f32 = 0.08;
/// Samples that say "no change" in each cell, against noise.
const FIELD_PRIOR_SAMPLES: f32 = 10.0;

/// What the match of one frame found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IlluminationReport {
    /// Gain of red, green and blue: frame = gain * background + offset.
    pub gain: [f32; 3],
    /// Offset of red, green and blue, grey levels.
    pub offset: [f32; 3],
    /// Robust standard deviation of what remains, grey levels.
    pub noise_sd: f32,
}

/// Matches a background to frames; holds its buffers from frame to frame.
#[derive(Clone, Debug)]
pub struct IlluminationMatch {
    matched: RgbPlanes,
    field: Vec<[f32; 3]>,
    field_row: Vec<[f32; 3]>,
}

impl IlluminationMatch {
    /// For images of the size of `like`.
    pub fn new(like: &RgbPlanes) -> Self {
        Self { matched: like.clone(), field: Vec::new(), field_row: Vec::new() }
    }

    /// The background of the last match, in the light of its frame.
    pub fn matched(&self) -> &RgbPlanes {
        &self.matched
    }

    /// Brings `background` under the light of `frame`. Pixels of `person` (say, of the frame before) are not asked;
    /// the fit is robust, so that a third of the image may differ besides.
    ///
    /// # Panics
    /// When the sizes differ.
    pub fn fit(&mut self, frame: &RgbPlanes, background: &RgbPlanes, person: &Mask) -> IlluminationReport {
        assert_eq!(
            (frame.width, frame.height),
            (background.width, background.height),
            "frame and background"
        );
        let samples = sample_positions(frame, person);
        let mut report = IlluminationReport { gain: [1.0; 3], offset: [0.0; 3], noise_sd: 0.0 };
        for channel in 0..3 {
            let pairs = samples.iter().map(|&at| (background.planes[channel][at], frame.planes[channel][at]));
            let line = robust_line(pairs.collect());
            report.gain[channel] = line.gain;
            report.offset[channel] = line.offset;
            report.noise_sd += line.residual_sd / 3.0;
            let matched = &mut self.matched.planes[channel];
            matched.iter_mut().zip(&background.planes[channel]).for_each(|(out, &value)| {
                *out = line.gain * value + line.offset;
            });
        }
        self.fit_field(frame, &samples, report.noise_sd);
        self.apply_field();
        report
    }

    /// Mean relative residual of the samples in each cell, smoothed over neighbours, as gains.
    fn fit_field(&mut self, frame: &RgbPlanes, samples: &[usize], noise_sd: f32) {
        let (columns, rows, cell_px) = self.field_size();
        // Per cell and channel: sum of residuals, sum of background, both over pixels that look like background.
        let mut sums = vec![[[0.0f32; 3]; 2]; columns * rows];
        for &at in samples {
            let cell = (at / frame.width / cell_px) * columns + at % frame.width / cell_px;
            let expected = self.matched.planes.each_ref().map(|plane| plane[at]);
            let residual: [f32; 3] =
                std::array::from_fn(|channel| frame.planes[channel][at] - expected[channel]);
            let is_background = residual
                .iter()
                .zip(expected)
                .all(|(r, mean)| r.abs() < BIWEIGHT_SD * noise_sd + 0.5 * FIELD_LIMIT * mean);
            if is_background {
                for channel in 0..3 {
                    sums[cell][0][channel] += residual[channel];
                    sums[cell][1][channel] += expected[channel];
                }
            }
        }
        for _ in 0..2 {
            smooth_cells(&mut sums, columns, rows);
        }
        self.field = sums
            .into_iter()
            .map(|[residuals, means]| {
                let gain = |channel: usize| {
                    let total = means[channel] + FIELD_PRIOR_SAMPLES * f32::from(u8::MAX) / 2.0;
                    1.0 + (residuals[channel] / total).clamp(-FIELD_LIMIT, FIELD_LIMIT)
                };
                [gain(0), gain(1), gain(2)]
            })
            .collect();
    }

    /// Multiplies the matched background by the field, interpolated between the middles of the cells.
    fn apply_field(&mut self) {
        let (columns, rows, cell_px) = self.field_size();
        let width = self.matched.width;
        for y in 0..self.matched.height {
            let (row, next_row, part) = between_cells(y, cell_px, rows);
            self.field_row.clear();
            self.field_row.extend((0..columns).map(|column| {
                let (a, b) = (self.field[row * columns + column], self.field[next_row * columns + column]);
                std::array::from_fn(|channel| a[channel] + part * (b[channel] - a[channel]))
            }));
            for (channel, plane) in self.matched.planes.iter_mut().enumerate() {
                let pixels = &mut plane[y * width..(y + 1) * width];
                apply_field_row(pixels, &self.field_row, channel, cell_px);
            }
        }
    }

    /// Columns and rows of cells, and the side of a cell in pixels.
    fn field_size(&self) -> (usize, usize, usize) {
        let cell_px = self.matched.width.max(self.matched.height).div_ceil(FIELD_CELLS).max(1);
        (self.matched.width.div_ceil(cell_px), self.matched.height.div_ceil(cell_px), cell_px)
    }
}

fn apply_field_row(pixels: &mut [f32], gains: &[[f32; 3]], channel: usize, cell_px: usize) {
    // Half a cell at a time: between two changes of neighbour the gain is a straight line.
    let half = cell_px / 2;
    let mut start = 0;
    while start < pixels.len() {
        let (left, right, part) = between_cells(start, cell_px, gains.len());
        let end = if start < half { half } else { half + ((start - half) / cell_px + 1) * cell_px };
        let end = end.clamp(start + 1, pixels.len().max(start + 1));
        let (from, to) = (gains[left][channel], gains[right][channel]);
        let step = (to - from) / cell_px as f32;
        let mut gain = from + part * (to - from);
        for value in &mut pixels[start..end] {
            *value *= gain;
            gain += step;
        }
        start = end;
    }
}

/// The cells before and after position `at`, and how far it lies from the middle of the first to that of the second.
fn between_cells(at: usize, cell_px: usize, n_cells: usize) -> (usize, usize, f32) {
    let half = cell_px / 2;
    let first = (at + cell_px - half) / cell_px;
    let part = ((at + cell_px - half) % cell_px) as f32 / cell_px as f32;
    (first.saturating_sub(1), first.min(n_cells - 1), part)
}

/// Indices of working pixels on a regular grid, outside `person`.
fn sample_positions(image: &RgbPlanes, person: &Mask) -> Vec<usize> {
    let step = ((image.width * image.height) as f64 / SAMPLES as f64).sqrt().max(1.0) as usize;
    let rows = (step / 2..image.height).step_by(step);
    rows.flat_map(|y| (step / 2..image.width).step_by(step).map(move |x| (x, y)))
        .filter(|&(x, y)| !person.get(x as u32, y as u32))
        .map(|(x, y)| y * image.width + x)
        .collect()
}

/// A line through most of the points.
struct Line {
    gain: f32,
    offset: f32,
    residual_sd: f32,
}

/// Fits `frame = gain * background + offset`: median ratio first, then least squares with Tukey's biweight.
fn robust_line(mut pairs: Vec<(f32, f32)>) -> Line {
    pairs.retain(|(background, frame)| UNCLIPPED.contains(background) && UNCLIPPED.contains(frame));
    let mut ratios: Vec<f32> = pairs.iter().map(|(background, frame)| frame / background).collect();
    let Some(ratio) = median(&mut ratios) else {
        return Line { gain: 1.0, offset: 0.0, residual_sd: 0.0 };
    };
    let mut line = Line { gain: ratio, offset: 0.0, residual_sd: 0.0 };
    let mut residuals = vec![0.0f32; pairs.len()];
    for _ in 0..ROUNDS {
        for (residual, (x, y)) in residuals.iter_mut().zip(&pairs) {
            *residual = (y - line.gain * x - line.offset).abs();
        }
        line.residual_sd = SD_PER_MAD * median(&mut residuals).unwrap_or(0.0);
        let reach = BIWEIGHT_SD * line.residual_sd.max(0.5);
        let [mut total, mut sum_x, mut sum_r, mut sum_xx, mut sum_xr] = [0.0f64; 5];
        for &(x, y) in &pairs {
            let deviation = (y - line.gain * x - line.offset) / reach;
            let weight = f64::from((1.0 - deviation * deviation).max(0.0).powi(2));
            let (x, r) = (f64::from(x), f64::from(y - ratio * x));
            total += weight;
            sum_x += weight * x;
            sum_r += weight * r;
            sum_xx += weight * x * x;
            sum_xr += weight * x * r;
        }
        if total <= 0.0 {
            break;
        }
        let (mean_x, mean_r) = (sum_x / total, sum_r / total);
        let variance =
            sum_xx / total - mean_x * mean_x + f64::from(SLOPE_PRIOR_SD * SLOPE_PRIOR_SD) / total.sqrt();
        let slope = (sum_xr / total - mean_x * mean_r) / variance;
        line.gain = ratio + slope as f32;
        line.offset = (mean_r - slope * mean_x) as f32;
    }
    line
}

/// The median; reorders `values`. `None` when there are none.
fn median(values: &mut [f32]) -> Option<f32> {
    let middle = values.len().checked_sub(1)? / 2;
    Some(*values.select_nth_unstable_by(middle, f32::total_cmp).1)
}

/// One pass of (1 2 1)/4 along both axes; beyond the edges there is nothing.
fn smooth_cells(cells: &mut [[[f32; 3]; 2]], columns: usize, rows: usize) {
    let blend = |line: &[[[f32; 3]; 2]], at: usize| {
        let neighbours = [(at.checked_sub(1), 0.25), (Some(at), 0.5), (Some(at + 1), 0.25)];
        let mut sum = [[0.0f32; 3]; 2];
        for (index, weight) in neighbours {
            let Some(cell) = index.and_then(|index| line.get(index)) else {
                continue;
            };
            for (out, value) in sum.as_flattened_mut().iter_mut().zip(cell.as_flattened()) {
                *out += weight * value;
            }
        }
        sum
    };
    for row in cells.chunks_exact_mut(columns) {
        let before = row.to_vec();
        row.iter_mut().enumerate().for_each(|(at, cell)| *cell = blend(&before, at));
    }
    for column in 0..columns {
        let before: Vec<_> = (0..rows).map(|row| cells[row * columns + column]).collect();
        (0..rows).for_each(|row| cells[row * columns + column] = blend(&before, row));
    }
}
