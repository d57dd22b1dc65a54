//! Learns the predictor: first from bodies, then from fits to walks of some of them.
//!
//! What a fit does to coefficients depends on how a person walks, and there are few recorded walkers. So corrections are chosen,
//! and errors told, by what is predicted for the walks of a walker none of whose walks was learned from.

use std::collections::BTreeMap;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::fit::ShapeFit;
use super::predict::{Line, PredictorFile, Quantity, VERSION, sex_score};
use crate::synth::Truth;

/// A body: its coefficients and what is true of it.
pub struct KnownBody<'a> {
    /// `[n_shape]`.
    pub shape: Vec<f64>,
    /// What is true of it.
    pub truth: &'a Truth,
}

/// A fit and the truth.
#[derive(Clone)]
pub struct KnownFit<'a> {
    /// What was fitted.
    pub fit: ShapeFit,
    /// What is true.
    pub truth: &'a Truth,
    /// Whose recorded motion the person walks with.
    pub walker: String,
}

/// What a line predicts, from what is true.
type Target = Box<dyn Fn(&Truth) -> f64>;

/// Weights of the prior on corrections that are tried: the precision of a coefficient, in walks.
const RIDGES: [f64; 7] = [3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 1e5];
/// Factors on the variance of the fit that are tried.
const FIT_VARIANCES: [f64; 7] = [0.0, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0];
/// No error variance is taken to be less than this share of the mean square error.
const LEAST_VARIANCE_SHARE: f64 = 0.05;
/// Share of the errors inside the intervals.
const COVERAGE: f64 = 0.9;
const QUANTILE_95: f64 = 1.644_853_626_951_472;

/// Learns a predictor on the first `n_shape` coefficients.
///
/// # Panics
/// With fewer than ten walks or two walkers, or fewer bodies than coefficients.
pub fn learn(bodies: &[KnownBody<'_>], walks: &[KnownFit<'_>], n_shape: usize) -> PredictorFile {
    assert!(walks.len() >= 10 && bodies.len() > n_shape, "{} walks, {} bodies", walks.len(), bodies.len());
    let groups = walks_of_each(walks.iter().map(|walk| &walk.walker[..]));
    assert!(groups.len() >= 2, "all walks are of one walker");
    let quantities = Quantity::ALL.map(|quantity| {
        let of: Target = Box::new(move |truth| quantity.of(truth));
        (quantity.name().to_owned(), of)
    });
    let sex: Target = Box::new(|truth| sex_score(truth.sex));
    let body_design = design(bodies.iter().map(|body| &body.shape[..]), n_shape);
    let walk_design = design(walks.iter().map(|walk| &walk.fit.shape[..]), n_shape);
    let (mut lines, mut errors) = (Vec::new(), Vec::new());
    for (name, of) in quantities.into_iter().chain([("sex".to_owned(), sex)]) {
        let known = DVector::from_iterator(bodies.len(), bodies.iter().map(|body| of(body.truth)));
        let truths = DVector::from_iterator(walks.len(), walks.iter().map(|walk| of(walk.truth)));
        let plain = Ridge::new(&body_design, 1.0).weights(&known);
        let residuals = &truths - &walk_design * &plain;
        let fits = RIDGES.map(|weight| {
            let ridge = Ridge::new(&walk_design, weight);
            (ridge.weights(&residuals), ridge.left_out_errors(&residuals, &groups))
        });
        let best = fits.into_iter().min_by(|a, b| a.1.norm().total_cmp(&b.1.norm())).expect("there are some");
        let weights = plain + &best.0;
        let mut line = Line {
            name,
            intercept: weights[0],
            slopes: weights.as_slice()[1..].to_vec(),
            variance: 0.0,
            fit_variance: 0.0,
            interval_factor: 1.0,
        };
        set_variance(&mut line, walks, &best.1);
        errors.push(best.1.iter().zip(walks).map(|(e, walk)| e / line.sd(&walk.fit.covariance)).collect());
        lines.push(line);
    }
    let scores = |is_male: bool| -> Vec<f64> {
        let line = lines.last().expect("the sex is the last");
        let walks = walks.iter().zip(errors.last().expect("as many"));
        let of_sex = walks.filter(|(walk, _)| (sex_score(walk.truth.sex) > 0.0) == is_male);
        // The prediction of a walk that the line has not seen is the truth less the error.
        of_sex.map(|(walk, e)| sex_score(walk.truth.sex) - e * line.sd(&walk.fit.covariance)).collect()
    };
    let (women, men) = (scores(false), scores(true));
    let (female, male) = (mean(&women), mean(&men));
    let squares = women.iter().map(|s| (s - female).powi(2)).chain(men.iter().map(|s| (s - male).powi(2)));
    let spread = (squares.sum::<f64>() / (walks.len() - 2) as f64).sqrt();
    PredictorFile {
        version: VERSION,
        n_walks: walks.len(),
        correlation: correlation(&errors),
        lines,
        sex_scores: [female, male, spread],
        without: BTreeMap::new(),
    }
}

/// Rows of 1 and coefficients.
fn design<'a>(shapes: impl ExactSizeIterator<Item = &'a [f64]>, n_shape: usize) -> DMatrix<f64> {
    let rows = shapes.len();
    let values = shapes.flat_map(|shape| std::iter::once(1.0).chain(shape[..n_shape].iter().copied()));
    DMatrix::from_row_iterator(rows, n_shape + 1, values)
}

/// The places of each walker's walks.
fn walks_of_each<'a>(walkers: impl Iterator<Item = &'a str>) -> Vec<Vec<usize>> {
    let mut places: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for (place, walker) in walkers.enumerate() {
        places.entry(walker).or_default().push(place);
    }
    places.into_values().collect()
}

/// A ridge regression whose intercept is free.
struct Ridge<'a> {
    design: &'a DMatrix<f64>,
    factor: Cholesky<f64, Dyn>,
}

impl<'a> Ridge<'a> {
    fn new(design: &'a DMatrix<f64>, weight: f64) -> Self {
        let mut normal = design.tr_mul(design);
        for k in 1..design.ncols() {
            normal[(k, k)] += weight;
        }
        Self { design, factor: Cholesky::new(normal).expect("the ridge makes it positive definite") }
    }

    fn weights(&self, targets: &DVector<f64>) -> DVector<f64> {
        self.factor.solve(&self.design.tr_mul(targets))
    }

    /// Target less prediction for the rows of each group, by weights learned from the others: (I − H)⁻¹ times the residuals, where H
    /// is the group's block of the matrix that takes targets to predictions.
    fn left_out_errors(&self, targets: &DVector<f64>, groups: &[Vec<usize>]) -> DVector<f64> {
        let residuals = targets - self.design * self.weights(targets);
        let mut errors = residuals.clone();
        for rows in groups {
            let own = self.design.select_rows(rows);
            let unexplained =
                DMatrix::identity(rows.len(), rows.len()) - &own * self.factor.solve(&own.transpose());
            let left_out = unexplained.lu().solve(&residuals.select_rows(rows));
            let left_out = left_out.expect("the other rows determine the weights");
            rows.iter().zip(&left_out).for_each(|(&row, error)| errors[row] = *error);
        }
        errors
    }
}

/// Variance of the error as a constant and a share of what the fit says, by likelihood; then the width of the interval.
fn set_variance(line: &mut Line, walks: &[KnownFit<'_>], errors: &DVector<f64>) {
    let n = errors.len() as f64;
    let mean_square = errors.norm_squared() / n;
    let fit: Vec<f64> = walks.iter().map(|walk| line.variance_of(&walk.fit.covariance)).collect();
    let mean_fit = mean(&fit);
    let mut best = f64::NEG_INFINITY;
    for fit_variance in FIT_VARIANCES {
        let variance = (mean_square - fit_variance * mean_fit).max(LEAST_VARIANCE_SHARE * mean_square);
        let log_likelihood: f64 = errors
            .iter()
            .zip(&fit)
            .map(|(error, fit)| {
                let total = variance + fit_variance * fit;
                -0.5 * (error.powi(2) / total + total.ln())
            })
            .sum();
        if log_likelihood > best {
            best = log_likelihood;
            (line.variance, line.fit_variance) = (variance, fit_variance);
        }
    }
    let mut sizes: Vec<f64> =
        errors.iter().zip(walks).map(|(error, walk)| error.abs() / line.sd(&walk.fit.covariance)).collect();
    sizes.sort_by(f64::total_cmp);
    let place = ((COVERAGE * n).ceil() as usize).min(sizes.len() - 1);
    line.interval_factor = sizes[place] / QUANTILE_95;
}

fn correlation(errors: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    errors
        .iter()
        .map(|a| errors.iter().map(|b| product(a, b) / (product(a, a) * product(b, b)).sqrt()).collect())
        .collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use body::Sex;
    use pf_core::rng::{Draw, Purpose, particle_rng};

    const N: usize = 3;

    /// People whose girths follow their coefficients, and fits that shrink coefficients and err.
    fn people(count: u32, stream: u64) -> Vec<(Truth, Vec<f64>, ShapeFit)> {
        (0..count)
            .map(|person| {
                let mut rng =
                    particle_rng(Draw { seed: 9, frame: stream, layer: 0, purpose: Purpose::User }, person);
                let shape: Vec<f64> = (0..N).map(|_| rng.standard_normal()).collect();
                let sex = if shape[2] > 0.0 { Sex::Male } else { Sex::Female };
                let truth = Truth {
                    id: String::new(),
                    sex,
                    weight_kg: 75.0 + 12.0 * shape[1],
                    stature_m: 1.7 + 0.09 * shape[0],
                    chest_m: 1.0 + 0.05 * shape[1] + 0.01 * rng.standard_normal(),
                    waist_m: 0.9 + 0.08 * shape[1],
                    hips_m: 1.0 + 0.05 * shape[1],
                    right_thigh_m: 0.6 + 0.04 * shape[1],
                    right_calf_m: 0.38 + 0.02 * shape[1],
                };
                let sd = if rng.uniform() < 0.5 { 0.1 } else { 0.5 };
                let found = shape.iter().map(|c| 0.8 * c + 0.1 + sd * rng.standard_normal()).collect();
                let fit = ShapeFit {
                    mean: DVector::zeros(N + 1),
                    covariance: DMatrix::identity(N + 1, N + 1) * (sd * sd),
                    shape: found,
                    frames: Vec::new(),
                    misfit_px: Vec::new(),
                    lowest_m: Vec::new(),
                };
                (truth, shape, fit)
            })
            .collect()
    }

    #[test]
    fn errors_of_a_group_are_those_of_a_fit_without_it() {
        let people = people(12, 3);
        let design = design(people.iter().map(|(_, shape, _)| &shape[..]), N);
        let targets = DVector::from_iterator(12, people.iter().map(|(truth, ..)| truth.chest_m));
        let groups = walks_of_each(["b", "a", "a", "c", "b", "a", "c", "c", "b", "a", "b", "b"].into_iter());
        assert_eq!(groups, [vec![1, 2, 5, 9], vec![0, 4, 8, 10, 11], vec![3, 6, 7]]);
        let errors = Ridge::new(&design, 0.5).left_out_errors(&targets, &groups);
        for rows in &groups {
            let others: Vec<usize> = (0..12).filter(|row| !rows.contains(row)).collect();
            let rest = design.select_rows(&others);
            let weights = Ridge::new(&rest, 0.5).weights(&targets.select_rows(&others));
            for &row in rows {
                let expected = targets[row] - (design.row(row) * &weights)[0];
                assert!((errors[row] - expected).abs() < 1e-12, "row {row}: {} {expected}", errors[row]);
            }
        }
    }

    #[test]
    fn intervals_cover_new_people_and_the_bias_of_the_fit_goes() {
        let (known, walks, new) = (people(300, 0), people(150, 1), people(400, 2));
        let bodies: Vec<KnownBody<'_>> =
            known.iter().map(|(truth, shape, _)| KnownBody { shape: shape.clone(), truth }).collect();
        let fits: Vec<KnownFit<'_>> = walks
            .iter()
            .enumerate()
            .map(|(k, (truth, _, fit))| KnownFit { fit: fit.clone(), truth, walker: (k % 7).to_string() })
            .collect();
        let file = learn(&bodies, &fits, N);
        let predictor = super::super::Predictor::new(file.clone());
        for quantity in [Quantity::Waist, Quantity::Stature] {
            let (mut inside, mut bias) = (0, 0.0);
            for (truth, _, fit) in &new {
                let found = predictor.predict(fit, &Default::default());
                let [low, high] = found.of(quantity).interval90;
                inside += usize::from((low..=high).contains(&quantity.of(truth)));
                bias += (found.of(quantity).value - quantity.of(truth)) / new.len() as f64;
            }
            let share = inside as f64 / new.len() as f64;
            // Of 400 people, 0.90 ± 0.015; of the 150 walks, ± 0.025: three of both.
            assert!((0.81..0.99).contains(&share), "{quantity:?}: {share}");
            assert!(bias.abs() < 0.01, "{quantity:?}: {bias}");
        }
        assert_eq!(file.lines[0].name, "chest");
        assert!(
            file.lines.iter().any(|line| line.fit_variance > 0.0),
            "the fit's own variance says something here"
        );
        let told = new.iter().filter(|(truth, _, fit)| {
            (predictor.predict(fit, &Default::default()).male_probability > 0.5) == (truth.sex == Sex::Male)
        });
        assert!(told.count() > 320);
    }
}
