//! What segmentation does to a silhouette: an outline that is off, blobs, holes, a shadow, a lost limb.

use std::f64::consts::TAU;

use rand::{Rng, RngExt as _};
use silhouette::Mask;

/// The outline moves by a smooth field of this standard deviation, pixels at a figure of [`FIGURE_PX`],
const OUTLINE_SD_PX: f64 = 1.0;
/// whose waves are so long, in figures' heights.
const WAVELENGTHS: [f64; 2] = [0.06, 0.16];
const N_WAVES: usize = 6;
/// The height of figure that pixels above are meant for.
const FIGURE_PX: f64 = 340.0;
/// How often a mask has a hole, a shadow, a limb's end missing.
const HOLE_SHARE: f64 = 0.12;
const SHADOW_SHARE: f64 = 0.15;
const MISSING_SHARE: f64 = 0.05;

/// The person in `mask` as a segmenter might have found it, cut out with some room around. The waves of the outline,
/// ellipses and their sizes are drawn from `rng`.
pub fn segmentation_noise<R: Rng + ?Sized>(mask: &Mask, rng: &mut R) -> Mask {
    let Some(person) = mask.bounding_box() else { return mask.clone() };
    let person = mask.crop(person);
    let height = f64::from(person.height());
    let margin = (0.1 * height).ceil();
    let (middle_x, bottom) = (margin + f64::from(person.width()) / 2.0, margin + height);
    let unit = height / FIGURE_PX;
    let mut uniform = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
    let [width, rows] = [person.width(), person.height()].map(|length| length + 2 * margin as u32);
    let amplitude = OUTLINE_SD_PX * unit * 2.0 / (N_WAVES as f64).sqrt();
    let waves: Vec<Wave> = (0..N_WAVES)
        .map(|_| {
            let direction = uniform(0.0, TAU);
            let frequency = TAU / (height * uniform(WAVELENGTHS[0], WAVELENGTHS[1]));
            let phase = uniform(0.0, TAU);
            let push = uniform(0.0, TAU);
            let along = |length: u32, step: f64, phase: f64| -> Vec<[f64; 2]> {
                (0..length).map(|i| (step * f64::from(i) + phase).sin_cos().into()).collect()
            };
            Wave {
                columns: along(width, frequency * direction.cos(), phase),
                rows: along(rows, frequency * direction.sin(), 0.0),
                push: [amplitude * push.cos(), amplitude * push.sin()],
            }
        })
        .collect();
    let mut blobs: Vec<(Ellipse, bool)> = Vec::new();
    if uniform(0.0, 1.0) < SHADOW_SHARE {
        for _ in 0..2 {
            let center = [middle_x + uniform(-0.2, 0.2) * height, bottom - uniform(0.0, 0.03) * height];
            blobs.push((Ellipse { center, radii: [uniform(0.05, 0.14) * height, 0.02 * height] }, true));
        }
    }
    if uniform(0.0, 1.0) < HOLE_SHARE {
        let center = [middle_x + uniform(-0.06, 0.06) * height, bottom - uniform(0.45, 0.8) * height];
        let radius = uniform(2.0, 6.0) * unit;
        blobs.push((Ellipse { center, radii: [radius; 2] }, false));
    }
    if uniform(0.0, 1.0) < MISSING_SHARE {
        let center = [middle_x + uniform(-0.2, 0.2) * height, bottom - uniform(0.0, 0.6) * height];
        let radius = uniform(0.03, 0.06) * height;
        blobs.push((Ellipse { center, radii: [radius; 2] }, false));
    }
    Mask::from_fn(width, rows, |x, y| {
        let p = [f64::from(x) + 0.5, f64::from(y) + 0.5];
        if let Some((_, is_person)) = blobs.iter().rev().find(|(blob, _)| blob.contains(p)) {
            return *is_person;
        }
        // Where this pixel looks into the clean mask.
        let mut at = p.map(|v| v - margin);
        for wave in &waves {
            let height = wave.height(x, y);
            at[0] += wave.push[0] * height;
            at[1] += wave.push[1] * height;
        }
        person.get_or_background(at[0].floor() as i64, at[1].floor() as i64)
    })
}

/// A plane wave by columns and rows: sin(a + b) = sin a cos b + cos a sin b.
struct Wave {
    /// Sine and cosine of its phase.
    columns: Vec<[f64; 2]>,
    rows: Vec<[f64; 2]>,
    /// Where it pushes a pixel, pixels.
    push: [f64; 2],
}

impl Wave {
    fn height(&self, x: u32, y: u32) -> f64 {
        let ([sin_x, cos_x], [sin_y, cos_y]) = (self.columns[x as usize], self.rows[y as usize]);
        sin_x * cos_y + cos_x * sin_y
    }
}

struct Ellipse {
    center: [f64; 2],
    radii: [f64; 2],
}

impl Ellipse {
    fn contains(&self, p: [f64; 2]) -> bool {
        let square = |axis: usize| ((p[axis] - self.center[axis]) / self.radii[axis]).powi(2);
        square(0) + square(1) <= 1.0
    }
}

#[cfg(test)]
mod tests {
    use pf_core::rng::{Draw, Purpose, particle_rng};

    use super::*;

    #[test]
    fn noise_moves_the_outline_by_a_pixel_and_now_and_then_more() {
        let person = Mask::from_fn(200, 400, |x, y| (60..140).contains(&x) && (30..370).contains(&y));
        let (mut worst, mut mean) = (1.0_f64, 0.0);
        for frame in 0..60 {
            let at = Draw { seed: 1, frame, layer: 0, purpose: Purpose::User };
            let noisy = segmentation_noise(&person, &mut particle_rng(at, 0));
            assert_eq!(noisy, segmentation_noise(&person, &mut particle_rng(at, 0)));
            // Its margin is a tenth of the figure's height.
            let placed = Mask::from_fn(200, 400, |x, y| {
                noisy.get_or_background(i64::from(x) - 60 + 34, i64::from(y) - 30 + 34)
            });
            let iou = placed.iou(&person);
            mean += iou / 60.0;
            worst = worst.min(iou);
        }
        // A pixel all around changes 3 % of this figure's area.
        assert!((0.94..0.99).contains(&mean), "mean IoU {mean}");
        // A lost limb or a shadow changes some percent more.
        assert!(worst < mean - 0.01, "worst {worst}, mean {mean}");
    }

    #[test]
    fn an_empty_mask_stays_empty() {
        let at = Draw { seed: 1, frame: 0, layer: 0, purpose: Purpose::User };
        assert!(segmentation_noise(&Mask::new(20, 20), &mut particle_rng(at, 0)).is_empty());
    }
}
