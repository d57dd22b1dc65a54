//! Where to begin: an upright body of the given heading, placed by camera, floor and stature.

use body::{JointId, N_JOINTS, Pose, RestJoints};
use glam::{DVec2, DVec3};
use render_gpu::ScoreError;
use silhouette::Mask;

use super::overlap::BodyOverlap;

/// Distances from the camera that a placement tries, metres,
const DISTANCES_M: std::ops::Range<f64> = 0.8..20.0;
/// and how many, evenly spaced in their logarithm: 4 % apart.
const N_DISTANCES: usize = 80;
/// How far the feet may be off the floor before a placement loses [`FLOOR_LOSS`]: neither floors (a treadmill, a mat)
/// nor statures are exact.
const FLOOR_TOLERANCE_M: f64 = 0.25;
/// Intersection over union that a placement with its feet off the floor by the tolerance loses.
const FLOOR_LOSS: f64 = 0.02;

/// A body put before the camera, and how well it fits the mask there.
#[derive(Clone, Debug)]
pub struct Placement {
    /// The upright pose.
    pub pose: Pose,
    /// Intersection over union with the mask, less what the distance of the feet from the floor costs.
    pub score: f64,
}

/// Why a body cannot be placed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlaceError {
    /// The distortion of the camera leads no ray to the person.
    #[error(
        "camera: `distortion` folds over before the pixel ({x_px:.0}, {y_px:.0}), the middle of the person"
    )]
    NoRay {
        /// Pixel at working resolution.
        x_px: f64,
        /// Pixel at working resolution.
        y_px: f64,
    },
    /// The overlap cannot be counted.
    #[error("cannot lay the body over the mask")]
    Score(#[from] ScoreError),
}

/// Places an upright body with these joint angles and heading where its silhouette covers the mask best: the pelvis lies
/// on the ray through the middle of the mask, at the distance at which size and floor agree.
///
/// # Errors
/// When the overlap cannot be counted, or the lens of the camera shows nothing at the middle of the mask.
///
/// # Panics
/// When the mask is empty or not the one that `overlap` counts against.
pub fn place_upright(
    overlap: &mut BodyOverlap,
    mask: &Mask,
    angles: &[f64],
    heading_rad: f64,
) -> Result<Placement, PlaceError> {
    let middle_px = DVec2::from_array(mask.centroid_px().expect("somebody is on the mask"));
    let ray =
        overlap.camera().ray(middle_px).ok_or(PlaceError::NoRay { x_px: middle_px.x, y_px: middle_px.y })?;
    let log_ratio = (DISTANCES_M.end / DISTANCES_M.start).ln() / (N_DISTANCES - 1) as f64;
    let poses: Vec<Pose> = (0..N_DISTANCES)
        .map(|step| {
            let distance_m = DISTANCES_M.start * (log_ratio * step as f64).exp();
            let mut pose = Pose::upright(ray.origin + distance_m * ray.direction, heading_rad);
            pose.angles.copy_from_slice(angles);
            pose
        })
        .collect();
    let ious: Vec<f64> = overlap.counts(&poses)?.iter().map(|counts| counts.iou()).collect();
    let best = poses
        .into_iter()
        .zip(ious)
        .map(|(pose, iou)| {
            let floor_gap_m =
                lowest_sole_m(&overlap.body().joints_world(&pose), overlap.body().rest_joints());
            let score = iou - FLOOR_LOSS * (floor_gap_m / FLOOR_TOLERANCE_M).powi(2);
            Placement { pose, score }
        })
        .max_by(|a, b| a.score.total_cmp(&b.score));
    Ok(best.expect("there is at least one distance"))
}

/// Height of the lowest sole above the floor z = 0, metres; negative when it is below.
/// `joints_world` and `rest_joints`, `[n_joints]`, metres; at rest the soles are at y = 0.
pub fn lowest_sole_m(joints_world: &[DVec3; N_JOINTS], rest_joints: &RestJoints) -> f64 {
    FEET.iter()
        .map(|foot| joints_world[foot.index()].z - rest_joints[foot.index()].y)
        .fold(f64::INFINITY, f64::min)
}

/// The parts of the feet that stand on the floor.
const FEET: [JointId; 6] = [
    JointId::LEFT_HEEL,
    JointId::LEFT_BALL,
    JointId::LEFT_TOE_TIP,
    JointId::RIGHT_HEEL,
    JointId::RIGHT_BALL,
    JointId::RIGHT_TOE_TIP,
];

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::Arc;

    use body::io::cameras::load_camera;
    use body::pose_prior::PosePrior;
    use body::{BodyModel, JointId};

    use super::*;
    use crate::eval::reference::{JUDGED, read_reference};
    use crate::track::{ClipInput, ClipReader};

    #[test]
    fn an_upright_body_is_placed_where_a_real_man_stands() {
        const SCALE: f64 = 0.25;
        let clip = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/balance");
        let camera = load_camera(&clip.join("camera.toml")).unwrap().camera().unwrap().scaled(SCALE);
        let first = ClipReader::open(&ClipInput::Masks(clip.join("masks"))).unwrap().next_frame().unwrap();
        let mask = first.unwrap().mask.resized(camera.intrinsics().width, camera.intrinsics().height);
        let body = Arc::new(BodyModel::builtin().shape_for_stature(1.77, None));
        let mut overlap = BodyOverlap::new(body, camera);
        overlap.set_mask(&mask).unwrap();

        let placement = place_upright(&mut overlap, &mask, PosePrior::builtin().mean_rad(), 0.0).unwrap();

        let reference = &read_reference(&clip.join("joints3d.csv")).unwrap()[&0];
        let hip = |side| reference[JUDGED.iter().position(|(_, joint)| *joint == side).unwrap()].unwrap();
        let hips = 0.5 * (hip(JointId::LEFT_HIP) + hip(JointId::RIGHT_HIP));
        let off_m = (placement.pose.root_position - hips).length();
        assert!(off_m < 0.35, "{off_m} m from the hips of the reference");
        assert!(placement.score > 0.5, "overlap of {}", placement.score);
        // The floor of the clip's world is a little below the treadmill that he stands on.
        let sole_m =
            lowest_sole_m(&overlap.body().joints_world(&placement.pose), overlap.body().rest_joints());
        assert!(sole_m.abs() < FLOOR_TOLERANCE_M, "soles {sole_m} m above the floor");
    }
}
