//! What a state is: a point that can be moved by a vector of increments.

/// A space of states with local coordinates.
///
/// # Laws
/// - `local(a, b, d); retract(a, d)` leads from `a` to `b`, for `a` and `b` inside the limits and near each other.
/// - `local(a, a, d)` sets `d` to zero, and `retract(a, 0)` leaves `a` where it is.
/// - `retract` always ends inside the limits, whatever the increment.
///
/// Feature `conformance` has these laws as functions. A state that owns no heap memory (`[f64; N]`, say) keeps
/// the filter's loop free of allocations; `Clone::clone_from` is used wherever a state is copied.
///
/// ```
/// use pf_core::StateSpace;
///
/// /// Headings in radians, kept in (-pi, pi].
/// struct Headings;
/// impl StateSpace for Headings {
///     type State = f64;
///     fn dim(&self) -> usize {
///         1
///     }
///     fn retract(&self, heading: &mut f64, delta: &[f64]) {
///         let turned = *heading + delta[0];
///         *heading = turned.sin().atan2(turned.cos());
///     }
///     fn local(&self, from: &f64, to: &f64, delta: &mut [f64]) {
///         let turn = to - from;
///         delta[0] = turn.sin().atan2(turn.cos());
///     }
/// }
///
/// let mut delta = [0.0];
/// Headings.local(&3.0, &-3.0, &mut delta);
/// assert!((delta[0] - 0.283).abs() < 1e-3, "the short way round");
/// ```
pub trait StateSpace: Sync {
    /// A point of the space.
    type State: Clone + Send + Sync;
    /// Number of local coordinates.
    fn dim(&self) -> usize;
    /// Moves `state` by `delta` (length `dim()`) and brings it back inside its limits.
    fn retract(&self, state: &mut Self::State, delta: &[f64]);
    /// The `delta` that leads from `from` to `to`; undoes `retract` away from limits.
    fn local(&self, from: &Self::State, to: &Self::State, delta: &mut [f64]);
}

/// The vectors of `N` real numbers, without limits.
#[derive(Clone, Copy, Debug, Default)]
pub struct Euclidean<const N: usize>;

impl<const N: usize> StateSpace for Euclidean<N> {
    type State = [f64; N];

    fn dim(&self) -> usize {
        N
    }

    fn retract(&self, state: &mut [f64; N], delta: &[f64]) {
        for (x, d) in state.iter_mut().zip(delta) {
            *x += d;
        }
    }

    fn local(&self, from: &[f64; N], to: &[f64; N], delta: &mut [f64]) {
        for ((d, a), b) in delta.iter_mut().zip(from).zip(to) {
            *d = b - a;
        }
    }
}
