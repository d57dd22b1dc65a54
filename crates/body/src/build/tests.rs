use super::*;
use crate::mesh::is_closed;
use crate::model::BodyModel;

/// An octahedron split `levels` times and pushed out to an ellipsoid: symmetric, with a ring of edges on x = 0.
fn ellipsoid(levels: u32) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let mut points = vec![DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z];
    let mut triangles =
        vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    for _ in 0..levels {
        let mut middles = std::collections::HashMap::new();
        let mut middle = |a: u32, b: u32, points: &mut Vec<DVec3>| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                points.push((points[a as usize] + points[b as usize]).normalize());
                points.len() as u32 - 1
            })
        };
        triangles = triangles
            .iter()
            .flat_map(|&[a, b, c]| {
                let [ab, bc, ca] =
                    [middle(a, b, &mut points), middle(b, c, &mut points), middle(c, a, &mut points)];
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    (points.iter().map(|p| *p * DVec3::new(0.3, 0.9, 0.2) + DVec3::Y * 0.9).collect(), triangles)
}

/// 40 ellipsoids that differ in height, breadth and depth, with the parts and landmarks of a body.
fn population() -> BodiesData {
    let (mean, triangles) = ellipsoid(4);
    let along =
        |axis: DVec3, size: f64| mean.iter().map(|&p| (p - DVec3::Y * 0.9) * axis * size).collect::<Vec<_>>();
    let mean_joints: Vec<DVec3> = (0..28).map(|joint| DVec3::Y * 0.05 * f64::from(joint)).collect();
    let scale = |size: f64| mean_joints.iter().map(|&p| (p - DVec3::Y * 0.9) * size).collect();
    let wave = |body: usize, step: f64| (body as f64 * step).sin() * std::f64::consts::SQRT_2;
    let parts: Vec<u8> = mean.iter().map(|p| u8::from(p.y < 1.5)).collect();
    let skin = |p: &DVec3| {
        let upper = (p.y / 1.8).clamp(0.0, 1.0) as f32;
        vec![(JointId::PELVIS, 1.0 - upper), (JointId::HEAD, upper)]
    };
    let names = ["head", "abdomen", "left_hand", "right_hand", "left_foot", "right_foot"];
    BodiesData {
        basis: vec![along(DVec3::Y, 0.1), along(DVec3::X, 0.2), along(DVec3::Z, 0.1)],
        joint_basis: vec![scale(0.1), scale(0.0), scale(0.0)],
        coefficients: (0..40).map(|body| vec![wave(body, 1.0), wave(body, 2.3), wave(body, 0.7)]).collect(),
        is_female: (0..40).map(|body| body % 2 == 0).collect(),
        skin: mean.iter().map(skin).collect(),
        landmarks: vec![("Lt Calcaneous, Post.".into(), 3), ("Rt Calcaneous, Post.".into(), 3)],
        part_names: names.map(String::from).to_vec(),
        parts,
        mean_joints,
        triangles,
        mean,
    }
}

const CONFIG: BuildConfig = BuildConfig { n_vertices: 160, n_components: 3 };

#[test]
fn a_population_of_ellipsoids() {
    let data = population();
    let model = BodyModel::from_file(build_body_asset(&data, &CONFIG).unwrap()).unwrap();
    assert!(is_closed(model.triangles()));
    assert!((155..=160).contains(&model.n_vertices()));
    let sources = &model.template().source_vertices;
    for (&source, &part) in sources.iter().zip(&model.template().parts) {
        assert_eq!(data.parts[source as usize], part);
    }
    let fit = SurfaceFit::new(&data, sources, model.triangles()).unwrap();
    let (mut worst, mut squares) = (0.0f64, 0.0);
    for (body, coefficients) in data.coefficients.iter().enumerate() {
        let vertices = fit.apply(&data.vertices(body));
        let found = model.coefficients_of(&vertices);
        squares += found.iter().map(|c| c * c).sum::<f64>();
        let rebuilt = model.shape(&found);
        for (vertex, rebuilt) in vertices.iter().zip(rebuilt.rest_vertices()) {
            worst = worst.max(vertex.distance(DVec3::from_array(rebuilt.map(f64::from))));
        }
        // Three directions span the population: surface and joints come back whole.
        let joint = rebuilt.rest_joints()[20];
        assert!((joint.y - (1.0 + 0.01 * coefficients[0])).abs() < 1e-6, "body {body}: {joint}");
    }
    assert!(worst < 1e-6, "{worst}");
    assert!((squares / 120.0 - 1.0).abs() < 1e-4, "coefficients have variance {}", squares / 120.0);
    // The fitted surface runs through the ellipsoid, neither inside nor outside.
    let mean: Vec<DVec3> = fit.apply(&data.mean);
    let volume = crate::mesh::volume_m3(&mean, model.triangles());
    let exact = 4.0 / 3.0 * std::f64::consts::PI * 0.3 * 0.9 * 0.2;
    assert!((volume / exact - 1.0).abs() < 0.01, "{volume} instead of {exact}");
}

#[test]
fn says_why_there_is_no_model() {
    let message = |data: &BodiesData, config| build_body_asset(data, config).unwrap_err().to_string();
    let wanted = BuildConfig { n_components: 4, ..CONFIG };
    assert_eq!(message(&population(), &wanted), "3 bodies span fewer than the 4 components wanted");
    let mut lopsided = population();
    lopsided.mean[0].x += 0.01;
    assert_eq!(message(&lopsided, &CONFIG), "vertex 0 of the mean body has no mirror image within 0.0005 m");
    let mut bare = population();
    bare.landmarks.clear();
    assert_eq!(message(&bare, &CONFIG), "the landmark `Lt Calcaneous, Post.` is missing");
    let few = BuildConfig { n_vertices: 4, ..CONFIG };
    assert!(message(&population(), &few).starts_with("the template stays at "));
}

/// Distances are to the surface made from the components alone, over bodies whose coefficients the components have not seen.
#[test]
fn held_out_bodies_lie_on_the_template() {
    let Some(folder) = crate::test_data::folder() else { return };
    let data = BodiesData::read(&folder.join("bodies")).unwrap();
    assert_eq!((data.held_out().len(), data.training_bodies().len()), (200, 1_000));
    let training = data.clone().training();
    let model = BodyModel::from_file(build_body_asset(&training, &BuildConfig::default()).unwrap()).unwrap();
    let builtin = BodyModel::builtin();
    assert_eq!(model.triangles(), builtin.triangles(), "the asset in the repository is not of this program");
    let (trained, shipped) = (model.mean(), builtin.mean());
    assert_eq!(
        trained.rest_vertices(),
        shipped.rest_vertices(),
        "the asset was not made of the training bodies"
    );
    let fit = SurfaceFit::new(&data, &model.template().source_vertices, model.triangles()).unwrap();
    let (mut distances, mut joint_errors) = (Vec::new(), Vec::new());
    for (index, body) in data.held_out().into_iter().enumerate() {
        let vertices = data.vertices(body);
        let rebuilt = model.shape(&model.coefficients_of(&fit.apply(&vertices)));
        for (found, expected) in rebuilt.rest_joints().iter().zip(data.joints(body)) {
            joint_errors.push(found.distance(expected));
        }
        if index % 20 == 0 {
            let surface: Vec<DVec3> =
                rebuilt.rest_vertices().iter().map(|p| DVec3::from_array(p.map(f64::from))).collect();
            let tree = TriangleTree::new(&surface, model.triangles());
            distances.extend(vertices.iter().map(|&vertex| tree.nearest(vertex).distance_m));
        }
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let largest = joint_errors.iter().copied().fold(0.0, f64::max);
    println!(
        "surface {:.2} mm, joints {:.2} mm, at worst {:.2} mm",
        1e3 * mean(&distances),
        1e3 * mean(&joint_errors),
        1e3 * largest
    );
    assert!(mean(&distances) < 0.004, "{}", mean(&distances));
    assert!(largest < 0.005, "{largest}");
}
