//! Relevance vector regression of any number of outputs.

use rayon::prelude::*;

use super::sequential::{Noise, Sequential};
use super::{FitError, Memory, Remembered, RvmParams, SparseFunction, check_samples, used_centres};
use crate::design::{Products, WeightedDesign};
use crate::linalg::{add_scaled, dot};
use crate::{Design, Expert, Gaussian, Inputs, Kernel};

/// y_d = Σ_m w_dm φ_m(x) + noise of variance σ²_d, with few bases.
///
/// Each output picks bases of its own (the cheapest for outputs that vary on other scales); kernels that several
/// outputs picked are stored and evaluated once.
///
/// ```
/// use bme::{Design, Expert, Gaussian, Inputs, Kernel, Rvm, RvmParams};
/// let x: Vec<f64> = (0..100).map(|i| f64::from(i) * 0.2 - 10.0).collect();
/// let y: Vec<f64> = x.iter().map(|x| if *x == 0.0 { 1.0 } else { x.sin() / x }).collect();
/// let design = Design::new(Kernel::gaussian(1, 0.25)?, Inputs::from_rows(1, x)?);
/// let model = Rvm::fit(&design, &[y], &[1.0; 100], &RvmParams::default())?;
/// let mut prediction = Gaussian::default();
/// model.predict(&[1.1], &mut prediction);
/// assert!((prediction.mean[0] - 1.1_f64.sin() / 1.1).abs() < 0.01);
/// assert!(model.n_bases() < 20);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Rvm {
    pub(crate) kernel: Kernel,
    pub(crate) centres: Inputs,
    pub(crate) outputs: Vec<SparseFunction>,
    pub(crate) memory: Memory,
}

impl Rvm {
    /// Fits one function an output to samples of weight 0 and above (responsibilities).
    ///
    /// `targets[d][i]` is output d of sample i. A sample of weight w counts as w samples.
    ///
    /// # Errors
    /// When a target is not finite, a weight is negative or not finite, or the weights sum to nothing.
    ///
    /// # Panics
    /// When a length is not the number of samples.
    pub fn fit(
        design: &Design,
        targets: &[Vec<f64>],
        weights: &[f64],
        params: &RvmParams,
    ) -> Result<Self, FitError> {
        for target in targets {
            check_samples(design, target, weights)?;
        }
        let weighted = WeightedDesign::new(design, weights.to_vec());
        let fits: Vec<SparseFit> =
            targets.par_iter().map(|target| fit_output(&weighted, target, params, None)).collect();
        Ok(Self::from_fits(design, &fits, weights))
    }

    /// Collects the bases of all outputs into one table of centres.
    pub(crate) fn from_fits(design: &Design, fits: &[SparseFit], weights: &[f64]) -> Self {
        let (used, centres) = used_centres(design, fits.iter().flat_map(|fit| fit.active.iter().copied()));
        let slot = |basis: usize| used.binary_search(&basis).unwrap_or(used.len());
        let outputs = fits
            .iter()
            .map(|fit| SparseFunction {
                bases: fit.active.iter().map(|&basis| slot(basis)).collect(),
                ..fit.function.clone()
            })
            .collect();
        let samples: Vec<Vec<Remembered>> = fits
            .iter()
            .map(|fit| {
                let parts = weights.iter().zip(fit.fitted(design));
                parts.map(|(&w, f)| Remembered { precision: w, weighted_target: w * f }).collect()
            })
            .collect();
        let memory = Memory::of_fit(design, &samples);
        Self { kernel: design.kernel().clone(), centres, outputs, memory }
    }

    /// Distinct kernels of all outputs.
    pub fn n_centres(&self) -> usize {
        self.centres.len()
    }

    /// Bases of all outputs together, biases included.
    pub fn n_bases(&self) -> usize {
        self.outputs.iter().map(|output| output.bases.len()).sum()
    }

    /// Log evidence of each output's training targets.
    pub fn log_evidence(&self) -> Vec<f64> {
        self.outputs.iter().map(|output| output.log_evidence).collect()
    }

    /// Noise variance of each output, squared units of the output.
    pub fn noise_variance(&self) -> Vec<f64> {
        self.outputs.iter().map(|output| output.noise_variance).collect()
    }

    /// The kernel of all bases.
    pub fn kernel(&self) -> &Kernel {
        &self.kernel
    }

    /// The mean outputs at `x`, without the work that variances take.
    ///
    /// # Panics
    /// When `x` has the wrong length.
    pub fn mean(&self, x: &[f64]) -> Vec<f64> {
        let features = self.features(x);
        self.outputs.iter().map(|output| output.mean_at(&features)).collect()
    }

    /// The mean outputs at `x` and their derivatives, `[n_outputs][n_inputs]`.
    ///
    /// # Panics
    /// When `x` has the wrong length.
    pub fn mean_and_jacobian(&self, x: &[f64]) -> (Vec<f64>, Vec<Vec<f64>>) {
        let features = self.features(x);
        let inverse_widths: Vec<f64> =
            self.kernel.blocks().flat_map(|(dim, g)| std::iter::repeat_n(g, dim)).collect();
        let derivatives = |output: &SparseFunction| {
            let mut row = vec![0.0; x.len()];
            for (&basis, weight) in
                output.bases.iter().zip(&output.mean).filter(|(b, _)| **b < self.centres.len())
            {
                // dφ/dx = −2 g (x − c) φ.
                let scale = -2.0 * weight * features[basis];
                for (i, &c) in self.centres.row(basis).iter().enumerate() {
                    row[i] += scale * inverse_widths[i] * (x[i] - f64::from(c));
                }
            }
            row
        };
        let means = self.outputs.iter().map(|output| output.mean_at(&features)).collect();
        (means, self.outputs.iter().map(derivatives).collect())
    }

    /// Length of the room that [`Self::mean_into`] and [`Self::predict_into`] work in.
    pub fn n_features(&self) -> usize {
        self.centres.len() + 1
    }

    /// The mean outputs at `x`, without allocating: `room` is [`Self::n_features`] long, `mean` as long as the outputs.
    ///
    /// # Panics
    /// When a length is wrong.
    pub fn mean_into(&self, x: &[f64], room: &mut [f64], mean: &mut [f64]) {
        self.fill_features(x, room);
        mean.iter_mut().zip(&self.outputs).for_each(|(mean, output)| *mean = output.mean_at(room));
    }

    /// Mean and variance of a new observation at `x`, as [`Expert::predict`], without allocating.
    ///
    /// # Panics
    /// When a length is wrong.
    pub fn predict_into(&self, x: &[f64], room: &mut [f64], mean: &mut [f64], variance: &mut [f64]) {
        self.mean_into(x, room, mean);
        variance.iter_mut().zip(&self.outputs).for_each(|(variance, output)| {
            *variance = output.noise_variance + output.variance_at(room);
        });
    }

    fn fill_features(&self, x: &[f64], room: &mut [f64]) {
        assert_eq!(room.len(), self.n_features(), "room for {} features", room.len());
        let values = self.kernel.values(&self.centres, x).chain([1.0]);
        room.iter_mut().zip(values).for_each(|(feature, value)| *feature = value);
    }

    /// All kernels at `x`, and 1 for the bias after them.
    pub(crate) fn features(&self, x: &[f64]) -> Vec<f64> {
        let mut features = Vec::with_capacity(self.centres.len() + 1);
        self.kernel.at_centres(&self.centres, x, &mut features);
        features.push(1.0);
        features
    }
}

impl Expert for Rvm {
    fn input_dim(&self) -> usize {
        self.kernel.dim()
    }

    fn output_dim(&self) -> usize {
        self.outputs.len()
    }

    /// `[Tipping2001]` eqs. (21), (22): mean μᵀφ, variance σ² + φᵀΣφ.
    fn predict(&self, x: &[f64], out: &mut Gaussian) {
        let features = self.features(x);
        out.mean.clear();
        out.variance.clear();
        for output in &self.outputs {
            let (mean, variance) = output.predict(&features);
            out.mean.push(mean);
            out.variance.push(output.noise_variance + variance);
        }
    }
}

/// A fitted function whose bases are still numbered as in its design.
pub(crate) struct SparseFit {
    pub(crate) active: Vec<usize>,
    pub(crate) function: SparseFunction,
}

impl SparseFit {
    /// The mean at every sample.
    fn fitted(&self, design: &Design) -> Vec<f64> {
        let mut fitted = vec![0.0; design.n_samples()];
        for (&basis, &weight) in self.active.iter().zip(&self.function.mean) {
            add_scaled(&mut fitted, weight, design.column(basis));
        }
        fitted
    }

    /// ln N(t_i | mean, variance) of every sample.
    pub(crate) fn log_densities(&self, design: &Design, target: &[f64]) -> Vec<f64> {
        let columns: Vec<&[f64]> = self.active.iter().map(|&basis| design.column(basis)).collect();
        let SparseFunction { mean, covariance, noise_variance, .. } = &self.function;
        let mut own = vec![0.0; columns.len()];
        let log_density = |(i, t): (usize, &f64)| {
            own.iter_mut().zip(&columns).for_each(|(own, column)| *own = column[i]);
            let variance = noise_variance * (1.0 + covariance.quadratic(&own).max(0.0));
            let away = t - dot(mean, &own);
            -0.5 * (away * away / variance + (2.0 * std::f64::consts::PI * variance).ln())
        };
        target.iter().enumerate().map(log_density).collect()
    }
}

/// Climbs the evidence of one output to the top, from nothing or from the bases of an earlier fit.
pub(crate) fn fit_output(
    weighted: &WeightedDesign<'_>,
    target: &[f64],
    params: &RvmParams,
    start: Option<&SparseFit>,
) -> SparseFit {
    let total_weight: f64 = weighted.weights.iter().sum();
    let products: Vec<f64> = target.iter().zip(&weighted.weights).map(|(t, w)| t * w).collect();
    let mean = products.iter().sum::<f64>() / total_weight;
    let spread: f64 = target.iter().zip(&weighted.weights).map(|(t, w)| w * (t - mean) * (t - mean)).sum();
    let energy: f64 = target.iter().zip(&products).map(|(t, p)| t * p).sum();
    // Targets that hardly vary about a large mean leave no more than rounding to learn the noise from.
    let floor = (params.noise_floor * spread.max(1e-6 * energy)).max(f64::MIN_POSITIVE * 1e20);
    let mut model = Sequential::new(
        weighted,
        Noise::Estimated { total_weight },
        weighted.design.project(&products),
        energy,
        floor,
    );
    match start {
        Some(start) => {
            weighted.prepare(&start.active);
            model = model.with_bases(&start.active, &start.function.precisions);
        }
        None => {
            // From little noise upwards: the details come in while they still count, and what proves to be noise
            // leaves again. Downwards from all noise, the climb ends in a poorer local maximum.
            let precision = total_weight / (params.initial_noise * spread).max(floor);
            model.set_noise(Noise::Known { precision });
            climb(&mut model, params, params.min_gain_of_addition, |_, _| ());
            model.set_noise(Noise::Estimated { total_weight });
        }
    }
    climb(&mut model, params, params.min_gain, |_, _| ());
    SparseFit {
        active: model.active().to_vec(),
        function: SparseFunction {
            bases: Vec::new(),
            precisions: model.precisions().to_vec(),
            mean: model.mean().to_vec(),
            covariance: model.covariance().clone(),
            noise_variance: model.noise_variance(),
            log_evidence: model.log_evidence(),
            total_weight,
        },
    }
}

/// Takes the best step until none gains `min_gain` nats; `seen` gets every step's promised gain.
pub(crate) fn climb<P: Products>(
    model: &mut Sequential<'_, P>,
    params: &RvmParams,
    min_gain: f64,
    mut seen: impl FnMut(&Sequential<'_, P>, f64),
) -> usize {
    let (mut steps, mut since_refresh) = (0, 0);
    while steps < params.max_steps {
        match model.best_action(params).filter(|&(_, gain)| gain >= min_gain) {
            Some((action, gain)) => {
                model.apply(action);
                steps += 1;
                since_refresh += 1;
                seen(model, gain);
                if since_refresh == params.refresh_every {
                    model.refresh();
                    since_refresh = 0;
                }
            }
            // The end has to hold in exact numbers, too.
            None if since_refresh > 0 => {
                model.refresh();
                since_refresh = 0;
            }
            None => break,
        }
    }
    if since_refresh > 0 {
        model.refresh();
    }
    steps
}
