//! Ghosts: changed pixels without an outline in the frame.
//!
//! Where a thing stood on the plate and stands no more, the pixels differ from the plate, but the edges about them are
//! edges of the plate, not of the frame. A smudge of shadow or light has edges in neither. A person's outline shows in
//! the frame `[Cucchiara2003]`.

use crate::clean::{Components, Connectivity, Window};
use crate::image::RgbPlanes;
use crate::mask::Mask;

/// The components of `changed` whose rim has edges in the frame that exceed those of the background by the factor
/// `least_ratio`; the component that shares most with `last_person` stays in any case.
pub(crate) fn without_ghosts(
    changed: &Mask,
    frame: &RgbPlanes,
    background: &RgbPlanes,
    last_person: Option<&Mask>,
    least_ratio: f32,
) -> Mask {
    let components = Components::of(changed, Connectivity::Eight);
    let n = components.all().len();
    let mut rim = changed.clone();
    rim.subtract(&changed.eroded(Window::radius(1)));
    let mut edges = vec![[0.0f32; 2]; n];
    components.for_each_run(|component, y, x0, x1| {
        for x in x0..x1 {
            if rim.get(x, y) {
                edges[component][0] += steepness(frame, x as usize, y as usize);
                edges[component][1] += steepness(background, x as usize, y as usize);
            }
        }
    });
    let person = last_person.and_then(|last_person| {
        let shared = components.overlap_areas(last_person);
        (0..n).max_by_key(|&index| shared[index]).filter(|&index| shared[index] > 0)
    });
    components.select(|index| Some(index) == person || edges[index][0] >= least_ratio * edges[index][1])
}

/// Largest difference of a channel across a pixel, along either axis.
fn steepness(image: &RgbPlanes, x: usize, y: usize) -> f32 {
    let row = y * image.width;
    let (left, right) = (row + x.saturating_sub(1), row + (x + 1).min(image.width - 1));
    let above = y.saturating_sub(1) * image.width + x;
    let below = (y + 1).min(image.height - 1) * image.width + x;
    image
        .planes
        .iter()
        .map(|plane| (plane[right] - plane[left]).abs().max((plane[below] - plane[above]).abs()))
        .fold(0.0, f32::max)
}
