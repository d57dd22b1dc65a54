//! Holes: background that the person surrounds.

use super::components::{Components, Connectivity};
use crate::mask::{Mask, PixelRect};

impl Mask {
    /// Fills the holes (background that no path over pixel edges joins to the border) of at most `max_area` pixels.
    #[must_use]
    pub fn with_holes_filled(&self, max_area: u64) -> Self {
        let mut filled = self.clone();
        let (holes, is_hole) = self.holes();
        filled.union_with(&holes.select(|index| is_hole[index] && holes.all()[index].area <= max_area));
        filled
    }

    /// The components of the background, and which of them are holes.
    pub(crate) fn holes(&self) -> (Components, Vec<bool>) {
        let background = Components::of(&self.complement(), Connectivity::Four);
        let is_inside = |rect: &PixelRect| {
            rect.x0 > 0 && rect.y0 > 0 && rect.x1 < self.width() && rect.y1 < self.height()
        };
        let is_hole = background.all().iter().map(|component| is_inside(&component.bounding_box)).collect();
        (background, is_hole)
    }
}
