//! Triangles cut at the near plane and snapped: what every exact rasteriser is fed.

use crate::project::{NEAR_M, Projector, Snapped, load};

/// Snaps whole meshes; keeps its memory between them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Clipper {
    snapped: Vec<Snapped>,
}

/// The first vertex of a mesh that is not finite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct NotFinite {
    pub vertex: usize,
}

impl Clipper {
    /// Calls `emit` with the snapped corners of each triangle, in order; a triangle that reaches through the near
    /// plane gives one or two, one behind it none.
    pub fn triangles(
        &mut self,
        projector: &Projector,
        positions: &[[f32; 3]],
        triangles: &[[u32; 3]],
        mut emit: impl FnMut([Snapped; 3]),
    ) -> Result<(), NotFinite> {
        if let Some(vertex) = positions.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
            return Err(NotFinite { vertex });
        }
        self.snapped.clear();
        for first in (0..positions.len()).step_by(8) {
            let [x, y] = projector.snap(load(positions, first)).map(|lanes| lanes.to_array());
            let in_chunk = (positions.len() - first).min(8);
            self.snapped.extend(x.into_iter().zip(y).map(|(x, y)| [x, y]).take(in_chunk));
        }
        for corners in triangles {
            let corners = corners.map(|vertex| vertex as usize);
            if corners.iter().all(|&vertex| positions[vertex][2] >= NEAR_M) {
                emit(corners.map(|vertex| self.snapped[vertex]));
            } else {
                self.cut(projector, positions, corners, &mut emit);
            }
        }
        Ok(())
    }

    /// What lies beyond the near plane of a triangle, as a fan.
    fn cut(
        &self,
        projector: &Projector,
        positions: &[[f32; 3]],
        corners: [usize; 3],
        emit: &mut impl FnMut([Snapped; 3]),
    ) {
        let mut outline = [[0; 2]; 4];
        let mut n = 0;
        let mut push = |point| {
            outline[n] = point;
            n += 1;
        };
        for corner in 0..3 {
            let (this, next) = (corners[corner], corners[(corner + 1) % 3]);
            let (this_visible, next_visible) = (positions[this][2] >= NEAR_M, positions[next][2] >= NEAR_M);
            if this_visible {
                push(self.snapped[this]);
            }
            if this_visible != next_visible {
                let (front, behind) = if this_visible { (this, next) } else { (next, this) };
                push(projector.snap_one(at_near_plane(positions[front], positions[behind])));
            }
        }
        for end in 2..n {
            emit([outline[0], outline[end - 1], outline[end]]);
        }
    }
}

/// Where the segment meets the near plane; always reckoned from its visible end, so that two triangles that share an
/// edge are cut at the same point.
fn at_near_plane(front: [f32; 3], behind: [f32; 3]) -> [f32; 3] {
    let t = (front[2] - NEAR_M) / (front[2] - behind[2]);
    let between = |axis: usize| front[axis] + t * (behind[axis] - front[axis]);
    [between(0), between(1), NEAR_M]
}
