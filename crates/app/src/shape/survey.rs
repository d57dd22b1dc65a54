//! What masks and camera tell before any body is fitted: about how tall the person is, and where they walk.
//!
//! The lowest point of a mask is a foot on the floor, so the camera's ray through it gives the distance; the height of the head
//! follows from the ray through the highest point. One frame is off by a step's length in distance, the median of many is not.

use body::Camera;
use glam::DVec2;
use rayon::prelude::*;
use silhouette::Mask;

use super::rim::{is_cropped, outline_of, person_of};

/// Heights of people, metres: what lies outside is a fault of the masks.
const STATURES_M: std::ops::Range<f64> = 1.4..2.1;
/// Rows of pixels from the lowest one up that are taken for the foot on the floor.
const ROWS_OF_A_FOOT: f64 = 3.0;
/// Who is upright is at least so tall as a share of their greatest height: a step or a foot nearer to the camera takes less away, a
/// bend more.
const UPRIGHT_SHARE: f64 = 0.85;
/// Walked so far, metres, the direction of travel is known.
const LEAST_TRAVEL_M: f64 = 0.35;
/// Seconds over which the direction of travel is taken: about a step.
pub const TRAVEL_SECS: f64 = 0.9;

/// What a clip tells at first sight.
#[derive(Clone, Debug, PartialEq)]
pub struct Survey {
    /// Median height of the head on the frames that show the person upright, metres.
    pub stature_m: f64,
    /// Direction of travel on the first frames, radians counter-clockwise from world +x; none for a person who stands.
    pub heading_rad: Option<f64>,
    /// Where the person is on each frame, and where to they walk.
    pub sightings: Vec<Option<Sighting>>,
}

/// A person on the floor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// On the floor, metres, world.
    pub place: DVec2,
    /// Height of the head, metres.
    pub height_m: f64,
    /// Direction of travel, radians counter-clockwise from world +x; none for a person who stands.
    pub heading_rad: Option<f64>,
}

/// Surveys masks, `fps` a second; none when no mask shows a whole person on the floor.
pub fn survey(masks: &[&Mask], camera: &Camera, fps: f64) -> Option<Survey> {
    let mut sightings: Vec<Option<Sighting>> = masks.par_iter().map(|mask| sight(mask, camera)).collect();
    let heights: Vec<f64> = sightings
        .iter()
        .flatten()
        .map(|sighting| sighting.height_m)
        .filter(|h| STATURES_M.contains(h))
        .collect();
    if heights.is_empty() {
        return None;
    }
    let stature_m = upright_height(heights);
    let path: Vec<(f64, DVec2)> = sightings
        .iter()
        .enumerate()
        .filter_map(|(frame, sighting)| Some((frame as f64 / fps, (*sighting)?.place)))
        .collect();
    for (frame, sighting) in sightings.iter_mut().enumerate() {
        let now = frame as f64 / fps;
        let near: Vec<(f64, DVec2)> =
            path.iter().copied().filter(|(secs, _)| (secs - now).abs() <= TRAVEL_SECS / 2.0).collect();
        if let Some(sighting) = sighting {
            sighting.heading_rad = direction_of_travel(&near).map(DVec2::to_angle);
        }
    }
    let heading_rad = sightings.iter().flatten().next().and_then(|sighting| sighting.heading_rad);
    Some(Survey { stature_m, heading_rad, sightings })
}

/// The median of the heights that are near the greatest ones, of which a tenth may be wrong.
///
/// # Panics
/// Without a height.
fn upright_height(mut heights: Vec<f64>) -> f64 {
    heights.sort_by(f64::total_cmp);
    let tall = heights[(heights.len() - 1) * 9 / 10];
    let upright = &heights[heights.partition_point(|height| *height < UPRIGHT_SHARE * tall)..];
    upright[upright.len() / 2]
}

/// Where the person on a mask stands, seen once: without a heading. None when they are not whole on it, or not on the floor.
pub fn sight(mask: &Mask, camera: &Camera) -> Option<Sighting> {
    let person = person_of(mask)?;
    if is_cropped(&person) {
        return None;
    }
    let outline = outline_of(&person)?;
    let low = outline.iter().map(|point| point.y).fold(f64::NEG_INFINITY, f64::max);
    let head = *outline.iter().min_by(|a, b| a.y.total_cmp(&b.y))?;
    let feet: Vec<f64> =
        outline.iter().filter(|point| point.y > low - ROWS_OF_A_FOOT).map(|point| point.x).collect();
    let foot = DVec2::new(feet.iter().sum::<f64>() / feet.len() as f64, low);
    let place = camera.ray(foot)?.at_height(0.0)?.truncate();
    let head_ray = camera.ray(head)?;
    let eye = head_ray.origin.truncate();
    let away = head_ray.direction.truncate().length();
    let height_m = head_ray.origin.z + head_ray.direction.z / away * place.distance(eye);
    // Sideways the head says more of the place than a foot that steps out.
    let direction = head_ray.direction.truncate() / away;
    let place = eye + direction * direction.dot(place - eye);
    Some(Sighting { place, height_m, heading_rad: None })
}

/// The way through places at times (seconds), in order, unit; none when it is too short to tell.
pub fn direction_of_travel(places: &[(f64, DVec2)]) -> Option<DVec2> {
    let duration = places.last()?.0 - places[0].0;
    let travelled = velocity(places) * duration;
    (travelled.length() > LEAST_TRAVEL_M).then(|| travelled.normalize())
}

/// Slope of the places over time by least squares, metres a second.
fn velocity(places: &[(f64, DVec2)]) -> DVec2 {
    let n = places.len().max(1) as f64;
    let mean_secs = places.iter().map(|(secs, _)| secs).sum::<f64>() / n;
    let spread: f64 = places.iter().map(|(secs, _)| (secs - mean_secs).powi(2)).sum();
    if spread == 0.0 {
        return DVec2::ZERO;
    }
    places.iter().map(|&(secs, place)| (secs - mean_secs) / spread * place).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use body::{BodyModel, Intrinsics, Pose, Sex};
    use glam::DVec3;

    #[test]
    fn who_bends_down_most_of_the_time_is_as_tall_as_when_upright() {
        let bent = [1.41, 1.42, 1.45, 1.41, 1.43, 1.44];
        let upright = [1.74, 1.76, 1.78, 1.76];
        assert_eq!(upright_height([&bent[..], &upright].concat()), 1.76);
        // One frame with an arm up is no stature.
        assert_eq!(upright_height([&upright[..], &[1.75, 1.77, 1.75, 1.76, 1.76, 2.09]].concat()), 1.76);
        assert_eq!(upright_height(vec![1.7]), 1.7);
    }

    #[test]
    fn a_walking_person_is_measured_at_first_sight() {
        let body = BodyModel::builtin().shape_for_stature(1.82, Some(Sex::Male));
        let intrinsics = Intrinsics::from_focal(640, 480, 700.0).unwrap();
        let eye = DVec3::new(0.0, -4.3, 1.5);
        let camera = Camera::look_at(intrinsics, eye, DVec3::new(0.0, 0.0, 0.8)).unwrap();
        let lens = render_gpu::Intrinsics::centred(640, 480, 700.0);
        let place = |k: usize| DVec2::new(-0.6 + 0.06 * k as f64, 0.2 + 0.03 * k as f64);
        let direction = place(1) - place(0);
        let mask = |k: usize| {
            let pelvis = body.rest_joints()[0].y;
            let pose = Pose::upright(place(k).extend(pelvis), direction.to_angle());
            let mut vertices = vec![[0.0; 3]; body.n_vertices()];
            body.skin_batch_into(&camera.camera_from_world(), std::slice::from_ref(&pose), &mut vertices);
            let drawn = render_gpu::rasterize(&vertices, body.triangles(), &lens).unwrap();
            Mask::from_words(640, 480, drawn.words)
        };
        let masks: Vec<Mask> = (0..20).map(mask).collect();
        let survey = survey(&masks.iter().collect::<Vec<_>>(), &camera, 20.0).unwrap();
        assert!((survey.stature_m - 1.82).abs() < 0.06, "{}", survey.stature_m);
        for (k, sighting) in survey.sightings.iter().enumerate() {
            let sighting = sighting.unwrap();
            // The lowest point of the mask is a toe, nearer to the camera than the body.
            assert!(sighting.place.distance(place(k)) < 0.3, "frame {k}: {sighting:?}");
            let off = DVec2::from_angle(sighting.heading_rad.unwrap()).angle_to(direction);
            assert!(off.abs() < 0.2, "frame {k}: heading off by {off}");
        }
        let still: Vec<&Mask> = vec![&masks[3]; 10];
        assert_eq!(super::survey(&still, &camera, 20.0).unwrap().heading_rad, None);
        assert!(super::survey(&[&Mask::new(640, 480)], &camera, 20.0).is_none());
    }
}
