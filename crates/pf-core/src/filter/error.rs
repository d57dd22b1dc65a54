//! What can go wrong in a filter.

use std::error::Error;

use crate::weights::BadWeights;

/// Why a frame could not be worked on. The filter is as it was before the frame.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StepError<E: Error + 'static> {
    /// No particles yet.
    #[error("the filter has no particles, expected a call of `initialise` or `restore` first")]
    NotInitialised,
    /// The likelihood failed.
    #[error("frame {frame}, layer {layer}: cannot score the particles")]
    Likelihood {
        /// Frame number.
        frame: u64,
        /// Annealing layer.
        layer: u32,
        /// What the likelihood says.
        source: E,
    },
    /// The likelihood returned NaN or +∞.
    #[error(
        "frame {frame}, layer {layer}, particle {particle}: the log likelihood is {value}, expected a number below +inf"
    )]
    BadLogLikelihood {
        /// Frame number.
        frame: u64,
        /// Annealing layer.
        layer: u32,
        /// Which particle.
        particle: usize,
        /// What was returned.
        value: f64,
    },
    /// The proposal returned NaN or +∞.
    #[error(
        "frame {frame}, layer 0, particle {particle}: the log correction is {value}, expected a number below +inf"
    )]
    BadLogCorrection {
        /// Frame number.
        frame: u64,
        /// Which particle.
        particle: usize,
        /// What was returned.
        value: f64,
    },
    /// A tempered filter met a motion prior whose density is unknown, NaN or +∞.
    #[error(
        "frame {frame}, layer {layer}, particle {particle}: the motion prior has no density here, but tempering needs one"
    )]
    NoMotionDensity {
        /// Frame number.
        frame: u64,
        /// Annealing layer.
        layer: u32,
        /// Which particle.
        particle: usize,
    },
}

/// Why particles cannot be taken in.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BadState {
    /// No particle.
    #[error("`particles` is empty, expected one or more")]
    Empty,
    /// Not a weight for each particle.
    #[error("`weights` has {weights} entries, expected one for each of the {particles} particles")]
    Lengths {
        /// Number of particles.
        particles: usize,
        /// Number of weights.
        weights: usize,
    },
    /// Not a distribution.
    #[error("`weights` are no distribution")]
    Weights {
        /// What is wrong with them.
        source: BadWeights,
    },
    /// Too many particles to number.
    #[error("`particles` has {0} entries, expected at most {max}", max = u32::MAX)]
    TooMany(usize),
}

/// Why filter settings are refused.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BadFilterConfig {
    /// No particle, or too many to number.
    #[error("`n_particles` is {0}, expected 1 to {max}", max = u32::MAX)]
    Particles(usize),
    /// Not a share.
    #[error("`resample_below` is {0}, expected 0 to 1")]
    ResampleBelow(f64),
    /// No move, or more than an address can name.
    #[error("`moves_per_layer` is {0}, expected 1 to {max}", max = MAX_MOVES)]
    Moves(u32),
}

/// Moves a layer, at most.
pub(super) const MAX_MOVES: u32 = crate::rng::MAX_LAYERS / crate::schedule::MAX_LAYERS;
