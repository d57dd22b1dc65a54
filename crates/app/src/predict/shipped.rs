//! What the program knows of how people move, by activity.

use body::pose_prior::PosePrior;

use super::{LatentPoses, PosePredictor};
use crate::config::TrackConfig;

/// What somebody is expected to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Activity {
    /// Walking.
    Walk,
    /// Jogging and running.
    Jog,
    /// Boxing.
    Box,
    /// Anything: nothing narrower is known.
    Any,
}

impl Activity {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Walk, Self::Jog, Self::Box, Self::Any];

    /// Its name, as in file names.
    pub fn name(self) -> &'static str {
        match self {
            Self::Walk => "walk",
            Self::Jog => "jog",
            Self::Box => "box",
            Self::Any => "any",
        }
    }

    /// The activity that a clip or sequence is named after, as `Walking`; [`Self::Any`] for a name that says nothing.
    pub fn called(name: &str) -> Self {
        match name.to_lowercase().as_str() {
            "walk" | "walking" => Self::Walk,
            "jog" | "jogging" | "run" | "running" => Self::Jog,
            "box" | "boxing" => Self::Box,
            _ => Self::Any,
        }
    }

    /// Whether clips of this action show it.
    pub fn includes(self, action: &str) -> bool {
        self == Self::Any || self == Self::called(action)
    }

    /// `config` for it: poses and steps of people who do just this hold for others nearly as they are, while those of many
    /// things have to be widened; and a predictor that was trained on them always has its say.
    pub fn over(self, config: TrackConfig) -> TrackConfig {
        match self {
            Self::Any => config,
            Self::Walk | Self::Jog | Self::Box => TrackConfig {
                prior_widening: 1.1,
                least_sd: 0.02,
                least_step: 0.002,
                frees_clavicles: false,
                diffusion: 1.5,
                least_share: 0.4,
                ..config
            },
        }
    }

    /// Poses and steps of many people who do it, as the program ships them.
    ///
    /// # Panics
    /// Never: a test loads all of them.
    pub fn prior(self) -> PosePrior {
        let bytes: &[u8] = match self {
            Self::Walk => include_bytes!("../../assets/prior-walk.bin"),
            Self::Jog => include_bytes!("../../assets/prior-jog.bin"),
            Self::Box => include_bytes!("../../assets/prior-box.bin"),
            Self::Any => return PosePrior::builtin(),
        };
        PosePrior::from_bytes(bytes).expect("the bundled prior is whole")
    }

    /// Number of coordinates of its [latent poses](Self::latent): five for an activity, as in `[Kanaujia2014]`, more for all of
    /// them together.
    pub fn n_latent(self) -> usize {
        if self == Self::Any { 8 } else { 5 }
    }

    /// Few coordinates for the poses of people who do it, and how they go on.
    ///
    /// # Panics
    /// Never: a test loads all of them.
    pub fn latent(self) -> LatentPoses {
        let bytes: &[u8] = match self {
            Self::Walk => include_bytes!("../../assets/latent-walk.bin"),
            Self::Jog => include_bytes!("../../assets/latent-jog.bin"),
            Self::Box => include_bytes!("../../assets/latent-box.bin"),
            Self::Any => include_bytes!("../../assets/latent-any.bin"),
        };
        LatentPoses::from_bytes(bytes).expect("the bundled latent poses are whole")
    }

    /// What a mask of somebody who does it says of the pose: the predictor that the program ships, learned from rendered
    /// masks.
    ///
    /// # Panics
    /// Never: a test loads all of them.
    pub fn predictor(self) -> PosePredictor {
        let bytes: &[u8] = match self {
            Self::Walk => include_bytes!("../../assets/predict-walk.bin"),
            Self::Jog => include_bytes!("../../assets/predict-jog.bin"),
            Self::Box => include_bytes!("../../assets/predict-box.bin"),
            Self::Any => include_bytes!("../../assets/predict-any.bin"),
        };
        PosePredictor::from_bytes(bytes).expect("the bundled predictor is whole")
    }
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use super::*;

    #[test]
    fn the_shipped_models_load_at_once_and_know_what_they_are_for() {
        for activity in Activity::ALL {
            let mut least = Duration::MAX;
            for _ in 0..3 {
                let start = Instant::now();
                let (prior, predictor) = (activity.prior(), activity.predictor());
                let latent = activity.latent();
                least = least.min(start.elapsed());
                assert_eq!(latent.dim(), activity.n_latent());
                assert!(latent.notice().contains("mocap.cs.cmu.edu"));
                let training = predictor.training();
                assert_eq!(training.activity, activity.name());
                assert!(training.notice.contains("mocap.cs.cmu.edu"));
                assert!(prior.notice().contains("mocap.cs.cmu.edu"));
                assert_eq!(training.check(1.5, activity.name()), Ok(()));
            }
            println!("models of {}: {:.0} ms", activity.name(), 1e3 * least.as_secs_f64());
            // 200 ms are promised on a quiet machine; tests share theirs.
            assert!(least < Duration::from_millis(600), "{}: {least:?}", activity.name());
        }
    }

    #[test]
    fn the_shipped_models_are_under_ten_megabytes() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");
        let sizes = std::fs::read_dir(folder).unwrap().map(|file| file.unwrap().metadata().unwrap().len());
        let total: u64 = sizes.sum();
        assert!(total < 10_000_000, "{total} bytes");
    }

    #[test]
    fn an_activity_has_the_clips_that_are_called_after_it() {
        assert!(Activity::Jog.includes("run") && Activity::Walk.includes("walk"));
        assert!(!Activity::Walk.includes("jog") && !Activity::Box.includes("bend"));
        assert!(Activity::Any.includes("bend"));
        assert_eq!(Activity::called("Gestures"), Activity::Any);
    }

    #[test]
    fn the_prior_of_an_activity_is_narrower_than_that_of_all() {
        let any: f64 = Activity::Any.prior().sd_rad().iter().sum();
        for activity in [Activity::Walk, Activity::Jog] {
            let narrow: f64 = activity.prior().sd_rad().iter().sum();
            assert!(narrow < any, "{}: {narrow:.2}, all: {any:.2}", activity.name());
        }
    }
}
