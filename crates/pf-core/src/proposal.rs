//! Where particles of a new frame come from.

mod mixture;
mod random_walk;

use crate::rng::ParticleRng;
use crate::space::StateSpace;

pub use mixture::{BadMixture, MixtureConfig, MixtureProposal, Weighting};
pub use random_walk::RandomWalk;

/// A state drawn from a proposal.
///
/// `log_correction` is ln p(x|x′) − ln q(x|x′,z): zero only when drawn from the motion prior.
#[derive(Clone, Debug, PartialEq)]
pub struct Proposed<T> {
    /// The state drawn.
    pub state: T,
    /// ln p(x|x′) − ln q(x|x′,z).
    pub log_correction: f64,
}

/// Draws a particle's next state from its last one.
///
/// # Laws
/// - A draw follows from the arguments alone, and from the share of sources that [`adapt`](Self::adapt) set.
/// - Where both densities are known, `log_correction` is `log_motion_density` − `log_density` at the drawn state.
/// - `log_correction` is below +∞ and never NaN.
///
/// `propose` alone is enough for [`Filter::bootstrap`](crate::Filter::bootstrap) and
/// [`Filter::annealed`](crate::Filter::annealed).
///
/// ```
/// use pf_core::{Euclidean, ParticleRng, Proposal, Proposed};
///
/// /// Half the way home, and a step of unit variance.
/// struct Homesick;
/// impl Proposal<Euclidean<1>> for Homesick {
///     type Frame = f64;
///     fn propose(&self, _: &Euclidean<1>, previous: &[f64; 1], _: &f64, rng: &mut ParticleRng) -> Proposed<[f64; 1]> {
///         Proposed { state: [0.5 * previous[0] + rng.standard_normal()], log_correction: 0.0 }
///     }
/// }
/// ```
pub trait Proposal<S: StateSpace>: Sync {
    /// What is observed at one instant.
    type Frame: ?Sized + Sync;

    /// Draws from q(x|x′,z), x′ being `previous` and z being `frame`.
    fn propose(
        &self,
        space: &S,
        previous: &S::State,
        frame: &Self::Frame,
        rng: &mut ParticleRng,
    ) -> Proposed<S::State>;

    /// ln p(`state`|`previous`) of the motion prior, if it can be evaluated.
    fn log_motion_density(&self, _space: &S, _previous: &S::State, _state: &S::State) -> Option<f64> {
        None
    }

    /// ln q(`state`|`previous`, `frame`), if it can be evaluated.
    fn log_density(
        &self,
        _space: &S,
        _previous: &S::State,
        _frame: &Self::Frame,
        _state: &S::State,
    ) -> Option<f64> {
        None
    }

    /// Number of sources that states come from; more than one in a mixture.
    fn n_sources(&self) -> usize {
        1
    }

    /// As [`propose`](Self::propose), and the source that the state came from, below [`n_sources`](Self::n_sources).
    fn propose_from_source(
        &self,
        space: &S,
        previous: &S::State,
        frame: &Self::Frame,
        rng: &mut ParticleRng,
    ) -> (Proposed<S::State>, u8) {
        (self.propose(space, previous, frame, rng), 0)
    }

    /// Called before each frame with the posterior weight of the particles of each source in the frame before, summing to
    /// one; empty before the first frame. Whatever is adapted must follow from `source_shares` alone, for a resumed filter
    /// has nothing else.
    fn adapt(&mut self, _source_shares: &[f64]) {}
}
