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

/// `mask` as a segmenter might have found it. The waves of the outline, ellipses and their sizes are drawn from `rng`.
pub fn segmentation_noise<R: Rng + ?Sized>(mask: &Mask, rng: &mut R) -> Mask {
    let Some(person) = mask.bounding_box() else { return mask.clone() };
    let height = f64::from(person.y1 - person.y0);
    let (middle_x, bottom) = (f64::from(person.x0 + person.x1) / 2.0, f64::from(person.y1));
    let unit = height / FIGURE_PX;
    let mut uniform = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
    // A sum of plane waves displaces where each pixel looks into the clean mask.
    let waves: Vec<[f64; 5]> = (0..N_WAVES)
        .map(|_| {
            let (direction, phase) = (uniform(0.0, TAU), uniform(0.0, TAU));
            let frequency = TAU / (height * uniform(WAVELENGTHS[0], WAVELENGTHS[1]));
            let push = uniform(0.0, TAU);
            [frequency * direction.cos(), frequency * direction.sin(), phase, push.cos(), push.sin()]
        })
        .collect();
    let amplitude = OUTLINE_SD_PX * unit * (2.0 / N_WAVES as f64).sqrt() * std::f64::consts::SQRT_2;
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
    Mask::from_fn(mask.width(), mask.height(), |x, y| {
        let p = [f64::from(x) + 0.5, f64::from(y) + 0.5];
        if let Some((_, is_person)) = blobs.iter().rev().find(|(blob, _)| blob.contains(p)) {
            return *is_person;
        }
        let (mut dx, mut dy) = (0.0, 0.0);
        for [kx, ky, phase, push_x, push_y] in &waves {
            let height = (kx * p[0] + ky * p[1] + phase).sin();
            dx += push_x * height;
            dy += push_y * height;
        }
        let at = [p[0] + amplitude * dx, p[1] + amplitude * dy].map(|v| v.floor() as i64);
        mask.get_or_background(at[0], at[1])
    })
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
