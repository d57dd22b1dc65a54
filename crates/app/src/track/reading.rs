//! Readings: states that explain one silhouette in different ways, and what they come to together.
//!
//! What readings agree on is sure; where they do not, their mean is nearer to the truth than any one of them. Only readings
//! that face about the same way have a mean that means anything.

use pf_core::NormalizedWeights;
use pf_core::estimate::weighted_mean;

use super::state::{BodySpace, BodyState};

/// Difference in fit (log-likelihood) at which a reading's weight falls by the factor e. The overlap of a right pose varies
/// by one or two hundredths, two units at the default sharpness.
const FIT_SCALE: f64 = 2.0;
/// The fit of a reading that explains nothing, in place of -∞.
const LEAST_FIT: f64 = -1e6;
/// States whose pelves are turned further apart than this are no readings of the same pose.
const SAME_READING_RAD: f64 = 1.0;
/// A rival must explain a frame so much better (log-likelihood) than what is believed to take its place.
const RIVAL_MARGIN: f64 = 1.0;

/// One state that explains a frame.
#[derive(Clone, Copy, Debug)]
pub struct Reading {
    /// Where and how the body is.
    pub state: BodyState,
    /// ln p(mask|state); the same for all on a frame without a mask.
    pub fit: f64,
}

/// ln of the weight of a reading with this fit, up to a constant: fits of a frame share most of their errors.
pub fn log_weight(fit: f64) -> f64 {
    fit.max(LEAST_FIT) / FIT_SCALE
}

/// Whether the two face about the same way.
pub fn is_same_way(a: &BodyState, b: &BodyState) -> bool {
    a.orientation.angle_between(b.orientation) <= SAME_READING_RAD
}

/// The reading that is to be believed, where the first one is believed already.
pub fn leader(readings: &[Reading]) -> usize {
    (1..readings.len()).fold(0, |leader, rival| {
        let margin = if leader == 0 { RIVAL_MARGIN } else { 0.0 };
        if readings[rival].fit > readings[leader].fit + margin { rival } else { leader }
    })
}

/// Weights of states with these log weights: none for those that do not face as number `leader` does, whose own log weight is
/// finite.
pub fn weights(states: &[BodyState], log_weights: &[f64], leader: usize) -> NormalizedWeights {
    let weight = |(state, log): (&BodyState, &f64)| {
        if is_same_way(state, &states[leader]) { (log - log_weights[leader]).exp() } else { 0.0 }
    };
    let weights = states.iter().zip(log_weights).map(weight).collect();
    NormalizedWeights::from_linear(weights).expect("the leader weighs 1")
}

/// The mean of the readings that face as number `leader` does.
pub fn mean(space: &BodySpace, readings: &[Reading], leader: usize) -> BodyState {
    let states: Vec<BodyState> = readings.iter().map(|reading| reading.state).collect();
    let log_weights: Vec<f64> = readings.iter().map(|reading| log_weight(reading.fit)).collect();
    weighted_mean(space, &states, &weights(&states, &log_weights, leader))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use body::Pose;
    use body::pose_prior::PosePrior;
    use glam::DVec3;

    use super::*;
    use crate::track::pose_model::{FreeJoints, Widening};

    fn space() -> BodySpace {
        let widening = Widening { factor: 1.3, least_sd: 0.06, least_step: 0.006, frees_clavicles: true };
        BodySpace::new(Arc::new(FreeJoints::new(&PosePrior::builtin(), widening)))
    }

    fn reading(space: &BodySpace, x_m: f64, heading_rad: f64, fit: f64) -> Reading {
        let state = space.state_from_pose(&Pose::upright(DVec3::new(x_m, 0.0, 0.95), heading_rad));
        Reading { state, fit }
    }

    #[test]
    fn readings_weigh_by_their_fit() {
        let space = space();
        let x_m = |other_fit: f64| {
            let readings = [reading(&space, 0.0, 0.0, -10.0), reading(&space, 0.3, 0.1, other_fit)];
            mean(&space, &readings, 0).position.x
        };
        assert!((x_m(-10.0) - 0.15).abs() < 1e-9);
        // Two units worse: a weight of 1/e.
        let share = (-1.0_f64).exp() / (1.0 + (-1.0_f64).exp());
        assert!((x_m(-12.0) - 0.3 * share).abs() < 1e-9);
        assert!(x_m(f64::NEG_INFINITY).abs() < 1e-9);
    }

    #[test]
    fn a_rival_leads_when_it_fits_clearly_better() {
        let space = space();
        let of = |fits: [f64; 3]| leader(&fits.map(|fit| reading(&space, 0.0, 0.0, fit)));
        assert_eq!(of([-10.0, -9.5, -9.2]), 0, "within the margin");
        assert_eq!(of([-10.0, -8.5, -8.2]), 2, "the best of those beyond it");
        assert_eq!(of([f64::NEG_INFINITY, -50.0, -60.0]), 1);
    }

    #[test]
    fn what_faces_another_way_has_no_say() {
        let space = space();
        let readings = [reading(&space, 0.0, 0.0, -10.0), reading(&space, 0.3, 2.0, -9.0)];
        assert_eq!(mean(&space, &readings, 0).position.x, 0.0);
        assert_eq!(mean(&space, &readings, 1).position.x, 0.3);
    }
}
