//! How particles move between annealing layers: diffusion of one body part at a time, exchange of parts between particles,
//! and now and then a jump to where a silhouette is as good.
//!
//! In 55 dimensions noise on all of them at once spoils a particle whose trunk is right and whose arm is not; noise on a
//! part keeps the rest. Exchange of parts is the crossover operator of `[Deutscher2005]` section 5. A silhouette does not tell whether a limb points towards the camera or away from it, and hardly how far away the whole
//! body is. Diffusion does not cross from one reading to the other; these moves do.

use std::cell::RefCell;
use std::sync::Arc;

use body::{Body, Pose};
use glam::DVec3;
use pf_core::{LayerStep, Mutation, ParticleRng, StateSpace as _};

use pf_core::scratch::with_buffer;

use super::likelihood::Observation;
use super::limb::{LIMBS, Part, mirror_limb};
use super::start::lowest_sole_m;
use super::state::{BodySpace, BodyState, RIGID_DIM, blank_pose};

/// The moves of one layer; shares are of the particles, and of what is left of them after the line before.
pub struct BodyMoves {
    /// Standard deviation of each coordinate's step, `[dim]`, before the factor of the layer.
    pub step_sd: Vec<f64>,
    /// Body whose limbs are mirrored.
    pub body: Arc<Body>,
    /// Centre of projection, metres, world.
    pub camera_centre: DVec3,
    /// Share that takes a part from another survivor before it diffuses.
    pub exchange_share: f64,
    /// Share that diffuses in one part only.
    pub part_share: f64,
    /// Share that mirrors a limb in depth.
    pub mirror_share: f64,
    /// Share that is put on the floor.
    pub ground_share: f64,
    /// The survivors of the layer, kept for exchanges.
    pub survivors: Vec<BodyState>,
}

thread_local! {
    /// Room for the pose of the particle that is moved.
    static POSE: RefCell<Pose> = RefCell::new(blank_pose());
}

impl Mutation<BodySpace, Observation> for BodyMoves {
    fn prepare(&mut self, _space: &BodySpace, survivors: &[BodyState], _step: &LayerStep) {
        self.survivors.clear();
        self.survivors.extend_from_slice(survivors);
    }

    fn mutate(
        &self,
        space: &BodySpace,
        _frame: &Observation,
        step: &LayerStep,
        state: &mut BodyState,
        rng: &mut ParticleRng,
    ) {
        let parts = space.model().parts();
        if !parts.is_empty() && rng.uniform() < self.exchange_share {
            let other = &self.survivors[pick(rng, self.survivors.len())];
            for &coordinate in &parts[pick(rng, parts.len())] {
                state.latent[coordinate] = other.latent[coordinate];
            }
        }
        self.diffuse(space, step.diffusion_scale, state, rng);
        let choice = rng.uniform();
        if choice < self.mirror_share {
            let part = [Part::Whole, Part::Lower][pick(rng, 2)];
            let limb = &LIMBS[pick(rng, LIMBS.len())];
            POSE.with_borrow_mut(|pose| {
                space.pose_into(state, pose);
                mirror_limb(pose, self.body.rest_joints(), limb, part, self.camera_centre);
                *state = space.state_from_pose(pose);
            });
        } else if choice < self.mirror_share + self.ground_share {
            let sole_m = POSE.with_borrow_mut(|pose| {
                space.pose_into(state, pose);
                lowest_sole_m(&self.body.joints_world(pose), self.body.rest_joints())
            });
            state.position.z -= sole_m;
        }
    }
}

impl BodyMoves {
    /// Gaussian noise on the rigid part and one part of the body, or on everything.
    fn diffuse(&self, space: &BodySpace, scale: f64, state: &mut BodyState, rng: &mut ParticleRng) {
        let parts = space.model().parts();
        let only = (!parts.is_empty() && rng.uniform() < self.part_share).then(|| pick(rng, parts.len() + 1));
        with_buffer(self.step_sd.len(), |delta| {
            rng.fill_standard_normal(delta);
            for (d, sd) in delta.iter_mut().zip(&self.step_sd) {
                *d *= scale * sd;
            }
            if let Some(only) = only {
                // The rigid part is the last of the choices.
                let (rigid, latent) = delta.split_at_mut(RIGID_DIM);
                for (_, part) in parts.iter().enumerate().filter(|(part, _)| *part != only) {
                    part.iter().for_each(|&coordinate| latent[coordinate] = 0.0);
                }
                if only != parts.len() {
                    rigid.fill(0.0);
                }
            }
            space.retract(state, delta);
        });
    }
}

/// A number below `n`, each as likely.
fn pick(rng: &mut ParticleRng, n: usize) -> usize {
    ((rng.uniform() * n as f64) as usize).min(n - 1)
}

#[cfg(test)]
mod tests {
    use body::BodyModel;
    use body::pose_prior::PosePrior;
    use pf_core::rng::{Draw, Purpose, particle_rng};
    use silhouette::Mask;

    use super::*;
    use crate::track::pose_model::{FreeJoints, Widening};

    /// A body that floats, after a layer of this share of floor moves and no noise.
    fn moved(ground_share: f64) -> (BodyState, f64) {
        let widening = Widening { factor: 1.3, least_sd: 0.06, least_step: 0.006, frees_clavicles: true };
        let space = BodySpace::new(Arc::new(FreeJoints::new(&PosePrior::builtin(), widening)));
        let body = Arc::new(BodyModel::builtin().mean());
        let moves = BodyMoves {
            step_sd: vec![0.0; space.dim()],
            body: body.clone(),
            camera_centre: DVec3::new(0.0, -5.0, 1.5),
            exchange_share: 0.0,
            part_share: 0.0,
            mirror_share: 0.0,
            ground_share,
            survivors: Vec::new(),
        };
        let mut state = space.state_from_pose(&Pose::upright(DVec3::new(0.3, 0.2, 1.4), 0.5));
        let frame =
            Observation { mask: Mask::new(8, 8), cue: None, outline: None, travel: None, description: None };
        let step = LayerStep { layer: 0, layers: 1, diffusion_scale: 1.0 };
        let at = Draw { seed: 1, frame: 0, layer: 0, purpose: Purpose::User };
        moves.mutate(&space, &frame, &step, &mut state, &mut particle_rng(at, 0));
        let sole_m = lowest_sole_m(&body.joints_world(&space.pose(&state)), body.rest_joints());
        (state, sole_m)
    }

    #[test]
    fn the_floor_move_puts_the_lowest_sole_on_the_floor_and_moves_nothing_else() {
        let ((floating, height_m), (standing, sole_m)) = (moved(0.0), moved(1.0));
        assert!(height_m > 0.2 && sole_m.abs() < 1e-9, "from {height_m} to {sole_m}");
        assert!((floating.position.z - standing.position.z - height_m).abs() < 1e-9);
        assert_eq!(floating.position.truncate(), standing.position.truncate());
        assert_eq!((floating.orientation, floating.latent), (standing.orientation, standing.latent));
    }
}
