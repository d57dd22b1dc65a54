//! What predictors are trained for.

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
