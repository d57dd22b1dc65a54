//! What the training frames of a sequence show: masks, the body that moves, and how it moves.

use std::ops::Range;

use anyhow::{Context as _, ensure};
use body::BodyModel;
use silhouette::Mask;

use crate::input::MaskFolder;
use crate::shape::{ShapeConfig, ShapeFit, ShapeFrame, Told, fit_shape};
use crate::stage::{FittedSequence, Markers, Sequence, fit_sequence, markers_of, personal_joints};

/// Frames whose mean bone lengths are the subject's.
const LENGTH_FRAMES: usize = 100;
/// Frames between those whose poses the body is first fitted with.
const SHAPE_STRIDE: usize = 25;
/// Markers between which a length is measured, and how far our joints, as standard deviation in metres, may be from where the
/// markers are: limbs turn about the same points, ends of the trunk depend on who defines them.
const LENGTHS: [(usize, usize, f64); 12] = [
    (0, 1, 0.02),
    (18, 19, 0.02),
    (2, 6, 0.01),
    (10, 14, 0.01),
    (2, 3, 0.005),
    (4, 5, 0.005),
    (6, 7, 0.005),
    (8, 9, 0.005),
    (10, 11, 0.005),
    (12, 13, 0.005),
    (14, 15, 0.005),
    (16, 17, 0.005),
];
/// Standard deviation of a stature as it is told, metres.
pub const STATURE_SD_M: f64 = 0.005;

/// The training frames of a sequence before one camera.
pub struct TrainingFrames<'a> {
    /// The sequence.
    pub sequence: &'a Sequence,
    /// The camera.
    pub camera: String,
    /// Kind of masks: `observed` or `clean`.
    pub kind: String,
    /// The masks, one a frame.
    pub masks: Vec<Mask>,
    /// Shape coefficients of the person as the masks show them, clothes included.
    pub shape: Vec<f64>,
    /// That body's skeleton on every frame, with the bone lengths of the markers.
    pub motion: FittedSequence,
}

impl<'a> TrainingFrames<'a> {
    /// Reads the masks of `camera`, kind `observed` or `clean`, and fits body and motion.
    ///
    /// # Errors
    /// When masks or valid joints are missing.
    pub fn read(sequence: &'a Sequence, camera: &str, kind: &str) -> anyhow::Result<Self> {
        let range = sequence.train.clone();
        let masks = sequence_masks(sequence, camera, kind, &range)?;
        let shape = personal_shape(sequence, camera, &masks)?;
        let body = BodyModel::builtin().shape(&shape);
        let rest = personal_joints(body.rest_joints(), &first_markers(sequence, &range)?);
        let motion = fit_sequence(sequence, range, rest, true);
        Ok(Self { sequence, camera: camera.to_owned(), kind: kind.to_owned(), masks, shape, motion })
    }

    /// The numbers of the frames.
    pub fn range(&self) -> Range<usize> {
        self.sequence.train.clone()
    }
}

/// The first valid markers of `range`, enough of them for bone lengths.
///
/// # Errors
/// When there are none.
pub fn first_markers(sequence: &Sequence, range: &Range<usize>) -> anyhow::Result<Vec<Markers>> {
    let found: Vec<Markers> =
        sequence.markers[range.clone()].iter().flatten().take(LENGTH_FRAMES).copied().collect();
    ensure!(
        !found.is_empty(),
        "{}: no valid joints on frames {} to {}, expected some",
        sequence.folder.join("joints.csv").display(),
        range.start,
        range.end
    );
    Ok(found)
}

/// The masks of frames `range`, kind `observed` or `clean`.
///
/// # Errors
/// When there are fewer, or one cannot be read.
pub fn sequence_masks(
    sequence: &Sequence,
    camera: &str,
    kind: &str,
    range: &Range<usize>,
) -> anyhow::Result<Vec<Mask>> {
    let path = sequence.masks_path(camera, kind);
    let mut folder = MaskFolder::open(&path)?;
    let mut masks = Vec::with_capacity(range.len());
    for frame in 0..range.end {
        let mask = folder
            .next_mask()?
            .with_context(|| format!("{}: holds {frame} masks, expected {}", path.display(), range.end))?;
        if frame >= range.start {
            masks.push(mask);
        }
    }
    Ok(masks)
}

/// The shape whose outlines are those of the training masks in the true poses, and whose bones are as long as the true ones.
/// Where too few masks show the whole person, the shape that stature and sex suggest.
fn personal_shape(sequence: &Sequence, camera: &str, masks: &[Mask]) -> anyhow::Result<Vec<f64>> {
    let model = BodyModel::builtin();
    let template = model.shape_for_stature(sequence.stature_m, sequence.sex);
    let range = sequence.train.clone();
    let markers = first_markers(sequence, &range)?;
    let rest = personal_joints(template.rest_joints(), &markers);
    let frames: Vec<ShapeFrame> = range
        .clone()
        .step_by(SHAPE_STRIDE)
        .filter(|&frame| sequence.markers[frame].is_some())
        .map(|frame| ShapeFrame {
            index: frame as u64,
            mask: masks[frame - range.start].clone(),
            pose: fit_sequence(sequence, frame..frame + 1, rest, true).motion.poses.swap_remove(0),
            sighting: None,
        })
        .collect();
    let config = ShapeConfig::default();
    match fit_shape(&model, &sequence.camera(camera)?, &frames, sequence.fps, sequence.stature_m, &config) {
        Ok(fit) => Ok(measured(&model, &fit, &markers, sequence.stature_m)),
        Err(_) => Ok(model.coefficients_for_stature(sequence.stature_m, sequence.sex)),
    }
}

/// The shape of `fit` given the lengths between `markers` and the stature.
fn measured(model: &BodyModel, fit: &ShapeFit, markers: &[Markers], stature_m: f64) -> Vec<f64> {
    let length = |markers: &Markers, (a, b, _): (usize, usize, f64)| markers[a].distance(markers[b]);
    let mean = |ends| markers.iter().map(|frame| length(frame, ends)).sum::<f64>() / markers.len() as f64;
    let bones = LENGTHS.iter().map(|&ends| Told { length_m: mean(ends), sd_m: ends.2 });
    let told: Vec<Told> = bones.chain([Told { length_m: stature_m, sd_m: STATURE_SD_M }]).collect();
    fit.given(model, &told, |body| {
        let own = markers_of(body.rest_joints());
        LENGTHS.iter().map(|&ends| length(&own, ends)).chain([body.stature_m()]).collect()
    })
}
