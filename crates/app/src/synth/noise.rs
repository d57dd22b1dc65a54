//! What background subtraction does to a silhouette: a wandering outline, missing parts, holes, shadows, speckle.

use std::f64::consts::TAU;
use std::ops::Range;

use body::{Camera, JointId, N_JOINTS};
use glam::{DVec2, DVec3};
use pf_core::rng::ParticleRng;
use silhouette::{DistanceField, Mask};

use super::polygon;

/// How often each effect is seen and how strong it is. Durations are ranges in seconds, sizes in pixels or metres.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseConfig {
    /// Standard deviation of the outline's displacement, and its largest value.
    pub outline_sd_px: f64,
    /// See [`outline_sd_px`](Self::outline_sd_px).
    pub outline_most_px: f64,
    /// Side of the cells over which the displacement changes,
    pub outline_cell_px: f64,
    /// and their duration.
    pub outline_cell_secs: f64,
    /// Share of the frames on which a piece of a lower leg or forearm is gone, and for how long.
    pub missing_share: f64,
    /// See [`missing_share`](Self::missing_share).
    pub missing_secs: [f64; 2],
    /// Share of the frames with holes in the body, and for how long.
    pub holes_share: f64,
    /// See [`holes_share`](Self::holes_share).
    pub holes_secs: [f64; 2],
    /// Share of the frames on which two patches of floor by the feet count as body, and for how long.
    pub shadow_share: f64,
    /// See [`shadow_share`](Self::shadow_share).
    pub shadow_secs: [f64; 2],
    /// Largest number of specks on a frame; the number is uniform from 0.
    pub most_specks: u32,
}

impl Default for NoiseConfig {
    fn default() -> Self {
        Self {
            outline_sd_px: 1.0,
            outline_most_px: 3.0,
            outline_cell_px: 18.0,
            outline_cell_secs: 8.0 / 60.0,
            missing_share: 0.05,
            missing_secs: [3.0 / 60.0, 9.0 / 60.0],
            holes_share: 0.12,
            holes_secs: [2.0 / 60.0, 6.0 / 60.0],
            shadow_share: 0.15,
            shadow_secs: [12.0 / 60.0, 40.0 / 60.0],
            most_specks: 4,
        }
    }
}

/// The mean of the squares of the weights of linear interpolation between two nodes, over all places between them.
const INTERPOLATED_VARIANCE: f64 = 2.0 / 3.0;
/// Length of a limb's piece that goes missing, as a share of the limb, and half its breadth, metres.
const MISSING_LENGTH: f64 = 0.45;
const MISSING_RADIUS_M: f64 = 0.09;
const HOLE_RADIUS_PX: [f64; 2] = [2.0, 6.0];
const SHADOW_LENGTH_M: [f64; 2] = [0.15, 0.35];
const SHADOW_BREADTH_M: [f64; 2] = [0.06, 0.12];
const SPECK_RADIUS_PX: [f64; 2] = [1.0, 4.0];
/// Corners of an ellipse.
const N_CORNERS: u32 = 24;

/// Noise of one clip.
pub struct Noise {
    config: NoiseConfig,
    rng: ParticleRng,
    rate_hz: f64,
    missing: Vec<(Range<usize>, Missing)>,
    holes: Vec<(Range<usize>, Vec<Hole>)>,
    shadows: Vec<(Range<usize>, [Patch; 2])>,
    /// Standard normal displacements at the nodes of the cells of two layers of time: the cell's number and its nodes.
    layers: [(usize, Vec<f64>); 2],
}

/// A piece of a limb: its joints, and where along it the piece begins.
#[derive(Clone, Copy, Debug)]
struct Missing {
    from: JointId,
    to: JointId,
    start: f64,
}

/// An ellipse at a place of the bounding box.
#[derive(Clone, Copy, Debug)]
struct Hole {
    place: [f64; 2],
    radii_px: [f64; 2],
    turn_rad: f64,
}

/// An ellipse on the floor that begins at a foot.
#[derive(Clone, Copy, Debug)]
struct Patch {
    foot: JointId,
    length_m: f64,
    breadth_m: f64,
    heading_rad: f64,
}

impl Noise {
    /// The noise of a clip of `n_frames`.
    pub fn new(config: NoiseConfig, n_frames: usize, rate_hz: f64, mut rng: ParticleRng) -> Self {
        const LIMBS: [(JointId, JointId); 4] = [
            (JointId::LEFT_KNEE, JointId::LEFT_ANKLE),
            (JointId::RIGHT_KNEE, JointId::RIGHT_ANKLE),
            (JointId::LEFT_ELBOW, JointId::LEFT_WRIST),
            (JointId::RIGHT_ELBOW, JointId::RIGHT_WRIST),
        ];
        let events = |rng: &mut ParticleRng, share, secs| events(rng, n_frames, rate_hz, share, secs);
        let missing = events(&mut rng, config.missing_share, config.missing_secs).into_iter().map(|frames| {
            let (from, to) = LIMBS[(rng.uniform() * LIMBS.len() as f64) as usize];
            (frames, Missing { from, to, start: (1.0 - MISSING_LENGTH) * rng.uniform() })
        });
        let missing = missing.collect();
        let holes = events(&mut rng, config.holes_share, config.holes_secs).into_iter().map(|frames| {
            let n_holes = 1 + (3.0 * rng.uniform()) as usize;
            let holes = (0..n_holes).map(|_| Hole {
                place: [between(&mut rng, [0.3, 0.7]), between(&mut rng, [0.1, 0.9])],
                radii_px: [between(&mut rng, HOLE_RADIUS_PX), between(&mut rng, HOLE_RADIUS_PX)],
                turn_rad: between(&mut rng, [0.0, TAU]),
            });
            (frames, holes.collect())
        });
        let holes = holes.collect();
        let shadows = events(&mut rng, config.shadow_share, config.shadow_secs).into_iter().map(|frames| {
            let heading_rad = between(&mut rng, [0.0, TAU]);
            let patches = [JointId::LEFT_BALL, JointId::RIGHT_BALL].map(|foot| Patch {
                foot,
                length_m: between(&mut rng, SHADOW_LENGTH_M),
                breadth_m: between(&mut rng, SHADOW_BREADTH_M),
                heading_rad,
            });
            (frames, patches)
        });
        let shadows = shadows.collect();
        let layers = [(usize::MAX, Vec::new()), (usize::MAX, Vec::new())];
        Self { config, rng, rate_hz, missing, holes, shadows, layers }
    }

    /// The silhouette `clean` of frame `index` with all that is wrong on it. Frames must come in order.
    /// `joints_world`: metres, world.
    pub fn observe(
        &mut self,
        index: usize,
        clean: &Mask,
        camera: &Camera,
        joints_world: &[DVec3; N_JOINTS],
    ) -> Mask {
        let mut mask = self.wander(index, clean);
        for (_, missing) in self.missing.iter().filter(|(frames, _)| frames.contains(&index)) {
            missing.apply(&mut mask, camera, joints_world);
        }
        for (_, holes) in self.holes.iter().filter(|(frames, _)| frames.contains(&index)) {
            holes.iter().for_each(|hole| hole.apply(&mut mask, clean));
        }
        for (_, patches) in self.shadows.iter().filter(|(frames, _)| frames.contains(&index)) {
            patches.iter().for_each(|patch| patch.apply(&mut mask, camera, joints_world));
        }
        let n_specks = (self.rng.uniform() * f64::from(self.config.most_specks + 1)) as u32;
        for _ in 0..n_specks {
            let centre = DVec2::new(
                self.rng.uniform() * f64::from(mask.width()),
                self.rng.uniform() * f64::from(mask.height()),
            );
            let radius_px = between(&mut self.rng, SPECK_RADIUS_PX);
            polygon::fill(&mut mask, &ellipse(centre, [radius_px; 2], 0.0), true);
        }
        mask
    }

    /// The mask with its outline moved in and out by a field that is smooth over the image and over time.
    fn wander(&mut self, index: usize, clean: &Mask) -> Mask {
        let most_px = self.config.outline_most_px;
        let Some(field) = DistanceField::of(clean, most_px.ceil() as u32 + 1) else { return clean.clone() };
        let at = index as f64 / self.rate_hz / self.config.outline_cell_secs;
        let (cell, share) = (at.floor() as usize, at.fract());
        let columns = (f64::from(clean.width()) / self.config.outline_cell_px).ceil() as usize + 1;
        let rows = (f64::from(clean.height()) / self.config.outline_cell_px).ceil() as usize + 1;
        self.enter(cell, columns * rows);
        let [(_, before), (_, after)] = &self.layers;
        let sd_px = self.config.outline_sd_px * INTERPOLATED_VARIANCE.powi(3).sqrt().recip();
        let node = |column: usize, row: usize| {
            let k = row * columns + column;
            before[k] + share * (after[k] - before[k])
        };
        let mut mask = clean.clone();
        let rect = field.rect();
        for y in rect.y0..rect.y1 {
            for x in rect.x0..rect.x1 {
                let distance_px = f64::from(field.at_pixel(x, y));
                if distance_px.abs() > most_px {
                    continue;
                }
                let (u, v) =
                    (f64::from(x) / self.config.outline_cell_px, f64::from(y) / self.config.outline_cell_px);
                let (column, row) = (u as usize, v as usize);
                let (du, dv) = (u.fract(), v.fract());
                let top = node(column, row) + du * (node(column + 1, row) - node(column, row));
                let bottom = node(column, row + 1) + du * (node(column + 1, row + 1) - node(column, row + 1));
                let moved_px = (sd_px * (top + dv * (bottom - top))).clamp(-most_px, most_px);
                mask.set(x, y, distance_px < moved_px);
            }
        }
        mask
    }

    /// Makes the nodes of cell `cell` of time and of the next one ready.
    fn enter(&mut self, cell: usize, n_nodes: usize) {
        while self.layers[0].0 != cell {
            let next = if self.layers[1].0 == usize::MAX { cell } else { self.layers[1].0 + 1 };
            let mut nodes = vec![0.0; n_nodes];
            self.rng.fill_standard_normal(&mut nodes);
            self.layers.swap(0, 1);
            self.layers[1] = (next, nodes);
        }
    }
}

impl Missing {
    fn apply(&self, mask: &mut Mask, camera: &Camera, joints_world: &[DVec3; N_JOINTS]) {
        let (from, to) = (joints_world[self.from.index()], joints_world[self.to.index()]);
        let at = |share: f64| camera.project(from.lerp(to, share));
        let (Some(start), Some(end)) = (at(self.start), at(self.start + MISSING_LENGTH)) else { return };
        let depth_m = camera.camera_from_world().transform_point3(from).z;
        let radius_px = MISSING_RADIUS_M * camera.intrinsics().focal_px[0] / depth_m;
        let along = (end - start).normalize_or(DVec2::Y);
        let across = radius_px * along.perp();
        let corners = [start + across, end + across, end - across, start - across];
        polygon::fill(mask, &corners.map(|corner| corner.to_array()), false);
    }
}

impl Hole {
    fn apply(&self, mask: &mut Mask, clean: &Mask) {
        let Some(person) = clean.bounding_box() else { return };
        let centre = DVec2::new(
            f64::from(person.x0) + self.place[0] * f64::from(person.width()),
            f64::from(person.y0) + self.place[1] * f64::from(person.height()),
        );
        polygon::fill(mask, &ellipse(centre, self.radii_px, self.turn_rad), false);
    }
}

impl Patch {
    fn apply(&self, mask: &mut Mask, camera: &Camera, joints_world: &[DVec3; N_JOINTS]) {
        let ahead = DVec2::from_angle(self.heading_rad);
        let middle = joints_world[self.foot.index()].truncate() + 0.5 * self.length_m * ahead;
        let corners = (0..N_CORNERS).map(|k| {
            let (sin, cos) = (f64::from(k) * TAU / f64::from(N_CORNERS)).sin_cos();
            let place = middle + 0.5 * self.length_m * cos * ahead + self.breadth_m * sin * ahead.perp();
            camera.project(place.extend(0.0)).map(|pixel| pixel.to_array())
        });
        if let Some(corners) = corners.collect::<Option<Vec<_>>>() {
            polygon::fill(mask, &corners, true);
        }
    }
}

/// Stretches of frames that together are about `share` of all.
fn events(
    rng: &mut ParticleRng,
    n_frames: usize,
    rate_hz: f64,
    share: f64,
    secs: [f64; 2],
) -> Vec<Range<usize>> {
    let mean_frames = (0.5 * (secs[0] + secs[1]) * rate_hz).max(1.0);
    let mut found = Vec::new();
    let mut frame = 0;
    while frame < n_frames {
        if rng.uniform() < share / mean_frames {
            let length = (between(rng, secs) * rate_hz).round().max(1.0) as usize;
            found.push(frame..frame + length);
            frame += length;
        } else {
            frame += 1;
        }
    }
    found
}

fn between(rng: &mut ParticleRng, [low, high]: [f64; 2]) -> f64 {
    low + (high - low) * rng.uniform()
}

fn ellipse(centre: DVec2, radii_px: [f64; 2], turn_rad: f64) -> Vec<[f64; 2]> {
    let axis = DVec2::from_angle(turn_rad);
    let corner = |k: u32| {
        let (sin, cos) = (f64::from(k) * TAU / f64::from(N_CORNERS)).sin_cos();
        (centre + radii_px[0] * cos * axis + radii_px[1] * sin * axis.perp()).to_array()
    };
    (0..N_CORNERS).map(corner).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use pf_core::rng::{Draw, Purpose, particle_rng};

    const N_FRAMES: usize = 300;

    fn camera() -> Camera {
        let intrinsics = body::Intrinsics::from_focal(320, 240, 350.0).unwrap();
        Camera::look_at(intrinsics, DVec3::new(0.0, -4.0, 1.5), DVec3::new(0.0, 0.0, 0.9)).unwrap()
    }

    fn noisy(config: NoiseConfig) -> (Mask, Vec<Mask>) {
        let clean = Mask::from_fn(320, 240, |x, y| (100..220).contains(&x) && (40..200).contains(&y));
        let rng = particle_rng(Draw { seed: 3, frame: 0, layer: 0, purpose: Purpose::User }, 0);
        let mut noise = Noise::new(config, N_FRAMES, 60.0, rng);
        let joints = [DVec3::new(0.0, 0.0, 0.3); N_JOINTS];
        let masks = (0..N_FRAMES).map(|index| noise.observe(index, &clean, &camera(), &joints)).collect();
        (clean, masks)
    }

    /// Nothing but the outline.
    fn outline_only() -> NoiseConfig {
        NoiseConfig {
            missing_share: 0.0,
            holes_share: 0.0,
            shadow_share: 0.0,
            most_specks: 0,
            ..NoiseConfig::default()
        }
    }

    #[test]
    fn the_outline_wanders_by_a_pixel_either_way() {
        let (_, masks) = noisy(outline_only());
        // Where the left edge lies on rows away from the corners.
        let edges: Vec<f64> = masks
            .iter()
            .step_by(8)
            .flat_map(|mask| {
                (60..180).step_by(18).map(|y| f64::from((80..120).find(|&x| mask.get(x, y)).unwrap()))
            })
            .collect();
        let mean = edges.iter().sum::<f64>() / edges.len() as f64;
        let sd = (edges.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / edges.len() as f64).sqrt();
        // 260 places that are nearly independent: 0.06 px of standard error; whole pixels add 0.29 px in square.
        assert!((mean - 100.0).abs() < 0.3, "{mean}");
        assert!((0.8..1.3).contains(&sd), "{sd}");
        assert!(edges.iter().all(|x| (x - 100.0).abs() <= 3.0));
    }

    #[test]
    fn events_are_as_frequent_as_asked() {
        for (share, config) in [
            (0.12, NoiseConfig { holes_share: 0.12, ..outline_only() }),
            (0.15, NoiseConfig { shadow_share: 0.15, ..outline_only() }),
        ] {
            let quiet = NoiseConfig { outline_most_px: 0.0, ..config };
            let (clean, masks) = noisy(quiet);
            let touched = masks.iter().filter(|mask| **mask != clean).count() as f64 / N_FRAMES as f64;
            assert!((0.3 * share..2.5 * share).contains(&touched), "{touched} instead of {share}");
        }
        let (clean, masks) = noisy(NoiseConfig { outline_most_px: 0.0, ..outline_only() });
        assert!(masks.iter().all(|mask| *mask == clean));
    }
}
