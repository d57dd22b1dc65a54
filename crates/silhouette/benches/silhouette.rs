//! Frame to mask and mask to descriptor, one thread.

use criterion::{Criterion, criterion_group, criterion_main};
use silhouette::background::StaticModel;
use silhouette::descriptor::{
    Codebook, CodebookConfig, CropComponents, CropComponentsConfig, Descriptor, ShapeContextHistogram,
    contour_contexts, crop_distances,
};
use silhouette::{Geometry, Mask, RgbView, Segmenter, SegmenterConfig, SegmenterParams};

const WIDTH: u32 = 1088;
const HEIGHT: u32 = 1920;

/// A lying ellipse with a wavy outline, of the size of a person, another shape for each `phase`.
fn blob(phase: f64) -> Mask {
    Mask::from_fn(WIDTH, HEIGHT, |x, y| {
        let (dx, dy) = (f64::from(x) - 500.0, f64::from(y) - 900.0);
        let wave = 1.0 + 0.25 * (5.0 * dy.atan2(dx) + phase).sin() + 0.1 * (9.0 * dy.atan2(dx) - phase).cos();
        (dx / 220.0).hypot(dy / 600.0) < wave
    })
}

fn picture(person: Option<&Mask>, seed: u32) -> Vec<u8> {
    let mut state = seed;
    let mut data = Vec::with_capacity((3 * WIDTH * HEIGHT) as usize);
    for (x, y) in (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y))) {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let noise = (state >> 29) as u8;
        let grey = if person.is_some_and(|person| person.get(x, y)) {
            60
        } else {
            120 + (x / 8 + y / 16) as u8 % 64
        };
        data.extend([grey + noise, grey - noise, grey + 20 - noise]);
    }
    data
}

fn segment(c: &mut Criterion) {
    let plate = picture(None, 1);
    let frame = picture(Some(&blob(0.0)), 2);
    let view = |data: &'static [u8]| RgbView::new(WIDTH, HEIGHT, data).expect("three bytes a pixel");
    let (plate, frame) = (view(plate.leak()), view(frame.leak()));
    let model = StaticModel::from_plate(&plate, Geometry::for_frames(WIDTH, HEIGHT));
    let params = SegmenterParams::new(SegmenterConfig::default()).expect("the defaults hold");
    let mut segmenter = Segmenter::new(params, Box::new(model));
    c.bench_function("segment 1088x1920", |b| {
        b.iter(|| segmenter.segment(&frame).expect("of the right size").mask)
    });
}

fn describe(c: &mut Criterion) {
    let masks: Vec<Mask> = (0..80).map(|index| blob(f64::from(index) * 0.3).reduced(4)).collect();
    let contexts: Vec<_> = masks.iter().filter_map(contour_contexts).flatten().collect();
    let config = CodebookConfig { n_rounds: 5, ..CodebookConfig::default() };
    let histogram =
        ShapeContextHistogram::new(Codebook::learn(&contexts, &config).expect("enough contexts"), 1);
    let crops: Vec<_> = masks.iter().filter_map(crop_distances).collect();
    let components = CropComponents::learn(&crops, &CropComponentsConfig::default()).expect("enough crops");
    let mask = blob(1.0);
    c.bench_function("shape-context histogram 1088x1920, K 400", |b| b.iter(|| histogram.describe(&mask)));
    c.bench_function("crop components 1088x1920, 60", |b| b.iter(|| components.describe(&mask)));
}

criterion_group!(benches, segment, describe);
criterion_main!(benches);
