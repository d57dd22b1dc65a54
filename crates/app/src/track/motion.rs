//! p(x_n | x_{n-1}): how a body goes on when no mask is seen.

use pf_core::scratch::with_buffer;
use pf_core::{Gaussian, ParticleRng, Proposal, Proposed, StateSpace as _};

use super::likelihood::Observation;
use super::state::{BodySpace, BodyState, RIGID_DIM};

/// Place and orientation walk at random. So do the coordinates of the pose, about where its model
/// [expects](super::pose_model::PoseModel::expected_step) them, as far as it expects anything.
#[derive(Clone, Debug)]
pub struct BodyMotion {
    noise: Gaussian,
    /// Standard deviations of the noise, `[dim]`.
    step_sd: Vec<f64>,
    /// A frame is so many sixtieths of a second long,
    frame_scale: f64,
    /// and noise is so many times that of the motion.
    diffusion: f64,
}

/// Expected steps and standard deviations of the coordinates of a pose.
struct Expected<'a> {
    step: &'a [f64],
    sd: &'a [f64],
}

impl BodyMotion {
    /// Motion with steps of `step_sd`, `[dim]`, of which those of the pose are replaced where its model knows better: by
    /// `diffusion` times its own, for frames of `frame_scale` sixtieths of a second.
    ///
    /// # Errors
    /// When a standard deviation is negative or not finite.
    pub fn new(step_sd: Vec<f64>, frame_scale: f64, diffusion: f64) -> Result<Self, pf_core::BadCovariance> {
        Ok(Self { noise: Gaussian::diagonal(step_sd.clone())?, step_sd, frame_scale, diffusion })
    }

    /// Calls `work` with what the model of the pose expects after `previous`, over one frame.
    fn with_expected<R>(
        &self,
        space: &BodySpace,
        previous: &BodyState,
        work: impl FnOnce(Option<Expected<'_>>) -> R,
    ) -> R {
        let dim = space.dim() - RIGID_DIM;
        with_buffer(2 * dim, |buffer| {
            let (step, sd) = buffer.split_at_mut(dim);
            if !space.model().expected_step(&previous.latent[..dim], step, sd) {
                return work(None);
            }
            step.iter_mut().for_each(|step| *step *= self.frame_scale);
            sd.iter_mut().for_each(|sd| *sd *= self.frame_scale * self.diffusion);
            work(Some(Expected { step, sd }))
        })
    }
}

impl Proposal<BodySpace> for BodyMotion {
    type Frame = Observation;

    fn propose(
        &self,
        space: &BodySpace,
        previous: &BodyState,
        _: &Observation,
        rng: &mut ParticleRng,
    ) -> Proposed<BodyState> {
        let mut state = *previous;
        with_buffer(space.dim(), |delta| {
            self.noise.sample(1.0, rng, delta);
            self.with_expected(space, previous, |expected| {
                let Some(Expected { step, sd }) = expected else { return };
                for (i, d) in delta[RIGID_DIM..].iter_mut().enumerate() {
                    *d = step[i] + sd[i] * *d / self.step_sd[RIGID_DIM + i];
                }
            });
            space.retract(&mut state, delta);
        });
        Proposed { state, log_correction: 0.0 }
    }

    fn log_motion_density(&self, space: &BodySpace, previous: &BodyState, state: &BodyState) -> Option<f64> {
        with_buffer(space.dim(), |delta| {
            space.local(previous, state, delta);
            let narrower = self.with_expected(space, previous, |expected| {
                let Some(Expected { step, sd }) = expected else { return 0.0 };
                let mut narrower = 0.0;
                for (i, d) in delta[RIGID_DIM..].iter_mut().enumerate() {
                    let ratio = self.step_sd[RIGID_DIM + i] / sd[i];
                    *d = (*d - step[i]) * ratio;
                    narrower += ratio.ln();
                }
                narrower
            });
            Some(self.noise.log_density(delta) + narrower)
        })
    }

    fn log_density(
        &self,
        space: &BodySpace,
        previous: &BodyState,
        _: &Observation,
        state: &BodyState,
    ) -> Option<f64> {
        self.log_motion_density(space, previous, state)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use pf_core::rng::{Draw, Purpose, particle_rng};

    use super::*;
    use crate::predict::Activity;
    use crate::track::latent_joints::LatentJoints;
    use crate::track::pose_model::PoseModel as _;
    use silhouette::Mask;

    /// Walkers, what is learned of how they go on, and one of them.
    fn walker() -> (BodySpace, BodyMotion, BodyState) {
        let (latent, prior) = (Activity::Walk.latent(), Activity::Walk.prior());
        let mean = latent.prior().components[0].mean.clone();
        let model = LatentJoints::new(latent, &prior);
        let step_sd: Vec<f64> =
            model.rigid_step_sd().iter().chain(model.step_sd()).map(|sd| 2.0 * sd).collect();
        let space = BodySpace::new(Arc::new(model));
        let mut state = space.state_from_pose(&crate::track::state::blank_pose());
        state.latent[..mean.len()].copy_from_slice(&mean);
        (space, BodyMotion::new(step_sd, 2.0, 1.0).unwrap(), state)
    }

    #[test]
    fn poses_are_drawn_about_where_they_are_expected() {
        let (space, motion, before) = walker();
        let dim = space.dim() - RIGID_DIM;
        let (mut step, mut sd) = (vec![0.0; dim], vec![0.0; dim]);
        assert!(space.model().expected_step(&before.latent[..dim], &mut step, &mut sd));
        let frame =
            Observation { mask: Mask::new(8, 8), cue: None, outline: None, travel: None, description: None };
        let n = 2_000;
        let mut mean = vec![0.0; dim];
        for particle in 0..n {
            let at = Draw { seed: 1, frame: 0, layer: 0, purpose: Purpose::User };
            let after = motion.propose(&space, &before, &frame, &mut particle_rng(at, particle)).state;
            mean.iter_mut().enumerate().for_each(|(d, mean)| {
                *mean += (after.latent[d] - before.latent[d]) / f64::from(n);
            });
        }
        for d in 0..dim {
            // Frames of two sixtieths: twice the step, twice the spread; five standard errors.
            let tolerance = 5.0 * 2.0 * sd[d] / f64::from(n).sqrt();
            assert!((mean[d] - 2.0 * step[d]).abs() < tolerance, "{mean:?}, expected twice {step:?}");
        }
    }

    #[test]
    fn the_density_is_that_of_the_draws() {
        let (space, motion, before) = walker();
        let dim = space.dim() - RIGID_DIM;
        let (mut step, mut sd) = (vec![0.0; dim], vec![0.0; dim]);
        space.model().expected_step(&before.latent[..dim], &mut step, &mut sd);
        let mut expected = before;
        (0..dim).for_each(|d| expected.latent[d] += 2.0 * step[d]);
        let mut off = expected;
        off.latent[1] += 2.0 * sd[1];
        let density = |state| motion.log_motion_density(&space, &before, state).unwrap();
        // One standard deviation off.
        assert!((density(&expected) - density(&off) - 0.5).abs() < 1e-6);
        let mut delta = vec![0.0; space.dim()];
        space.local(&before, &expected, &mut delta);
        let rigid: f64 = motion.step_sd[..RIGID_DIM].iter().map(|sd| sd.ln()).sum();
        let latent: f64 = sd.iter().map(|sd| (2.0 * sd).ln()).sum();
        let normal = -0.5 * space.dim() as f64 * std::f64::consts::TAU.ln();
        assert!((density(&expected) - (normal - rigid - latent)).abs() < 1e-6);
    }
}
