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

#[cfg(test)]
mod tests {
    use super::*;
    use body::pose_prior::PosePrior;
    use body::{Intrinsics, JointId, Sex};

    use crate::track::pose_model::Widening;
    use crate::train::render::render;

    /// The mask is that of a stouter man, so that the outline is not the body's own.
    #[test]
    fn a_pose_that_is_off_comes_back_to_the_outline() {
        let model = BodyModel::builtin();
        let body = model.shape_for_stature(1.76, Some(Sex::Male));
        let mut stouter = model.coefficients_for_stature(1.77, Some(Sex::Male));
        stouter[1] += 0.3;
        let widening = Widening { factor: 1.3, least_sd: 0.06, least_step: 0.006, frees_clavicles: true };
        let prior = FreeJoints::new(&PosePrior::builtin(), widening);
        let mut truth = Pose::upright(DVec3::new(0.1, 0.0, body.rest_joints()[0].y), 0.3);
        truth.angles.copy_from_slice(prior.mean());
        let camera = Camera::look_at(
            Intrinsics::from_focal(640, 480, 700.0).unwrap(),
            DVec3::new(0.0, -4.0, 1.5),
            DVec3::new(0.0, 0.0, 0.9),
        )
        .unwrap();
        let outline = Seen::of(&render(&model.shape(&stouter), &truth, &camera).unwrap()).unwrap();
        let mut off = truth.clone();
        off.root_position += DVec3::new(0.03, 0.0, 0.02);
        for angle in &mut off.angles {
            *angle += 0.06;
        }
        off.clamp();
        let found = Refiner::new(&body, prior).refine(&camera, &outline, &off, 6);
        // Across the line of sight, along the camera's x and z.
        let across_mm = |pose: &Pose| {
            let [own, true_joints] = [pose, &truth].map(|pose| body.joints_world(pose));
            let limbs = [JointId::LEFT_WRIST, JointId::RIGHT_WRIST, JointId::LEFT_ANKLE, JointId::HEAD];
            let off =
                limbs.map(|joint| (own[joint.index()] - true_joints[joint.index()]).with_y(0.0).length());
            1000.0 * off.iter().sum::<f64>() / off.len() as f64
        };
        let (before, after) = (across_mm(&off), across_mm(&found));
        assert!(before > 40.0 && after < 0.5 * before, "{before} mm before, {after} mm after");
    }
}
