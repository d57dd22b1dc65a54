//! A scan as points with normals, and the surface they stand for.

use std::collections::BTreeMap;

use glam::{DMat3, DVec3};
use nalgebra::Matrix3;

use crate::mesh::{PointTree, area_normal, corners};

/// Neighbours that give a point's normal.
const NORMAL_NEIGHBOURS: usize = 12;
/// Points that stand for the surface near a place.
const SURFACE_NEIGHBOURS: usize = 6;
/// Where a scan has triangles, they are covered with points this dense.
const SAMPLE_SPACING_M: f64 = 0.006;
/// A place is over a hole when the nearest point of the scan is farther aside than this many spacings.
const HOLE_SPACINGS: f64 = 2.0;
/// Fewer points are no scan of a person.
const LEAST_POINTS: usize = 500;
/// No scan of a person is larger, whoever and whatever else is in it: such lengths are in another unit.
const LARGEST_EXTENT_M: f64 = 10.0;

/// Why points are not a scan that can be registered.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ScanError {
    /// Too little to go by.
    #[error("{found} points, expected {LEAST_POINTS} or more")]
    TooFewPoints {
        /// Points there are.
        found: usize,
    },
    /// A point that is nowhere.
    #[error("`points[{point}]` is {position:?}, expected finite numbers")]
    NotFinite {
        /// Which.
        point: usize,
        /// Where.
        position: [f32; 3],
    },
    /// Larger than a room: covering its triangles with points would take all memory.
    #[error("the scan extends over {extent_m:.1} m, expected {LARGEST_EXTENT_M} m or less: check the unit")]
    TooLarge {
        /// Longest side of the box around the points.
        extent_m: f64,
    },
}

/// Points of a body's surface with normals, metres, in the scan's own frame.
#[derive(Clone, Debug)]
pub struct Scan {
    points: Vec<DVec3>,
    normals: Vec<DVec3>,
    /// Whether the normals point outwards; until [`Scan::orient`] those of a cloud may point either way.
    is_oriented: bool,
    spacing_m: f64,
    tree: PointTree,
}

/// The surface of a scan near some place: a plane through it.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePlane {
    /// A point of the plane.
    pub point: DVec3,
    /// Its outward unit normal.
    pub normal: DVec3,
}

impl SurfacePlane {
    /// How far `place` is outside the plane, metres; negative inside.
    pub fn height_m(&self, place: DVec3) -> f64 {
        self.normal.dot(place - self.point)
    }
}

impl Scan {
    /// A scan of `positions` in metres. With `triangles` (outward by the right-hand rule) their surface counts, without
    /// them the points are a cloud, whose normals follow from neighbours.
    ///
    /// # Errors
    /// When there are too few points, one is not finite, or they lie too far apart for metres.
    ///
    /// # Panics
    /// When a triangle names a vertex that is not there.
    pub fn new(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Result<Self, ScanError> {
        if let Some(point) = positions.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
            return Err(ScanError::NotFinite { point, position: positions[point] });
        }
        let positions: Vec<DVec3> = positions.iter().map(|p| DVec3::from_array(p.map(f64::from))).collect();
        let [low, high] = bounds(&positions);
        let extent_m = (high - low).max_element();
        if extent_m > LARGEST_EXTENT_M {
            return Err(ScanError::TooLarge { extent_m });
        }
        let (points, normals) = if triangles.is_empty() {
            (without_repeats(positions), Vec::new())
        } else {
            samples(&positions, triangles)
        };
        if points.len() < LEAST_POINTS {
            return Err(ScanError::TooFewPoints { found: points.len() });
        }
        let tree = PointTree::new(&points);
        let is_oriented = !normals.is_empty();
        let spacing_m = spacing_m(&points, &tree);
        let normals = if is_oriented { normals } else { plane_normals(&points, &tree) };
        Ok(Self { points, normals, is_oriented, spacing_m, tree })
    }

    /// The points, metres.
    pub fn points(&self) -> &[DVec3] {
        &self.points
    }

    /// Typical distance between neighbours, metres.
    pub fn spacing_m(&self) -> f64 {
        self.spacing_m
    }

    /// Lowest and highest corner of the box around the points.
    pub fn bounds(&self) -> [DVec3; 2] {
        bounds(&self.points)
    }

    /// The scan with about `count` of its points.
    pub(super) fn thinned(&self, count: usize) -> Self {
        let every = self.points.len().div_ceil(count);
        let points: Vec<DVec3> = self.points.iter().copied().step_by(every).collect();
        let tree = PointTree::new(&points);
        let spacing_m = spacing_m(&points, &tree);
        let normals = self.normals.iter().copied().step_by(every).collect();
        Self { points, normals, is_oriented: self.is_oriented, spacing_m, tree }
    }

    /// Drops all points but those of the largest piece; points in neighbouring cells of side `cell_m` hang together.
    pub(super) fn keep_largest_piece(&mut self, cell_m: f64) {
        let cell = |point: &DVec3| (*point / cell_m).floor().to_array().map(|x| x as i64);
        let mut piece_of: BTreeMap<[i64; 3], usize> = self.points.iter().map(|p| (cell(p), 0)).collect();
        let cells: Vec<[i64; 3]> = piece_of.keys().copied().collect();
        let mut n_pieces = 0;
        for seed in cells {
            if piece_of[&seed] != 0 {
                continue;
            }
            n_pieces += 1;
            piece_of.insert(seed, n_pieces);
            let mut open = vec![seed];
            while let Some([x, y, z]) = open.pop() {
                for k in 0..27 {
                    let next = [x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1];
                    if let Some(piece) = piece_of.get_mut(&next).filter(|piece| **piece == 0) {
                        *piece = n_pieces;
                        open.push(next);
                    }
                }
            }
        }
        let mut sizes = vec![0; n_pieces + 1];
        self.points.iter().for_each(|point| sizes[piece_of[&cell(point)]] += 1);
        let largest = (1..=n_pieces).max_by_key(|&piece| sizes[piece]).expect("a scan has points");
        let is_kept: Vec<bool> = self.points.iter().map(|point| piece_of[&cell(point)] == largest).collect();
        let mut kept = is_kept.iter();
        self.points.retain(|_| *kept.next().expect("one for each point"));
        kept = is_kept.iter();
        self.normals.retain(|_| *kept.next().expect("one for each point"));
        self.tree = PointTree::new(&self.points);
    }

    /// Turns every normal to the side that `outward` says for its point; those of triangles stay.
    pub(super) fn orient(&mut self, outward: impl Fn(DVec3) -> DVec3) {
        if self.is_oriented {
            return;
        }
        for (normal, point) in self.normals.iter_mut().zip(&self.points) {
            if normal.dot(outward(*point)) < 0.0 {
                *normal = -*normal;
            }
        }
    }

    /// The surface near `place`, if some lies within `farthest_m` whose normal agrees with `normal` to `least_cosine`:
    /// the mean of the planes of the nearest such points. `None` over a hole, too.
    pub fn surface_near(
        &self,
        place: DVec3,
        normal: DVec3,
        farthest_m: f64,
        least_cosine: f64,
    ) -> Option<SurfacePlane> {
        let mut found = Vec::with_capacity(2 * SURFACE_NEIGHBOURS + 1);
        self.tree.nearest_into(place, 2 * SURFACE_NEIGHBOURS, farthest_m, &mut found);
        let agrees = |&(id, _): &(u32, f64)| self.normals[id as usize].dot(normal) > least_cosine;
        found.retain(agrees);
        found.truncate(SURFACE_NEIGHBOURS);
        let (nearest, _) = *found.first()?;
        let mut plane = SurfacePlane { point: DVec3::ZERO, normal: DVec3::ZERO };
        for &(id, _) in &found {
            plane.point += self.points[id as usize] / found.len() as f64;
            plane.normal += self.normals[id as usize];
        }
        plane.normal = plane.normal.normalize_or(normal);
        let aside = (place - self.points[nearest as usize]).reject_from_normalized(plane.normal);
        (aside.length() < HOLE_SPACINGS * self.spacing_m).then_some(plane)
    }
}

/// Lowest and highest corner of the box around points.
fn bounds(points: &[DVec3]) -> [DVec3; 2] {
    let start = [DVec3::INFINITY, DVec3::NEG_INFINITY];
    points.iter().fold(start, |[low, high], point| [low.min(*point), high.max(*point)])
}

/// The points in another order, each place once: repeats would make the spacing zero.
fn without_repeats(mut points: Vec<DVec3>) -> Vec<DVec3> {
    points.sort_unstable_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
    points.dedup();
    points
}

/// Points on the triangles, evenly spread, with the triangles' normals.
fn samples(vertices: &[DVec3], triangles: &[[u32; 3]]) -> (Vec<DVec3>, Vec<DVec3>) {
    let (mut points, mut normals) = (Vec::new(), Vec::new());
    // The area left over from one triangle is carried to the next, so that small ones get their share.
    let mut owed = 0.0;
    for &triangle in triangles {
        let [a, b, c] = corners(vertices, triangle);
        let normal = area_normal([a, b, c]);
        owed += normal.length() / (2.0 * SAMPLE_SPACING_M * SAMPLE_SPACING_M);
        let count = owed as usize;
        owed -= count as f64;
        for k in 0..count {
            // The plastic number's low-discrepancy sequence, folded into the triangle.
            let (mut u, mut v) =
                ((0.5 + 0.754_877_666 * k as f64).fract(), (0.5 + 0.569_840_291 * k as f64).fract());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            points.push(a + (b - a) * u + (c - a) * v);
            normals.push(normal.normalize_or_zero());
        }
    }
    (points, normals)
}

/// Median distance to the nearest neighbour of a few hundred points, times the ratio that a cloud of random points would need
/// for one point per square of that side.
fn spacing_m(points: &[DVec3], tree: &PointTree) -> f64 {
    let mut distances = Vec::new();
    let mut found = Vec::new();
    for point in points.iter().step_by(points.len().div_ceil(500)) {
        tree.nearest_into(*point, 2, f64::INFINITY, &mut found);
        distances.push(found[1].1);
    }
    distances.sort_by(f64::total_cmp);
    // Points at random, n on a unit square: the median of the nearest distance is sqrt(ln 2 / (π n)).
    distances[distances.len() / 2] * (std::f64::consts::PI / std::f64::consts::LN_2).sqrt()
}

/// The direction of least spread of each point's neighbours, of either sign (`[Hoppe1992]` section 3.1).
fn plane_normals(points: &[DVec3], tree: &PointTree) -> Vec<DVec3> {
    let mut found = Vec::new();
    let mut normal = |point: &DVec3| {
        tree.nearest_into(*point, NORMAL_NEIGHBOURS, f64::INFINITY, &mut found);
        let neighbours = || found.iter().map(|&(id, _)| points[id as usize]);
        let mean = neighbours().sum::<DVec3>() / found.len() as f64;
        let covariance = neighbours().fold(DMat3::ZERO, |sum, p| {
            let d = p - mean;
            sum + DMat3::from_cols(d * d.x, d * d.y, d * d.z)
        });
        least_axis(covariance)
    };
    points.iter().map(&mut normal).collect()
}

fn least_axis(covariance: DMat3) -> DVec3 {
    let eigen = Matrix3::from_column_slice(&covariance.to_cols_array()).symmetric_eigen();
    let axis = eigen.eigenvectors.column(eigen.eigenvalues.imin());
    DVec3::new(axis[0], axis[1], axis[2])
}
