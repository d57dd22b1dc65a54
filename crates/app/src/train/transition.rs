//! Training of p(x_n | x_{n-1}, r_n) from the frames of a sequence.

use anyhow::{Context as _, ensure};
use bme::{
    Design, Inputs, Kernel, MixtureConfig, MixtureOfExperts, MixtureParams, RvmConfig, mean_squared_distance,
};
use pf_core::rng::{Draw, Purpose, particle_rng};
use silhouette::Mask;

use super::{TrainConfig, TrainingFrames};
use crate::predict::{PosePredictor, TransitionPredictor, ViewedPose};

/// Inverse kernel width over the mean squared distance of a block's inputs.
const WIDTH_FACTOR: f64 = 1.0;
/// Inputs that may carry a kernel.
const MAX_CENTRES: usize = 400;
/// Each pair of frames is there so many times, and
const COPIES: usize = 2;
/// the pose before is off by this much (standard deviations of its coordinates, and radians of heading), as a tracker's is.
const ERROR_BEFORE: f64 = 0.4;

/// Learns how the person goes on, given the next mask; descriptions and coordinates are those of `predictor`. Every pair of
/// frames serves as a mirror shows it, too.
///
/// # Errors
/// When there is too little to learn from.
pub fn train_transitions(
    frames: &TrainingFrames<'_>,
    predictor: &PosePredictor,
    config: &TrainConfig,
) -> anyhow::Result<TransitionPredictor> {
    let TrainingFrames { sequence, camera, masks, motion, .. } = frames;
    let camera_world = sequence.camera(camera)?.centre_world();
    let steps = motion.motion.poses.windows(2).zip(&masks[1..]).map(|(pair, mask)| {
        let [before, now] = [0, 1].map(|i| ViewedPose::of(&pair[i], camera_world));
        Step { before, now, mask }
    });
    fit_transitions(steps, predictor, config)
        .with_context(|| format!("{}: cannot learn how the person goes on", sequence.folder.display()))
}

/// A pose, the next one, and what the camera sees of that.
pub struct Step<'a> {
    /// The pose before.
    pub before: ViewedPose,
    /// The pose now.
    pub now: ViewedPose,
    /// The mask now.
    pub mask: &'a Mask,
}

/// The same from `steps`, and from their mirror images.
///
/// # Errors
/// When there is too little to learn from.
pub fn fit_transitions<'a>(
    steps: impl Iterator<Item = Step<'a>>,
    predictor: &PosePredictor,
    config: &TrainConfig,
) -> anyhow::Result<TransitionPredictor> {
    let (space, descriptor) = (predictor.space(), predictor.descriptor());
    let at = Draw { seed: config.seed, frame: 0, layer: 0, purpose: Purpose::User };
    let mut rng = particle_rng(at, 0);
    let (mut inputs, mut targets) = (Vec::new(), vec![Vec::new(); space.dim() + 2]);
    for Step { before, now, mask } in steps {
        for (before, now, mask) in
            [(before.mirrored(), now.mirrored(), &mask.mirrored()), (before, now, mask)]
        {
            let Some(description) = descriptor.describe(mask) else { continue };
            for _ in 0..COPIES {
                let mut off = || ERROR_BEFORE * rng.standard_normal();
                let heading = before.heading_rad + off();
                let coordinates: Vec<f64> = space.encode(&before).iter().map(|z| z + off()).collect();
                let off_pose = space.decode(heading, &coordinates);
                inputs.extend(TransitionPredictor::input(space, &off_pose, &description));
                for (column, value) in targets.iter_mut().zip(space.point(&now)) {
                    column.push(value);
                }
            }
        }
    }
    ensure!(!inputs.is_empty(), "no two frames in a row with a person");
    let (n_before, n_now) = (space.dim() + 2, descriptor.descriptor().dimension());
    let inputs = Inputs::from_rows(n_before + n_now, inputs).context("poses and descriptions")?;
    let kernel = product_kernel(&inputs, n_before, n_now)?;
    let every = inputs.len().div_ceil(MAX_CENTRES);
    let centres = inputs.select(&(0..inputs.len()).step_by(every).collect::<Vec<_>>());
    let expert =
        RvmConfig { min_gain: 0.2, min_gain_of_addition: 1.0, max_bases: 60, ..RvmConfig::default() };
    let gate = RvmConfig { min_gain: 0.2, max_bases: 20, max_steps: 10, ..RvmConfig::default() };
    let mixture = MixtureConfig {
        n_experts: 5,
        max_iterations: 4,
        min_gain: 1e-2,
        expert,
        gate,
        seed: config.seed,
        ..MixtureConfig::default()
    };
    let params = MixtureParams::new(mixture).context("settings of the experts")?;
    let weights = vec![1.0; inputs.len()];
    let (experts, _) =
        MixtureOfExperts::fit(&Design::with_centres(kernel, inputs, centres), &targets, &weights, &params)
            .context("the experts cannot be trained")?;
    Ok(TransitionPredictor::new(descriptor.clone(), space.clone(), experts))
}

/// K(x) K(r), each as wide as its part of the inputs is spread.
fn product_kernel(inputs: &Inputs, n_before: usize, n_now: usize) -> anyhow::Result<Kernel> {
    let part = |columns: std::ops::Range<usize>| -> anyhow::Result<f64> {
        let values =
            (0..inputs.len()).flat_map(|i| inputs.row(i)[columns.clone()].iter().map(|v| f64::from(*v)));
        let spread =
            mean_squared_distance(&Inputs::from_rows(columns.len(), values).context("a part of the inputs")?);
        ensure!(spread > 0.0, "all poses or all masks are alike, expected some that differ");
        Ok(WIDTH_FACTOR / spread)
    };
    let blocks = [(n_before, part(0..n_before)?), (n_now, part(n_before..n_before + n_now)?)];
    Kernel::product(&blocks).context("the kernel")
}
