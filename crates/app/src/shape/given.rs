//! The shape of a clip, given what else is known of the person.

use body::{Body, BodyModel};
use nalgebra::{DMatrix, DVector};

use super::fit::ShapeFit;

/// Steps of the update.
const STEPS: usize = 3;
/// Step of the difference quotients, standard deviations.
const DIFFERENCE_SD: f64 = 0.05;

/// A length that a body has, as told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Told {
    /// Metres.
    pub length_m: f64,
    /// Standard deviation of what is told, metres.
    pub sd_m: f64,
}

impl ShapeFit {
    /// The most probable shape coefficients when `lengths_of` the body are `told`: the fit to the outlines is the prior of an
    /// iterated Kalman update `[Bell1993]`.
    ///
    /// # Panics
    /// When `lengths_of` gives another number of lengths than are told.
    pub fn given(
        &self,
        model: &BodyModel,
        told: &[Told],
        lengths_of: impl Fn(&Body) -> Vec<f64>,
    ) -> Vec<f64> {
        let n_shape = self.shape.len();
        let of = |shape: &DVector<f64>| DVector::from_vec(lengths_of(&model.shape(shape.as_slice())));
        let target = DVector::from_iterator(told.len(), told.iter().map(|told| told.length_m));
        let variances = told.iter().map(|told| told.sd_m.powi(2));
        let noise = DMatrix::from_diagonal(&DVector::from_iterator(told.len(), variances));
        let mean = self.mean.rows(0, n_shape).into_owned();
        let covariance = self.covariance.view((0, 0), (n_shape, n_shape)).into_owned();
        let mut shape = mean.clone();
        for _ in 0..STEPS {
            let at = of(&shape);
            let mut jacobian = DMatrix::zeros(told.len(), n_shape);
            for k in 0..n_shape {
                let mut moved = shape.clone();
                moved[k] += DIFFERENCE_SD;
                jacobian.set_column(k, &((of(&moved) - &at) / DIFFERENCE_SD));
            }
            let innovation_covariance = &jacobian * &covariance * jacobian.transpose() + &noise;
            let inverse = innovation_covariance.try_inverse().expect("the noise makes it positive definite");
            let innovation = &target - at + &jacobian * (&shape - &mean);
            shape = &mean + &covariance * jacobian.transpose() * inverse * innovation;
        }
        shape.as_slice().to_vec()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_told_stature_moves_the_shape_to_it_and_a_vague_one_does_not() {
        let model = BodyModel::builtin();
        let fit = ShapeFit {
            shape: vec![0.0; 6],
            mean: DVector::zeros(7),
            covariance: DMatrix::identity(7, 7),
            frames: Vec::new(),
            misfit_px: Vec::new(),
            lowest_m: Vec::new(),
        };
        let stature = |shape: &[f64]| model.shape(shape).stature_m();
        let tall = stature(&fit.shape) + 0.08;
        let told = |sd_m: f64| {
            let told = [Told { length_m: tall, sd_m }];
            stature(&fit.given(&model, &told, |body| vec![body.stature_m()]))
        };
        assert!((told(1e-4) - tall).abs() < 1e-3, "{} m", told(1e-4));
        assert!((told(10.0) - stature(&fit.shape)).abs() < 1e-3);
    }
}
