//! Where the fit begins.

use super::*;

/// A place is tried with the person turned by each of these.
const HEADINGS: usize = 8;
/// Of these, every second one is tried on the head, too.
const EVERY_UPSIDE_DOWN: usize = 2;
/// Heights of people, metres.
const STATURES_M: [f64; 2] = [1.2, 2.3];
/// Cells in which points count as connected.
const CELL_M: f64 = 0.06;
/// Rounds that compare headings, on a part of the points; the first ones hardly leave the shape they begin with.
const LOOKS: [Round; 3] = [
    Round { farthest_m: 0.3, surface_sd_m: 1.0, landmark_sd_m: 1.0, steps: 4 },
    Round { farthest_m: 0.2, surface_sd_m: 0.3, landmark_sd_m: 1.0, steps: 4 },
    Round { farthest_m: 0.12, surface_sd_m: 0.1, landmark_sd_m: 1.0, steps: 4 },
];
const POINTS_LOOKED_AT: usize = 3_000;

/// The mean body, brought to the landmarks by a rigid motion; `None` when these do not say which.
pub(super) fn from_landmarks<'a>(model: &'a BodyModel, pairs: &[LandmarkPair]) -> Option<ModelFit<'a>> {
    let body = model.mean();
    let rest = |v: u32| DVec3::from_array(body.rest_vertices()[v as usize].map(f64::from));
    let place = |pair: &LandmarkPair| -> DVec3 {
        pair.vertices.iter().zip(pair.barycentric).map(|(&v, w)| rest(v) * w).sum()
    };
    let points: Vec<(DVec3, DVec3)> = pairs.iter().map(|pair| (place(pair), pair.position)).collect();
    let scan_from_body = rigid_fit(&points)?;
    let pose = Pose {
        root_position: scan_from_body.transform_point3(body.rest_joints()[JointId::PELVIS.index()]),
        root_orientation: DQuat::from_mat3(&scan_from_body.matrix3),
        angles: vec![0.0; N_DOF],
    };
    Some(ModelFit::new(model, vec![0.0; model.n_components()], pose))
}

/// A body of the scan's height in the middle of its largest connected piece, at the heading that fits best. The other pieces
/// are taken out of the scan.
pub(super) fn without_landmarks<'a>(
    model: &'a BodyModel,
    scan: &mut Scan,
) -> Result<ModelFit<'a>, RegisterError> {
    scan.keep_largest_piece(CELL_M);
    let [low, high] = scan.bounds();
    let height_m = high.y - low.y;
    if !(STATURES_M[0]..=STATURES_M[1]).contains(&height_m) {
        return Err(RegisterError::NotAPerson { height_m });
    }
    let coefficients = model.coefficients_for_stature(height_m, None);
    let body = model.shape(&coefficients);
    let pelvis = body.rest_joints()[JointId::PELVIS.index()];
    let middle = low.midpoint(high);
    let mut thin = scan.thinned(POINTS_LOOKED_AT);
    let mut look = |heading: usize, is_upright: bool| {
        let turn = DQuat::from_rotation_y(std::f64::consts::TAU * heading as f64 / HEADINGS as f64);
        let (root_orientation, root_y) = if is_upright {
            (turn, low.y + pelvis.y)
        } else {
            (turn * DQuat::from_rotation_x(std::f64::consts::PI), high.y - pelvis.y)
        };
        let root_position = DVec3::new(middle.x, root_y, middle.z);
        let pose = Pose { root_position, root_orientation, angles: vec![0.0; N_DOF] };
        let mut fit = ModelFit::new(model, coefficients.clone(), pose);
        for look in &LOOKS {
            for _ in 0..look.steps {
                orient(&mut thin, &fit.vertices, model.triangles());
                fit.run(&thin, &[], &Round { steps: 1, ..*look });
            }
        }
        (mean_distance_m(&thin, &fit, model), fit)
    };
    let mut upright: Vec<(f64, ModelFit)> = (0..HEADINGS).map(|heading| look(heading, true)).collect();
    upright.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (least, fit) = upright.swap_remove(0);
    let mut on_the_head = (0..HEADINGS).step_by(EVERY_UPSIDE_DOWN).map(|heading| look(heading, false).0);
    if on_the_head.any(|distance| distance < least) {
        return Err(RegisterError::UpsideDown);
    }
    Ok(fit)
}

/// Mean distance from points of the scan to the body, each at most 10 cm.
fn mean_distance_m(scan: &Scan, fit: &ModelFit<'_>, model: &BodyModel) -> f64 {
    let tree = TriangleTree::new(&fit.vertices, model.triangles());
    let distances = scan.points().iter().map(|point| tree.nearest(*point).distance_m.min(STRAY_M));
    distances.sum::<f64>() / scan.points().len() as f64
}
