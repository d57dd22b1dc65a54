//! What predictors are trained for, and the one that the program carries.

use super::PosePredictor;

/// What somebody is expected to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Activity {
    /// Walking.
    Walk,
    /// Jogging and running.
    Jog,
    /// Boxing.
    Box,
    /// Anything that was recorded.
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

    /// Whether clips of this action show it.
    pub fn includes(self, action: &str) -> bool {
        match self {
            Self::Walk => action == "walk",
            Self::Jog => action == "jog" || action == "run",
            Self::Box => action == "box",
            Self::Any => true,
        }
    }
}

impl PosePredictor {
    /// The predictor that the program ships: of anything recorded, by many people, from rendered masks.
    ///
    /// # Panics
    /// Never: a test loads the file.
    pub fn builtin() -> Self {
        let bytes = include_bytes!("../../assets/predict-any.bin");
        Self::from_bytes(bytes).expect("the bundled predictor is whole: a test loads it")
    }
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use super::*;

    #[test]
    fn the_shipped_model_loads_at_once_and_knows_what_it_is_for() {
        let mut least = Duration::MAX;
        for _ in 0..3 {
            let start = Instant::now();
            let predictor = PosePredictor::builtin();
            least = least.min(start.elapsed());
            assert_eq!(predictor.training().activity, "any");
            assert!(predictor.training().notice.contains("mocap.cs.cmu.edu"));
            assert_eq!(predictor.training().check(1.5, "walk"), Ok(()));
        }
        // 200 ms are promised on a quiet machine; tests share theirs.
        assert!(least < Duration::from_millis(600), "{least:?}");
    }
}
