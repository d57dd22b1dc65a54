//! A k-d tree over points.

use glam::DVec3;

/// Points in a leaf.
const LEAF: usize = 8;

/// A k-d tree (`[Bentley1975]`) for the nearest of many points.
#[derive(Clone, Debug)]
pub struct PointTree {
    /// Points in the order of the tree: the middle one of a range splits it, the axis is that of the widest spread.
    points: Vec<DVec3>,
    /// Their places in the list the tree was made of.
    ids: Vec<u32>,
    /// Axis of the split at each middle point.
    axes: Vec<u8>,
}

impl PointTree {
    /// A tree over `points`.
    pub fn new(points: &[DVec3]) -> Self {
        let mut entries: Vec<(DVec3, u32)> = points.iter().copied().zip(0..).collect();
        let mut axes = vec![0; points.len()];
        split(&mut entries, &mut axes);
        let (points, ids) = entries.into_iter().unzip();
        Self { points, ids, axes }
    }

    /// Numbers and distances of the `count` points nearest to `point` and nearer than `farthest_m`, nearest
    /// first, into `out`.
    pub fn nearest_into(&self, point: DVec3, count: usize, farthest_m: f64, out: &mut Vec<(u32, f64)>) {
        out.clear();
        let mut search = Search { tree: self, point, count, bound: farthest_m * farthest_m, found: out };
        search.visit(0, self.points.len());
        out.iter_mut().for_each(|(_, square)| *square = square.sqrt());
    }
}

fn split(entries: &mut [(DVec3, u32)], axes: &mut [u8]) {
    if entries.len() <= LEAF {
        return;
    }
    let bounds =
        entries.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), (p, _)| (l.min(*p), h.max(*p)));
    let size = bounds.1 - bounds.0;
    let axis = (0..3).max_by(|&a, &b| size[a].total_cmp(&size[b])).expect("three axes");
    let middle = entries.len() / 2;
    entries.select_nth_unstable_by(middle, |a, b| a.0[axis].total_cmp(&b.0[axis]));
    axes[middle] = axis as u8;
    let (low, high) = entries.split_at_mut(middle);
    let (low_axes, high_axes) = axes.split_at_mut(middle);
    split(low, low_axes);
    split(&mut high[1..], &mut high_axes[1..]);
}

struct Search<'a> {
    tree: &'a PointTree,
    point: DVec3,
    count: usize,
    /// Square of the distance that a point must come below.
    bound: f64,
    /// Squares of distances, least first.
    found: &'a mut Vec<(u32, f64)>,
}

impl Search<'_> {
    fn visit(&mut self, first: usize, end: usize) {
        if end - first <= LEAF {
            (first..end).for_each(|place| self.offer(place));
            return;
        }
        let middle = first + (end - first) / 2;
        let axis = usize::from(self.tree.axes[middle]);
        let beyond = self.point[axis] - self.tree.points[middle][axis];
        let (near, far) = if beyond < 0.0 {
            ((first, middle), (middle + 1, end))
        } else {
            ((middle + 1, end), (first, middle))
        };
        self.visit(near.0, near.1);
        self.offer(middle);
        if beyond * beyond < self.bound {
            self.visit(far.0, far.1);
        }
    }

    fn offer(&mut self, place: usize) {
        let square = self.tree.points[place].distance_squared(self.point);
        if square >= self.bound {
            return;
        }
        let rank = self.found.partition_point(|&(_, other)| other <= square);
        self.found.insert(rank, (self.tree.ids[place], square));
        if self.found.len() > self.count {
            self.found.pop();
        }
        if self.found.len() == self.count {
            self.bound = self.found[self.count - 1].1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_looking_at_every_point() {
        let wave = |k: usize, rate: f64| (k as f64 * rate).sin();
        let points: Vec<DVec3> =
            (0..700).map(|k| DVec3::new(wave(k, 1.3), 0.2 * wave(k, 2.9), wave(k, 4.7))).collect();
        let tree = PointTree::new(&points);
        let mut found = Vec::new();
        for k in 0..50 {
            let at = DVec3::new(wave(k, 0.7), wave(k, 1.9), wave(k, 3.3));
            tree.nearest_into(at, 5, 0.6, &mut found);
            let mut all: Vec<f64> = points.iter().map(|p| p.distance(at)).filter(|d| *d < 0.6).collect();
            all.sort_by(f64::total_cmp);
            all.truncate(5);
            assert_eq!(found.iter().map(|f| f.1).collect::<Vec<_>>(), all);
            assert!(found.iter().all(|&(id, distance)| points[id as usize].distance(at) == distance));
        }
    }
}
