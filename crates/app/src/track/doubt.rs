//! When what the trackers believe is to be doubted, and what has to be shown before another belief takes its place.
//!
//! Overlap alone does not tell: a body that faces the wrong way covers the mask as well as one that faces the right way. What does
//! tell, over several frames, is the predictor, which sees the person turned another way, and a fit that has fallen below
//! what it used to be on this clip.

use serde::{Deserialize, Serialize};

/// Share of a prediction that must face as the tracker believes.
const LEAST_AGREEMENT: f64 = 0.1;
/// Fall of the fit (log-likelihood) below what it was on earlier frames that is odd: six hundredths of overlap at the default
/// sharpness.
const ODD_FALL: f64 = 12.0;
/// Share of what the usual fit is taken to be that each frame leaves.
const MEMORY: f64 = 0.97;
/// So many odd frames more than even ones, and the belief is put to the test.
const ODD_FRAMES: i32 = 6;
/// A start has tried all ways to face: what it chose is not tested for so many frames; nor is a belief that stood its test, for
/// twice as many each time.
const REST_FRAMES: i32 = 30;
/// Where the predictor denies the belief, a rival that faces as the predictor says may fit so much worse and still win.
const HEADING_MARGIN: f64 = 2.0;
/// Any other rival must fit so much better.
const FIT_MARGIN: f64 = 6.0;

/// How far a belief is doubted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Doubt {
    /// Odd frames less even ones.
    odd: i32,
    usual_fit: Option<f64>,
    tests_stood: u32,
}

/// A belief and what speaks for it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Standing {
    /// Log-likelihood of the masks, mean over some frames.
    pub fit: f64,
    /// Share of the prediction that faces the same way; none without a prediction that is sure of a way.
    pub agreement: Option<f64>,
}

impl Standing {
    fn is_contradicted(&self) -> bool {
        self.agreement.is_some_and(|share| share < LEAST_AGREEMENT)
    }

    /// Whether this rival should take the place of the `incumbent`.
    pub fn beats(&self, incumbent: &Self) -> bool {
        let is_favoured = incumbent.is_contradicted() && self.agreement > Some(0.5);
        let margin = if is_favoured { -HEADING_MARGIN } else { FIT_MARGIN };
        self.fit > incumbent.fit + margin
    }
}

impl Default for Doubt {
    fn default() -> Self {
        Self { odd: -REST_FRAMES, usual_fit: None, tests_stood: 0 }
    }
}

impl Doubt {
    /// Looks at what speaks for the belief on a frame; whether it should be put to the test now.
    pub fn look(&mut self, now: &Standing) -> bool {
        let usual = self.usual_fit.unwrap_or(now.fit);
        let has_fallen = now.fit < usual - ODD_FALL;
        let is_odd = has_fallen || now.is_contradicted();
        if !has_fallen {
            self.usual_fit = Some(MEMORY * usual + (1.0 - MEMORY) * now.fit);
        }
        self.odd = if is_odd || self.odd < 0 { self.odd + 1 } else { (self.odd - 1).max(0) };
        self.odd >= ODD_FRAMES
    }

    /// The belief stood its test: let it be for a while, and take its fit for what can be had here.
    pub fn rest(&mut self, fit: f64) {
        self.tests_stood += 1;
        self.odd = -(REST_FRAMES << self.tests_stood.min(6));
        self.usual_fit = Some(fit);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn standing(fit: f64, agreement: f64) -> Standing {
        Standing { fit, agreement: Some(agreement) }
    }

    #[test]
    fn a_heading_that_the_predictor_denies_is_tested_after_some_frames_and_then_let_be() {
        let mut doubt = Doubt::default();
        let tests: Vec<usize> = (0..200)
            .filter(|_| {
                let is_due = doubt.look(&standing(-20.0, 0.02));
                if is_due {
                    doubt.rest(-20.0);
                }
                is_due
            })
            .collect();
        assert_eq!(tests, [35, 101]);
        let mut agreed = Doubt::default();
        assert!((0..100).all(|frame| !agreed.look(&standing(-20.0, if frame % 3 == 0 { 0.0 } else { 0.4 }))));
    }

    #[test]
    fn a_fall_of_the_fit_is_odd_and_a_hard_clip_is_not() {
        let mut doubt = Doubt::default();
        assert!((0..40).all(|_| !doubt.look(&standing(-40.0, 0.9))));
        assert_eq!((0..20).position(|_| doubt.look(&standing(-53.0, 0.9))), Some(5));
        doubt.rest(-53.0);
        assert!((0..100).all(|_| !doubt.look(&standing(-53.0, 0.9))));
    }

    #[test]
    fn a_rival_wins_by_heading_when_it_fits_as_well_and_else_by_fit() {
        let believed = standing(-20.0, 0.0);
        assert!(standing(-21.0, 0.8).beats(&believed));
        assert!(!standing(-23.0, 0.8).beats(&believed));
        assert!(!standing(-19.0, 0.1).beats(&believed), "it faces no better");
        assert!(standing(-13.0, 0.1).beats(&believed));
        assert!(!standing(-19.0, 0.9).beats(&standing(-20.0, 0.3)), "nothing speaks against the belief");
    }
}
