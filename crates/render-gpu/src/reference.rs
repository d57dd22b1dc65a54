//! The rule of coverage, pixel by pixel: slow, plain, and the judge of every other scorer.

use crate::camera::Intrinsics;
use crate::clip::Clipper;
use crate::exact::turn;
use crate::project::{Projector, SUBPIXELS, Snapped};
use crate::rows::RowStep;
use crate::scorer::{MaskView, MeshBatch, OverlapCounts, ScoreError, SilhouetteScorer, TargetError};
use crate::topology::Topology;

/// Tests every pixel centre against the edges of every triangle.
#[derive(Clone, Debug, Default)]
pub struct ReferenceScorer {
    target: Option<(Vec<Vec<bool>>, Projector)>,
    row_step: Option<RowStep>,
}

impl SilhouetteScorer for ReferenceScorer {
    fn set_target(&mut self, mask: &MaskView<'_>, camera: &Intrinsics) -> Result<(), TargetError> {
        camera.check()?;
        let (size, expected) = ([mask.width, mask.height], [camera.width, camera.height]);
        if size != expected {
            return Err(TargetError::Size { mask: size, camera: expected });
        }
        let bit = |x: u32, y: u32| {
            let word = mask.words[y as usize * mask.words_per_row + x as usize / 64];
            word >> (x % 64) & 1 == 1
        };
        let pixels = (0..mask.height).map(|y| (0..mask.width).map(|x| bit(x, y)).collect()).collect();
        self.target = Some((pixels, Projector::new(camera)));
        Ok(())
    }

    fn set_row_step(&mut self, step: RowStep) {
        self.row_step = Some(step);
    }

    fn score(&mut self, batch: &MeshBatch<'_>, out: &mut [OverlapCounts]) -> Result<(), ScoreError> {
        let n_meshes = batch.n_meshes();
        assert_eq!(out.len(), n_meshes, "{} slots for the counts of {n_meshes} meshes", out.len());
        let (mask, projector) = self.target.as_ref().ok_or(ScoreError::NoTarget)?;
        Topology::new(batch.triangles, batch.vertices_per_mesh)?;
        let step = self.row_step.unwrap_or(RowStep::EVERY);
        for (mesh, counts) in out.iter_mut().enumerate() {
            let positions =
                &batch.positions_camera[mesh * batch.vertices_per_mesh..][..batch.vertices_per_mesh];
            let mut silhouette = vec![vec![false; mask[0].len()]; mask.len()];
            Clipper::default()
                .triangles(projector, positions, batch.triangles, |corners| {
                    draw(corners, projector.origin, &mut silhouette);
                })
                .map_err(|bad| ScoreError::NotFinite { mesh, vertex: bad.vertex })?;
            *counts = OverlapCounts::default();
            for y in step.rows(mask.len() as u32) {
                for (&observed, &rendered) in mask[y as usize].iter().zip(&silhouette[y as usize]) {
                    counts.observed += u32::from(observed);
                    counts.rendered += u32::from(rendered);
                    counts.both += u32::from(observed && rendered);
                }
            }
        }
        Ok(())
    }
}

/// Sets the pixels of a triangle.
fn draw([a, b, c]: [Snapped; 3], origin: [i32; 2], pixels: &mut [Vec<bool>]) {
    let corners = match turn([a, b, c]) {
        0 => return,
        1.. => [a, b, c],
        _ => [a, c, b],
    };
    // The pixels whose centres can lie in the box around the corners.
    let range = |axis: usize, n: usize| {
        let (low, high) = (corners.map(|p| p[axis]), corners.map(|p| p[axis]));
        let pixel = |snapped: i32| snapped.div_euclid(SUBPIXELS) + origin[axis];
        let first = pixel(low.into_iter().min().expect("three corners")).max(0);
        first..(pixel(high.into_iter().max().expect("three corners")) + 1).min(n as i32)
    };
    for y in range(1, pixels.len()) {
        for x in range(0, pixels[0].len()) {
            let centre = [x - origin[0], y - origin[1]].map(|pixel| SUBPIXELS * pixel + SUBPIXELS / 2);
            let inside = [(0, 1), (1, 2), (2, 0)].iter().all(|&(from, to)| {
                let (from, to) = (corners[from], corners[to]);
                // A centre on the edge belongs to the triangle if the edge is its upper or its left one.
                let is_top = from[1] == to[1] && to[0] > from[0];
                let is_left = to[1] < from[1];
                let side = turn([from, to, centre]);
                side > 0 || (side == 0 && (is_top || is_left))
            });
            pixels[y as usize][x as usize] |= inside;
        }
    }
}
