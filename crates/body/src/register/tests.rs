//! Scans made of bodies of the model, whose vertices are known.

use nalgebra::DVector;

use super::*;
use crate::model::Sex;
use crate::skeleton::Skeleton;

/// A man who lets his arms hang a little, turned and moved: body, pose, posed vertices.
fn man(model: &BodyModel) -> (Body, Pose, Vec<DVec3>) {
    let mut coefficients = model.coefficients_for_stature(1.79, Some(Sex::Male));
    for (k, coefficient) in coefficients.iter_mut().enumerate().take(12) {
        *coefficient += 0.8 * (1.7 * k as f64).sin();
    }
    let body = model.shape(&coefficients);
    let mut angles = vec![0.0; N_DOF];
    for (name, angle) in
        [("left_shoulder_abduction", -0.2), ("right_elbow_flexion", 0.15), ("right_hip_flexion", 0.1)]
    {
        angles[Skeleton::human().dof_index(name).unwrap()] = angle;
    }
    let root_orientation = DQuat::from_rotation_y(0.15);
    let pelvis = body.rest_joints()[JointId::PELVIS.index()];
    let pose = Pose { root_position: pelvis + DVec3::new(0.03, 0.0, -0.04), root_orientation, angles };
    let mut posed = vec![[0.0; 3]; body.n_vertices()];
    body.skin_into(&pose, &mut posed);
    let vertices = double(&posed);
    (body, pose, vertices)
}

fn double(points: &[[f32; 3]]) -> Vec<DVec3> {
    points.iter().map(|p| DVec3::from_array(p.map(f64::from))).collect()
}

fn single(points: &[DVec3]) -> Vec<[f32; 3]> {
    points.iter().map(|p| p.to_array().map(|x| x as f32)).collect()
}

/// Points on the surface with a millimetre of noise; those that `is_kept` refuses are holes.
fn cloud(vertices: &[DVec3], triangles: &[[u32; 3]], is_kept: impl Fn(DVec3) -> bool) -> Vec<[f32; 3]> {
    let scan = Scan::new(&single(vertices), triangles).unwrap();
    let noise = |k: usize, rate: f64| 1.4e-3 * (rate * k as f64).sin();
    let kept = scan.points().iter().enumerate().filter(|(_, point)| is_kept(**point));
    let points: Vec<DVec3> =
        kept.map(|(k, p)| *p + DVec3::new(noise(k, 12.9), noise(k, 78.2), noise(k, 37.7))).collect();
    single(&points)
}

/// Every `every`th landmark of the body, 2 mm off.
fn landmarks(model: &BodyModel, vertices: &[DVec3], every: usize) -> Vec<ScanLandmark> {
    let known = model.template().landmarks.iter().step_by(every).enumerate();
    known
        .map(|(k, landmark)| {
            let corners = landmark.vertices.iter().zip(landmark.barycentric);
            let place: DVec3 = corners.map(|(&v, w)| vertices[v as usize] * f64::from(w)).sum();
            let off = DVec3::new((3.1 * k as f64).sin(), (5.3 * k as f64).sin(), (7.7 * k as f64).sin());
            ScanLandmark { name: landmark.name.clone(), position: place + 0.002 * off }
        })
        .collect()
}

/// Median and largest distance to the true places, metres.
fn errors(found: &[DVec3], truth: &[DVec3]) -> (f64, f64) {
    let mut errors: Vec<f64> = found.iter().zip(truth).map(|(a, b)| a.distance(*b)).collect();
    errors.sort_by(f64::total_cmp);
    (errors[errors.len() / 2], errors[errors.len() - 1])
}

fn mean_distance(registration: &Registration) -> f64 {
    let known: Vec<f64> = registration.distances_m.iter().flatten().copied().collect();
    known.iter().sum::<f64>() / known.len() as f64
}

#[test]
fn a_noisy_cloud_with_holes_is_registered() {
    let model = BodyModel::builtin();
    let (_, _, truth) = man(&model);
    let crown = truth.iter().copied().max_by(|a, b| a.y.total_cmp(&b.y)).unwrap();
    let points = cloud(&truth, model.triangles(), |p| p.y > 0.02 && p.distance(crown) > 0.05);
    let scan = Scan::new(&points, &[]).unwrap();
    let found = register(&model, scan, &landmarks(&model, &truth, 1)).unwrap();
    let (median, largest) = errors(&found.vertices, &truth);
    assert!(median < 3e-3 && largest < 0.03, "median {median}, largest {largest}");
    assert!(mean_distance(&found) < 1e-3, "{}", mean_distance(&found));
    assert_eq!((found.flipped.len(), found.crossing.len(), found.stray_share), (0, 0, 0.0));
    assert!(found.unknown_landmarks.is_empty());
    let in_hole = found.vertices.iter().position(|p| p.distance(crown) < 0.02).unwrap();
    assert_eq!(found.distances_m[in_hole], None, "there is no surface over a hole");
}

#[test]
fn a_few_landmarks_do_and_unknown_names_are_told() {
    let model = BodyModel::builtin();
    let (body, _, truth) = man(&model);
    let mut marks = landmarks(&model, &truth, 8);
    marks.push(ScanLandmark { name: "Butt Block".into(), position: DVec3::ONE });
    let scan = Scan::new(&single(&truth), model.triangles()).unwrap();
    let found = register(&model, scan, &marks).unwrap();
    assert_eq!(found.unknown_landmarks, ["Butt Block"]);
    let (median, _) = errors(&found.vertices, &truth);
    assert!(median < 5e-3, "{median}");
    let rest = double(body.rest_vertices());
    let (median, largest) = errors(&found.rest_vertices(&model), &rest);
    assert!(median < 8e-3 && largest < 0.05, "at rest: median {median}, largest {largest}");
}

#[test]
fn a_standing_pose_straightens_limbs_and_keeps_the_trunk() {
    let model = BodyModel::builtin();
    let (body, mut pose, _) = man(&model);
    pose.angles[Skeleton::human().dof_index("neck_flexion").unwrap()] = 0.2;
    let mut posed = vec![[0.0; 3]; body.n_vertices()];
    body.skin_into(&pose, &mut posed);
    let registration = Registration {
        vertices: double(&posed),
        coefficients_sd: Vec::new(),
        pose: pose.clone(),
        distances_m: Vec::new(),
        unknown_landmarks: Vec::new(),
        stray_share: 0.0,
        flipped: Vec::new(),
        crossing: Vec::new(),
    };
    let standing = registration.standing_pose(&body);
    let moved: Vec<&str> = Skeleton::human()
        .dofs()
        .iter()
        .zip(&standing.angles)
        .filter(|(_, angle)| **angle != 0.0)
        .map(|(dof, _)| dof.name.as_str())
        .collect();
    assert_eq!(moved, ["neck_flexion"]);
    assert!((standing.root_orientation * DVec3::Z).distance(DVec3::Z) < 1e-9, "it faces +z");
    let mut expected = vec![[0.0; 3]; body.n_vertices()];
    body.skin_into(&standing, &mut expected);
    let found =
        Reposer::new(&body, &pose, &standing).carry_all(&registration.vertices, &model.template().influences);
    assert!(errors(&found, &double(&expected)).1 < 1e-5);
}

#[test]
fn names_of_survey_files_are_understood() {
    let model = BodyModel::builtin();
    let found = |name| find_landmark(&model.template().landmarks, name).map(|known| known.name.as_str());
    assert_eq!(found("Lt. Axilla, An"), Some("Lt Axilla, Ant."));
    assert_eq!(found("Rt. Metacarpal Phal. V"), Some("Rt Metacarpal-Phal. V"));
    assert_eq!(found("Rt. Metatarsal-Phal. I"), Some("Rt Metatarsal-Phal. I"));
    assert_eq!(found("Rt. Femoral "), None, "there are two");
    assert_eq!(found("Cro"), None, "too short");
}

#[test]
fn a_scan_without_landmarks_is_registered_the_right_way_round() {
    let model = BodyModel::builtin();
    let (_, _, truth) = man(&model);
    let turned: Vec<DVec3> = truth.iter().map(|p| DQuat::from_rotation_y(2.0) * *p).collect();
    let scan = Scan::new(&cloud(&turned, model.triangles(), |_| true), &[]).unwrap();
    let found = register(&model, scan, &[]).unwrap();
    let (median, largest) = errors(&found.vertices, &turned);
    assert!(median < 6e-3 && largest < 0.05, "median {median}, largest {largest}");
}

#[test]
fn another_person_in_the_scan_is_left_out_and_told() {
    let model = BodyModel::builtin();
    let (_, _, truth) = man(&model);
    let woman = model.shape_for_stature(1.6, Some(Sex::Female));
    let aside = DVec3::new(1.3, 0.0, 0.2);
    let other: Vec<DVec3> = double(woman.rest_vertices()).iter().map(|p| *p + aside).collect();
    let mut points = cloud(&truth, model.triangles(), |_| true);
    points.extend(cloud(&other, model.triangles(), |_| true));
    let marks = landmarks(&model, &truth, 4);
    let found = register(&model, Scan::new(&points, &[]).unwrap(), &marks).unwrap();
    assert!(errors(&found.vertices, &truth).0 < 4e-3);
    assert!((0.35..0.55).contains(&found.stray_share), "{}", found.stray_share);
    let alone = register(&model, Scan::new(&points, &[]).unwrap(), &[]).unwrap();
    assert!(errors(&alone.vertices, &truth).0 < 6e-3, "the larger piece is the man");
    assert!((0.35..0.55).contains(&alone.stray_share), "{}", alone.stray_share);
}

#[test]
fn what_is_no_standing_person_is_refused() {
    let model = BodyModel::builtin();
    let (_, _, truth) = man(&model);
    let message = |vertices: &[DVec3], marks: &[ScanLandmark]| {
        let scan = Scan::new(&single(vertices), model.triangles()).unwrap();
        register(&model, scan, marks).unwrap_err().to_string()
    };
    let turned =
        |angle: f64| -> Vec<DVec3> { truth.iter().map(|p| DQuat::from_rotation_x(angle) * *p).collect() };
    let expected = "the scan stands on its head, expected the head at the larger y";
    assert_eq!(message(&turned(3.1), &[]), expected);
    let text = message(&turned(1.5), &[]);
    assert!(text.ends_with("m high, expected a person of 1.2 to 2.3 m who stands along y"), "{text}");
    let mut marks = landmarks(&model, &truth, 1);
    marks.iter_mut().for_each(|mark| mark.name.insert(0, 'x'));
    let expected = "0 of 75 landmarks are known, expected 3 or more that are not in a line, or none at all";
    assert_eq!(message(&truth, &marks), expected);
    let marks = landmarks(&model, &truth, 1);
    let legs = cloud(&truth, model.triangles(), |p| p.y < 0.5);
    let text = register(&model, Scan::new(&legs, &[]).unwrap(), &marks).unwrap_err().to_string();
    assert!(text.starts_with("the scan has a surface near "), "{text}");
    let text = Scan::new(&legs[..100], &[]).unwrap_err().to_string();
    assert_eq!(text, "100 points, expected 500 or more");
    let in_millimetres: Vec<DVec3> = truth.iter().map(|p| 1000.0 * *p).collect();
    let text = Scan::new(&single(&in_millimetres), model.triangles()).unwrap_err().to_string();
    assert!(text.ends_with(" m, expected 10 m or less: check the unit"), "{text}");
    let text = Scan::new(&[[0.0, f32::NAN, 0.0]], &[]).unwrap_err().to_string();
    assert_eq!(text, "`points[0]` is [0.0, NaN, 0.0], expected finite numbers");
}

#[test]
fn derivatives_agree_with_differences() {
    let model = BodyModel::builtin();
    let (_, pose, _) = man(&model);
    let fit = ModelFit::new(&model, vec![0.3; model.n_components()], pose);
    let motion = model_fit::Motion::of(&fit);
    let direction = DVec3::new(0.3, -0.5, 0.8);
    let n = 6 + N_DOF + model.n_components();
    for vertex in (0..model.n_vertices()).step_by(171) {
        let mut row = vec![0.0; n];
        motion.add(vertex, direction, &mut row);
        for unknown in (0..n).step_by(3) {
            const STEP: f64 = 1e-2; // vertices are single precision
            let moved = |sign: f64| {
                let mut other = fit.clone();
                let mut step = DVector::zeros(n);
                step[unknown] = -sign * STEP;
                other.advance(&step);
                direction.dot(other.vertices[vertex])
            };
            let slope = (moved(1.0) - moved(-1.0)) / (2.0 * STEP);
            // An angle at its limit moves one way only.
            let is_at_limit = (6..6 + N_DOF).contains(&unknown) && {
                let [low, high] = Skeleton::human().dofs()[unknown - 6].limits_rad;
                let angle = fit.pose.angles[unknown - 6];
                angle - low < STEP || high - angle < STEP
            };
            let expected = row[unknown];
            assert!(
                is_at_limit || (expected - slope).abs() < 2e-4,
                "vertex {vertex}, unknown {unknown}: {expected} and {slope}"
            );
        }
    }
}

#[test]
fn spoilt_triangles_are_settled() {
    let model = BodyModel::builtin();
    let before = double(model.mean().rest_vertices());
    let triangles = model.triangles();
    // A corner on the other side of the opposite edge.
    let mut after = before.clone();
    let [a, b, c] = triangles[200].map(|vertex| vertex as usize);
    after[a] = before[b] + before[c] - before[a];
    let spoilt = |after: &[DVec3]| {
        flipped(&before, after, triangles).len() + new_crossings(&before, after, triangles).len()
    };
    assert!(spoilt(&after) > 0);
    settle(&before, &mut after, triangles, &edges(triangles));
    assert_eq!(spoilt(&after), 0);
}
