//! The three subjects of a stage-like data set: other bodies, another skinning, other noise than those of the population.

use std::path::Path;

use anyhow::Context as _;
use body::BodyModel;
use body::io::cameras::load_camera;
use serde::{Deserialize, Serialize};
use silhouette::Mask;

use crate::predict::Activity;
use crate::shape::{
    Estimate, Known, Predictor, Quantity, ShapeConfig, ShapeMethod, light_tracking, shape_from_masks,
};
use crate::track::{ClipInput, ClipReader};

const SUBJECTS: [&str; 3] = ["S1", "S2", "S3"];
const SEQUENCE: &str = "Walking_1";
const CAMERA: &str = "C2";
/// The test part of a sequence, every second frame.
const FRAMES: u64 = 200;
const EVERY: u64 = 2;
const RATE_HZ: f64 = 60.0 / EVERY as f64;

/// A subject's table, of which we read the measures. Waist is the least girth there, and hips the greatest.
#[derive(Debug, Deserialize)]
struct SubjectFile {
    stature_mm: f64,
    mass_kg: f64,
    chest_girth_mm: f64,
    waist_girth_mm: f64,
    hips_girth_mm: f64,
    thigh_girth_mm: f64,
    calf_girth_mm: f64,
}

/// Truth and estimate of one quantity, metres or kilograms.
#[derive(Clone, Debug, Serialize)]
pub struct StageQuantity {
    /// Which.
    pub name: &'static str,
    /// The subject's table says.
    pub truth: f64,
    /// The program says.
    #[serde(flatten)]
    pub estimate: Estimate,
}

/// One subject.
#[derive(Clone, Debug, Serialize)]
pub struct StageSubject {
    /// Name.
    pub subject: &'static str,
    /// Probability of being a man.
    pub male_probability: f64,
    /// In the order of [`Quantity::ALL`].
    pub quantities: Vec<StageQuantity>,
}

/// The subjects of `data`; those that are not there or whose shape cannot be found are left out. They walk, but the prior of
/// walking knows their motion: here it is that of all recorded motion.
///
/// # Errors
/// When a file of a subject that is there cannot be read.
pub fn subjects(data: &Path, method: ShapeMethod) -> anyhow::Result<Vec<StageSubject>> {
    let (track, config) = (light_tracking(), ShapeConfig { method, ..ShapeConfig::default() });
    let mut found = Vec::new();
    for subject in SUBJECTS {
        let folder = data.join(subject);
        if !folder.is_dir() {
            continue;
        }
        let path = folder.join("subject.json");
        let text =
            std::fs::read_to_string(&path).with_context(|| format!("{}: cannot read", path.display()))?;
        let truth: SubjectFile =
            serde_json::from_str(&text).with_context(|| format!("{}: not a subject", path.display()))?;
        let camera_path = data.join("calibration").join(format!("{CAMERA}.json"));
        let camera = load_camera(&camera_path)?
            .camera()
            .with_context(|| format!("{}: no pose of the camera", camera_path.display()))?;
        let mut reader =
            ClipReader::open(&ClipInput::Masks(folder.join(SEQUENCE).join(CAMERA).join("observed")))?;
        let mut masks: Vec<Mask> = Vec::new();
        while let Some(frame) = reader.next_frame()? {
            if frame.index >= FRAMES {
                break;
            }
            if frame.index % EVERY == 0 {
                masks.push(frame.mask);
            }
        }
        let masks: Vec<&Mask> = masks.iter().collect();
        let model = BodyModel::builtin();
        let Some((fit, _)) = shape_from_masks(&model, &camera, &masks, RATE_HZ, &track, &config)? else {
            continue;
        };
        let prediction = Predictor::of(Activity::Any).predict(&fit, &Known::default());
        let quantities = Quantity::ALL.map(|quantity| StageQuantity {
            name: quantity.name(),
            truth: truth.of(quantity),
            estimate: *prediction.of(quantity),
        });
        found.push(StageSubject {
            subject,
            male_probability: prediction.male_probability,
            quantities: quantities.to_vec(),
        });
    }
    Ok(found)
}

impl SubjectFile {
    fn of(&self, quantity: Quantity) -> f64 {
        match quantity {
            Quantity::Chest => self.chest_girth_mm / 1e3,
            Quantity::Waist => self.waist_girth_mm / 1e3,
            Quantity::Hips => self.hips_girth_mm / 1e3,
            Quantity::Thigh => self.thigh_girth_mm / 1e3,
            Quantity::Calf => self.calf_girth_mm / 1e3,
            Quantity::Stature => self.stature_mm / 1e3,
            Quantity::Weight => self.mass_kg,
        }
    }
}
