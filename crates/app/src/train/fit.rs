//! From examples to a predictor.

use anyhow::{Context as _, ensure};
use bme::{
    Design, HierarchicalConfig, HierarchicalMixture, HierarchicalParams, Inputs, Kernel, MixtureConfig, Rvm,
    RvmConfig, RvmParams, Split, choose, kernels_by_spread,
};
use body::RestJoints;
use rayon::prelude::*;
use silhouette::descriptor::{
    Codebook, CodebookConfig, CropComponents, CropComponentsConfig, ShapeContextHistogram, contour_contexts,
    crop_distances,
};

use super::Examples;
use crate::predict::{MaskDescriptor, PosePredictor, PoseSpace, Training};

/// Which description of masks to learn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum DescriptorKind {
    /// Principal components of the figure cut out.
    Crop,
    /// Histogram of shape contexts.
    Histogram,
}

impl DescriptorKind {
    /// That of `descriptor`.
    pub fn of(descriptor: &MaskDescriptor) -> Self {
        match descriptor {
            MaskDescriptor::Crop(_) => Self::Crop,
            MaskDescriptor::Histogram(_) => Self::Histogram,
        }
    }
}

/// How to train a predictor.
#[derive(Clone, Debug)]
pub struct TrainConfig {
    /// The description of masks.
    pub descriptor: DescriptorKind,
    /// Coordinates of a pose.
    pub pose_dim: usize,
    /// Views rendered of each pose of a sequence, beside those that were filmed.
    pub views_per_pose: usize,
    /// Masks rendered of the motion of people at large, mirror images not counted.
    pub rendered_masks: usize,
    /// Whether the mirror image of every mask is learned from, too.
    pub mirror: bool,
    /// Experts.
    pub experts: HierarchicalConfig,
    /// Seed of everything that is drawn.
    pub seed: u64,
}

impl Default for TrainConfig {
    fn default() -> Self {
        let expert =
            RvmConfig { min_gain: 0.2, min_gain_of_addition: 1.0, max_bases: 80, ..RvmConfig::default() };
        let gate = RvmConfig { min_gain: 0.2, max_bases: 30, max_steps: 12, ..RvmConfig::default() };
        let mixture =
            MixtureConfig { max_iterations: 5, min_gain: 1e-2, expert, gate, ..MixtureConfig::default() };
        Self {
            descriptor: DescriptorKind::Crop,
            pose_dim: 10,
            views_per_pose: 3,
            rendered_masks: 2_600,
            mirror: false,
            experts: HierarchicalConfig { max_centres: 400, mixture, ..HierarchicalConfig::default() },
            seed: 0,
        }
    }
}

impl TrainConfig {
    /// The same for the models that the program ships. They have to be small: fewer bases an expert, pose coordinates and
    /// sectors.
    #[must_use]
    pub fn for_people_at_large(mut self) -> Self {
        self.pose_dim = 8;
        self.experts.n_views = 6;
        self.experts.mixture.expert.max_bases = 20;
        self
    }
}

/// Inverse kernel widths tried, over the mean squared distance of the descriptions.
const WIDTH_FACTORS: [f64; 5] = [0.25, 0.5, 1.0, 2.0, 4.0];
/// Examples that widths are compared on, the share of them held out, and how many neighbours are held out together.
const WIDTH_EXAMPLES: usize = 1_200;
const HELD_OUT: f64 = 0.1;
const HELD_OUT_RUN: usize = 20;
/// Pose coordinates that widths are compared by.
const WIDTH_COORDINATES: usize = 3;
/// Components of a crop: more of them hold noise, fewer lose limbs.
const CROP_COMPONENTS: usize = 60;
/// Masks that a description is learned from.
const DESCRIPTOR_EXAMPLES: usize = 1_500;

/// Trains a predictor for people with joints like `rest`.
///
/// # Errors
/// When there are too few examples to learn from.
pub fn fit_predictor(
    examples: &Examples,
    rest: &RestJoints,
    training: Training,
    config: &TrainConfig,
) -> anyhow::Result<PosePredictor> {
    ensure!(!examples.is_empty(), "no mask with a person among the training frames, expected some");
    let descriptor = fit_descriptor(examples, config)?;
    let space = PoseSpace::fit(&examples.poses, rest, config.pose_dim);
    let descriptions: Vec<Option<Vec<f64>>> =
        examples.masks.par_iter().map(|mask| descriptor.describe(mask)).collect();
    let descriptions: Vec<f64> =
        descriptions.into_iter().map(|d| d.expect("examples show a person")).collect::<Vec<_>>().concat();
    let inputs = Inputs::from_rows(descriptor.descriptor().dimension(), descriptions)
        .context("descriptions of masks")?;
    let headings: Vec<f64> = examples.poses.iter().map(|pose| pose.heading_rad).collect();
    let rows: Vec<Vec<f64>> = examples.poses.iter().map(|pose| space.encode(pose)).collect();
    let coordinates: Vec<Vec<f64>> =
        (0..space.dim()).map(|d| rows.iter().map(|row| row[d]).collect()).collect();
    let kernel = choose_kernel(&inputs, &headings, &coordinates, config)?;
    let params = HierarchicalParams::new(HierarchicalConfig { seed: config.seed, ..config.experts })
        .context("settings of the experts")?;
    let experts = HierarchicalMixture::fit(&kernel, &inputs, &headings, &coordinates, &params)
        .context("the experts cannot be trained")?;
    Ok(PosePredictor::new(training, descriptor, space, experts))
}

fn fit_descriptor(examples: &Examples, config: &TrainConfig) -> anyhow::Result<MaskDescriptor> {
    let step = examples.len().div_ceil(DESCRIPTOR_EXAMPLES);
    let some: Vec<_> = examples.masks.iter().step_by(step).collect();
    match config.descriptor {
        DescriptorKind::Crop => {
            let crops: Vec<Vec<f32>> = some.par_iter().filter_map(|mask| crop_distances(mask)).collect();
            let crop_config = CropComponentsConfig {
                n_components: CROP_COMPONENTS.min(crops.len().saturating_sub(1)),
                seed: config.seed,
            };
            Ok(MaskDescriptor::Crop(CropComponents::learn(&crops, &crop_config)?))
        }
        DescriptorKind::Histogram => {
            let contexts: Vec<_> = some.par_iter().filter_map(|mask| contour_contexts(mask)).collect();
            let codebook_config = CodebookConfig { seed: config.seed, ..CodebookConfig::default() };
            let codebook = Codebook::learn(&contexts.concat(), &codebook_config)?;
            Ok(MaskDescriptor::Histogram(ShapeContextHistogram::new(codebook, 1)))
        }
    }
}

/// The kernel that predicts heading and first coordinates best on examples held out.
fn choose_kernel(
    inputs: &Inputs,
    headings: &[f64],
    coordinates: &[Vec<f64>],
    config: &TrainConfig,
) -> anyhow::Result<Kernel> {
    let step = inputs.len().div_ceil(WIDTH_EXAMPLES);
    let some: Vec<usize> = (0..inputs.len()).step_by(step).collect();
    let split = Split::new(some.len(), HELD_OUT, HELD_OUT_RUN, config.seed);
    let rows_of = |part: &[usize]| part.iter().map(|&i| some[i]).collect::<Vec<_>>();
    let (train, held_out) = (rows_of(&split.train), rows_of(&split.held_out));
    let mut targets: Vec<Vec<f64>> = coordinates.iter().take(WIDTH_COORDINATES).cloned().collect();
    targets.push(headings.iter().map(|h| h.cos()).collect());
    targets.push(headings.iter().map(|h| h.sin()).collect());
    let pick = |rows: &[usize]| {
        targets.iter().map(|t| rows.iter().map(|&i| t[i]).collect()).collect::<Vec<Vec<f64>>>()
    };
    let params = RvmParams::new(RvmConfig { max_bases: 150, ..config.experts.mixture.expert })
        .context("settings of the experts")?;
    let mut candidates = kernels_by_spread(inputs, &WIDTH_FACTORS);
    let (train_inputs, train_targets) = (inputs.select(&train), pick(&train));
    let (best, _) = choose(&candidates, |kernel| {
        let design = Design::new(kernel.clone(), train_inputs.clone());
        let model = Rvm::fit(&design, &train_targets, &vec![1.0; train.len()], &params)?;
        let error = held_out.iter().map(|&i| {
            let mean = model.mean(&inputs.row_f64(i));
            mean.iter().zip(&targets).map(|(m, t)| (m - t[i]).powi(2)).sum::<f64>()
        });
        Ok::<_, bme::FitError>(-error.sum::<f64>())
    })
    .context("the width of the kernels cannot be chosen")?;
    Ok(candidates.swap_remove(best))
}
