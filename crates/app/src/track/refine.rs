//! A pose brought onto the outline of the mask by local optimisation: what is left to do when the particles have found
//! the right valley.
//!
//! A few hundred particles in fifty dimensions stop a centimetre short of the best pose. A few Gauss-Newton steps on the
//! distances between the rim of the body and the outline of the mask, under the prior over joint angles and with the lower
//! foot on the floor, close that gap; particles moved by an optimiser are those of the smart particle filter `[Bray2007]`.

use body::{Body, BodyModel, Camera, Pose};
use glam::DVec3;

use super::pose_model::FreeJoints;
use crate::shape::adjust::{AdjustConfig, Adjuster, View};
use crate::shape::figure::{Figure, Rest};
use crate::shape::rim::Seen;

/// Heights of the lowest sole above the floor have this standard deviation, metres: feet leave it.
const FLOOR_SD_M: f64 = 0.02;
/// Farther from the floor than this, metres, nobody stands on it.
const FLOOR_GATE_M: f64 = 0.08;

/// Refines poses of one body.
pub struct Refiner {
    figure: Figure,
    rest: Rest,
    prior: FreeJoints,
}

impl Refiner {
    /// A refiner for `body` under a prior over its joint angles.
    pub fn new(body: &Body, prior: FreeJoints) -> Self {
        let wide = |vertex: &[f32; 3]| DVec3::from_array(vertex.map(f64::from));
        let rest =
            Rest { vertices: body.rest_vertices().iter().map(wide).collect(), joints: *body.rest_joints() };
        // The shape stays: one coefficient, which nothing moves.
        Self { figure: Figure::new(&BodyModel::builtin(), 1), rest, prior }
    }

    /// The pose after `steps` steps from `pose` towards an outline in the image of `camera`.
    pub fn refine(&self, camera: &Camera, seen: &Seen, pose: &Pose, steps: usize) -> Pose {
        let config = AdjustConfig {
            floor_m: [0.0, FLOOR_SD_M],
            floor_gate_m: FLOOR_GATE_M,
            ..AdjustConfig::default()
        };
        let adjuster = Adjuster::with_pose_prior(
            &self.figure,
            camera,
            config,
            self.prior.mean(),
            self.prior.precision().clone(),
        );
        let view = View { seen, pose: pose.clone(), weight: 1.0 };
        adjuster.adjust_pose(&view, &self.rest, steps).0
    }
}
