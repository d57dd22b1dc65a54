//! How well states explain a frame: scored all at once.

/// Scores the particles of a layer in one call.
///
/// # Laws
/// - `out[i]` depends on `frame` and `states[i]` alone, not on the other states or their order.
/// - `out[i]` is a number below +∞. −∞ says that the state is impossible; NaN is a bug and stops the filter with an
///   error that names frame, layer and particle.
///
/// The filter calls it from one thread; an implementation that is costly spreads the work itself.
///
/// ```
/// use pf_core::Likelihood;
/// use std::convert::Infallible;
///
/// /// A position measured with a standard deviation of half a metre.
/// struct Ruler;
/// impl Likelihood<[f64; 1]> for Ruler {
///     type Frame = f64;
///     type Error = Infallible;
///     fn log_likelihoods(&mut self, measured: &f64, states: &[[f64; 1]], out: &mut [f64]) -> Result<(), Infallible> {
///         for (log_likelihood, state) in out.iter_mut().zip(states) {
///             *log_likelihood = -0.5 * ((measured - state[0]) / 0.5).powi(2);
///         }
///         Ok(())
///     }
/// }
///
/// let mut out = [0.0; 2];
/// Ruler.log_likelihoods(&1.0, &[[1.0], [2.0]], &mut out)?;
/// assert_eq!(out, [0.0, -2.0]);
/// # Ok::<(), Infallible>(())
/// ```
pub trait Likelihood<T> {
    /// What is observed at one instant.
    type Frame: ?Sized;
    /// Why scoring can fail.
    type Error: std::error::Error + Send + Sync + 'static;
    /// ln p(frame|state) for each state, up to one constant a frame. −∞ is "impossible"; NaN is a bug.
    fn log_likelihoods(
        &mut self,
        frame: &Self::Frame,
        states: &[T],
        out: &mut [f64],
    ) -> Result<(), Self::Error>;
}
