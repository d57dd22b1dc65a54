use super::*;
use crate::cli::eval::data_folder;

fn studio() -> Option<(Studio, Walks)> {
    let Ok(data) = data_folder(None, "bodies") else {
        assert!(std::env::var_os("UMBRA_REQUIRE_DATA").is_none_or(|value| value != "1"), "no data folder");
        println!("SKIPPED: no data folder");
        return None;
    };
    let motions = data.with_file_name("cmu");
    let mut studio = Studio::open(&data).unwrap();
    studio.walk.n_frames = 12;
    Some((studio, Walks::read(&motions, &["validate"]).unwrap()))
}

#[test]
fn walks_are_seen_whole_on_the_floor_and_repeat() {
    let Some((studio, walks)) = studio() else { return };
    let person = studio.people.data().held_out()[0];
    let walk = studio.walk(&walks, person, 5).unwrap();
    assert_eq!(walk.frames.len(), 12);
    let body = studio.people.body(person);
    for frame in &walk.frames {
        let rect = frame.clean.bounding_box().unwrap();
        assert!(rect.x0 > 0 && rect.y0 > 0 && rect.x1 < 640 && rect.y1 < 480, "cropped: {rect:?}");
        let iou = frame.clean.iou(&frame.observed);
        assert!((0.75..0.99).contains(&iou), "{iou}");
        // Every joint inside the body is inside its silhouette.
        let hip = body.joints_world(&frame.pose)[body::JointId::LEFT_HIP.index()];
        let pixel = walk.camera.project(hip).unwrap();
        assert!(frame.clean.get(pixel.x as u32, pixel.y as u32));
    }
    let mut posed = Vec::new();
    let lowest = walk.frames.iter().map(|frame| {
        body.skin_into(&glam::DAffine3::IDENTITY, &frame.pose, &mut posed);
        posed.iter().map(|vertex| vertex[2]).fold(f32::INFINITY, f32::min)
    });
    for height in lowest {
        assert!(height.abs() < 1e-4, "the lowest point is {height} m above the floor");
    }
    let again = studio.walk(&walks, person, 5).unwrap();
    let other = studio.walk(&walks, person, 6).unwrap();
    for ((frame, again), other) in walk.frames.iter().zip(&again.frames).zip(&other.frames) {
        assert_eq!(frame.observed, again.observed);
        assert_ne!(frame.observed, other.observed);
    }
}

#[test]
fn the_full_mesh_at_rest_has_the_stature_of_its_truth() {
    let Some((studio, _)) = studio() else { return };
    for person in [0, 1, 1100] {
        let body = studio.people.body(person);
        let heights = body.rest_vertices().iter().map(|vertex| f64::from(vertex.y));
        let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), y| (l.min(y), h.max(y)));
        let truth = studio.people.truths()[person].stature_m;
        assert!((high - low - truth).abs() < 1e-3, "{} instead of {truth}", high - low);
    }
}
