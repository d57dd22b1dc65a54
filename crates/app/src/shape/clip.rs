//! The road from the masks of a clip to one body.

use std::sync::Arc;

use body::{BodyModel, Camera, Pose};
use silhouette::Mask;

use super::fit::{ShapeConfig, ShapeFit, ShapeFrame, fit_shape};
use super::survey::{Survey, survey};
use crate::config::{Method, TrackConfig, TrackParams};
use crate::run_folder::Status;
use crate::track::follower::Follower;
use crate::track::pose_model::FreeJoints;
use crate::track::tracker::Scene;

/// Masks beyond the current one that a start looks at.
const START_MASKS: usize = 12;
/// The head of somebody who walks is so much lower than their stature, and the lowest point of a mask is the foot in front:
/// metres, mean over synthetic walks of training bodies.
const SURVEY_BIAS_M: f64 = -0.025;

/// Settings of the tracker for a shape fit: it needs to know roughly where the person is, since the fit finds the poses anew.
pub fn light_tracking() -> TrackConfig {
    TrackConfig {
        method: Method::Apf,
        modes: 1,
        particles: 50,
        layers: 6,
        working_height_px: 220.0,
        // The survey gives the heading, and the predictor was calibrated on walks tracked so.
        travel_weight: 0.0,
        ..TrackConfig::default()
    }
}

/// Tracks the person on `masks`, `fps` a second, and fits one body to them. None when no frame shows a whole person.
///
/// # Errors
/// When the masks do not fit the camera, or a setting is outside its range.
pub fn shape_from_masks(
    model: &BodyModel,
    camera: &Camera,
    masks: &[&Mask],
    fps: f64,
    track: &TrackConfig,
    config: &ShapeConfig,
) -> anyhow::Result<Option<(ShapeFit, Vec<ShapeFrame>)>> {
    let Some(survey) = survey(masks, camera, fps) else { return Ok(None) };
    let stature_m = stature_from(&survey);
    let params = TrackParams::new(TrackConfig {
        stature_m: Some(stature_m),
        initial_heading_deg: survey.heading_rad.map(f64::to_degrees),
        ..track.clone()
    })?;
    let body = Arc::new(model.shape_for_stature(stature_m, None));
    let prior = Arc::new(FreeJoints::new(&config.pose_prior, params.widening()));
    let scene = Scene {
        body,
        camera: *camera,
        model: prior,
        predictor: None,
        transitions: None,
        refiner: None,
        fps,
        params,
    };
    let mut follower = Follower::new(scene);
    let mut poses = Vec::new();
    for (index, mask) in masks.iter().enumerate() {
        let ahead = &masks[index..(index + START_MASKS).min(masks.len())];
        let record = follower.step(index as u64, ahead)?;
        if let Some(record) = record.filter(|record| record.status == Status::Tracked) {
            poses.push((index, (*mask).clone(), record.pose));
        }
    }
    let frames = frames_of(&survey, poses);
    Ok(fit_shape(model, camera, &frames, fps, stature_m, config).ok().map(|fit| (fit, frames)))
}

/// The stature at first sight.
pub fn stature_from(survey: &Survey) -> f64 {
    survey.stature_m - SURVEY_BIAS_M
}

/// Tracked poses with what the survey says of their frames. `poses`: place in the survey, mask, pose.
pub fn frames_of(survey: &Survey, poses: Vec<(usize, Mask, Pose)>) -> Vec<ShapeFrame> {
    poses
        .into_iter()
        .map(|(index, mask, pose)| ShapeFrame {
            index: index as u64,
            mask,
            pose,
            sighting: survey.sightings.get(index).copied().flatten(),
        })
        .collect()
}
