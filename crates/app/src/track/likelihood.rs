//! p(mask|state): the silhouette of the posed body against the mask, and a weak prior on the pose.

use std::sync::Arc;

use body::Pose;
use glam::{DVec2, DVec3};
use pf_core::Likelihood;
use rayon::prelude::*;
use render_gpu::ScoreError;
use silhouette::Mask;

use super::cue::Cue;
use super::overlap::BodyOverlap;
use super::state::{BodySpace, BodyState, blank_pose};
use crate::shape::rim::Seen;

/// States that one task poses: fewer are not worth a task.
const STATES_A_TASK: usize = 32;

/// What the tracker sees on a frame.
#[derive(Clone, Debug)]
pub struct Observation {
    /// The person, of the size of the working camera's image.
    pub mask: Mask,
    /// What the mask alone says of the pose, where a predictor is at hand.
    pub cue: Option<Cue>,
    /// The outline of the mask, for what refines poses.
    pub outline: Option<Arc<Seen>>,
    /// Which way the person goes, unit, world; none for one who stands.
    pub travel: Option<DVec2>,
    /// The description of the mask for a predictor of the next pose, where one is at hand.
    pub description: Option<Vec<f64>>,
}

/// ln p(r|x) = -sharpness (1 - IoU) + prior_weight ln p(pose) + travel_weight cos(angle between facing and going); under the joint likelihood model
/// (1 - b) ln p(r|x) + b ln p_B(x|r) with the density p_B of the [`Cue`].
///
/// Intersection over union punishes the body outside the mask and the mask left unexplained alike, so that neither a
/// body that walks into the camera nor one that shrinks away gains anything.
pub struct SilhouetteLikelihood {
    space: BodySpace,
    /// Counts overlaps; [`BodyOverlap::set_mask`] comes before the frame is worked on.
    pub overlap: BodyOverlap,
    sharpness: f64,
    prior_weight: f64,
    travel_weight: f64,
    /// Exponent b of the cue's density, 0 to 1; the silhouette's is 1 - b.
    cue_exponent: Option<f64>,
    poses: Vec<Pose>,
}

impl SilhouetteLikelihood {
    /// The likelihood of masks under the bodies of `overlap`, joined with the cue to the power `cue_exponent`, 0 to 1, where there is one.
    pub fn new(
        space: BodySpace,
        overlap: BodyOverlap,
        sharpness: f64,
        prior_weight: f64,
        travel_weight: f64,
        cue_exponent: Option<f64>,
    ) -> Self {
        Self { space, overlap, sharpness, prior_weight, travel_weight, cue_exponent, poses: Vec::new() }
    }
}

impl Likelihood<BodyState> for SilhouetteLikelihood {
    type Frame = Observation;
    type Error = ScoreError;

    fn log_likelihoods(
        &mut self,
        frame: &Observation,
        states: &[BodyState],
        out: &mut [f64],
    ) -> Result<(), ScoreError> {
        let Self { space, sharpness, prior_weight, .. } = self;
        self.poses.resize_with(states.len(), blank_pose);
        let prior = self.poses.par_iter_mut().zip(states).zip(&mut *out).with_min_len(STATES_A_TASK);
        prior.for_each(|((pose, state), log_prior)| {
            space.pose_into(state, pose);
            *log_prior = space.model().log_prior(&state.latent[..space.model().dim()]);
        });
        let counts = self.overlap.counts(&self.poses)?;
        for (log_likelihood, counts) in out.iter_mut().zip(counts) {
            *log_likelihood = *prior_weight * *log_likelihood - *sharpness * (1.0 - counts.iou());
        }
        if let Some(travel) = frame.travel {
            for (log_likelihood, state) in out.iter_mut().zip(states) {
                let facing = (state.orientation * DVec3::Z).truncate().normalize_or_zero();
                *log_likelihood += self.travel_weight * facing.dot(travel);
            }
        }
        if let (Some(exponent), Some(cue)) = (self.cue_exponent, &frame.cue) {
            let space = &self.space;
            out.par_iter_mut().zip(states).with_min_len(STATES_A_TASK).for_each(|(log_likelihood, state)| {
                *log_likelihood =
                    (1.0 - exponent) * *log_likelihood + exponent * cue.log_evidence(space, state);
            });
        }
        Ok(())
    }
}
