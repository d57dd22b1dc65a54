//! Stature, weight and gender of a person from the shape or the girths of a body, by relevance vector machines.

use bme::file::ModelFileError;
use bme::{
    Design, Expert, FitError, Gate, Gaussian, Inputs, Kernel, Rvm, RvmClassifier, RvmParams, Split, choose,
    kernels_by_spread,
};
use body::Sex;
use nalgebra::{DMatrix, DVector};

pub mod file;
#[cfg(test)]
mod tests;

/// Half the width of an interval that holds 90 % of a normal distribution, in standard deviations.
const HALF_WIDTH_90: f64 = 1.644_853_626_951_472_7;
/// Bases are centred on so many of the samples, evenly taken, at most.
const MOST_CENTRES: usize = 400;
/// Inverse widths that are tried, in units of one over the mean squared distance of the samples.
const WIDTH_FACTORS: [f64; 4] = [0.05, 0.2, 0.8, 3.0];
/// Share of the samples that judges the widths.
const JUDGING_SHARE: f64 = 0.2;
const SPLIT_SEED: u64 = 1;
/// Weight of the ridge against the mean square of a scaled feature.
const RIDGE: f64 = 1e-3;

static BUILTIN: &[u8] = include_bytes!("../assets/umbra-biosig.bin");

/// A person whose stature, weight and sex are known, and the numbers to tell them from.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// Shape coefficients or girths.
    pub features: Vec<f64>,
    /// Metres.
    pub stature_m: f64,
    /// Kilograms.
    pub weight_kg: f64,
    /// Sex.
    pub sex: Sex,
}

/// A number and how sure it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The middle of the distribution.
    pub value: f64,
    /// Standard deviation; of a logarithm, times the value.
    pub sd: f64,
    /// From its 5 % to its 95 % point.
    pub interval90: [f64; 2],
}

/// What a predictor says of a person.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Profile {
    /// Metres.
    pub stature_m: Estimate,
    /// Kilograms.
    pub weight_kg: Estimate,
    /// Probability that the person is a woman.
    pub female: f64,
}

/// Predicts stature, weight and gender from a fixed list of numbers.
///
/// The numbers are first brought down to three scores, the linear least-squares predictions of stature, log weight and gender;
/// the machines work on these. In dozens of dimensions all people are about equally far from each other, and a
/// Gaussian kernel tells them apart by everything that does not matter.
#[derive(Clone, Debug, PartialEq)]
pub struct Predictor {
    scaling: Scaling,
    /// Each of unit spread over the samples, `[3]` of `[n_features]`.
    directions: [Vec<f64>; 3],
    stature: Regression,
    log_weight: Regression,
    gender: RvmClassifier,
}

/// A line along one score, and a machine for what the line leaves over: far from all samples, where every kernel is zero, the
/// line is what remains.
#[derive(Clone, Debug, PartialEq)]
struct Regression {
    /// Which score.
    score: usize,
    mean: f64,
    slope: f64,
    rest: Rvm,
}

/// Brings every feature to mean 0 and standard deviation 1.
#[derive(Clone, Debug, PartialEq)]
struct Scaling {
    means: Vec<f64>,
    sds: Vec<f64>,
}

/// Why no predictor could be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TrainError {
    /// Not enough people.
    #[error("{found} samples, expected 20 or more with women and men among them")]
    TooFewSamples {
        /// How many there are.
        found: usize,
    },
    /// A number that is not finite, or a weight or stature that is not positive.
    #[error("sample {sample} has a number that is not finite or a weight that is not positive")]
    BadSample {
        /// Which.
        sample: usize,
    },
    /// Samples that differ in nothing.
    #[error("feature {feature} is the same in all samples")]
    NoSpread {
        /// Which.
        feature: usize,
    },
    /// The machine could not be fitted.
    #[error("cannot fit `{target}`")]
    Fit {
        /// What was to be predicted.
        target: &'static str,
        /// Why not.
        source: FitError,
    },
}

impl Predictor {
    /// Fits to people. The width of each machine's kernel is that which predicts a held-out fifth of them best.
    ///
    /// # Errors
    /// When there are too few people, only women or men, or a number makes no sense.
    ///
    /// # Panics
    /// When the samples have features of different numbers.
    pub fn fit(samples: &[Sample]) -> Result<Self, TrainError> {
        let n_women = samples.iter().filter(|sample| sample.sex == Sex::Female).count();
        if samples.len() < 20 || n_women == 0 || n_women == samples.len() {
            return Err(TrainError::TooFewSamples { found: samples.len() });
        }
        let is_bad = |sample: &Sample| {
            let positive = sample.weight_kg > 0.0 && sample.stature_m > 0.0;
            let numbers = sample.features.iter().chain([&sample.weight_kg, &sample.stature_m]);
            !positive || numbers.into_iter().any(|x| !x.is_finite())
        };
        if let Some(sample) = samples.iter().position(is_bad) {
            return Err(TrainError::BadSample { sample });
        }
        let scaling = Scaling::of(samples)?;
        let column = |value: &dyn Fn(&Sample) -> f64| samples.iter().map(value).collect::<Vec<f64>>();
        let stature = column(&|sample| sample.stature_m);
        let log_weight = column(&|sample| sample.weight_kg.ln());
        let female = column(&|sample| f64::from(u8::from(sample.sex == Sex::Female)));
        let rows: Vec<Vec<f64>> = samples.iter().map(|sample| scaling.apply(&sample.features)).collect();
        let directions = directions(&rows, [&stature, &log_weight, &female]);
        let scores = rows.iter().flat_map(|row| scores(&directions, row));
        let inputs = Inputs::from_rows(directions.len(), scores).expect("scaled features are finite");
        let fit = |target| move |source| TrainError::Fit { target, source };
        Ok(Self {
            stature: Regression::fit(&inputs, 0, &stature).map_err(fit("stature"))?,
            log_weight: Regression::fit(&inputs, 1, &log_weight).map_err(fit("weight"))?,
            gender: fit_classification(&inputs, &female).map_err(fit("gender"))?,
            directions,
            scaling,
        })
    }

    /// Number of features.
    pub fn n_features(&self) -> usize {
        self.scaling.means.len()
    }

    /// What the features tell.
    ///
    /// # Panics
    /// When their number is not [`Predictor::n_features`].
    pub fn predict(&self, features: &[f64]) -> Profile {
        let x = scores(&self.directions, &self.scaling.apply(features));
        let mut log_gates = [0.0; 2];
        self.gender.log_gates(&x, &mut log_gates);
        let log_weight = self.log_weight.predict(&x);
        Profile {
            stature_m: self.stature.predict(&x),
            weight_kg: Estimate {
                value: log_weight.value.exp(),
                sd: log_weight.sd * log_weight.value.exp(),
                interval90: log_weight.interval90.map(f64::exp),
            },
            female: log_gates[0].exp(),
        }
    }

    /// Bases of the three machines: stature, weight, gender.
    pub fn n_bases(&self) -> [usize; 3] {
        [self.stature.rest.n_bases(), self.log_weight.rest.n_bases(), self.gender.n_bases()]
    }
}

impl Scaling {
    fn of(samples: &[Sample]) -> Result<Self, TrainError> {
        let (n, dim) = (samples.len() as f64, samples[0].features.len());
        let mut means = vec![0.0; dim];
        let mut sds = vec![0.0; dim];
        for sample in samples {
            assert_eq!(sample.features.len(), dim, "{} features, expected {dim}", sample.features.len());
            means.iter_mut().zip(&sample.features).for_each(|(mean, x)| *mean += x / n);
        }
        for sample in samples {
            let away = sample.features.iter().zip(&means).map(|(x, mean)| (x - mean).powi(2) / n);
            sds.iter_mut().zip(away).for_each(|(sd, square)| *sd += square);
        }
        sds.iter_mut().for_each(|sd| *sd = sd.sqrt());
        // Rounding leaves equal features a trace of spread.
        let is_flat = |(sd, mean): (&f64, &f64)| *sd <= 1e-9 * (1.0 + mean.abs());
        match sds.iter().zip(&means).position(is_flat) {
            Some(feature) => Err(TrainError::NoSpread { feature }),
            None => Ok(Self { means, sds }),
        }
    }

    fn apply(&self, features: &[f64]) -> Vec<f64> {
        let (given, expected) = (features.len(), self.means.len());
        assert_eq!(given, expected, "{given} features, expected {expected}");
        features.iter().zip(&self.means).zip(&self.sds).map(|((x, mean), sd)| (x - mean) / sd).collect()
    }
}

/// The directions of the rows along which each target changes, by linear regression with a trace of ridge; of unit spread.
fn directions(rows: &[Vec<f64>], targets: [&[f64]; 3]) -> [Vec<f64>; 3] {
    let (n, dim) = (rows.len(), rows[0].len());
    let x = DMatrix::from_fn(n, dim, |row, feature| rows[row][feature]);
    let ridge = DMatrix::from_diagonal_element(dim, dim, RIDGE * n as f64);
    let normal = (x.tr_mul(&x) + ridge).cholesky().expect("the ridge makes it positive definite");
    targets.map(|target| {
        // The rows have mean zero, so the target's mean drops out.
        let direction = normal.solve(&x.tr_mul(&DVector::from_column_slice(target)));
        let spread = (&x * &direction).norm() / (n as f64).sqrt();
        (direction / spread.max(f64::MIN_POSITIVE)).iter().copied().collect()
    })
}

fn scores(directions: &[Vec<f64>; 3], row: &[f64]) -> [f64; 3] {
    let along = |direction: &Vec<f64>| direction.iter().zip(row).map(|(d, x)| d * x).sum();
    [along(&directions[0]), along(&directions[1]), along(&directions[2])]
}

impl Regression {
    fn fit(inputs: &Inputs, score: usize, target: &[f64]) -> Result<Self, FitError> {
        let n = target.len() as f64;
        let along: Vec<f64> = (0..inputs.len()).map(|row| f64::from(inputs.row(row)[score])).collect();
        let mean = target.iter().sum::<f64>() / n;
        // The scores have mean zero.
        let slope = along.iter().zip(target).map(|(x, y)| x * (y - mean)).sum::<f64>()
            / along.iter().map(|x| x * x).sum::<f64>();
        let rest: Vec<f64> = along.iter().zip(target).map(|(x, y)| y - mean - slope * x).collect();
        Ok(Self { score, mean, slope, rest: fit_regression(inputs, &rest)? })
    }

    fn predict(&self, x: &[f64]) -> Estimate {
        let mut rest = Gaussian::default();
        self.rest.predict(x, &mut rest);
        let value = self.mean + self.slope * x[self.score] + rest.mean[0];
        let sd = rest.variance[0].sqrt();
        Estimate { value, sd, interval90: [value - HALF_WIDTH_90 * sd, value + HALF_WIDTH_90 * sd] }
    }
}

/// A design on `rows` of the inputs, with bases centred on some of them.
fn design(kernel: &Kernel, inputs: &Inputs, rows: &[usize]) -> Design {
    let every = rows.len().div_ceil(MOST_CENTRES);
    let centres: Vec<usize> = rows.iter().copied().step_by(every).collect();
    Design::with_centres(kernel.clone(), inputs.select(rows), inputs.select(&centres))
}

fn split(inputs: &Inputs) -> Split {
    Split::new(inputs.len(), JUDGING_SHARE, 1, SPLIT_SEED)
}

fn pick(values: &[f64], rows: &[usize]) -> Vec<f64> {
    rows.iter().map(|&row| values[row]).collect()
}

fn fit_regression(inputs: &Inputs, target: &[f64]) -> Result<Rvm, FitError> {
    let fit = |kernel: &Kernel, rows: &[usize]| {
        let design = design(kernel, inputs, rows);
        Rvm::fit(&design, &[pick(target, rows)], &vec![1.0; rows.len()], &RvmParams::default())
    };
    let Split { train, held_out } = split(inputs);
    let kernels = kernels_by_spread(inputs, &WIDTH_FACTORS);
    let (best, _) = choose(&kernels, |kernel| {
        let machine = fit(kernel, &train)?;
        let square = |&row: &usize| (machine.mean(&inputs.row_f64(row))[0] - target[row]).powi(2);
        Ok(-held_out.iter().map(square).sum::<f64>())
    })?;
    fit(&kernels[best], &(0..inputs.len()).collect::<Vec<_>>())
}

fn fit_classification(inputs: &Inputs, is_first: &[f64]) -> Result<RvmClassifier, FitError> {
    let fit = |kernel: &Kernel, rows: &[usize]| {
        let first = pick(is_first, rows);
        let second = first.iter().map(|x| 1.0 - x).collect();
        RvmClassifier::fit(&design(kernel, inputs, rows), &[first, second], &RvmParams::default())
    };
    let Split { train, held_out } = split(inputs);
    let kernels = kernels_by_spread(inputs, &WIDTH_FACTORS);
    let (best, _) = choose(&kernels, |kernel| {
        let machine = fit(kernel, &train)?;
        let log_probability = |&row: &usize| {
            let mut log_gates = [0.0; 2];
            machine.log_gates(&inputs.row_f64(row), &mut log_gates);
            if is_first[row] > 0.5 { log_gates[0] } else { log_gates[1] }
        };
        Ok(held_out.iter().map(log_probability).sum::<f64>())
    })?;
    fit(&kernels[best], &(0..inputs.len()).collect::<Vec<_>>())
}

/// Shape coefficients that the shape predictor looks at: the first ones.
pub const N_SHAPE_FEATURES: usize = 30;

/// The predictors that come with this crate.
#[derive(Clone, Debug, PartialEq)]
pub struct Predictors {
    /// From the first [`N_SHAPE_FEATURES`] coefficients of the built-in body model.
    pub shape: Predictor,
    /// From the girths of chest, waist, hips, right thigh and right calf, metres.
    pub girths: Predictor,
    /// From these and the stature, metres; its own stature is of no use.
    pub girths_and_stature: Predictor,
}

/// Why bytes are no predictors.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LoadPredictorsError {
    /// Another kind or version of file, cut short, or damaged.
    #[error(transparent)]
    Container(#[from] body::container::ContainerError),
    /// The checksum fits but the data do not decode.
    #[error("cannot decode the data")]
    Decode(#[source] postcard::Error),
    /// A machine that does not fit its file.
    #[error("`{machine}` cannot be used")]
    Machine {
        /// Which.
        machine: &'static str,
        /// Why not.
        source: ModelFileError,
    },
    /// A machine of another number of scores.
    #[error("a machine of `{predictor}` takes {found} scores, expected 3")]
    Scores {
        /// Which.
        predictor: &'static str,
        /// Scores it takes.
        found: usize,
    },
    /// A predictor of other features.
    #[error("`{predictor}` takes {found} features, expected {expected}")]
    Features {
        /// Which.
        predictor: &'static str,
        /// Features it takes.
        found: usize,
        /// Features there are.
        expected: usize,
    },
}

impl Predictors {
    /// The predictors in the program.
    ///
    /// ```
    /// let model = body::BodyModel::builtin();
    /// let man = model.coefficients_for_stature(1.84, Some(body::Sex::Male));
    /// let profile = biosig::Predictors::builtin().from_shape(&man);
    /// assert!(profile.female < 0.1 && (profile.stature_m.value - 1.84).abs() < 0.02);
    /// ```
    pub fn builtin() -> Self {
        Self::from_bytes(BUILTIN).expect("the file in the program is tested")
    }

    /// What the shape coefficients (standard deviations, [`N_SHAPE_FEATURES`] or more) tell.
    ///
    /// # Panics
    /// When there are fewer.
    pub fn from_shape(&self, coefficients_sd: &[f64]) -> Profile {
        self.shape.predict(&coefficients_sd[..N_SHAPE_FEATURES])
    }

    /// What girths tell, with the stature where it is known, metres.
    pub fn from_girths(&self, girths: &FiveGirths, stature_m: Option<f64>) -> Profile {
        let mut features = girths.features().to_vec();
        match stature_m {
            None => self.girths.predict(&features),
            Some(stature_m) => {
                features.push(stature_m);
                self.girths_and_stature.predict(&features)
            }
        }
    }
}

/// The girths that tell weight and gender, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FiveGirths {
    /// At the bust points.
    pub chest_m: f64,
    /// At the navel.
    pub waist_m: f64,
    /// At the rearmost point of the buttocks.
    pub hips_m: f64,
    /// Below the crotch.
    pub right_thigh_m: f64,
    /// The largest.
    pub right_calf_m: f64,
}

impl FiveGirths {
    /// In the order of [`Predictors::girths`].
    pub fn features(&self) -> [f64; 5] {
        [self.chest_m, self.waist_m, self.hips_m, self.right_thigh_m, self.right_calf_m]
    }
}

impl From<&crate::Measurements> for FiveGirths {
    fn from(measured: &crate::Measurements) -> Self {
        use crate::Girth;
        Self {
            chest_m: measured.girth_m(Girth::Chest),
            waist_m: measured.girth_m(Girth::Waist),
            hips_m: measured.girth_m(Girth::Hips),
            right_thigh_m: measured.girth_m(Girth::RightThigh),
            right_calf_m: measured.girth_m(Girth::RightCalf),
        }
    }
}
