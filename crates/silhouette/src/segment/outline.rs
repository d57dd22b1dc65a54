//! The outline to a part of a pixel: at the rim of the person a pixel is a blend of person and background,
//! I = cF + (1 − c)B, and its coverage c follows from the colours on both sides.

use crate::clean::Window;
use crate::image::{Geometry, RgbPlanes};
use crate::mask::Mask;

/// Least difference of the colours on both sides for the blend to tell anything, grey levels.
const MINIMUM_CONTRAST: f32 = 30.0;
/// The person's colour is taken this many pixels inside the rim.
const INSIDE_PX: u32 = 2;

/// Person's share of each pixel, `[height * width]`: 1 inside, 0 outside, between at the rim.
pub(crate) fn coverage(mask: &Mask, frame: &RgbPlanes, background: &RgbPlanes) -> Vec<f32> {
    let (width, height) = (frame.width, frame.height);
    let inside = mask.eroded(Window::radius(INSIDE_PX));
    let mut rim = mask.dilated(Window::radius(1));
    rim.subtract(&inside);
    let mut coverage = vec![0.0; width * height];
    for y in 0..height {
        for (x0, x1) in mask.runs(y as u32) {
            coverage[y * width + x0 as usize..y * width + x1 as usize].fill(1.0);
        }
    }
    for y in 0..height {
        for x in rim.runs(y as u32).flat_map(|(x0, x1)| x0 as usize..x1 as usize) {
            if let Some(person) = color_nearby(&inside, frame, x, y) {
                let at = y * width + x;
                if let Some(share) = blend(frame, background, at, person) {
                    coverage[at] = share;
                }
            }
        }
    }
    coverage
}

/// Mean colour of the pixels of `inside` about a pixel of the rim.
fn color_nearby(inside: &Mask, frame: &RgbPlanes, x: usize, y: usize) -> Option<[f32; 3]> {
    let reach = INSIDE_PX as usize + 2;
    let mut sum = [0.0; 3];
    let mut count = 0.0f32;
    for near_y in y.saturating_sub(reach)..(y + reach + 1).min(frame.height) {
        for near_x in x.saturating_sub(reach)..(x + reach + 1).min(frame.width) {
            if inside.get(near_x as u32, near_y as u32) {
                let at = near_y * frame.width + near_x;
                sum.iter_mut().zip(&frame.planes).for_each(|(sum, plane)| *sum += plane[at]);
                count += 1.0;
            }
        }
    }
    (count > 0.0).then(|| sum.map(|value| value / count))
}

/// Coverage by least squares over the channels: (I − B)·(F − B) / |F − B|².
fn blend(frame: &RgbPlanes, background: &RgbPlanes, at: usize, person: [f32; 3]) -> Option<f32> {
    let [mut along, mut length] = [0.0; 2];
    for (channel, person) in person.into_iter().enumerate() {
        let behind = background.planes[channel][at];
        along += (frame.planes[channel][at] - behind) * (person - behind);
        length += (person - behind) * (person - behind);
    }
    (length >= MINIMUM_CONTRAST * MINIMUM_CONTRAST).then(|| (along / length).clamp(0.0, 1.0))
}

/// The mask of the pixels of which `least` or more is covered, in the size of the frames; between the centres of
/// working pixels the coverage runs in straight lines.
pub(crate) fn enlarged(coverage: &[f32], geometry: Geometry, least: f32) -> Mask {
    let Geometry { width, height, reduction } = geometry;
    let working_width = geometry.working_width() as usize;
    let working_height = coverage.len() / working_width;
    if reduction == 1 {
        return Mask::from_fn(width, height, |x, y| {
            coverage[y as usize * working_width + x as usize] >= least
        });
    }
    let steps = |length: u32, cells: usize| -> Vec<(usize, usize, f32)> {
        (0..length)
            .map(|at| {
                let place = ((at as f32 + 0.5) / reduction as f32 - 0.5).clamp(0.0, (cells - 1) as f32);
                let first = (place as usize).min(cells - 1);
                (first, (first + 1).min(cells - 1), place - first as f32)
            })
            .collect()
    };
    let columns = steps(width, working_width);
    let mut mask = Mask::new(width, height);
    let mut row = vec![0.0f32; working_width];
    for (y, (above, below, part)) in steps(height, working_height).into_iter().enumerate() {
        let lines = [above, below].map(|at| &coverage[at * working_width..(at + 1) * working_width]);
        row.iter_mut().zip(lines[0]).zip(lines[1]).for_each(|((out, a), b)| *out = a + part * (b - a));
        let Some(first) = row.iter().position(|&share| share > 0.0) else {
            continue;
        };
        let last = row.iter().rposition(|&share| share > 0.0).unwrap_or(first);
        // Columns that lie between two working pixels without any person stay empty.
        let start = columns.partition_point(|&(_, right, _)| right < first);
        let end = columns.partition_point(|&(left, ..)| left <= last);
        for (x, &(left, right, part)) in (start..).zip(&columns[start..end]) {
            if row[left] + part * (row[right] - row[left]) >= least {
                mask.set(x as u32, y as u32, true);
            }
        }
    }
    mask
}
