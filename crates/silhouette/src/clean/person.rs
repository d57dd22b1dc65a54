//! Following the person over time: which components of a mask are the person.

use super::components::{Components, Connectivity};
use super::morphology::Window;
use crate::mask::Mask;

/// Settings of [`PersonTracker`].
#[derive(Clone, Debug)]
pub struct PersonTrackerConfig {
    /// A person covers at least this share of the image.
    pub minimum_share: f64,
    /// A detached piece that is kept has at least this share of the main component's area.
    pub piece_share: f64,
    /// A detached piece is kept when it lies within this share of the person's height of the main component.
    pub piece_gap: f64,
    /// ... or when this share of it lay in the person of the frame before.
    pub piece_overlap: f64,
    /// After this many frames without a person the next one may appear anywhere.
    pub forget_after: u32,
}

impl Default for PersonTrackerConfig {
    fn default() -> Self {
        Self {
            minimum_share: 0.001,
            piece_share: 0.003,
            piece_gap: 0.04,
            piece_overlap: 0.5,
            forget_after: 15,
        }
    }
}

/// Picks the components that continue the person of the frames before; at the start, the largest.
///
/// ```
/// use silhouette::{Mask, clean::{PersonTracker, PersonTrackerConfig}};
/// let mut tracker = PersonTracker::new(PersonTrackerConfig { minimum_share: 0.05, ..Default::default() });
/// let start: Mask = "##......\n##......".parse()?;
/// assert_eq!(tracker.follow(&start), start);
/// let two: Mask = ".##..###\n.##..###".parse()?;
/// assert_eq!(tracker.follow(&two).to_string(), ".##.....\n.##.....\n");
/// # Ok::<(), silhouette::mask::ParseMaskError>(())
/// ```
#[derive(Clone, Debug)]
pub struct PersonTracker {
    config: PersonTrackerConfig,
    previous: Option<Mask>,
    n_missed: u32,
}

impl PersonTracker {
    /// Nobody seen yet.
    pub fn new(config: PersonTrackerConfig) -> Self {
        Self { config, previous: None, n_missed: 0 }
    }

    /// The person as last seen; `None` before the first and when too long ago.
    pub fn previous(&self) -> Option<&Mask> {
        self.previous.as_ref()
    }

    /// The part of `mask` that is the person; an empty mask when there is none.
    ///
    /// # Panics
    /// When the size changes from one call to the next.
    pub fn follow(&mut self, mask: &Mask) -> Mask {
        let components = Components::of(mask, Connectivity::Eight);
        let Some(main) = self.main_component(&components, mask) else {
            self.n_missed += 1;
            if self.n_missed >= self.config.forget_after {
                self.previous = None;
            }
            return Mask::new(mask.width(), mask.height());
        };
        let person = self.with_pieces(&components, main);
        self.n_missed = 0;
        self.previous = Some(person.clone());
        person
    }

    /// The component that shares most with the last person, else the largest.
    fn main_component(&self, components: &Components, mask: &Mask) -> Option<usize> {
        let image_area = f64::from(mask.width()) * f64::from(mask.height());
        let is_large =
            |index: &usize| components.all()[*index].area as f64 >= self.config.minimum_share * image_area;
        let continues = self.previous.as_ref().and_then(|previous| {
            let shared = components.overlap_areas(previous);
            let best = (0..shared.len()).max_by_key(|&index| (shared[index], std::cmp::Reverse(index)))?;
            (shared[best] > 0).then_some(best)
        });
        continues.filter(is_large).or_else(|| components.largest().filter(is_large))
    }

    /// The main component with the detached pieces that belong to it.
    fn with_pieces(&self, components: &Components, main: usize) -> Mask {
        let all = components.all();
        let body = components.select(|index| index == main);
        let gap_px = (self.config.piece_gap * f64::from(all[main].bounding_box.height())).ceil() as u32;
        let near = components.overlap_areas(&body.dilated(Window::radius(gap_px)));
        let before = self.previous.as_ref().map(|previous| components.overlap_areas(previous));
        components.select(|index| {
            let area = all[index].area as f64;
            let was_person = before
                .as_ref()
                .is_some_and(|shared| shared[index] as f64 >= self.config.piece_overlap * area);
            let is_piece = area >= self.config.piece_share * all[main].area as f64;
            index == main || is_piece && (near[index] > 0 || was_person)
        })
    }
}
