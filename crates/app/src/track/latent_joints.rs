//! Joint angles from the few coordinates of a spectral latent variable model, as in `[Kanaujia2014]`.

use body::pose_prior::PosePrior;
use pf_core::scratch::with_buffer;

use super::pose_model::{PoseModel, STEP_RATE_HZ, captured_rigid_step_sd, clamp_angles};
use super::state::RIGID_DIM;
use crate::predict::LatentPoses;

/// Coordinates may leave the range of the training by this share of it on either side.
const MARGIN: f64 = 0.1;

/// The poses of [`LatentPoses`]: every coordinate moves the whole body, and none leaves what was recorded.
///
/// Unlike other models' coordinates, those of angles are the most likely ones only: they come back to the joint angles up to
/// what the latent poses leave out.
pub struct LatentJoints {
    latent: LatentPoses,
    step_sd: Vec<f64>,
    rigid_step_sd: [f64; RIGID_DIM],
    mean_angles: Vec<f64>,
}

impl LatentJoints {
    /// The model over `latent` poses; the steps of the pelvis and the mean pose are those of `prior`.
    pub fn new(latent: LatentPoses, prior: &PosePrior) -> Self {
        let per_step = latent.frame_rate_hz() / STEP_RATE_HZ;
        let step_sd = latent.step_sd().iter().map(|sd| per_step * sd).collect();
        let rigid_step_sd = captured_rigid_step_sd(prior);
        Self { latent, step_sd, rigid_step_sd, mean_angles: prior.mean_rad().to_vec() }
    }
}

impl PoseModel for LatentJoints {
    fn dim(&self) -> usize {
        self.latent.dim()
    }

    fn angles_from_latent(&self, latent: &[f64], angles: &mut [f64]) {
        self.latent.angles_into(latent, angles);
        clamp_angles(angles);
    }

    fn latent_from_angles(&self, angles: &[f64], latent: &mut [f64]) {
        latent.copy_from_slice(&self.latent.coordinates(angles));
        self.clamp(latent);
    }

    fn clamp(&self, latent: &mut [f64]) {
        for (x, [low, high]) in latent.iter_mut().zip(self.latent.range()) {
            let margin = MARGIN * (high - low);
            *x = x.clamp(low - margin, high + margin);
        }
    }

    /// ln p of the mixture of normal distributions over the latent points.
    fn log_prior(&self, latent: &[f64]) -> f64 {
        let prior = self.latent.prior();
        with_buffer(prior.components.len(), |room| prior.log_density_in(latent, room))
    }

    fn step_sd(&self) -> &[f64] {
        &self.step_sd
    }

    fn rigid_step_sd(&self) -> [f64; RIGID_DIM] {
        self.rigid_step_sd
    }

    fn mean_angles(&self) -> &[f64] {
        &self.mean_angles
    }

    fn expected_step(&self, latent: &[f64], step: &mut [f64], sd: &mut [f64]) -> bool {
        self.latent.dynamics().step_into(latent, step, sd);
        let per_step = self.latent.frame_rate_hz() / STEP_RATE_HZ;
        step.iter_mut().for_each(|step| *step *= per_step);
        sd.iter_mut().for_each(|variance| *variance = per_step * variance.sqrt());
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::predict::Activity;
    use body::{N_DOF, Skeleton};

    fn walkers() -> LatentJoints {
        LatentJoints::new(Activity::Walk.latent(), &Activity::Walk.prior())
    }

    #[test]
    fn poses_of_all_coordinates_are_within_limits_and_come_back() {
        let model = walkers();
        let mut angles = vec![0.0; N_DOF];
        let mut off_deg = 0.0;
        let components = model.latent.prior().components.clone();
        for component in &components {
            let mut point = component.mean.clone();
            model.clamp(&mut point);
            model.angles_from_latent(&point, &mut angles);
            let limits = Skeleton::human().dofs().iter().map(|dof| dof.limits_rad);
            assert!(angles.iter().zip(limits).all(|(angle, [low, high])| (low..=high).contains(angle)));
            let (mut back, mut again) = (vec![0.0; model.dim()], vec![0.0; N_DOF]);
            model.latent_from_angles(&angles, &mut back);
            model.angles_from_latent(&back, &mut again);
            let differences = angles.iter().zip(&again).map(|(a, b)| (a - b).abs().to_degrees());
            off_deg += differences.sum::<f64>() / (N_DOF * components.len()) as f64;
        }
        assert!(off_deg < 1.0, "{off_deg} degrees");
    }

    #[test]
    fn coordinates_that_nobody_showed_are_brought_back_once() {
        let model = walkers();
        let mut far = vec![1e3; model.dim()];
        model.clamp(&mut far);
        let once = far.clone();
        model.clamp(&mut far);
        assert_eq!(far, once);
        let near = &model.latent.prior().components[0].mean;
        assert!(model.log_prior(&once) < model.log_prior(near) - 5.0);
        assert!((model.log_prior(near) - model.latent.prior().log_density(near)).abs() < 1e-9);
    }
}
