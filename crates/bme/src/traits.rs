//! What experts, gates and models that learn online promise.

use crate::rvm::LARGEST;

/// Independent normal distributions, one an output: a prediction.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gaussian {
    /// Means, in the units of the outputs.
    pub mean: Vec<f64>,
    /// Variances of a new observation, in squared units of the outputs; all above zero.
    pub variance: Vec<f64>,
}

impl Gaussian {
    /// ln N(y | mean, variance).
    ///
    /// # Panics
    /// When `y` has another length than the mean.
    pub fn log_density(&self, y: &[f64]) -> f64 {
        assert_eq!(y.len(), self.mean.len(), "a point of {} for a density over {}", y.len(), self.mean.len());
        let terms = y.iter().zip(&self.mean).zip(&self.variance);
        terms.map(|((y, m), v)| -0.5 * ((y - m) * (y - m) / v + (2.0 * std::f64::consts::PI * v).ln())).sum()
    }
}

/// Predicts outputs from an input, with their uncertainty.
///
/// Laws: `out.mean` and `out.variance` get [`Self::output_dim`] finite numbers for any finite input; variances are
/// above zero; equal inputs give equal bits.
pub trait Expert {
    /// The length of an input.
    fn input_dim(&self) -> usize;
    /// The length of a prediction.
    fn output_dim(&self) -> usize;
    /// p(y | x), written into `out`.
    ///
    /// # Panics
    /// When `x` has not [`Self::input_dim`] numbers.
    fn predict(&self, x: &[f64], out: &mut Gaussian);
}

/// Says how much each expert is to be believed at an input.
///
/// Laws: the log-sum-exp of `out` is 0 to rounding; no entry is NaN or above 0 (−∞ is "never").
pub trait Gate {
    /// The length of an input.
    fn input_dim(&self) -> usize;
    /// How many experts there are.
    fn n_experts(&self) -> usize;
    /// ln g_k(x), written into `out`.
    ///
    /// # Panics
    /// When `x` has not [`Self::input_dim`] or `out` not [`Self::n_experts`] numbers.
    fn log_gates(&self, x: &[f64], out: &mut [f64]);
}

/// One output that goes with an input, and how far it is to be believed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer<'a> {
    /// The output.
    pub y: &'a [f64],
    /// Its weight in samples, above 0 and at most 1.
    pub responsibility: f64,
}

/// Learns from one labelled example at a time.
pub trait OnlineUpdate {
    /// Learns that these outputs go with one input, as a tracker's best particles go with its frame: every output adds its
    /// own part to the sufficient statistics, and bases change once, at the price of a single example.
    ///
    /// # Errors
    /// When a length is wrong, a number is not finite, or a responsibility is not in (0, 1]. The model is then as it was.
    fn update_all(&mut self, x: &[f64], answers: &[Answer<'_>]) -> Result<UpdateReport, UpdateError>;

    /// Bases added, pruned, re-estimated, and the gain in log evidence. On `Err` the model is as it was.
    ///
    /// # Errors
    /// As [`Self::update_all`].
    fn update(&mut self, x: &[f64], y: &[f64], responsibility: f64) -> Result<UpdateReport, UpdateError> {
        self.update_all(x, &[Answer { y, responsibility }])
    }
}

/// What an update did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UpdateReport {
    /// Bases that came in.
    pub added: usize,
    /// Bases that went out.
    pub deleted: usize,
    /// Precisions that moved.
    pub reestimated: usize,
    /// Log evidence after less before the changes of bases, both with the new example; never negative.
    pub log_evidence_gain: f64,
}

impl std::ops::AddAssign for UpdateReport {
    fn add_assign(&mut self, other: Self) {
        self.added += other.added;
        self.deleted += other.deleted;
        self.reestimated += other.reestimated;
        self.log_evidence_gain += other.log_evidence_gain;
    }
}

/// Why a model cannot learn from an example.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum UpdateError {
    /// The input has the wrong length.
    #[error("`x` has {found} numbers, expected {expected}")]
    InputDim {
        /// Length given.
        found: usize,
        /// Length of the model's inputs.
        expected: usize,
    },
    /// The output has the wrong length.
    #[error("`y` has {found} numbers, expected {expected}")]
    OutputDim {
        /// Length given.
        found: usize,
        /// Length of the model's outputs.
        expected: usize,
    },
    /// A number is NaN, or so large that its square would be infinite.
    #[error("`{field}[{index}]` is {value}, expected a finite number within ±{LARGEST:e}")]
    NotFinite {
        /// `x` or `y`.
        field: &'static str,
        /// Which entry.
        index: usize,
        /// What stands there.
        value: f64,
    },
    /// A share of a class that is negative, or shares that are all zero.
    #[error("`y[{index}]` is {value}, expected shares of 0 and more, not all 0")]
    Share {
        /// Which entry.
        index: usize,
        /// What stands there.
        value: f64,
    },
    /// A responsibility out of range.
    #[error("`responsibility` is {value}, expected a number above 0 and at most 1")]
    Responsibility {
        /// What was given.
        value: f64,
    },
}
