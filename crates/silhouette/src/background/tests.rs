use super::*;
use crate::image::RgbView;

const WIDTH: u32 = 96;
const HEIGHT: u32 = 64;

fn geometry() -> Geometry {
    Geometry { width: WIDTH, height: HEIGHT, reduction: 1 }
}

/// A fixed noise in `0..1` for each index.
fn noise(index: usize) -> f32 {
    let mixed = (index as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mixed = (mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    (mixed >> 40) as f32 / (1u64 << 24) as f32
}

/// A coloured texture between 40 and 200 grey levels.
fn texture() -> RgbPlanes {
    let mut image = RgbPlanes::black(geometry());
    for (channel, plane) in image.planes.iter_mut().enumerate() {
        for (pixel, value) in plane.iter_mut().enumerate() {
            let (x, y) = (pixel as f32 % WIDTH as f32, (pixel as u32 / WIDTH) as f32);
            let wave = (x * 0.11 + channel as f32).sin() * (y * 0.07 - channel as f32).cos();
            *value = 120.0 + 60.0 * wave + 20.0 * noise(pixel + 7919 * channel);
        }
    }
    image
}

fn mapped(image: &RgbPlanes, map: impl Fn(usize, usize, f32) -> f32) -> RgbPlanes {
    let mut result = image.clone();
    for (channel, plane) in result.planes.iter_mut().enumerate() {
        plane.iter_mut().enumerate().for_each(|(pixel, value)| *value = map(channel, pixel, *value));
    }
    result
}

fn bytes(image: &RgbPlanes) -> Vec<u8> {
    let n_pixels = image.width * image.height;
    (0..3 * n_pixels).map(|at| image.planes[at % 3][at / 3].round() as u8).collect()
}

fn largest_difference(a: &RgbPlanes, b: &RgbPlanes) -> f32 {
    a.planes.as_flattened_pairs(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// Values of two images side by side.
trait Pairs {
    fn as_flattened_pairs<'a>(&'a self, other: &'a RgbPlanes) -> Box<dyn Iterator<Item = (f32, f32)> + 'a>;
}

impl Pairs for [Vec<f32>; 3] {
    fn as_flattened_pairs<'a>(&'a self, other: &'a RgbPlanes) -> Box<dyn Iterator<Item = (f32, f32)> + 'a> {
        Box::new(self.iter().flatten().copied().zip(other.planes.iter().flatten().copied()))
    }
}

#[test]
fn planted_gain_and_offset_come_back_beside_a_large_person() {
    let background = texture();
    let (gain, offset) = ([0.8, 1.1, 0.95], [6.0, -4.0, 2.0]);
    // A third of the image is something else.
    let frame = mapped(&background, |channel, pixel, value| {
        let is_person = (pixel as u32 % WIDTH) < WIDTH / 3;
        let seen = gain[channel] * value + offset[channel] + 2.0 * noise(pixel * 3 + channel) - 1.0;
        if is_person { 30.0 + 40.0 * noise(pixel) } else { seen }
    });
    let mut light = IlluminationMatch::new(&frame);
    let report = light.fit(&frame, &background, &Mask::new(WIDTH, HEIGHT));
    for channel in 0..3 {
        assert!((report.gain[channel] - gain[channel]).abs() < 0.01, "{report:?}");
        assert!((report.offset[channel] - offset[channel]).abs() < 1.2, "{report:?}");
    }
    // Of uniform noise within ±1 the middle deviation is 0.5, and 0.75 beside a third of outliers; times 1.48.
    assert!((0.74..1.12).contains(&report.noise_sd), "{report:?}");
}

#[test]
fn planted_light_field_is_followed() {
    let background = texture();
    let slope = |pixel: usize| 1.0 + 0.05 * ((pixel as u32 % WIDTH) as f32 / WIDTH as f32 - 0.5);
    let frame = mapped(&background, |_, pixel, value| value * slope(pixel));
    let mut light = IlluminationMatch::new(&frame);
    light.fit(&frame, &background, &Mask::new(WIDTH, HEIGHT));
    let before = mean_difference(&frame, &background);
    let after = mean_difference(&frame, light.matched());
    assert!(after < 0.35 * before, "mean difference {before} before, {after} after");
}

fn mean_difference(a: &RgbPlanes, b: &RgbPlanes) -> f32 {
    let sum: f32 = a.planes.as_flattened_pairs(b).map(|(a, b)| (a - b).abs()).sum();
    sum / (3 * a.width * a.height) as f32
}

#[test]
fn light_of_an_unchanged_frame_changes_nothing() {
    let background = texture();
    let mut light = IlluminationMatch::new(&background);
    light.fit(&background, &background, &Mask::new(WIDTH, HEIGHT));
    assert!(largest_difference(light.matched(), &background) < 0.1);
    // Black frames have no pixel that tells a gain.
    let black = RgbPlanes::black(geometry());
    let report = light.fit(&black, &black, &Mask::new(WIDTH, HEIGHT));
    assert_eq!((report.gain, report.offset), ([1.0; 3], [0.0; 3]));
}

#[test]
fn empty_frames_give_mean_and_spread() {
    let scene = texture();
    let frames: Vec<Vec<u8>> =
        [-2.0, 0.0, 2.0].iter().map(|d| bytes(&mapped(&scene, |_, _, v| v.round() + d))).collect();
    let views = frames.iter().map(|data| RgbView { width: WIDTH, height: HEIGHT, data });
    let mut model = StaticModel::from_empty_frames(views, geometry()).unwrap();
    let expected = model.expected(&scene);
    assert!(largest_difference(expected.mean, &mapped(&scene, |_, _, v| v.round())) < 1e-3);
    let spread = (8.0f32 / 3.0).sqrt();
    assert!(expected.noise.iter().all(|noise| (noise - spread).abs() < 1e-2));
    assert!(StaticModel::from_empty_frames(std::iter::empty(), geometry()).is_none());
}

/// Frames in which a bright bar stands over each column for less than half of the time.
fn frames_with_a_passer_by() -> (RgbPlanes, Vec<Vec<u8>>) {
    let scene = mapped(&texture(), |_, _, value| value.round());
    let frames = (0..25)
        .map(|frame| {
            bytes(&mapped(&scene, |_, pixel, value| {
                let x = pixel as i64 % i64::from(WIDTH);
                if (x - 4 * frame).abs() < 12 { 240.0 } else { value }
            }))
        })
        .collect();
    (scene, frames)
}

#[test]
fn median_sees_past_a_passer_by() {
    let (scene, frames) = frames_with_a_passer_by();
    let mut median = TemporalMedian::new(geometry());
    frames.iter().for_each(|data| median.push(&RgbView { width: WIDTH, height: HEIGHT, data }));
    let mut model = median.finish().unwrap();
    let expected = model.expected(&scene);
    assert_eq!(expected.mean, &scene);
    assert!(expected.noise.iter().all(|&noise| noise == 0.0));
    assert!(TemporalMedian::new(geometry()).finish().is_none());
}

fn mixture(learning_rate: f32) -> MixtureModel {
    let params = MixtureParams::new(MixtureConfig { learning_rate, ..MixtureConfig::default() }).unwrap();
    MixtureModel::new(params, geometry())
}

#[test]
fn mixture_sees_past_a_passer_by() {
    let (scene, frames) = frames_with_a_passer_by();
    let mut model = mixture(0.05);
    frames.iter().for_each(|data| model.learn_view(&RgbView { width: WIDTH, height: HEIGHT, data }));
    let passer_by = mapped(&scene, |_, _, _| 240.0);
    assert!(largest_difference(model.expected(&passer_by).mean, &scene) < 1.0);
}

#[test]
fn mixture_holds_two_scenes_and_forgets() {
    let scene = texture();
    let lit = mapped(&scene, |_, _, value| value + 50.0);
    let mut model = mixture(0.05);
    let nobody = Mask::new(WIDTH, HEIGHT);
    for frame in 0..60 {
        model.learn(if frame % 2 == 0 { &scene } else { &lit }, &nobody);
    }
    assert!(largest_difference(model.expected(&scene).mean, &scene) < 1.0);
    assert!(largest_difference(model.expected(&lit).mean, &lit) < 1.0);
    (0..200).for_each(|_| model.learn(&lit, &nobody));
    assert!(largest_difference(model.expected(&scene).mean, &lit) < 1.0, "the old scene is forgotten");
}

#[test]
fn mixture_does_not_learn_the_person() {
    let scene = texture();
    let person = Mask::from_fn(WIDTH, HEIGHT, |x, _| x < 20);
    let frame = mapped(&scene, |_, pixel, value| if pixel as u32 % WIDTH < 20 { 10.0 } else { value });
    let mut model = mixture(0.1);
    model.learn(&scene, &Mask::new(WIDTH, HEIGHT));
    (0..300).for_each(|_| model.learn(&frame, &person));
    assert!(largest_difference(model.expected(&frame).mean, &scene) < 1e-3);
}

#[test]
fn mixture_settings_are_checked() {
    let config = MixtureConfig { learning_rate: f32::NAN, ..MixtureConfig::default() };
    let message = MixtureParams::new(config).unwrap_err().to_string();
    assert_eq!(message, "`learning_rate` is NaN, expected a share between 0 and 1");
}
