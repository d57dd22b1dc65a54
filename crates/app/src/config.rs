//! What a run can be told: the settings that change its answer, with their defaults and bounds.
//!
//! [`TrackConfig`] is the open form, as it stands in a file or on the command line; [`TrackParams`] is the checked one that
//! the tracker takes. What only changes how a run is carried out (threads) is in [`ExecConfig`].

use serde::{Deserialize, Serialize};

use crate::track::pose_model::Widening;

/// Which motions the pose model expects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Motion {
    /// Anything: every joint angle is free within its anatomical limits, under a weak Gaussian prior.
    Any,
    /// What the captured motions span: principal components of joint angles.
    Captured,
    /// The poses of captured motions and how they go on: a spectral latent variable model with learned dynamics.
    Latent,
}

/// The tracker: what of the bottom-up predictor it uses, and where.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// Annealed particle filter: particles come from the motion prior.
    Apf,
    /// Observation-driven particle filter: particles come from the pose before and the mask now.
    Opf,
    /// Joint particle filter: from a mixture of the motion prior and the predictor.
    Jpf,
    /// Joint likelihood model: from the motion prior; the predictor has a part in the likelihood.
    Jlm,
}

impl Method {
    /// Whether it asks a predictor of poses what a mask shows.
    pub const fn asks_predictor(self) -> bool {
        matches!(self, Self::Jpf | Self::Jlm)
    }

    /// Its name in tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Apf => "APF",
            Self::Opf => "OPF",
            Self::Jpf => "JPF",
            Self::Jlm => "JLM",
        }
    }
}

/// What particles of a mixture of sources weigh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Weighting {
    /// Their likelihood, as in the paper.
    Paper,
    /// Their likelihood times p / q, with the density q of the mixture: exact.
    Importance,
}

impl From<Weighting> for pf_core::proposal::Weighting {
    fn from(weighting: Weighting) -> Self {
        match weighting {
            Weighting::Paper => Self::LikelihoodOnly,
            Weighting::Importance => Self::Importance,
        }
    }
}

/// Settings under one name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Preset {
    /// Those of the paper: one filter over a few latent coordinates, its answer as the particles give it.
    Paper,
    /// Those that measured best here.
    Best,
}

impl Preset {
    /// `config` with its settings in it.
    pub fn over(self, config: TrackConfig) -> TrackConfig {
        match self {
            Self::Best => config,
            Self::Paper => TrackConfig {
                particles: 200,
                layers: 10,
                modes: 1,
                weighting: Weighting::Paper,
                motion: Motion::Latent,
                components: 5,
                refine_steps: 0,
                travel_weight: 0.0,
                least_share: 0.05,
                diffusion: 3.0,
                ..config
            },
        }
    }
}

/// Settings of a tracking run, unchecked; every default of the product stands here.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrackConfig {
    /// Seed of every random draw of the run.
    pub seed: u64,
    /// Particles of the filter.
    pub particles: u32,
    /// Annealing layers a frame.
    pub layers: u32,
    /// Filters side by side, each with so many particles and layers.
    pub modes: u32,
    /// The tracker.
    pub method: Method,
    /// What particles weigh under [`Method::Jpf`].
    pub weighting: Weighting,
    /// Share of the particles that come from the predictor on the first frame, under [`Method::Jpf`].
    pub cue_share: f64,
    /// Least share of the particles that come from either source, likewise.
    pub least_share: f64,
    /// Exponent of the predictor's density under [`Method::Jlm`].
    pub cue_exponent: f64,
    /// Best particles of each frame that the predictor learns from; with none it stays as it is.
    pub adapt: u32,
    /// Frames that the answer waits for those after it, which then have a say in it; none at 0.
    pub smooth: u32,
    /// Which motions are expected.
    pub motion: Motion,
    /// Principal components kept by [`Motion::Captured`], and coordinates of [`Motion::Latent`] where these are learned for the run.
    pub components: u32,
    /// Stature of the person, metres; measured on the first masks when absent.
    pub stature_m: Option<f64>,
    /// Heading of the person on the first frame, degrees anticlockwise from world +x; searched for when absent.
    pub initial_heading_deg: Option<f64>,
    /// Height to which the person is scaled before the overlap is counted, pixels.
    pub working_height_px: f64,
    /// Log-likelihood lost when body and mask share nothing: ln p(r|x) = -sharpness (1 - IoU).
    pub sharpness: f64,
    /// Ratio of the exponents of one annealing layer and the next sharper one.
    pub annealing_ratio: f64,
    /// Factor on the standard deviations of the recorded poses, for the prior of [`Motion::Any`].
    pub prior_widening: f64,
    /// Standard deviation added to each joint angle of that prior, as a share of the range between its limits.
    pub least_sd: f64,
    /// Least standard deviation of each joint angle's step from frame to frame, likewise.
    pub least_step: f64,
    /// Whether clavicles move more than they do in the recordings.
    pub frees_clavicles: bool,
    /// Steps of local optimisation that the answer of a frame takes towards the outline of the mask.
    pub refine_steps: u32,
    /// Weight of the Gaussian prior over joint angles in the log-likelihood.
    pub prior_weight: f64,
    /// What the log-likelihood gains when somebody who walks faces the way they go, and loses when they face away from it.
    pub travel_weight: f64,
    /// Diffusion of the first layer, in standard deviations of the motion from one frame to the next.
    pub diffusion: f64,
    /// Ratio of the diffusion of one layer and the layer before.
    pub diffusion_ratio: f64,
    /// Share of the particles that take a part of the body from another particle of the layer.
    pub exchange_share: f64,
    /// Share of the particles that a layer diffuses in one part of the body only.
    pub part_share: f64,
    /// Share of the particles for which a layer tries to mirror a limb in depth.
    pub mirror_share: f64,
    /// Share of the particles for which a layer puts the lowest foot on the floor.
    pub ground_share: f64,
    /// Frames without a usable mask that are bridged before the person counts as lost.
    pub coast_frames: u32,
}

impl Default for TrackConfig {
    fn default() -> Self {
        Self {
            seed: 1,
            particles: 200,
            layers: 10,
            modes: 2,
            method: Method::Jpf,
            weighting: Weighting::Paper,
            cue_share: 0.5,
            least_share: 0.05,
            cue_exponent: 0.35,
            adapt: 0,
            smooth: 0,
            motion: Motion::Any,
            components: 12,
            stature_m: None,
            initial_heading_deg: None,
            working_height_px: 360.0,
            sharpness: 150.0,
            annealing_ratio: 0.7,
            prior_widening: 1.3,
            least_sd: 0.06,
            least_step: 0.006,
            frees_clavicles: true,
            refine_steps: 4,
            prior_weight: 1.0,
            travel_weight: 8.0,
            diffusion: 3.0,
            diffusion_ratio: 0.8,
            exchange_share: 0.3,
            part_share: 0.8,
            mirror_share: 0.02,
            ground_share: 0.05,
            coast_frames: 30,
        }
    }
}

/// A setting outside its range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("settings: `{field}` is {value}, expected {expected}")]
pub struct BadSetting {
    /// Name of the field of [`TrackConfig`].
    pub field: &'static str,
    /// The value found.
    pub value: f64,
    /// What would have been accepted.
    pub expected: &'static str,
}

/// Checked settings of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackParams(TrackConfig);

impl TrackParams {
    /// Checks every field.
    ///
    /// # Errors
    /// The first field outside its range (NaN is outside every range).
    pub fn new(config: TrackConfig) -> Result<Self, BadSetting> {
        let c = &config;
        check("particles", f64::from(c.particles), 2.0..=100_000.0, "2 to 100000")?;
        check("layers", f64::from(c.layers), 1.0..=100.0, "1 to 100")?;
        check("refine_steps", f64::from(c.refine_steps), 0.0..=50.0, "0 to 50")?;
        check("modes", f64::from(c.modes), 1.0..=8.0, "1 to 8")?;
        check("components", f64::from(c.components), 1.0..=49.0, "1 to 49")?;
        check(
            "cue_share",
            c.cue_share,
            c.least_share..=1.0 - c.least_share,
            "`least_share` to 1 - `least_share`",
        )?;
        check("least_share", c.least_share, 1e-6..=0.5, "0.000001 to 0.5")?;
        check("cue_exponent", c.cue_exponent, 0.0..=1.0, "0 to 1")?;
        check("smooth", f64::from(c.smooth), 0.0..=1000.0, "0 to 1000 frames")?;
        check("adapt", f64::from(c.adapt), 0.0..=f64::from(c.particles), "0 to `particles`")?;
        if let Some(stature_m) = c.stature_m {
            check("stature_m", stature_m, 1.2..=2.3, "1.2 to 2.3 metres")?;
        }
        if let Some(heading) = c.initial_heading_deg {
            check("initial_heading_deg", heading, -360.0..=360.0, "-360 to 360 degrees")?;
        }
        check("working_height_px", c.working_height_px, 60.0..=2000.0, "60 to 2000 pixels")?;
        check("sharpness", c.sharpness, 1.0..=10_000.0, "1 to 10000")?;
        check("annealing_ratio", c.annealing_ratio, 0.05..=1.0, "0.05 to 1")?;
        check("prior_widening", c.prior_widening, 0.1..=100.0, "0.1 to 100")?;
        check("least_sd", c.least_sd, 0.001..=1.0, "0.001 to 1")?;
        check("least_step", c.least_step, 0.0..=1.0, "0 to 1")?;
        check("prior_weight", c.prior_weight, 0.0..=10.0, "0 to 10")?;
        check("travel_weight", c.travel_weight, 0.0..=1000.0, "0 to 1000")?;
        check("diffusion", c.diffusion, 0.01..=100.0, "0.01 to 100")?;
        check("diffusion_ratio", c.diffusion_ratio, 0.05..=1.0, "0.05 to 1")?;
        check("exchange_share", c.exchange_share, 0.0..=1.0, "0 to 1")?;
        check("part_share", c.part_share, 0.0..=1.0, "0 to 1")?;
        check("mirror_share", c.mirror_share, 0.0..=1.0, "0 to 1")?;
        check("ground_share", c.ground_share, 0.0..=1.0, "0 to 1")?;
        Ok(Self(config))
    }

    /// By how much the learned prior is widened for [`Motion::Any`].
    pub fn widening(&self) -> Widening {
        Widening {
            factor: self.prior_widening,
            least_sd: self.least_sd,
            least_step: self.least_step,
            frees_clavicles: self.frees_clavicles,
        }
    }
}

impl std::ops::Deref for TrackParams {
    type Target = TrackConfig;
    fn deref(&self) -> &TrackConfig {
        &self.0
    }
}

fn check(
    field: &'static str,
    value: f64,
    range: std::ops::RangeInclusive<f64>,
    expected: &'static str,
) -> Result<(), BadSetting> {
    if range.contains(&value) { Ok(()) } else { Err(BadSetting { field, value, expected }) }
}

/// How a run is carried out; never changes its answer.
#[derive(Clone, Copy, Debug)]
pub struct ExecConfig {
    /// Worker threads.
    pub threads: usize,
}

impl Default for ExecConfig {
    fn default() -> Self {
        Self { threads: std::thread::available_parallelism().map_or(1, usize::from) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_accepted() {
        assert!(TrackParams::new(TrackConfig::default()).is_ok());
    }

    #[test]
    fn nan_and_out_of_range_values_are_named() {
        let bad = TrackConfig { stature_m: Some(f64::NAN), ..TrackConfig::default() };
        let error = TrackParams::new(bad).expect_err("NaN is outside every range");
        assert_eq!(error.to_string(), "settings: `stature_m` is NaN, expected 1.2 to 2.3 metres");
        let bad = TrackConfig { particles: 1, ..TrackConfig::default() };
        let error = TrackParams::new(bad).expect_err("one particle is no cloud");
        assert_eq!(error.to_string(), "settings: `particles` is 1, expected 2 to 100000");
    }
}
