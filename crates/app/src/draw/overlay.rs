//! The body over a frame.

use silhouette::Mask;

use super::canvas::Canvas;
use super::outline::{Outline, outlines};
use super::raster::{BodyLayer, COVERAGE_SCALE, SeenMesh};
use super::{BODY_OUTLINE_COLOR, BONE_COLOR, MASK_COLOR};
use crate::input::RgbFrame;

/// Parts of an outline that enclose less are noise, pixels of the mask.
const LEAST_AREA: f32 = 40.0;
/// Background of a picture that shows no frame, and of the mask on it.
const NEUTRAL: [u8; 3] = [34, 37, 45];
const NEUTRAL_MASK: [u8; 3] = [86, 93, 108];
const BODY_OPACITY: f32 = 0.72;

/// What an overlay shows. Pixels are those of the overlay, whose size may be smaller than the mask's.
#[derive(Clone, Copy, Debug)]
pub struct OverlayScene<'a> {
    /// Columns and rows of the overlay.
    pub size: [u32; 2],
    /// The frame; without it the mask is shown on a neutral background.
    pub picture: Option<&'a RgbFrame>,
    /// The person as segmented.
    pub mask: &'a Mask,
    /// The posed body.
    pub mesh: SeenMesh<'a>,
    /// Joints, `[n_joints]`, pixels; NaN where the camera does not see one.
    pub joints: &'a [[f32; 2]],
    /// Pairs of joints that a bone connects.
    pub bones: &'a [[usize; 2]],
    /// Colour of the body.
    pub body_color: [u8; 3],
    /// Text in the top-left corner.
    pub label: &'a str,
}

/// A painted overlay.
#[derive(Clone, Debug)]
pub struct Overlay {
    /// The picture.
    pub picture: RgbFrame,
    /// Outlines of the mask, pixels of the picture.
    pub mask_outlines: Vec<Outline>,
    /// Outlines of the body, pixels of the picture.
    pub body_outlines: Vec<Outline>,
}

/// Paints the body, its bones and both outlines over the frame.
pub fn paint_overlay(scene: &OverlayScene<'_>) -> Overlay {
    let [width, height] = scene.size;
    let mask_scale = width as f32 / scene.mask.width() as f32;
    let mask_outlines = outlines(scene.mask, LEAST_AREA, mask_scale);
    let mut canvas = match scene.picture {
        Some(picture) => Canvas::shrunk(picture, width, height),
        None => neutral_background(scene.mask, width, height),
    };
    let body = BodyLayer::draw(&scene.mesh, width, height);
    body.blend_onto(&mut canvas, scene.body_color, BODY_OPACITY);
    let body_outlines = outlines(&body.coverage, LEAST_AREA, COVERAGE_SCALE);

    // Thin on small pictures, stronger on large ones.
    let stroke = (height.min(width) as f32 / 400.0).clamp(0.8, 3.0);
    for outline in &body_outlines {
        canvas.closed_line(outline, stroke, BODY_OUTLINE_COLOR);
    }
    for outline in &mask_outlines {
        canvas.closed_line(outline, stroke, MASK_COLOR);
    }
    for &[a, b] in scene.bones {
        canvas.line(scene.joints[a], scene.joints[b], 2.0 * stroke, BONE_COLOR);
    }
    for &joint in scene.joints {
        canvas.disc(joint, 2.2 * stroke, BODY_OUTLINE_COLOR);
        canvas.disc(joint, 1.4 * stroke, BONE_COLOR);
    }
    canvas.text(9, 7, scene.label, [0; 3]);
    canvas.text(8, 6, scene.label, [255; 3]);
    Overlay { picture: canvas.into_frame(), mask_outlines, body_outlines }
}

fn neutral_background(mask: &Mask, width: u32, height: u32) -> Canvas {
    let mut full = RgbFrame::default();
    full.resize(mask.width(), mask.height());
    for (y, row) in full.pixels.chunks_exact_mut(3 * mask.width() as usize).enumerate() {
        let row: &mut [[u8; 3]] = row.as_chunks_mut().0;
        row.fill(NEUTRAL);
        for (start, end) in mask.runs(y as u32) {
            row[start as usize..end as usize].fill(NEUTRAL_MASK);
        }
    }
    Canvas::shrunk(&full, width, height)
}
