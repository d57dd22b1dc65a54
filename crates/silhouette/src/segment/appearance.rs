//! The person's colours, learned while following: they tell clothes and skin from the shadow of a like colour.

use crate::image::RgbPlanes;
use crate::mask::Mask;

/// Bits kept of each channel.
const BITS: u32 = 4;
/// Cells along each channel.
const SIDE: usize = 1 << BITS;
/// Colours of the background are counted on every so manieth pixel.
const SCENE_STEP: usize = 7;
/// What a colour never seen counts, as a share of all.
const FLOOR: f32 = 1e-3;
/// Log ratios are cut here: a histogram of so few counts knows no better.
const LIMIT: f32 = 3.0;
/// Weight of a new frame.
const LEARNING_RATE: f32 = 0.1;

/// Colour histograms of the person and of the scene.
#[derive(Clone, Debug)]
pub(crate) struct Appearance {
    person: Vec<f32>,
    log_ratio: Vec<f32>,
    is_learned: bool,
}

impl Appearance {
    pub fn new() -> Self {
        let cells = vec![0.0; SIDE.pow(3)];
        Self { person: cells.clone(), log_ratio: cells, is_learned: false }
    }

    /// Whether a person has been seen.
    pub fn is_learned(&self) -> bool {
        self.is_learned
    }

    /// For each pixel, ln of how much likelier its colour is on the person than in the scene; 0 before a person has been seen.
    pub fn log_ratios(&self, frame: &RgbPlanes, out: &mut [f32]) {
        let [red, green, blue] = &frame.planes;
        for (((out, &red), &green), &blue) in out.iter_mut().zip(red).zip(green).zip(blue) {
            *out = self.log_ratio[cell([red, green, blue])];
        }
    }

    /// Takes in the colours of `person` in `frame`, and those of the scene.
    pub fn learn(&mut self, frame: &RgbPlanes, background: &RgbPlanes, person: &Mask) {
        let area = person.area();
        if area == 0 {
            return;
        }
        let rate = if self.is_learned { LEARNING_RATE } else { 1.0 };
        self.is_learned = true;
        self.person.iter_mut().for_each(|share| *share *= 1.0 - rate);
        let step = rate / area as f32;
        for y in 0..person.height() {
            for (x0, x1) in person.runs(y) {
                let row = y as usize * frame.width;
                for pixel in row + x0 as usize..row + x1 as usize {
                    self.person[cell(frame.color(pixel))] += step;
                }
            }
        }
        let mut scene = vec![0.0f32; SIDE.pow(3)];
        let n_pixels = frame.width * frame.height;
        let step = SCENE_STEP as f32 / n_pixels as f32;
        (0..n_pixels).step_by(SCENE_STEP).for_each(|pixel| scene[cell(background.color(pixel))] += step);
        let (person, scene) = (blurred(&self.person), blurred(&scene));
        for ((ratio, person), scene) in self.log_ratio.iter_mut().zip(person).zip(scene) {
            *ratio = ((person + FLOOR) / (scene + FLOOR)).ln().clamp(-LIMIT, LIMIT);
        }
    }
}

fn cell(color: [f32; 3]) -> usize {
    color.into_iter().fold(0, |index, value| index << BITS | (value as u8 >> (u8::BITS - BITS)) as usize)
}

/// (1 2 1)/4 along each channel: neighbouring colours share their counts.
fn blurred(histogram: &[f32]) -> Vec<f32> {
    let mut result = histogram.to_vec();
    for stride in [1, SIDE, SIDE * SIDE] {
        let before = result.clone();
        for (index, value) in result.iter_mut().enumerate() {
            let place = index / stride % SIDE;
            let lower = if place > 0 { before[index - stride] } else { before[index] };
            let upper = if place + 1 < SIDE { before[index + stride] } else { before[index] };
            *value = 0.25 * lower + 0.5 * before[index] + 0.25 * upper;
        }
    }
    result
}
