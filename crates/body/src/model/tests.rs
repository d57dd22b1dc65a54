use super::*;
use crate::asset::{BodyFile, VERSION};
use crate::mesh::{crossing_triangles, is_closed, volume_m3};
use crate::pose::Pose;
use crate::skeleton::Skeleton;

fn points_of(body: &Body) -> Vec<DVec3> {
    body.rest_vertices().iter().map(|vertex| DVec3::from_array(vertex.map(f64::from))).collect()
}

#[test]
fn builtin_template_is_small_closed_and_weighted() {
    let model = BodyModel::builtin();
    assert!(BUILTIN.len() < 3_000_000);
    assert!((1_100..=1_250).contains(&model.n_vertices()));
    assert!(is_closed(model.triangles()));
    // One surface without handles: V - E + F = 2, and 2 E = 3 F.
    assert_eq!(model.n_vertices() * 2, model.triangles().len() + 4);
    for influences in &model.template().influences {
        let sum: f64 = influences.iter().map(|&(_, weight)| f64::from(weight)).sum();
        assert!((1..=MAX_INFLUENCES).contains(&influences.len()) && (sum - 1.0).abs() < 1e-6);
    }
    for part in 0..model.template().part_names.len() {
        assert!(model.template().parts.iter().filter(|&&p| usize::from(p) == part).count() >= 20);
    }
}

#[test]
fn components_hold_the_variance() {
    let model = BodyModel::builtin();
    assert!(model.variance_shares().iter().sum::<f32>() > 0.98);
    assert!(model.variance_shares().windows(2).all(|pair| pair[0] >= pair[1]));
}

#[test]
fn bodies_do_not_cross_themselves() {
    let model = BodyModel::builtin();
    let mut shapes = vec![Vec::new()];
    for (component, sign) in (0..12).flat_map(|k| [(k, -2.0), (k, 2.0)]) {
        let mut shape = vec![0.0; component + 1];
        shape[component] = sign;
        shapes.push(shape);
    }
    for shape in shapes {
        let body = model.shape(&shape);
        let vertices = points_of(&body);
        assert_eq!(crossing_triangles(&vertices, body.triangles()), Vec::<[u32; 2]>::new(), "{shape:?}");
        assert!((0.04..0.14).contains(&volume_m3(&vertices, body.triangles())), "{shape:?}");
    }
}

#[test]
fn a_planted_crossing_is_found() {
    let body = BodyModel::builtin().mean();
    let mut vertices = points_of(&body);
    let nose = (0..vertices.len())
        .filter(|&v| vertices[v].y > 1.5)
        .max_by(|&a, &b| vertices[a].z.total_cmp(&vertices[b].z));
    vertices[nose.unwrap()].z -= 0.4; // out at the back of the head
    assert!(!crossing_triangles(&vertices, body.triangles()).is_empty());
}

#[test]
fn the_mean_is_symmetric_and_stands_on_the_floor() {
    let body = BodyModel::builtin().mean();
    let vertices = points_of(&body);
    for vertex in &vertices {
        let image = *vertex * DVec3::new(-1.0, 1.0, 1.0);
        assert!(vertices.iter().any(|other| other.distance(image) < 5e-4), "{vertex}");
    }
    for joint in JointId::all() {
        let image = body.rest_joints()[joint.mirror().index()] * DVec3::new(-1.0, 1.0, 1.0);
        assert!(body.rest_joints()[joint.index()].distance(image) < 1e-3, "{}", joint.name());
    }
    let lowest = vertices.iter().fold(f64::INFINITY, |low, vertex| low.min(vertex.y));
    assert!(lowest.abs() < 0.005, "{lowest}");
    let (heel, ankle) =
        (body.rest_joints()[JointId::LEFT_HEEL.index()], body.rest_joints()[JointId::LEFT_ANKLE.index()]);
    assert!(heel.z < ankle.z - 0.03 && heel.y < 0.03, "{heel}");
}

#[test]
fn landmarks_lie_where_their_names_say() {
    let body = BodyModel::builtin().mean();
    let [left, right] = ["Lt Acromion", "Rt Acromion"].map(|name| body.landmark(name).unwrap());
    assert!(left.distance(right * DVec3::new(-1.0, 1.0, 1.0)) < 2e-3);
    assert!(left.distance(body.rest_joints()[JointId::LEFT_SHOULDER.index()]) < 0.08);
    assert!(body.landmark("Sellion").unwrap().y > 1.5);
    assert_eq!(body.landmark("Third Eye"), None);
}

#[test]
fn stature_is_met_and_sexes_differ() {
    let model = BodyModel::builtin();
    for stature_m in [1.5, 1.65, 1.78, 1.95] {
        for sex in [None, Some(Sex::Female), Some(Sex::Male)] {
            let body = model.shape_for_stature(stature_m, sex);
            assert!(
                (body.stature_m() - stature_m).abs() < 1e-4,
                "{stature_m} {sex:?} gave {}",
                body.stature_m()
            );
            // A Gaussian of standard deviation 1 per component: 1.5 m and 1.95 m are rare, not absurd.
            let furthest = model
                .coefficients_for_stature(stature_m, sex)
                .into_iter()
                .fold(0.0, |m: f64, c| m.max(c.abs()));
            assert!(furthest < 4.0, "{stature_m} {sex:?} {furthest}");
        }
    }
    let breadth = |sex, a, b| {
        let body = model.shape_for_stature(1.7, Some(sex));
        body.landmark(a).unwrap().distance(body.landmark(b).unwrap())
    };
    let shoulders = |sex| breadth(sex, "Lt Acromion", "Rt Acromion");
    assert!(shoulders(Sex::Male) > shoulders(Sex::Female) + 0.01);
}

#[test]
fn coefficients_come_back() {
    let model = BodyModel::builtin();
    let coefficients = [1.0, -2.0, 0.5, 0.0, 1.5];
    let found = model.coefficients_of(&points_of(&model.shape(&coefficients)));
    for (k, found) in found.iter().enumerate() {
        let expected = coefficients.get(k).copied().unwrap_or(0.0);
        assert!((found - expected).abs() < 1e-3, "component {k}: {found}, expected {expected}");
    }
}

#[test]
fn a_mirrored_pose_is_the_mirrored_mesh() {
    let body = BodyModel::builtin().mean();
    let mut pose = Pose::upright(DVec3::new(0.2, 0.1, 0.9), 0.4);
    for (index, (angle, dof)) in pose.angles.iter_mut().zip(Skeleton::human().dofs()).enumerate() {
        *angle = dof.clamp(0.5 * (index as f64).sin());
    }
    let (mut mesh, mut mirrored) =
        (vec![[0.0f32; 3]; body.n_vertices()], vec![[0.0f32; 3]; body.n_vertices()]);
    body.skin_into(&pose, &mut mesh);
    body.skin_into(&pose.mirror(), &mut mirrored);
    let rest = points_of(&body);
    for (vertex, rest_vertex) in mesh.iter().zip(&rest) {
        let image = *rest_vertex * DVec3::new(-1.0, 1.0, 1.0);
        let nearest =
            (0..rest.len()).min_by(|&a, &b| rest[a].distance(image).total_cmp(&rest[b].distance(image)));
        let counterpart = mirrored[nearest.unwrap()];
        let distance =
            (counterpart[0] + vertex[0]).hypot(counterpart[1] - vertex[1]).hypot(counterpart[2] - vertex[2]);
        assert!(distance < 1e-3, "{distance}");
    }
}

#[test]
fn the_file_survives_a_round_trip() {
    let file = BodyFile::from_bytes(BUILTIN).unwrap();
    assert_eq!(file.to_bytes(), BUILTIN);
}

#[test]
fn says_what_is_wrong_with_the_bytes() {
    let message = |bytes: &[u8]| BodyModel::from_bytes(bytes).unwrap_err().to_string();
    assert_eq!(message(b"PNG"), "`magic`: the file does not begin with `UMBRABDY`");
    let mut bytes = BUILTIN.to_vec();
    bytes[8] = 9;
    assert_eq!(message(&bytes), format!("`version` is 9, expected {VERSION}"));
    let length = BUILTIN.len();
    assert_eq!(message(&BUILTIN[..1000]), format!("the file has 1000 bytes, expected {length}"));
    assert_eq!(message(&BUILTIN[..12]), "the file has 12 bytes, expected 16");
    let mut bytes = BUILTIN.to_vec();
    bytes[5000] ^= 1;
    assert!(message(&bytes).starts_with("`checksum` is "));
}

#[test]
fn says_which_array_does_not_fit() {
    let message = |plant: &dyn Fn(&mut BodyFile)| {
        let mut file = BodyFile::from_bytes(BUILTIN).unwrap();
        plant(&mut file);
        BodyModel::from_bytes(&file.to_bytes()).unwrap_err().to_string()
    };
    let n = BodyModel::builtin().n_vertices();
    let short = message(&|file| file.mean_vertices.truncate(5));
    assert_eq!(short, format!("`mean_vertices` has 5 elements, expected {}", 3 * n));
    let out_of_range = message(&|file| file.triangles[7][1] = 60_000);
    assert_eq!(out_of_range, format!("`triangles[7]` names 60000, but there are {n}"));
    let bad_joint = message(&|file| file.influences[3].0 = 30);
    assert_eq!(bad_joint, "`influences[3]` names 30, but there are 30");
    let heavy = message(&|file| file.influences[0].1 = 2.0);
    assert!(heavy.starts_with("the skin weights of vertex 0 sum to "), "{heavy}");
    assert_eq!(
        message(&|file| file.vertex_basis[5] = f32::NAN),
        "`vertex_basis[5]` is NaN, expected a finite number"
    );
}
