//! What a mask alone says of the pose, in the tracker's coordinates: the density p_B(x|r) of the bottom-up predictor.

use std::f64::consts::FRAC_PI_3;

use glam::DVec3;
use pf_core::{Gaussian, ParticleRng, Proposal, Proposed, StateSpace as _};
use rand::Rng;
use silhouette::Mask;

use super::likelihood::Observation;
use super::state::{BodySpace, BodyState};
use crate::predict::PosePredictor;

/// Poses drawn from a prediction: enough to hold its few modes and their spread.
const N_CENTRES: usize = 96;
/// Modes of a prediction that a start tries, and about which its spread is taken.
const N_MODES: usize = 4;
/// Turns of the pelvis by less are the same way.
const SAME_WAY_RAD: f64 = FRAC_PI_3;
/// A prediction of which so much faces one way is sure of it.
const SURE_SHARE: f64 = 0.6;
/// Coordinates of the pelvis's place, which come first; a mask alone says nothing of it.
const N_PLACE: usize = 3;

/// p_B(x|r) as a kernel density: poses drawn from the predictor's mixture of experts, and noise about each. Where particles
/// come from it, the noise is that of one step: so it is a density over the same coordinates as the motion prior's, and the
/// two can be mixed. Where particles are judged by it, the kernels are as wide as few draws in many dimensions need.
#[derive(Clone, Debug)]
pub struct Cue {
    /// Orientations and pose coordinates; their positions mean nothing.
    centres: Vec<BodyState>,
    /// The highest modes, highest first; likewise.
    modes: Vec<BodyState>,
    /// Kernels of the density as evidence.
    kernel: Gaussian,
}

impl Cue {
    /// What `predictor` says of `mask`, seen along `sight` (a point in the world on the ray through the person) from
    /// `camera_centre`, metres. None when there is no person in the mask.
    pub fn new<R: Rng>(
        predictor: &PosePredictor,
        mask: &Mask,
        camera_centre: DVec3,
        sight: DVec3,
        space: &BodySpace,
        rng: &mut R,
    ) -> Option<Self> {
        let density = predictor.density(mask)?;
        let state =
            |viewed: &crate::predict::ViewedPose| space.state_from_pose(&viewed.pose(camera_centre, sight));
        let centres = (0..N_CENTRES).map(|_| state(&density.sample(rng))).collect();
        let modes = density.modes(N_MODES).iter().map(|mode| state(&mode.pose)).collect();
        Some(Self::from_draws(space, centres, modes))
    }

    fn from_draws(space: &BodySpace, centres: Vec<BodyState>, modes: Vec<BodyState>) -> Self {
        let kernel = kernel(space, &centres, &modes);
        Self { centres, modes, kernel }
    }

    /// The highest modes, highest first; positions mean nothing.
    pub fn modes(&self) -> &[BodyState] {
        &self.modes
    }

    /// Share of the density that faces as `state` does; none when the density itself is not sure which way the person faces.
    pub fn agreement(&self, state: &BodyState) -> Option<f64> {
        let is_sure = self.modes.iter().any(|mode| self.share_facing(mode) > SURE_SHARE);
        is_sure.then(|| self.share_facing(state))
    }

    /// Share of the density whose pelvis is turned nearly as that of `state`.
    fn share_facing(&self, state: &BodyState) -> f64 {
        let near = |centre: &&BodyState| centre.orientation.angle_between(state.orientation) < SAME_WAY_RAD;
        self.centres.iter().filter(near).count() as f64 / self.centres.len() as f64
    }

    /// ln p_B of the orientation and pose of `state`, with the kernels of evidence.
    pub fn log_evidence(&self, space: &BodySpace, state: &BodyState) -> f64 {
        self.log_density(space, state, &self.kernel)
    }

    /// ln p_B of the orientation and pose of `state`, with kernels of `noise` over all coordinates but the place.
    fn log_density(&self, space: &BodySpace, state: &BodyState, noise: &Gaussian) -> f64 {
        pf_core::scratch::with_buffer(space.dim(), |delta| {
            let mut largest = f64::NEG_INFINITY;
            let mut sum = 0.0;
            for centre in &self.centres {
                space.local(centre, state, delta);
                delta[..N_PLACE].fill(0.0);
                let log = noise.log_density(delta);
                if log > largest {
                    sum = sum * (largest - log).exp() + 1.0;
                    largest = log;
                } else {
                    sum += (log - largest).exp();
                }
            }
            largest + (sum / self.centres.len() as f64).ln()
        })
    }
}

/// Kernels for a density given by `centres`: as wide as the rule for normal data has it (`[Silverman1986]`, equation 4.14 for each
/// coordinate), and a step of a sixtieth of a second at least.
///
/// Deviation: the spread is that about the mode that each centre faces like, for predictions have several.
fn kernel(space: &BodySpace, centres: &[BodyState], modes: &[BodyState]) -> Gaussian {
    let [dim, n] = [space.dim() - N_PLACE, centres.len()].map(|count| count as f64);
    let factor = (4.0 / ((dim + 2.0) * n)).powf(1.0 / (dim + 4.0));
    let (rigid, latent) = (space.model().rigid_step_sd(), space.model().step_sd());
    let steps = rigid.iter().chain(latent);
    let spread = variance_within_modes(space, centres, modes);
    let sd =
        spread.iter().zip(steps).map(|(variance, step)| (factor * variance.sqrt()).hypot(*step)).collect();
    Gaussian::diagonal(sd).expect("draws are finite, and steps above zero")
}

/// Variance of the coordinates of `centres` but the place about the mean of those that face like the same mode, `[dim]`.
fn variance_within_modes(space: &BodySpace, centres: &[BodyState], modes: &[BodyState]) -> Vec<f64> {
    let dim = space.dim();
    let turn = |a: &BodyState, b: &BodyState| a.orientation.angle_between(b.orientation);
    let mut offsets: Vec<Vec<Vec<f64>>> = vec![Vec::new(); modes.len()];
    for centre in centres {
        let near =
            (0..modes.len()).min_by(|&a, &b| turn(&modes[a], centre).total_cmp(&turn(&modes[b], centre)));
        if let Some(mode) = near {
            let mut offset = vec![0.0; dim];
            space.local(&modes[mode], centre, &mut offset);
            offset[..N_PLACE].fill(0.0);
            offsets[mode].push(offset);
        }
    }
    let squares = |coordinate: usize| {
        let of_mode = |offsets: &Vec<Vec<f64>>| {
            let values = || offsets.iter().map(|offset| offset[coordinate]);
            let mean = values().sum::<f64>() / offsets.len().max(1) as f64;
            values().map(|value| (value - mean).powi(2)).sum::<f64>()
        };
        offsets.iter().map(of_mode).sum::<f64>()
    };
    (0..dim).map(|coordinate| squares(coordinate) / centres.len() as f64).collect()
}

/// Draws from the cue of the frame: the place from the motion, everything else from the prediction. Without a cue, from
/// the motion.
#[derive(Clone, Debug)]
pub struct BottomUp {
    /// Noise of one step of the motion.
    noise: Gaussian,
    /// The same for the place alone, and nothing for the rest.
    place_sd: [f64; N_PLACE],
}

impl BottomUp {
    /// The proposal with the steps of the motion, standard deviations `[dim]`.
    pub fn new(step_sd: &[f64], noise: Gaussian) -> Self {
        let place_sd = std::array::from_fn(|i| step_sd[i]);
        Self { noise, place_sd }
    }
}

impl Proposal<BodySpace> for BottomUp {
    type Frame = Observation;

    fn propose(
        &self,
        space: &BodySpace,
        previous: &BodyState,
        frame: &Observation,
        rng: &mut ParticleRng,
    ) -> Proposed<BodyState> {
        let mut state = *previous;
        if let Some(cue) = &frame.cue {
            let index = (rng.uniform() * cue.centres.len() as f64) as usize;
            let centre = &cue.centres[index.min(cue.centres.len() - 1)];
            state.orientation = centre.orientation;
            state.latent = centre.latent;
        }
        pf_core::scratch::with_buffer(space.dim(), |delta| {
            self.noise.sample(1.0, rng, delta);
            // The place steps in the pelvis frame of the particle it comes from.
            let place = DVec3::from_slice(&delta[..N_PLACE]);
            delta[..N_PLACE].fill(0.0);
            space.retract(&mut state, delta);
            state.position = previous.position + previous.orientation * place;
        });
        Proposed { state, log_correction: 0.0 }
    }

    fn log_density(
        &self,
        space: &BodySpace,
        previous: &BodyState,
        frame: &Observation,
        state: &BodyState,
    ) -> Option<f64> {
        pf_core::scratch::with_buffer(space.dim(), |delta| {
            space.local(previous, state, delta);
            let Some(cue) = &frame.cue else { return Some(self.noise.log_density(delta)) };
            // The kernels' density at a place of zero counts the place's norming constant; only its square is to be added.
            let place: f64 =
                delta[..N_PLACE].iter().zip(self.place_sd).map(|(d, sd)| -0.5 * (d / sd).powi(2)).sum();
            Some(place + cue.log_density(space, state, &self.noise))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::track::pose_model::{FreeJoints, Widening};
    use crate::track::state::RIGID_DIM;
    use body::pose_prior::PosePrior;
    use std::sync::Arc;

    fn space() -> BodySpace {
        let widening = Widening { factor: 1.3, least_sd: 0.06, least_step: 0.006, frees_clavicles: true };
        BodySpace::new(Arc::new(FreeJoints::new(&PosePrior::builtin(), widening)))
    }

    fn facing(space: &BodySpace, heading_rad: f64) -> BodyState {
        let mut pose = body::Pose::upright(DVec3::ZERO, heading_rad);
        pose.angles.copy_from_slice(space.model().mean_angles());
        space.state_from_pose(&pose)
    }

    #[test]
    fn the_density_of_one_kernel_is_that_of_the_walk() {
        let space = space();
        let sd: Vec<f64> = (0..space.dim()).map(|i| 0.01 + 0.001 * i as f64).collect();
        let noise = Gaussian::diagonal(sd.clone()).expect("the deviations are positive");
        let centre = facing(&space, 0.3);
        let cue = Cue::from_draws(&space, vec![centre], vec![centre]);
        let frame = Observation {
            mask: Mask::new(8, 8),
            cue: Some(cue),
            outline: None,
            travel: None,
            description: None,
        };
        let without =
            Observation { mask: Mask::new(8, 8), cue: None, outline: None, travel: None, description: None };
        let proposal = BottomUp::new(&sd, noise);
        let mut state = centre;
        let mut delta = vec![0.0; space.dim()];
        delta[..RIGID_DIM].copy_from_slice(&[0.01, -0.02, 0.03, 0.01, 0.02, -0.01]);
        space.retract(&mut state, &delta);
        let of = |frame| proposal.log_density(&space, &centre, frame, &state).expect("it is known");
        assert!((of(&frame) - of(&without)).abs() < 1e-9, "{} and {}", of(&frame), of(&without));
    }

    #[test]
    fn kernels_of_evidence_are_as_wide_as_the_draws_spread_about_their_modes() {
        let space = space();
        let modes = [0.0, 3.0].map(|heading| facing(&space, heading));
        let bend = RIGID_DIM + 20;
        // Two modes far apart; about each, one coordinate swings by 0.4 either way.
        let draw = |mode: &BodyState, by: f64| {
            let mut delta = vec![0.0; space.dim()];
            delta[bend] = by;
            let mut state = *mode;
            space.retract(&mut state, &delta);
            state
        };
        let centres: Vec<BodyState> =
            modes.iter().flat_map(|mode| [-0.4, 0.4].map(|by| draw(mode, by))).collect();
        let variance = variance_within_modes(&space, &centres, &modes);
        let mut expected = vec![0.0; space.dim()];
        expected[bend] = 0.16;
        assert!(variance.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-9), "{variance:?}");
        // n = 4 draws in d dimensions: (4 / ((d + 2) n))^(1 / (d + 4)) standard deviations, and a step.
        let dim = (space.dim() - N_PLACE) as f64;
        let step = space.model().step_sd()[bend - RIGID_DIM];
        let mut sd: Vec<f64> = space
            .model()
            .rigid_step_sd()
            .into_iter()
            .chain(space.model().step_sd().iter().copied())
            .collect();
        sd[bend] = (0.4 * (1.0 / (dim + 2.0)).powf(1.0 / (dim + 4.0))).hypot(step);
        assert_eq!(kernel(&space, &centres, &modes), Gaussian::diagonal(sd).expect("they are positive"));
        // Between the two draws of a mode the evidence is that of either, nearly; far from both it is little.
        let cue = Cue::from_draws(&space, centres, modes.to_vec());
        let evidence = |by: f64| cue.log_evidence(&space, &draw(&modes[0], by));
        assert!((evidence(0.0) - evidence(0.4)).abs() < 0.7 && evidence(1.6) < evidence(0.0) - 3.0);
    }

    #[test]
    fn only_a_prediction_that_is_sure_of_a_way_agrees_or_not() {
        let space = space();
        let cue = |headings: &[f64]| {
            let centres: Vec<BodyState> = headings.iter().map(|&heading| facing(&space, heading)).collect();
            Cue::from_draws(&space, centres.clone(), centres)
        };
        let sure = cue(&[0.0, 0.1, 0.2, 3.0]);
        assert_eq!(sure.agreement(&facing(&space, 0.05)), Some(0.75));
        assert_eq!(sure.agreement(&facing(&space, 3.0)), Some(0.25));
        assert_eq!(sure.agreement(&facing(&space, 1.6)), Some(0.0));
        assert_eq!(cue(&[0.0, 0.1, 3.0, 3.1]).agreement(&facing(&space, 0.0)), None);
    }
}
