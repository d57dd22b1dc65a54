//! Connected components, found by joining the runs of neighbouring rows.

use crate::mask::{Mask, PixelRect};

/// Which pixels touch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Connectivity {
    /// Those that share an edge.
    Four,
    /// Those that share an edge or a corner.
    Eight,
}

/// A connected piece of a mask.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Component {
    /// Pixels.
    pub area: u64,
    /// The smallest rectangle about it.
    pub bounding_box: PixelRect,
}

#[derive(Clone, Copy, Debug)]
struct Run {
    y: u32,
    x0: u32,
    x1: u32,
    component: u32,
}

/// The connected components of a mask, in the order of their first pixel (rows first).
#[derive(Clone, Debug)]
pub struct Components {
    width: u32,
    height: u32,
    runs: Vec<Run>,
    all: Vec<Component>,
}

impl Components {
    /// The components of `mask`.
    pub fn of(mask: &Mask, connectivity: Connectivity) -> Self {
        let (mut runs, parents) = joined_runs(mask, connectivity);
        // Parents come before children, so that one sweep numbers every root before its runs ask for the number.
        let mut number_of_root = vec![u32::MAX; runs.len()];
        let mut all: Vec<Component> = Vec::new();
        for (index, run) in runs.iter_mut().enumerate() {
            let root = find(&parents, index);
            if root == index {
                number_of_root[root] = all.len() as u32;
                let bounding_box = PixelRect { x0: run.x0, y0: run.y, x1: run.x1, y1: run.y + 1 };
                all.push(Component { area: 0, bounding_box });
            }
            run.component = number_of_root[root];
            let component = &mut all[run.component as usize];
            component.area += u64::from(run.x1 - run.x0);
            component.bounding_box.x0 = component.bounding_box.x0.min(run.x0);
            component.bounding_box.x1 = component.bounding_box.x1.max(run.x1);
            component.bounding_box.y1 = run.y + 1;
        }
        Self { width: mask.width(), height: mask.height(), runs, all }
    }

    /// The components.
    pub fn all(&self) -> &[Component] {
        &self.all
    }

    /// The index of the largest component; the first of equals; `None` when there are none.
    pub fn largest(&self) -> Option<usize> {
        let index = |(index, component): (usize, &Component)| (component.area, std::cmp::Reverse(index));
        self.all.iter().enumerate().map(index).max().map(|(_, std::cmp::Reverse(index))| index)
    }

    /// The components for which `keep` holds, as a mask.
    pub fn select(&self, keep: impl Fn(usize) -> bool) -> Mask {
        let mut mask = Mask::new(self.width, self.height);
        let kept: Vec<bool> = (0..self.all.len()).map(keep).collect();
        for run in self.runs.iter().filter(|run| kept[run.component as usize]) {
            mask.fill_run(run.y, run.x0, run.x1);
        }
        mask
    }

    /// Pixels of each component for which `other` is person, `[n_components]`.
    ///
    /// # Panics
    /// When `other` has another size than the mask that was taken apart.
    pub fn overlap_areas(&self, other: &Mask) -> Vec<u64> {
        assert_eq!((other.width(), other.height()), (self.width, self.height), "masks of unequal size");
        let mut areas = vec![0; self.all.len()];
        for run in &self.runs {
            areas[run.component as usize] += other.count_run(run.y, run.x0, run.x1);
        }
        areas
    }

    /// Calls `visit` with component, row and columns `x0..x1` of every run.
    pub(crate) fn for_each_run(&self, mut visit: impl FnMut(usize, u32, u32, u32)) {
        self.runs.iter().for_each(|run| visit(run.component as usize, run.y, run.x0, run.x1));
    }
}

/// The runs of all rows, and for each the index of an earlier run of its component, or its own.
fn joined_runs(mask: &Mask, connectivity: Connectivity) -> (Vec<Run>, Vec<usize>) {
    let reach = u32::from(connectivity == Connectivity::Eight);
    let mut runs: Vec<Run> = Vec::new();
    let mut parents: Vec<usize> = Vec::new();
    let mut above = 0..0;
    for y in 0..mask.height() {
        let start = runs.len();
        let mut candidate = above.start;
        for (x0, x1) in mask.runs(y) {
            let index = runs.len();
            runs.push(Run { y, x0, x1, component: 0 });
            parents.push(index);
            // Skip the runs above that end before this one begins; join those that touch.
            while candidate < above.end && runs[candidate].x1 + reach <= x0 {
                candidate += 1;
            }
            let mut touching = candidate;
            while touching < above.end && runs[touching].x0 < x1 + reach {
                join(&mut parents, touching, index);
                touching += 1;
            }
        }
        above = start..runs.len();
    }
    (runs, parents)
}

fn find(parents: &[usize], mut index: usize) -> usize {
    while parents[index] != index {
        index = parents[index];
    }
    index
}

/// Makes the earlier root the parent of the later one, and shortens the paths walked.
fn join(parents: &mut [usize], a: usize, b: usize) {
    let (root_a, root_b) = (find(parents, a), find(parents, b));
    let root = root_a.min(root_b);
    for start in [a, b] {
        let mut index = start;
        while index != root {
            index = std::mem::replace(&mut parents[index], root);
        }
    }
    parents[root_a.max(root_b)] = root;
}
