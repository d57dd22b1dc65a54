use super::*;
use crate::background::StaticModel;
use crate::image::{Geometry, RgbPlanes, RgbView};
use crate::mask::{Mask, PixelRect};

const WIDTH: u32 = 160;
const HEIGHT: u32 = 120;

/// A fixed noise in `-1..1` for each index.
fn noise(index: usize) -> f32 {
    let mixed = (index as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mixed = (mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    (mixed >> 40) as f32 / (1u64 << 23) as f32 - 1.0
}

/// Planks: a brown grain with seams.
fn floor_color(x: u32, y: u32) -> [f32; 3] {
    let grain =
        12.0 * ((x as f32 * 0.9).sin() * (y as f32 * 0.13).cos()) + 6.0 * noise((y * WIDTH + x) as usize);
    let seam = if x.is_multiple_of(32) { -30.0 } else { 0.0 };
    [150.0 + grain + seam, 115.0 + 0.8 * grain + seam, 80.0 + 0.6 * grain + seam]
}

/// An image of `color` with sensor noise of ±1.5 grey levels, another for each `seed`.
fn picture(seed: usize, color: impl Fn(u32, u32) -> [f32; 3]) -> Vec<u8> {
    let mut data = Vec::new();
    for (x, y) in (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y))) {
        for value in color(x, y) {
            let sensor = 1.5 * noise(seed * 1_000_003 + data.len());
            data.push((value + sensor).round() as u8);
        }
    }
    data
}

fn view(data: &[u8]) -> RgbView<'_> {
    RgbView { width: WIDTH, height: HEIGHT, data }
}

fn segmenter() -> Segmenter {
    let plate = picture(0, floor_color);
    let model = StaticModel::from_plate(&view(&plate), Geometry::for_frames(WIDTH, HEIGHT));
    Segmenter::new(SegmenterParams::new(SegmenterConfig::default()).unwrap(), Box::new(model))
}

/// A person of head, trunk, arms and legs, 80 pixels tall, with its head at column `x`.
fn person(x: u32) -> Mask {
    Mask::from_fn(WIDTH, HEIGHT, |px, py| {
        let inside =
            |x0: u32, y0: u32, w: u32, h: u32| (x0..x0 + w).contains(&px) && (y0..y0 + h).contains(&py);
        let disc = (f64::from(px) - f64::from(x)).hypot(f64::from(py) - 28.0) < 7.0;
        let trunk = inside(x - 10, 34, 20, 32) || inside(x - 16, 36, 6, 24) || inside(x + 10, 36, 6, 24);
        disc || trunk || inside(x - 10, 66, 7, 36) || inside(x + 3, 66, 7, 36)
    })
}

/// A shadow on the floor beside the feet: soft-edged, down to 65 % of the light.
fn shade(x: u32, px: u32, py: u32) -> f32 {
    let (dx, dy) = ((px as f32 - x as f32 - 22.0) / 26.0, (py as f32 - 100.0) / 9.0);
    1.0 - 0.35 * (1.4 - (dx * dx + dy * dy)).clamp(0.0, 1.0)
}

fn scene(x: u32, light: f32) -> impl Fn(u32, u32) -> [f32; 3] {
    let person = person(x);
    move |px, py| {
        let shirt = if py < 66 { [60.0, 80.0, 170.0] } else { [45.0, 48.0, 52.0] };
        let color =
            if person.get(px, py) { shirt } else { floor_color(px, py).map(|v| v * shade(x, px, py)) };
        color.map(|value| value * light)
    }
}

#[test]
fn person_is_cut_out_and_the_shadow_left() {
    let mut segmenter = segmenter();
    for (frame, x) in (40..110).step_by(5).enumerate() {
        let truth = person(x);
        let light = 1.0 + 0.03 * (frame as f32).sin();
        let result = segmenter.segment(&view(&picture(frame + 1, scene(x, light)))).unwrap();
        let overlap = result.mask.overlap(&truth);
        assert!(overlap.iou() > 0.95, "frame {frame}: {overlap:?}\n{}", result.mask);
        let gain = result.diagnostics.illumination.gain;
        assert!(gain.iter().all(|gain| (gain / light - 1.0).abs() < 0.02), "{gain:?} for {light}");
        let share = result.diagnostics.person_share * f64::from(WIDTH * HEIGHT);
        assert!((share - truth.area() as f64).abs() < 0.06 * truth.area() as f64);
    }
}

#[test]
fn without_the_shadow_test_the_shadow_is_person() {
    let plate = picture(0, floor_color);
    let model = StaticModel::from_plate(&view(&plate), Geometry::for_frames(WIDTH, HEIGHT));
    let mut config = SegmenterConfig::default();
    config.evidence.darkest_shadow = 1.0;
    let mut plain = Segmenter::new(SegmenterParams::new(config).unwrap(), Box::new(model));
    let mask = plain.segment(&view(&picture(1, scene(60, 1.0)))).unwrap().mask;
    assert!(mask.iou(&person(60)) < 0.9, "the planted shadow is too faint to test anything");
}

#[test]
fn nobody_is_an_empty_mask() {
    let mut segmenter = segmenter();
    for frame in 1..4 {
        let result = segmenter.segment(&view(&picture(frame, floor_color))).unwrap();
        assert!(result.mask.is_empty(), "{}", result.mask);
        assert_eq!(result.diagnostics.person_share, 0.0);
    }
    let flash = vec![255; (3 * WIDTH * HEIGHT) as usize];
    segmenter.segment(&view(&flash)).unwrap();
    let dark = vec![0; (3 * WIDTH * HEIGHT) as usize];
    segmenter.segment(&view(&dark)).unwrap();
}

#[test]
fn what_left_the_plate_is_no_person() {
    // The plate shows a red box of the size of a person; the frames do not.
    let in_box = PixelRect { x0: 20, y0: 30, x1: 50, y1: 100 };
    let plate = picture(0, |x, y| {
        let inside = (in_box.x0..in_box.x1).contains(&x) && (in_box.y0..in_box.y1).contains(&y);
        if inside { [200.0, 40.0, 40.0] } else { floor_color(x, y) }
    });
    let model = StaticModel::from_plate(&view(&plate), Geometry::for_frames(WIDTH, HEIGHT));
    let mut segmenter =
        Segmenter::new(SegmenterParams::new(SegmenterConfig::default()).unwrap(), Box::new(model));
    let result = segmenter.segment(&view(&picture(1, floor_color))).unwrap();
    assert!(result.diagnostics.changed_share > 0.08, "the box differs from the plate");
    assert!(result.mask.is_empty(), "{}", result.mask);
    let result = segmenter.segment(&view(&picture(2, scene(110, 1.0)))).unwrap();
    assert!(result.mask.iou(&person(110)) > 0.94, "{}", result.mask);
}

#[test]
fn other_sizes_are_refused() {
    let error = segmenter().segment(&RgbView { width: 2, height: 2, data: &[0; 12] }).unwrap_err();
    assert_eq!(error.to_string(), "the frame has 2 x 2 pixels, expected 160 x 120 as the background");
}

#[test]
fn settings_are_checked() {
    let mut config = SegmenterConfig::default();
    config.evidence.darkest_shadow = f32::NAN;
    let error = SegmenterParams::new(config).unwrap_err();
    assert_eq!(error.to_string(), "`evidence.darkest_shadow` is NaN, expected a share from 0 to 1");
}

#[test]
fn reduced_work_keeps_the_outline() {
    let plate = picture(0, floor_color);
    let geometry = Geometry { width: WIDTH, height: HEIGHT, reduction: 2 };
    let model = StaticModel::from_plate(&view(&plate), geometry);
    let mut segmenter =
        Segmenter::new(SegmenterParams::new(SegmenterConfig::default()).unwrap(), Box::new(model));
    let result = segmenter.segment(&view(&picture(1, scene(70, 1.0)))).unwrap();
    assert_eq!((result.mask.width(), result.mask.height()), (WIDTH, HEIGHT));
    assert!(result.mask.iou(&person(70)) > 0.9, "{}", result.mask);
}

#[test]
fn smoothing_stops_at_edges_of_the_frame_alone() {
    let geometry = Geometry { width: 40, height: 4, reduction: 1 };
    let step = |edge_x: usize| {
        let mut image = RgbPlanes::black(geometry);
        for plane in &mut image.planes {
            plane
                .iter_mut()
                .enumerate()
                .for_each(|(pixel, value)| *value = if pixel % 40 < edge_x { 50.0 } else { 200.0 });
        }
        image
    };
    let (frame, flat) = (step(20), RgbPlanes::black(geometry));
    let score = |background: &RgbPlanes| {
        let mut score: Vec<f32> = (0..160).map(|pixel| if pixel % 40 < 20 { 1.0 } else { -1.0 }).collect();
        smooth::Smoother::new(40, 4).smooth(&mut score, &frame, background, &SmoothingConfig::default());
        (score[19], score[20])
    };
    let (left, right) = score(&flat);
    assert!(left > 0.95 && right < -0.95, "an edge of the frame keeps the sides apart: {left} {right}");
    let (left, right) = score(&frame);
    assert!(left < 0.5 && right > -0.5, "an edge that the background has does not: {left} {right}");
}
