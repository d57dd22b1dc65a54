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

/// Places an upright body with these joint angles and heading where its silhouette covers the mask best: the pelvis lies
/// on the ray through the middle of the mask, at the distance at which size and floor agree.
///
/// # Errors
/// When the overlap cannot be counted.
///
/// # Panics
/// When the mask is empty or not that of `overlap`'s camera.
pub fn place_upright(
    overlap: &mut BodyOverlap,
    mask: &Mask,
    angles: &[f64],
    heading_rad: f64,
) -> Result<Placement, ScoreError> {
    let ray = overlap.camera().ray(centroid_px(mask));
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
            let floor_gap_m = lowest_sole_m(&overlap.body().joints(&pose), overlap.body().rest_joints());
            let score = iou - FLOOR_LOSS * (floor_gap_m / FLOOR_TOLERANCE_M).powi(2);
            Placement { pose, score }
        })
        .max_by(|a, b| a.score.total_cmp(&b.score));
    Ok(best.expect("there is at least one distance"))
}

/// Height of the lowest sole above the floor z = 0, metres; negative when it is below.
/// `joints_world` and `rest_joints`, [n_joints], metres; at rest the soles are at y = 0.
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

/// Mean of the mask's pixel centres, pixels.
fn centroid_px(mask: &Mask) -> DVec2 {
    let (mut sum, mut n) = (DVec2::ZERO, 0.0);
    for y in 0..mask.height() {
        for x in 0..mask.width() {
            if mask.get(x, y) {
                sum += DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                n += 1.0;
            }
        }
    }
    assert!(n > 0.0, "an empty mask has no middle");
    sum / n
}
