//! What a pose model must answer, and the two of this version: free joint angles and their principal components.

use body::{N_DOF, PosePrior, Skeleton};

/// Coordinates of a pose: the joint angles themselves, or fewer numbers from which they follow.
///
/// # Laws
/// `latent_from_angles` undoes `angles_from_latent` on clamped coordinates; `clamp` is idempotent.
pub trait PoseModel: Sync {
    /// Number of coordinates.
    fn dim(&self) -> usize;
    /// Joint angles, [n_dof], radians, within the joint limits.
    fn angles_from_latent(&self, latent: &[f64], angles: &mut [f64]);
    /// The coordinates whose joint angles come nearest to `angles`.
    fn latent_from_angles(&self, angles: &[f64], latent: &mut [f64]);
    /// Brings coordinates back to where the model holds.
    fn clamp(&self, latent: &mut [f64]);
    /// ln p(latent) up to a constant.
    fn log_prior(&self, latent: &[f64]) -> f64;
    /// Standard deviation of each coordinate's change from one frame to the next, [dim].
    fn step_sd(&self) -> &[f64];
}
