//! Tubes of known girth, the bodies of the model, and what cannot be measured.

use std::f64::consts::PI;

use body::{BodyModel, N_JOINTS, Sex};

use super::*;

const PARTS: [&str; 12] = [
    "head",
    "neck",
    "chest",
    "pelvis",
    "left_upper_arm",
    "right_upper_arm",
    "left_forearm",
    "right_forearm",
    "left_hand",
    "right_hand",
    "right_thigh",
    "right_calf",
];

/// A mesh of tubes, each of one body part.
#[derive(Default)]
struct Tubes {
    vertices: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    parts: Vec<u8>,
    landmarks: Vec<Landmark>,
}

impl Tubes {
    /// A tube of elliptic rings around the way between `ends`; half axes as a function of the share of the way.
    fn add(&mut self, part: &str, ends: [DVec3; 2], radii: impl Fn(f64) -> [f64; 2]) {
        const AROUND: u32 = 360;
        const ALONG: u32 = 40;
        let first = self.vertices.len() as u32;
        let axis = (ends[1] - ends[0]).normalize();
        let side = DVec3::X.reject_from(axis).normalize();
        let third = axis.cross(side);
        for ring in 0..=ALONG {
            let share = f64::from(ring) / f64::from(ALONG);
            let [a, b] = radii(share);
            for step in 0..AROUND {
                let (sin, cos) = (2.0 * PI * f64::from(step) / f64::from(AROUND)).sin_cos();
                let point = ends[0].lerp(ends[1], share) + side * (a * cos) + third * (b * sin);
                self.vertices.push(point.to_array().map(|x| x as f32));
            }
        }
        for ring in 0..ALONG {
            for step in 0..AROUND {
                let [low, high] = [ring, ring + 1]
                    .map(|ring| [step, (step + 1) % AROUND].map(|step| first + ring * AROUND + step));
                self.triangles.push([low[0], low[1], high[0]]);
                self.triangles.push([high[0], low[1], high[1]]);
            }
        }
        let part = PARTS.iter().position(|known| *known == part).expect("one of the parts");
        self.parts.resize(self.vertices.len(), part as u8);
    }

    /// A landmark at the vertex nearest to `place`.
    fn mark(&mut self, name: &str, place: DVec3) {
        let distance =
            |&vertex: &u32| DVec3::from_array(self.vertices[vertex as usize].map(f64::from)).distance(place);
        let vertices = 0..self.vertices.len() as u32;
        let vertex = vertices.min_by(|a, b| distance(a).total_cmp(&distance(b))).expect("there are vertices");
        self.landmarks.push(Landmark {
            name: name.into(),
            vertices: [vertex; 3],
            barycentric: [1.0, 0.0, 0.0],
        });
    }
}

/// Perimeter of an ellipse with half axes a and b, by the arithmetic-geometric mean.
fn ellipse(a: f64, b: f64) -> f64 {
    let (mut x, mut y, mut sum, mut power) = (a, b, (a * a + b * b) / 2.0, 1.0);
    while (x - y).abs() > 1e-14 {
        let half = (x - y) / 2.0;
        (x, y) = (x.midpoint(y), (x * y).sqrt());
        sum -= power * half * half;
        power *= 2.0;
    }
    2.0 * PI * sum / x
}

const TRUNK: [f64; 2] = [0.17, 0.11];

/// A trunk from 0.8 m to 1.4 m, a thigh and a calf below it, a slanted arm beside it and a slanted neck above.
fn manikin() -> (Tubes, RestJoints) {
    let mut tubes = Tubes::default();
    let at = DVec3::new;
    let round = |share: f64| 1.0 - (share - 0.5).powi(2);
    tubes.add("pelvis", [at(0.0, 0.8, 0.0), at(0.0, 0.99, 0.0)], |share| TRUNK.map(|r| r * round(share)));
    tubes.add("chest", [at(0.0, 0.99, 0.0), at(0.0, 1.4, 0.0)], |_| TRUNK);
    tubes.add("right_thigh", [at(-0.1, 0.45, 0.0), at(-0.1, 0.82, 0.0)], |_| [0.09, 0.08]);
    // Largest, with half axes of 6 and 5 cm, at 40 % of the way from the knee down.
    let bulge = |share: f64| 1.0 - (share - 0.6).powi(2);
    tubes.add("right_calf", [at(-0.1, 0.05, 0.0), at(-0.1, 0.45, 0.0)], |share| {
        [0.06 * bulge(share), 0.05 * bulge(share)]
    });
    let (shoulder, elbow) = (at(-0.2, 1.35, 0.0), at(-0.4, 1.15, 0.05));
    tubes.add("right_upper_arm", [shoulder, elbow], |_| [0.05, 0.05]);
    let (neck, head) = (at(0.0, 1.42, 0.0), at(0.0, 1.52, 0.04));
    tubes.add("neck", [neck, head], |_| [0.06, 0.06]);
    for (name, place) in [
        ("Rt Thelion/Bustpoint", at(-0.09, 1.25, 0.1)),
        ("Lt Thelion/Bustpoint", at(0.09, 1.25, 0.1)),
        ("Navel", at(0.0, 1.02, 0.11)),
        ("Crotch", at(0.0, 0.8, 0.0)),
        ("Below Adam's Apple", at(0.0, 1.46, 0.08)),
    ] {
        tubes.mark(name, place);
    }
    let mut joints: RestJoints = [DVec3::ZERO; N_JOINTS];
    for (joint, place) in [
        (JointId::RIGHT_SHOULDER, shoulder),
        (JointId::RIGHT_ELBOW, elbow),
        (JointId::RIGHT_KNEE, at(-0.1, 0.45, 0.0)),
        (JointId::RIGHT_ANKLE, at(-0.1, 0.05, 0.0)),
        (JointId::NECK, neck),
        (JointId::HEAD, head),
    ] {
        joints[joint.index()] = place;
    }
    (tubes, joints)
}

fn part_names() -> Vec<String> {
    PARTS.map(String::from).to_vec()
}

fn tape_of(tubes: &Tubes, part_names: &[String]) -> Result<Tape, LabelsError> {
    let Tubes { triangles, parts, landmarks, .. } = tubes;
    Tape::new(Labels { triangles, parts, part_names, landmarks })
}

#[test]
fn cylinders_have_their_girths() {
    let (tubes, joints) = manikin();
    let measured = tape_of(&tubes, &part_names()).unwrap().measure(&tubes.vertices, &joints).unwrap();
    let trunk = ellipse(TRUNK[0], TRUNK[1]);
    for (girth, expected) in [
        (Girth::Chest, trunk),
        (Girth::Waist, trunk),
        (Girth::Hips, trunk),
        (Girth::RightThigh, ellipse(0.09, 0.08)),
        (Girth::RightCalf, ellipse(0.06, 0.05)),
        (Girth::Neck, ellipse(0.06, 0.06)),
        (Girth::RightUpperArm, ellipse(0.05, 0.05)),
        (Girth::SmallestWaist, trunk),
        (Girth::LargestHips, trunk),
    ] {
        let found = measured.girth_m(girth);
        assert!((found / expected - 1.0).abs() < 1e-3, "{}: {found}, expected {expected}", girth.name());
    }
    let height = measured.plane(Girth::RightCalf).point.y;
    assert!((height - 0.29).abs() < 6e-3, "{height}");
    assert!((measured.stature_m - 1.49).abs() < 0.02, "{}", measured.stature_m);
}

#[test]
fn ellipses_agree_with_known_perimeters() {
    assert!((ellipse(1.0, 1.0) - 2.0 * PI).abs() < 1e-12);
    // The complete elliptic integral E(m = 3/4) is 1.211056027568459.
    assert!((ellipse(2.0, 1.0) - 8.0 * 1.211_056_027_568_459).abs() < 1e-9);
}

#[test]
fn the_loop_of_a_girth_is_as_long_as_the_girth() {
    let model = BodyModel::builtin();
    let (tape, body) = (Tape::of_model(&model), model.shape_for_stature(1.7, Some(Sex::Female)));
    let measured = tape.measure_body(&body).unwrap();
    for girth in Girth::ALL {
        let around = tape.loop_of(body.rest_vertices(), girth, &measured.plane(girth));
        let next = around.iter().cycle().skip(1);
        let length: f64 = around.iter().zip(next).map(|(a, b)| a.distance(*b)).sum();
        assert!((length - measured.girth_m(girth)).abs() < 1e-9, "{}", girth.name());
    }
}

#[test]
fn girths_grow_with_the_body() {
    let model = BodyModel::builtin();
    let (tape, body) = (Tape::of_model(&model), model.mean());
    let small = tape.measure_body(&body).unwrap();
    let larger: Vec<[f32; 3]> = body.rest_vertices().iter().map(|v| v.map(|x| 1.1 * x)).collect();
    let joints = body.rest_joints().map(|joint| 1.1 * joint);
    let large = tape.measure(&larger, &joints).unwrap();
    for girth in [Girth::Chest, Girth::Waist, Girth::Hips, Girth::Neck, Girth::RightUpperArm] {
        assert!((large.girth_m(girth) / small.girth_m(girth) - 1.1).abs() < 1e-5, "{}", girth.name());
    }
    assert!((large.volume_m3 / small.volume_m3 - 1.331).abs() < 1e-4);
    assert!((large.crotch_height_m / small.crotch_height_m - 1.1).abs() < 1e-5);
}

#[test]
fn missing_labels_are_named() {
    let (mut tubes, _) = manikin();
    let message = |tubes: &Tubes, names: &[String]| tape_of(tubes, names).unwrap_err().to_string();
    let mut names = part_names();
    names[10] = "left_thigh".into();
    assert_eq!(message(&tubes, &names), "the body part `right_thigh` is missing");
    tubes.landmarks.retain(|landmark| landmark.name != "Navel");
    assert_eq!(message(&tubes, &part_names()), "the landmark `Navel` is missing");
    tubes.parts.pop();
    let left = tubes.parts.len();
    assert_eq!(message(&tubes, &part_names()), format!("vertex {left} is used, but there are {left} labels"));
}

#[test]
fn a_body_without_a_calf_or_with_a_wild_vertex_is_refused() {
    let (mut tubes, joints) = manikin();
    let tape = tape_of(&tubes, &part_names()).unwrap();
    let calf = PARTS.iter().position(|name| *name == "right_calf").unwrap() as u8;
    for (vertex, _) in tubes.vertices.iter_mut().zip(&tubes.parts).filter(|(_, part)| **part == calf) {
        vertex[1] -= 3.0;
    }
    let text = tape.measure(&tubes.vertices, &joints).unwrap_err().to_string();
    assert!(text.starts_with("`right_calf`: the plane at a height of 0."), "{text}");
    assert!(text.ends_with(" m does not meet that part of the body"), "{text}");
    tubes.vertices[7][2] = f32::NAN;
    let text = tape.measure(&tubes.vertices, &joints).unwrap_err().to_string();
    assert!(text.starts_with("`vertices[7]` is [") && text.ends_with("expected finite numbers"), "{text}");
}
