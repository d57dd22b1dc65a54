//! Masks with the poses that they show.

use silhouette::Mask;

use crate::predict::{ViewedPose, person_in};

/// Masks, cut out, with their poses.
#[derive(Clone, Debug, Default)]
pub struct Examples {
    /// The masks, `[n]`.
    pub masks: Vec<Mask>,
    /// What they show, `[n]`.
    pub poses: Vec<ViewedPose>,
}

impl Examples {
    /// Adds the person in a mask; a mask without one is left out.
    pub fn push(&mut self, mask: &Mask, pose: ViewedPose) {
        if let Some(person) = person_in(mask) {
            self.masks.push(person);
            self.poses.push(pose);
        }
    }

    /// Adds the mirror image of every mask and pose. Where motion goes one way round only, a mirror shows what will
    /// not be met, and shows it as something else; across people it is the cheapest way to more data.
    pub fn mirror(&mut self) {
        let masks: Vec<Mask> = self.masks.iter().map(Mask::mirrored).collect();
        let poses: Vec<ViewedPose> = self.poses.iter().map(ViewedPose::mirrored).collect();
        self.masks.extend(masks);
        self.poses.extend(poses);
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.masks.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.masks.is_empty()
    }

    /// Adds all of `other`.
    pub fn append(&mut self, mut other: Self) {
        self.masks.append(&mut other.masks);
        self.poses.append(&mut other.poses);
    }
}
