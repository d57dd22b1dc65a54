//! A picture of the fitted body from the front and from its right, with the tapes of its girths.

use biosig::{Girth, Measurements, Tape};
use body::{Body, Camera, Intrinsics, Pose};
use glam::{DVec2, DVec3};
use silhouette::Mask;

use crate::draw::{Canvas, OverlayScene, SeenMesh, paint_overlay};
use crate::input::RgbFrame;

const SIZE_PX: [u32; 2] = [520, 860];
/// From so far away that lines of sight are nearly parallel, metres.
const DISTANCE_M: f64 = 12.0;
/// Metres of the body's height that fill the picture.
const FIELD_M: f64 = 2.2;
const BODY_COLOR: [u8; 3] = [255, 158, 84];
const TAPE_COLOR: [u8; 3] = [64, 220, 255];
const TAPE_BEHIND_COLOR: [u8; 3] = [38, 110, 130];
const TEXT_COLOR: [u8; 3] = [235, 238, 245];
const TAPES: [Girth; 5] = [Girth::Chest, Girth::Waist, Girth::Hips, Girth::RightThigh, Girth::RightCalf];

/// The picture.
///
/// # Errors
/// When the body has a size that no camera can show.
pub fn picture(body: &Body, tape: &Tape, measured: &Measurements) -> anyhow::Result<RgbFrame> {
    let [width, height] = SIZE_PX;
    let mut both = Canvas::filled(2 * width, height, [0; 3]);
    for (place, side_rad) in [0.0, -std::f64::consts::FRAC_PI_2].into_iter().enumerate() {
        let view = view(body, tape, measured, side_rad)?;
        both.copy_part(&view, [0, 0], SIZE_PX, [place as u32 * width, 0]);
    }
    Ok(both.into_frame())
}

fn view(body: &Body, tape: &Tape, measured: &Measurements, turn_rad: f64) -> anyhow::Result<RgbFrame> {
    let [width, height] = SIZE_PX;
    let focal_px = f64::from(height) * DISTANCE_M / FIELD_M;
    let intrinsics = Intrinsics::from_focal(width, height, focal_px)?;
    let pelvis = body.rest_joints()[0];
    let middle_m = 0.5 * body.stature_m();
    // The body looks along +x of the world; the camera stands before it.
    let pose = Pose::upright(DVec3::new(0.0, 0.0, pelvis.y), turn_rad);
    let eye = DVec3::new(DISTANCE_M, 0.0, middle_m);
    let camera = Camera::look_at(intrinsics, eye, DVec3::new(0.0, 0.0, middle_m))?;
    let mut points_camera = vec![[0.0; 3]; body.n_vertices()];
    body.skin_batch_into(&camera.camera_from_world(), std::slice::from_ref(&pose), &mut points_camera);
    let pixel = |point: DVec3| camera.project_from_camera(point).map_or(DVec2::NAN, |pixel| pixel);
    let pixels: Vec<[f32; 2]> = points_camera
        .iter()
        .map(|p| pixel(DVec3::from_array(p.map(f64::from))).as_vec2().to_array())
        .collect();
    let painted = paint_overlay(&OverlayScene {
        size: SIZE_PX,
        picture: None,
        mask: &Mask::new(width, height),
        mesh: SeenMesh { pixels: &pixels, points_camera: &points_camera, triangles: body.triangles() },
        joints: &[],
        bones: &[],
        body_color: BODY_COLOR,
        label: "",
    });
    let mut canvas = Canvas::shrunk(&painted.picture, width, height);
    for girth in TAPES {
        let corners = tape.loop_of(body.rest_vertices(), girth, &measured.plane(girth));
        let seen: Vec<DVec3> = corners
            .iter()
            .map(|corner| {
                let world = pose.root_orientation * (*corner - pelvis) + pose.root_position;
                camera.camera_from_world().transform_point3(world)
            })
            .collect();
        let depth = seen.iter().map(|point| point.z).sum::<f64>() / seen.len().max(1) as f64;
        for (index, from) in seen.iter().enumerate() {
            let to = seen[(index + 1) % seen.len()];
            let is_behind = 0.5 * (from.z + to.z) > depth;
            let color = if is_behind { TAPE_BEHIND_COLOR } else { TAPE_COLOR };
            let ends = [*from, to].map(|point| pixel(point).as_vec2().to_array());
            canvas.line(ends[0], ends[1], if is_behind { 1.0 } else { 2.5 }, color);
        }
        if let Some(right) = seen.iter().max_by(|a, b| a.x.total_cmp(&b.x)) {
            let at = pixel(*right);
            let text =
                format!("{} {:.0} cm", girth.name().replace('_', " "), 100.0 * measured.girth_m(girth));
            let left = (at.x + 12.0).min(f64::from(width - Canvas::text_width(&text)) - 4.0);
            canvas.text(left as i64, at.y as i64 - 10, &text, TEXT_COLOR);
        }
    }
    Ok(canvas.into_frame())
}
