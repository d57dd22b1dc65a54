//! From a fitted shape to numbers: girths, stature, weight and gender, each with its uncertainty.
//!
//! A linear predictor on the fitted coefficients, learned from people with known bodies: what a coefficient means is learned on the
//! bodies themselves, and what the fit does to coefficients on synthetic walks of some of them. The errors that the
//! predictor makes on walks it did not see give the intervals.

use std::collections::BTreeMap;

use body::Sex;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::fit::{ShapeFit, fitted_as};
use crate::predict::Activity;
use crate::synth::Truth;

/// Version of [`PredictorFile`].
pub const VERSION: u32 = 2;
/// Standard normal quantile that leaves 5 % above it.
const QUANTILE_95: f64 = 1.644_853_626_951_472;

/// What is predicted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Chest girth, metres.
    Chest,
    /// Waist girth, metres.
    Waist,
    /// Hip girth, metres.
    Hips,
    /// Girth of the right thigh, metres.
    Thigh,
    /// Girth of the right calf, metres.
    Calf,
    /// Stature, metres.
    Stature,
    /// Weight, kg.
    Weight,
}

impl Quantity {
    /// In the order of all tables.
    pub const ALL: [Self; 7] =
        [Self::Chest, Self::Waist, Self::Hips, Self::Thigh, Self::Calf, Self::Stature, Self::Weight];

    /// As in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Chest => "chest",
            Self::Waist => "waist",
            Self::Hips => "hips",
            Self::Thigh => "thigh",
            Self::Calf => "calf",
            Self::Stature => "stature",
            Self::Weight => "weight",
        }
    }

    /// `m` or `kg`.
    pub const fn unit(self) -> &'static str {
        if matches!(self, Self::Weight) { "kg" } else { "m" }
    }

    /// How it is defined.
    pub const fn definition(self) -> &'static str {
        use biosig::Girth;
        match self {
            Self::Chest => Girth::Chest.definition(),
            Self::Waist => Girth::Waist.definition(),
            Self::Hips => Girth::Hips.definition(),
            Self::Thigh => Girth::RightThigh.definition(),
            Self::Calf => Girth::RightCalf.definition(),
            Self::Stature => "height of the body at rest, without shoes",
            Self::Weight => "weight of a person of this shape in the survey that the bodies were made after",
        }
    }

    /// Its true value.
    pub fn of(self, truth: &Truth) -> f64 {
        match self {
            Self::Chest => truth.chest_m,
            Self::Waist => truth.waist_m,
            Self::Hips => truth.hips_m,
            Self::Thigh => truth.right_thigh_m,
            Self::Calf => truth.right_calf_m,
            Self::Stature => truth.stature_m,
            Self::Weight => truth.weight_kg,
        }
    }
}

/// 1 for a man, -1 for a woman.
pub fn sex_score(sex: Sex) -> f64 {
    if sex == Sex::Male { 1.0 } else { -1.0 }
}

/// A value and how sure it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Expected value.
    pub value: f64,
    /// Standard deviation.
    pub sd: f64,
    /// The value lies inside with a probability of 90 %.
    pub interval90: [f64; 2],
}

/// What a fitted shape says of a person.
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    /// In the order of [`Quantity::ALL`].
    pub quantities: [Estimate; 7],
    /// Probability that the person is a man.
    pub male_probability: f64,
}

impl Prediction {
    /// One quantity.
    pub fn of(&self, quantity: Quantity) -> &Estimate {
        &self.quantities[quantity as usize]
    }
}

/// What is known of a person beforehand.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Known {
    /// Stature, metres.
    pub stature_m: Option<f64>,
    /// Weight, kg.
    pub weight_kg: Option<f64>,
}

/// Standard deviations of what people say of themselves.
const KNOWN_STATURE_SD_M: f64 = 0.01;
const KNOWN_WEIGHT_SD_KG: f64 = 1.0;

/// A predictor as it stands in a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PredictorFile {
    /// [`VERSION`].
    pub version: u32,
    /// Walks it was learned from.
    pub n_walks: usize,
    /// In the order of [`Quantity::ALL`], then the score of the sex: 1 for men, -1 for women.
    pub lines: Vec<Line>,
    /// Correlation of the errors of the lines, `[n_lines][n_lines]`.
    pub correlation: Vec<Vec<f64>>,
    /// Mean score of women and of men as predicted, and the standard deviation about either.
    pub sex_scores: [f64; 3],
    /// By performer: the same, learned from all other performers' walks. For tests in which people walk as the performer does.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub without: BTreeMap<String, PredictorFile>,
}

impl PredictorFile {
    /// The file of the predictor for people who do `activity`.
    pub const fn name_for(activity: Activity) -> &'static str {
        if matches!(fitted_as(activity), Activity::Walk) {
            "umbra-shape-walk.json"
        } else {
            "umbra-shape.json"
        }
    }
}

/// A linear function of the fitted coefficients and the variance of its error.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Line {
    /// `chest` and so on, or `sex`.
    pub name: String,
    /// Value of the mean body.
    pub intercept: f64,
    /// Change with each coefficient.
    pub slopes: Vec<f64>,
    /// Error variance that every fit has,
    pub variance: f64,
    /// and the factor on the variance that the fit itself gives.
    pub fit_variance: f64,
    /// Factor on the half-width of the interval of a Gaussian: errors have longer tails.
    pub interval_factor: f64,
}

impl Line {
    /// Value at these coefficients.
    pub fn at(&self, shape: &[f64]) -> f64 {
        self.intercept + self.slopes.iter().zip(shape).map(|(slope, c)| slope * c).sum::<f64>()
    }

    /// Variance that the uncertainty of the coefficients gives.
    pub fn variance_of(&self, covariance: &DMatrix<f64>) -> f64 {
        let n = self.slopes.len();
        let slopes = DVector::from_column_slice(&self.slopes);
        (covariance.view((0, 0), (n, n)) * &slopes).dot(&slopes)
    }

    /// Standard deviation of the prediction from a fit of this covariance.
    pub fn sd(&self, covariance: &DMatrix<f64>) -> f64 {
        (self.variance + self.fit_variance * self.variance_of(covariance)).sqrt()
    }
}

/// Predicts.
#[derive(Clone, Debug)]
pub struct Predictor(PredictorFile);

impl Predictor {
    /// The predictor that comes with the program, for fits under [`ShapeConfig::of`](super::ShapeConfig::of) this activity.
    pub fn of(activity: Activity) -> Self {
        let json = match fitted_as(activity) {
            Activity::Walk => include_str!("../../assets/umbra-shape-walk.json"),
            _ => include_str!("../../assets/umbra-shape.json"),
        };
        Self(serde_json::from_str(json).expect("the file in the program is tested"))
    }

    /// The same without what it learned from the walks of `performer`; itself when it learned nothing from them.
    #[must_use]
    pub fn without(&self, performer: &str) -> Self {
        Self(self.0.without.get(performer).unwrap_or(&self.0).clone())
    }

    /// The predictor of a file.
    ///
    /// # Panics
    /// When it has not a line for each quantity and the sex.
    pub fn new(file: PredictorFile) -> Self {
        assert_eq!(file.lines.len(), Quantity::ALL.len() + 1, "a line for each quantity and the sex");
        Self(file)
    }

    /// What the fit says of the person, with what is known of them.
    pub fn predict(&self, fit: &ShapeFit, known: &Known) -> Prediction {
        let lines = &self.0.lines;
        let n = lines.len();
        let mut mean = DVector::from_iterator(n, lines.iter().map(|line| line.at(&fit.shape)));
        let sd: Vec<f64> = lines.iter().map(|line| line.sd(&fit.covariance)).collect();
        let mut covariance = DMatrix::from_fn(n, n, |i, j| sd[i] * sd[j] * self.0.correlation[i][j]);
        let given = [
            (Quantity::Stature, known.stature_m, KNOWN_STATURE_SD_M),
            (Quantity::Weight, known.weight_kg, KNOWN_WEIGHT_SD_KG),
        ];
        for (quantity, value, value_sd) in given {
            if let Some(value) = value {
                let k = quantity as usize;
                let gain = covariance.column(k) / (covariance[(k, k)] + value_sd.powi(2));
                let seen = covariance.row(k).into_owned();
                mean += &gain * (value - mean[k]);
                covariance -= gain * seen;
            }
        }
        let quantities = Quantity::ALL.map(|quantity| {
            let k = quantity as usize;
            let (value, sd) = (mean[k], covariance[(k, k)].max(0.0).sqrt());
            let half = QUANTILE_95 * lines[k].interval_factor * sd;
            Estimate { value, sd, interval90: [value - half, value + half] }
        });
        let [female, male, spread] = self.0.sex_scores;
        let middle = 0.5 * (female + male);
        let log_odds = (mean[n - 1] - middle) * (male - female) / spread.powi(2);
        Prediction { quantities, male_probability: 1.0 / (1.0 + (-log_odds).exp()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use biosig::{Girth, Tape};
    use body::BodyModel;

    fn fit(shape: Vec<f64>, sd: f64) -> ShapeFit {
        let n = shape.len() + 1;
        ShapeFit {
            mean: DVector::zeros(n),
            covariance: DMatrix::identity(n, n) * sd.powi(2),
            shape,
            frames: Vec::new(),
            misfit_px: Vec::new(),
            lowest_m: Vec::new(),
        }
    }

    /// The tape lies on the surface; the predictor never saw it. Fails when the shape space was made anew and the predictor
    /// was not.
    #[test]
    fn agrees_with_a_tape_on_bodies_of_the_model() {
        let model = BodyModel::builtin();
        let tape = Tape::of_model(&model);
        let places = [(0, 1.5), (0, -1.5), (1, 1.5), (1, -1.5), (2, 1.5), (3, -1.5), (0, 0.0)];
        for (activity, (axis, value)) in [Activity::Any, Activity::Walk]
            .into_iter()
            .flat_map(|activity| places.map(|place| (activity, place)))
        {
            let predictor = Predictor::of(activity);
            let n = predictor.0.lines[0].slopes.len();
            let mut shape = vec![0.0; n];
            shape[axis] = value;
            let measured = tape.measure_body(&model.shape(&shape)).unwrap();
            let found = predictor.predict(&fit(shape, 0.1), &Known::default());
            for (quantity, tape_m, most_m) in [
                (Quantity::Chest, measured.girth_m(Girth::Chest), 0.06),
                (Quantity::Waist, measured.girth_m(Girth::Waist), 0.06),
                (Quantity::Hips, measured.girth_m(Girth::Hips), 0.06),
                (Quantity::Thigh, measured.girth_m(Girth::RightThigh), 0.05),
                (Quantity::Calf, measured.girth_m(Girth::RightCalf), 0.03),
                (Quantity::Stature, measured.stature_m, 0.03),
            ] {
                let value = found.of(quantity).value;
                assert!(
                    (value - tape_m).abs() < most_m,
                    "{activity:?}, {axis} {value}: {quantity:?} {value}, tape {tape_m}"
                );
            }
        }
    }

    #[test]
    fn what_is_known_tightens_the_rest() {
        let predictor = Predictor::of(Activity::Any);
        let fit = fit(vec![0.0; predictor.0.lines[0].slopes.len()], 0.5);
        let blind = predictor.predict(&fit, &Known::default());
        let weight_kg = blind.of(Quantity::Weight).value + 8.0;
        let known = predictor.predict(&fit, &Known { weight_kg: Some(weight_kg), ..Known::default() });
        assert!((known.of(Quantity::Weight).value - weight_kg).abs() < 2.0);
        assert!(known.of(Quantity::Weight).sd < 1.01);
        for quantity in [Quantity::Chest, Quantity::Waist, Quantity::Hips] {
            assert!(known.of(quantity).value > blind.of(quantity).value, "{quantity:?}");
            assert!(known.of(quantity).sd < blind.of(quantity).sd, "{quantity:?}");
        }
        let [low, high] = known.of(Quantity::Chest).interval90;
        assert!(low < known.of(Quantity::Chest).value && known.of(Quantity::Chest).value < high);
        assert!((0.0..=1.0).contains(&known.male_probability));
    }
}
