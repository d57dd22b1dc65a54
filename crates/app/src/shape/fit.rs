//! From tracked frames to one body.

use std::sync::Arc;

use body::pose_prior::PosePrior;
use body::{BodyModel, Camera, Pose, Skeleton};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use silhouette::Mask;

use super::adjust::{AdjustConfig, Adjusted, Adjuster, View};
use super::figure::{Figure, Rest};
use super::rim::Seen;
use super::search::{SearchConfig, search};
use super::survey::Sighting;
use crate::predict::Activity;

/// Settings of a shape fit.
#[derive(Clone, Debug, PartialEq)]
pub struct ShapeConfig {
    /// Leading shape coefficients that are fitted.
    pub n_shape: usize,
    /// Frames that are used, at most.
    pub n_frames: usize,
    /// With fewer whole views of the person there is no fit.
    pub least_frames: usize,
    /// Seconds after which a frame tells something new.
    pub correlation_secs: f64,
    /// How the shape is found.
    pub method: ShapeMethod,
    /// How people hold themselves.
    pub pose_prior: Arc<PosePrior>,
    /// Of the adjustment.
    pub adjust: AdjustConfig,
    /// Of the search.
    pub search: SearchConfig,
}

/// How the shape is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum ShapeMethod {
    /// Shape and poses of all frames adjusted together to the outlines.
    #[default]
    Adjust,
    /// An annealed particle filter over the shape coefficients, each hypothesis posed anew, as in the paper.
    Annealed,
}

/// As which activity somebody who does `activity` is fitted. Walking has a prior and a predictor of its own; the others have too
/// few recorded performers, and make do with those of all motion.
pub const fn fitted_as(activity: Activity) -> Activity {
    match activity {
        Activity::Walk => Activity::Walk,
        Activity::Jog | Activity::Box | Activity::Any => Activity::Any,
    }
}

impl Default for ShapeConfig {
    fn default() -> Self {
        Self::of(Activity::Any)
    }
}

impl ShapeConfig {
    /// Settings for somebody who does `activity`.
    pub fn of(activity: Activity) -> Self {
        Self {
            n_shape: 24,
            n_frames: 16,
            least_frames: 4,
            correlation_secs: 0.15,
            method: ShapeMethod::default(),
            pose_prior: Arc::new(fitted_as(activity).prior()),
            adjust: AdjustConfig::default(),
            search: SearchConfig::default(),
        }
    }
}

/// A tracked frame.
#[derive(Clone, Debug)]
pub struct ShapeFrame {
    /// Its number.
    pub index: u64,
    /// The person, at full resolution.
    pub mask: Mask,
    /// Where the tracker has them.
    pub pose: Pose,
    /// Where they stand and walk to at first sight.
    pub sighting: Option<Sighting>,
}

/// Why a clip has no shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoShape {
    /// Too few frames show the person from head to foot.
    #[error("{found} frames show a whole person, expected {expected} at least")]
    TooFewFrames {
        /// Such frames.
        found: usize,
        /// Needed.
        expected: usize,
    },
}

/// The body of a clip.
#[derive(Clone, Debug)]
pub struct ShapeFit {
    /// Shape coefficients, `[n_shape]`.
    pub shape: Vec<f64>,
    /// Shape coefficients and thickness of clothes, both in standard deviations: mean
    pub mean: DVector<f64>,
    /// and covariance.
    pub covariance: DMatrix<f64>,
    /// Frames that were used and their poses.
    pub frames: Vec<(u64, Pose)>,
    /// Distance of rim and outline on each of them, pixels.
    pub misfit_px: Vec<f64>,
    /// Height of the lowest point of the body on each of them, metres.
    pub lowest_m: Vec<f64>,
}

/// A frame whose misfit is so many times the median is left out of the second round.
const LARGEST_MISFIT: f64 = 1.6;
/// A frame has a whole person when its area is between these shares of the median.
const AREA_SHARES: std::ops::Range<f64> = 0.45..2.2;

/// Fits one body to tracked frames, `fps` a second, before `camera` (full resolution). `stature_m` is where the search begins.
///
/// # Errors
/// When too few frames show a whole person.
pub fn fit_shape(
    model: &BodyModel,
    camera: &Camera,
    frames: &[ShapeFrame],
    fps: f64,
    stature_m: f64,
    config: &ShapeConfig,
) -> Result<ShapeFit, NoShape> {
    let mut used = whole_views(choose(frames, config.n_frames));
    if used.len() < config.least_frames.max(1) {
        return Err(NoShape::TooFewFrames { found: used.len(), expected: config.least_frames });
    }
    let figure = Figure::new(model, config.n_shape);
    let start = &model.coefficients_for_stature(stature_m, None)[..config.n_shape];
    let rest = figure.rest(start);
    let adjuster = Adjuster::new(&figure, camera, &config.pose_prior, config.adjust.clone());
    let poses = used
        .par_iter()
        .map(|(frame, seen)| best_start(&adjuster, &config.pose_prior, &rest, frame, seen))
        .collect();
    let first = found(&adjuster, &used, poses, fps, start, config);

    let keep = well_fitted(&first.misfit_px);
    let mut places = keep.iter();
    used.retain(|_| *places.next().expect("one for each view"));
    let poses = first.poses.into_iter().zip(&keep).filter_map(|(pose, keep)| keep.then_some(pose)).collect();
    let steps = config.adjust.steps / 2;
    let finishing = AdjustConfig { steps, ..config.adjust.clone() };
    let finisher = Adjuster::new(&figure, camera, &config.pose_prior, finishing);
    let shape = &first.mean.as_slice()[..config.n_shape];
    let last = found(&finisher, &used, poses, fps, shape, config);
    Ok(ShapeFit {
        shape: last.mean.as_slice()[..config.n_shape].to_vec(),
        mean: last.mean,
        covariance: last.covariance,
        frames: used.iter().map(|(frame, _)| frame.index).zip(last.poses).collect(),
        misfit_px: last.misfit_px,
        lowest_m: last.lowest_m,
    })
}

/// The shape, by the method of `config`, from `shape` and `poses` on.
fn found(
    adjuster: &Adjuster<'_>,
    used: &[(&ShapeFrame, Seen)],
    poses: Vec<Pose>,
    fps: f64,
    shape: &[f64],
    config: &ShapeConfig,
) -> Adjusted {
    let views = views(used, poses, fps, config);
    match config.method {
        ShapeMethod::Adjust => adjuster.adjust(&views, shape),
        ShapeMethod::Annealed => {
            let masks: Vec<&Mask> = used.iter().map(|(frame, _)| &frame.mask).collect();
            search(adjuster, &views, &masks, shape, &config.search)
        }
    }
}

/// The frames on which the person is seen from head to foot.
fn whole_views(frames: Vec<&ShapeFrame>) -> Vec<(&ShapeFrame, Seen)> {
    let seen: Vec<(&ShapeFrame, Seen)> =
        frames.into_par_iter().filter_map(|frame| Some((frame, Seen::of(&frame.mask)?))).collect();
    let mut areas: Vec<u64> = seen.iter().map(|(_, seen)| seen.area).collect();
    areas.sort_unstable();
    let median = areas.get(areas.len() / 2).copied().unwrap_or(1);
    let is_whole =
        |seen: &Seen| !seen.is_cropped && AREA_SHARES.contains(&(seen.area as f64 / median as f64));
    seen.into_iter().filter(|(_, seen)| is_whole(seen)).collect()
}

fn views<'a>(
    used: &'a [(&ShapeFrame, Seen)],
    poses: Vec<Pose>,
    fps: f64,
    config: &ShapeConfig,
) -> Vec<View<'a>> {
    let places: Vec<f64> = used.iter().map(|(frame, _)| frame.index as f64 / fps).collect();
    let weights = weights(&places, config.correlation_secs);
    let views = used.iter().zip(poses).zip(weights);
    views.map(|(((_, seen), pose), weight)| View { seen, pose, weight }).collect()
}

/// Whether each view fits about as well as the others.
fn well_fitted(misfit_px: &[f64]) -> Vec<bool> {
    let mut sorted = misfit_px.to_vec();
    sorted.sort_by(f64::total_cmp);
    let limit_px = LARGEST_MISFIT * sorted[sorted.len() / 2];
    misfit_px.iter().map(|misfit| *misfit <= limit_px).collect()
}

/// Steps from each of the poses that a frame may begin with.
const START_STEPS: usize = 8;
/// Swing of the legs of a walking person at the start, radians.
const SWING_RAD: f64 = 0.4;

/// The best pose of a body of known shape: from the tracked one, or from a person who walks where the masks say.
fn best_start(
    adjuster: &Adjuster<'_>,
    prior: &PosePrior,
    rest: &Rest,
    frame: &ShapeFrame,
    seen: &Seen,
) -> Pose {
    let mut best: Option<(Pose, f64)> = None;
    for pose in starts(prior, rest, frame) {
        let (pose, cost) = adjuster.adjust_pose(&View { seen, pose, weight: 1.0 }, rest, START_STEPS);
        if best.as_ref().is_none_or(|(_, least)| cost < *least) {
            best = Some((pose, cost));
        }
    }
    best.expect("there is the tracked pose").0
}

fn starts(prior: &PosePrior, rest: &Rest, frame: &ShapeFrame) -> Vec<Pose> {
    let mut starts = vec![frame.pose.clone()];
    let Some(Sighting { place, heading_rad: Some(heading_rad), .. }) = frame.sighting else { return starts };
    let skeleton = Skeleton::human();
    let dof = |name: &str| skeleton.dof_index(name).expect("the skeleton has it");
    for swing in [-SWING_RAD, 0.0, SWING_RAD] {
        let mut pose = Pose::upright(place.extend(rest.joints[0].y), heading_rad);
        pose.angles.copy_from_slice(prior.mean_rad());
        pose.angles[dof("left_hip_flexion")] += swing;
        pose.angles[dof("right_hip_flexion")] -= swing;
        pose.angles[dof("left_shoulder_elevation")] -= swing;
        pose.angles[dof("right_shoulder_elevation")] += swing;
        pose.clamp();
        starts.push(pose);
    }
    starts
}

/// At most `count` frames, spread evenly.
fn choose(frames: &[ShapeFrame], count: usize) -> Vec<&ShapeFrame> {
    let count = count.min(frames.len());
    (0..count).map(|k| &frames[(2 * k + 1) * frames.len() / (2 * count)]).collect()
}

/// Frames nearer in time than `correlation_secs` share what they tell.
fn weights(places_secs: &[f64], correlation_secs: f64) -> Vec<f64> {
    let overlap = |a: f64, b: f64| (1.0 - (a - b).abs() / correlation_secs).max(0.0);
    places_secs
        .iter()
        .map(|&own| places_secs.iter().map(|&other| overlap(own, other)).sum::<f64>().recip())
        .collect()
}

#[cfg(test)]
mod tests;
