//! The next pose from the present one and the next mask: a conditional mixture of experts.

use bme::{MixtureDensity, MixtureOfExperts};
use rand::Rng;
use silhouette::Mask;

use super::descriptor::MaskDescriptor;
use super::pose_space::PoseSpace;
use super::viewed::ViewedPose;

/// p(x_n | x_{n-1}, r_n): experts over the product of a kernel on the pose before and a kernel on the mask now.
#[derive(Clone, Debug)]
pub struct TransitionPredictor {
    descriptor: MaskDescriptor,
    space: PoseSpace,
    experts: MixtureOfExperts,
}

impl TransitionPredictor {
    /// Puts trained parts together: `experts` from [`Self::input`] to coordinates and the cosine and sine of the heading.
    pub fn new(descriptor: MaskDescriptor, space: PoseSpace, experts: MixtureOfExperts) -> Self {
        Self { descriptor, space, experts }
    }

    /// The description of a mask; `None` when there is no person in it.
    pub fn describe(&self, mask: &Mask) -> Option<Vec<f64>> {
        self.descriptor.describe(mask)
    }

    /// What the experts see: coordinates and heading of the pose before, then the description of the mask now.
    pub fn input(space: &PoseSpace, previous: &ViewedPose, description: &[f64]) -> Vec<f64> {
        let mut input = space.point(previous);
        input.extend_from_slice(description);
        input
    }

    /// A random next pose.
    pub fn sample<R: Rng + ?Sized>(
        &self,
        previous: &ViewedPose,
        description: &[f64],
        rng: &mut R,
    ) -> ViewedPose {
        let density: MixtureDensity = self.experts.density(&Self::input(&self.space, previous, description));
        self.space.pose_at(&density.sample(rng))
    }
}
