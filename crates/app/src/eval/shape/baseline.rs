//! What can be said of a person's girths without a look at them.

use nalgebra::{Cholesky, DMatrix, DVector};

use crate::shape::Quantity;
use crate::shape::predict::sex_score;
use crate::synth::Truth;

/// Predictions from sex, from stature, from stature and weight.
pub struct Baselines {
    /// For each quantity and set of inputs, the weights of a line.
    lines: Vec<[DVector<f64>; 3]>,
}

/// What each baseline knows: a constant and the sex, the stature, stature and weight.
fn inputs(truth: &Truth) -> [Vec<f64>; 3] {
    [vec![1.0, sex_score(truth.sex)], vec![1.0, truth.stature_m], vec![1.0, truth.stature_m, truth.weight_kg]]
}

impl Baselines {
    /// Lines by least squares.
    pub fn learn<'a>(truths: impl Iterator<Item = &'a Truth>) -> Self {
        let truths: Vec<&Truth> = truths.collect();
        let fit = |quantity: Quantity, which: usize| {
            let rows: Vec<Vec<f64>> = truths.iter().map(|truth| inputs(truth)[which].clone()).collect();
            let design = DMatrix::from_fn(rows.len(), rows[0].len(), |row, column| rows[row][column]);
            let values = DVector::from_iterator(rows.len(), truths.iter().map(|truth| quantity.of(truth)));
            let normal = Cholesky::new(design.tr_mul(&design)).expect("people differ");
            normal.solve(&design.tr_mul(&values))
        };
        Self { lines: Quantity::ALL.map(|quantity| [0, 1, 2].map(|which| fit(quantity, which))).to_vec() }
    }

    /// The three predictions of a quantity.
    pub fn of(&self, quantity: Quantity, truth: &Truth) -> [f64; 3] {
        let inputs = inputs(truth);
        [0, 1, 2].map(|which| {
            let weights = &self.lines[quantity as usize][which];
            weights.iter().zip(&inputs[which]).map(|(weight, input)| weight * input).sum()
        })
    }
}
