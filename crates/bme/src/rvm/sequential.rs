//! Fast sequential maximisation of the marginal likelihood: one basis is added, re-estimated or deleted a step.
//!
//! The letters are those of `[Tipping2003]`: `s` sparsity and `q` quality factor of a basis with itself left out,
//! `S` and `Q` the same with it in place, α its precision, Σ and μ the posterior of the weights.
//!
//! Deviation: precisions are counted in units of the noise precision β (α = β a), as in `[Ji2009]`. Then Σ/σ², s and q
//! do not depend on the noise, β = N/T with T = tᵀ(I + Φ A⁻¹ Φᵀ)⁻¹t maximises the evidence at any a, and each step
//! climbs the evidence *with the noise at its best*. The stationary points are those of `[Tipping2003]`, but no step
//! ever forces S and Q to be made anew (`tests::evidence_agrees_with_direct_linear_algebra`).

use super::RvmParams;
use crate::design::Products;
use crate::linalg::{Symmetric, add_scaled, combine};

/// Precisions stay above this fraction of φᵀφ: keeps the factorisation of Σ⁻¹ sound (condition below about 1e12).
const PRECISION_FLOOR: f64 = 1e-10;
/// A candidate whose sparsity factor is below this fraction of φᵀφ lies in the span of the model already.
const SPAN_FLOOR: f64 = 1e-9;

/// What is known of the noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Noise {
    /// Its variance is re-estimated at every step, from samples of this total weight.
    Estimated { total_weight: f64 },
    /// It has this precision; 1 where the sample weights are precisions already (a Laplace approximation).
    Known { precision: f64 },
}

/// A change of one basis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Action {
    Add { basis: usize, precision: f64 },
    Reestimate { at: usize, precision: f64 },
    Delete { at: usize },
}

/// The model that grows and shrinks.
pub(crate) struct Sequential<'a, P> {
    design: &'a P,
    noise: Noise,
    /// φ_mᵀ W t of all candidates.
    target_products: Vec<f64>,
    /// tᵀ W t, plus `floor`.
    energy: f64,
    /// What T cannot fall below but by rounding (see `RvmConfig::noise_floor`).
    floor: f64,
    /// The bases in the model, in the order of `mean`.
    active: Vec<usize>,
    /// a = α σ² of each active basis.
    precisions: Vec<f64>,
    /// Σ / σ².
    covariance: Symmetric,
    mean: Vec<f64>,
    /// S and Q of all candidates.
    sparsity: Vec<f64>,
    quality: Vec<f64>,
    /// T = tᵀ(W⁻¹ + Φ A⁻¹ Φᵀ)⁻¹t.
    remaining: f64,
    /// ln |A + ΦᵀWΦ| − ln |A|.
    log_determinant: f64,
}

/// s, q and T of a basis as if it were out of the model.
struct Factors {
    s: f64,
    q: f64,
    energy: f64,
}

impl<'a, P: Products> Sequential<'a, P> {
    /// An empty model of targets given by φᵀWt of all candidates and by tᵀWt.
    ///
    /// `floor` is twice the rate of a Gamma prior on the noise precision: T never falls below it.
    pub(crate) fn new(
        design: &'a P,
        noise: Noise,
        target_products: Vec<f64>,
        energy: f64,
        floor: f64,
    ) -> Self {
        Self {
            sparsity: design.squares().to_vec(),
            quality: target_products.clone(),
            remaining: energy + floor,
            design,
            noise,
            target_products,
            energy: energy + floor,
            floor,
            active: Vec::new(),
            precisions: Vec::new(),
            covariance: Symmetric::default(),
            mean: Vec::new(),
            log_determinant: 0.0,
        }
    }

    /// The same with bases in place from the start.
    pub(crate) fn with_bases(mut self, active: &[usize], precisions: &[f64]) -> Self {
        assert_eq!(active.len(), precisions.len(), "{} bases, {} precisions", active.len(), precisions.len());
        self.active = active.to_vec();
        self.precisions = precisions.to_vec();
        self.refresh();
        self
    }

    /// Changes what is known of the noise; nothing else depends on it.
    pub(crate) fn set_noise(&mut self, noise: Noise) {
        self.noise = noise;
        self.remaining = self.above_floor(self.remaining);
    }

    pub(crate) fn active(&self) -> &[usize] {
        &self.active
    }

    pub(crate) fn precisions(&self) -> &[f64] {
        &self.precisions
    }

    pub(crate) fn mean(&self) -> &[f64] {
        &self.mean
    }

    pub(crate) fn covariance(&self) -> &Symmetric {
        &self.covariance
    }

    /// The most likely noise variance at the present precisions: T / N.
    pub(crate) fn noise_variance(&self) -> f64 {
        match self.noise {
            Noise::Estimated { total_weight } => self.remaining / total_weight,
            Noise::Known { precision } => 1.0 / precision,
        }
    }

    /// ln p(t), up to what the sample weights alone add.
    pub(crate) fn log_evidence(&self) -> f64 {
        -0.5 * match self.noise {
            Noise::Estimated { total_weight: n } => {
                n * ((2.0 * std::f64::consts::PI * self.noise_variance()).ln() + 1.0) + self.log_determinant
            }
            Noise::Known { precision } => precision * self.remaining + self.log_determinant,
        }
    }

    /// The step that raises the evidence most, and by how much; `None` when no step does.
    pub(crate) fn best_action(&self, params: &RvmParams) -> Option<(Action, f64)> {
        let mut best: Option<(Action, f64)> = None;
        let mut offer = |action, gain: f64| {
            if gain > best.map_or(0.0, |(_, g)| g) {
                best = Some((action, gain));
            }
        };
        for at in 0..self.active.len() {
            let without = self.factors_without(at);
            let present = self.gain(&without, self.precisions[at]);
            match self.best_precision(&without, self.precision_floor(self.active[at])) {
                Some(precision) => {
                    offer(Action::Reestimate { at, precision }, self.gain(&without, precision) - present);
                }
                None => offer(Action::Delete { at }, -present),
            }
        }
        if self.active.len() < params.max_bases {
            let mut is_active = vec![false; self.sparsity.len()];
            self.active.iter().for_each(|&basis| is_active[basis] = true);
            for (basis, _) in is_active.iter().enumerate().filter(|&(_, &active)| !active) {
                let without =
                    Factors { s: self.sparsity[basis], q: self.quality[basis], energy: self.remaining };
                if without.s <= SPAN_FLOOR * self.design.squares()[basis] {
                    continue;
                }
                if let Some(precision) = self.best_precision(&without, self.precision_floor(basis)) {
                    let gain = self.gain(&without, precision);
                    if gain >= params.min_gain_of_addition {
                        offer(Action::Add { basis, precision }, gain);
                    }
                }
            }
        }
        best
    }

    /// Does the step by rank-one updates: O(candidates × active bases).
    pub(crate) fn apply(&mut self, action: Action) {
        match action {
            Action::Add { basis, precision } => self.add(basis, precision),
            Action::Reestimate { at, precision } => self.reestimate(at, precision),
            Action::Delete { at } => self.delete(at),
        }
    }

    /// Makes Σ, μ, S, Q and T anew from the precisions, which takes away the rounding of the rank-one updates.
    ///
    /// # Panics
    /// When samples are so large that their squares are not finite, which the callers refuse.
    pub(crate) fn refresh(&mut self) {
        let columns: Vec<&[f64]> = self.active.iter().map(|&basis| self.design.product(basis)).collect();
        let factor = loop {
            let information = Symmetric::from_fn(self.active.len(), |i, j| {
                columns[i][self.active[j]] + if i == j { self.precisions[i] } else { 0.0 }
            });
            if let Some(factor) = information.cholesky() {
                break factor;
            }
            // Only where rounding hides the positive eigenvalues: a stronger prior brings them back.
            self.precisions.iter_mut().for_each(|a| *a *= 10.0);
            assert!(self.precisions.iter().all(|a| a.is_finite()), "products of samples are not finite");
        };
        self.covariance = factor.inverse();
        self.log_determinant = factor.log_determinant() - self.precisions.iter().map(|a| a.ln()).sum::<f64>();
        let products: Vec<f64> = self.active.iter().map(|&basis| self.target_products[basis]).collect();
        self.mean = factor.solve(&products);
        let explained: f64 = products.iter().zip(&self.mean).map(|(p, m)| p * m).sum();
        self.remaining = self.above_floor(self.energy - explained);
        combine(&columns, &self.mean, &mut self.quality);
        for (quality, product) in self.quality.iter_mut().zip(&self.target_products) {
            *quality = product - *quality;
        }
        factor.whitened_squares(&columns, &mut self.sparsity);
        for (sparsity, square) in self.sparsity.iter_mut().zip(self.design.squares()) {
            *sparsity = square - *sparsity;
        }
    }

    /// T as it was summed up, without what rounding took too much; a known noise needs no T above zero.
    fn above_floor(&self, remaining: f64) -> f64 {
        match self.noise {
            Noise::Estimated { .. } => remaining.max(self.floor),
            Noise::Known { .. } => remaining,
        }
    }

    fn precision_floor(&self, basis: usize) -> f64 {
        PRECISION_FLOOR * self.design.squares()[basis]
    }

    /// `[Tipping2003]` eq. (23), and T with the basis taken out.
    ///
    /// From Σ and μ: with a − S = a² Σ_ii and Q = a μ_i, the quotients keep their digits where S is near a.
    fn factors_without(&self, at: usize) -> Factors {
        let (a, mean, variance) = (self.precisions[at], self.mean[at], self.covariance.diagonal(at));
        Factors {
            s: (1.0 / variance - a).max(0.0),
            q: mean / variance,
            energy: self.remaining + mean * mean / variance,
        }
    }

    /// The precision at which the evidence is highest, or `None` when that is at infinity.
    ///
    /// Known noise: `[Tipping2003]` eq. (20), a = s²/(q² − s). Noise at its best: dL/da = 0 of
    /// L(a) = ½ ln a/(a+s) − N/2 ln(1 − q²/((a+s)T)) gives a = s (sT − q²)/(N q² − sT), the form of `[Ji2009]`.
    fn best_precision(&self, without: &Factors, floor: f64) -> Option<f64> {
        let &Factors { s, q, energy } = without;
        let precision = match self.noise {
            Noise::Estimated { total_weight: n } => {
                let denominator = n * q * q - s * energy;
                (denominator > 0.0).then(|| s * (s * energy - q * q) / denominator)
            }
            Noise::Known { precision } => {
                let denominator = precision * q * q - s;
                (denominator > 0.0).then(|| s * s / denominator)
            }
        };
        precision.map(|a| a.max(floor))
    }

    /// How much more evidence there is with the basis at precision `a` than without it.
    fn gain(&self, without: &Factors, a: f64) -> f64 {
        let &Factors { s, q, energy } = without;
        let explained = q * q / (a + s);
        let size = 0.5 * (a / (a + s)).ln();
        match self.noise {
            Noise::Estimated { total_weight } => size - 0.5 * total_weight * (-explained / energy).ln_1p(),
            Noise::Known { precision } => size + 0.5 * precision * explained,
        }
    }

    fn add(&mut self, basis: usize, a: f64) {
        let design = self.design;
        let product = design.product(basis);
        let columns: Vec<&[f64]> = self.active.iter().map(|&m| design.product(m)).collect();
        let inner: Vec<f64> = self.active.iter().map(|&m| product[m]).collect();
        // e_m = φ_mᵀ C⁻¹ φ_basis of all candidates m.
        let weights = self.covariance.times(&inner);
        let mut e = vec![0.0; product.len()];
        combine(&columns, &weights, &mut e);
        e.iter_mut().zip(product).for_each(|(e, p)| *e = p - *e);

        let (s, q) = (self.sparsity[basis], self.quality[basis]);
        let variance = 1.0 / (a + s);
        let mean = variance * q;
        self.remaining = self.above_floor(self.remaining - q * mean);
        self.log_determinant += ((a + s) / a).ln();
        self.covariance.add_outer(variance, &weights);
        let off_diagonal: Vec<f64> = weights.iter().map(|w| -variance * w).collect();
        self.covariance.push(&off_diagonal, variance);
        add_scaled(&mut self.mean, -mean, &weights);
        self.mean.push(mean);
        self.active.push(basis);
        self.precisions.push(a);
        self.spread(&e, -variance, -mean);
    }

    fn reestimate(&mut self, at: usize, a: f64) {
        let change = a - self.precisions[at];
        let variance = self.covariance.diagonal(at);
        let without = self.factors_without(at);
        let kappa = change / (1.0 + change * variance);
        self.log_determinant +=
            ((a + without.s) / a).ln() - ((self.precisions[at] + without.s) / self.precisions[at]).ln();
        self.remaining = self.above_floor(without.energy - without.q * without.q / (a + without.s));
        self.precisions[at] = a;
        self.pull_out(at, kappa);
    }

    fn delete(&mut self, at: usize) {
        let variance = self.covariance.diagonal(at);
        let without = self.factors_without(at);
        let a = self.precisions[at];
        self.log_determinant -= ((a + without.s) / a).ln();
        self.remaining = without.energy;
        self.pull_out(at, 1.0 / variance);
        self.active.remove(at);
        self.precisions.remove(at);
        self.mean.remove(at);
        self.covariance.remove(at);
    }

    /// Σ −= κ Σ_at Σ_atᵀ and what follows for μ, S and Q.
    fn pull_out(&mut self, at: usize, kappa: f64) {
        let column = self.covariance.row(at).to_vec();
        let mean = self.mean[at];
        let columns: Vec<&[f64]> = self.active.iter().map(|&m| self.design.product(m)).collect();
        let mut e = vec![0.0; self.sparsity.len()];
        combine(&columns, &column, &mut e);
        self.covariance.add_outer(-kappa, &column);
        add_scaled(&mut self.mean, -kappa * mean, &column);
        self.spread(&e, kappa, kappa * mean);
    }

    /// S += `per_square` e², Q += `per_unit` e.
    fn spread(&mut self, e: &[f64], per_square: f64, per_unit: f64) {
        for ((s, q), e) in self.sparsity.iter_mut().zip(&mut self.quality).zip(e) {
            *s += per_square * e * e;
            *q += per_unit * e;
        }
    }
}

#[cfg(test)]
mod tests;
