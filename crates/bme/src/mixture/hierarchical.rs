//! The hierarchical mixture: views by heading, and in each view small mixtures for every latent coordinate and the heading.

use std::f64::consts::TAU;

use rand::Rng;
use rayon::prelude::*;

use super::{HierarchicalParams, MixtureOfExperts};
use crate::density::{MixtureDensity, Mode, draw};
use crate::linalg::log_sum_exp;
use crate::rng::some_rows;
use crate::{Design, Expert, FitError, Gate, Inputs, Kernel, RvmClassifier};

/// p(latent, cos heading, sin heading | x) = Σ_v g_v(x) Π_d p_vd(latent_d | x) · p_v(cos, sin | x).
///
/// A point is the latent coordinates followed by the cosine and the sine of the heading. Views are sectors of the
/// heading; each is a mixture of a few experts per coordinate, so that both answers to a depth flip can live on.
#[derive(Clone, Debug, PartialEq)]
pub struct HierarchicalMixture {
    pub(crate) gate: RvmClassifier,
    pub(crate) views: Vec<View>,
}

/// The experts of one sector of headings.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct View {
    /// One mixture per latent coordinate, and last the one of (cos, sin).
    pub(crate) blocks: Vec<MixtureOfExperts>,
}

/// What a [`HierarchicalMixture`] says about one input.
#[derive(Clone, Debug, PartialEq)]
pub struct HierarchicalDensity {
    /// ln of the weight of each view.
    pub log_views: Vec<f64>,
    /// Per view the densities of the independent blocks of a point, in order.
    pub blocks: Vec<Vec<MixtureDensity>>,
}

/// The heading of a point that ends in cosine and sine, in (−π, π].
///
/// # Panics
/// When the point has fewer than two coordinates.
pub fn heading_of(point: &[f64]) -> f64 {
    let [.., cos, sin] = point else { panic!("a point of {} coordinates, expected at least 2", point.len()) };
    sin.atan2(*cos)
}

impl HierarchicalMixture {
    /// Fits gates and experts; `latents[d][i]` is latent coordinate d of sample i, `headings[i]` its heading in radians.
    ///
    /// A sample belongs to the two sectors beside its heading in proportion to its nearness, so that neighbours agree
    /// at their border. Sectors without enough samples are left out.
    ///
    /// # Errors
    /// As [`MixtureOfExperts::fit`].
    ///
    /// # Panics
    /// When a length is not the number of samples.
    pub fn fit(
        kernel: &Kernel,
        inputs: &Inputs,
        headings: &[f64],
        latents: &[Vec<f64>],
        params: &HierarchicalParams,
    ) -> Result<Self, FitError> {
        assert_eq!(headings.len(), inputs.len(), "{} headings, {} samples", headings.len(), inputs.len());
        if let Some(sample) = headings.iter().position(|h| !h.is_finite()) {
            return Err(FitError::Target { sample, value: headings[sample] });
        }
        let memberships = memberships(headings, params);
        let gate_design = Design::with_centres(
            kernel.clone(),
            inputs.clone(),
            inputs.select(&some_rows(inputs.len(), params.config().max_centres, params.config().seed)),
        );
        let gate = RvmClassifier::fit(&gate_design, &memberships, params.gate())?;
        drop(gate_design);
        let views = memberships
            .par_iter()
            .map(|membership| {
                let rows: Vec<usize> = (0..inputs.len()).filter(|&i| membership[i] > 0.0).collect();
                View::fit(kernel, inputs, &rows, membership, headings, latents, params)
            })
            .collect::<Result<_, _>>()?;
        Ok(Self { gate, views })
    }

    /// p(latent, cos, sin | x).
    ///
    /// # Panics
    /// When `x` has the wrong length.
    pub fn density(&self, x: &[f64]) -> HierarchicalDensity {
        let mut log_views = vec![0.0; self.views.len()];
        self.gate.log_gates(x, &mut log_views);
        let blocks = self
            .views
            .iter()
            .map(|view| view.blocks.iter().map(|block| block.density(x)).collect())
            .collect();
        HierarchicalDensity { log_views, blocks }
    }

    /// The length of an input.
    pub fn input_dim(&self) -> usize {
        self.gate.input_dim()
    }

    /// The length of a point: the latent coordinates and two for the heading.
    pub fn output_dim(&self) -> usize {
        self.views.first().map_or(0, |view| view.blocks.iter().map(Expert::output_dim).sum())
    }

    /// How many sectors had samples.
    pub fn n_views(&self) -> usize {
        self.views.len()
    }
}

impl View {
    fn fit(
        kernel: &Kernel,
        inputs: &Inputs,
        rows: &[usize],
        membership: &[f64],
        headings: &[f64],
        latents: &[Vec<f64>],
        params: &HierarchicalParams,
    ) -> Result<Self, FitError> {
        let centres = some_rows(rows.len(), params.config().max_centres, params.config().seed);
        let own = inputs.select(rows);
        let centres = own.select(&centres);
        let design = Design::with_centres(kernel.clone(), own, centres);
        let pick = |values: &[f64]| -> Vec<f64> { rows.iter().map(|&i| values[i]).collect() };
        let weights = pick(membership);
        let cos_sin =
            [f64::cos, f64::sin].map(|f| rows.iter().map(|&i| f(headings[i])).collect::<Vec<f64>>());
        let latent_blocks = latents.par_iter().map(|latent| {
            let targets = [pick(latent)];
            Ok(MixtureOfExperts::fit(&design, &targets, &weights, params.latent())?.0)
        });
        let mut blocks: Vec<MixtureOfExperts> = latent_blocks.collect::<Result<_, FitError>>()?;
        blocks.push(MixtureOfExperts::fit(&design, &cos_sin, &weights, params.heading())?.0);
        Ok(Self { blocks })
    }
}

impl HierarchicalDensity {
    /// ln p(point); −∞ where every view has weight 0.
    ///
    /// # Panics
    /// When the point has the wrong length.
    pub fn log_density(&self, point: &[f64]) -> f64 {
        log_sum_exp(&self.log_joint(point))
    }

    /// ln of weight times density, of each view.
    pub(crate) fn log_joint(&self, point: &[f64]) -> Vec<f64> {
        let views = self.log_views.iter().zip(&self.blocks);
        let joint = views.map(|(log_view, blocks)| {
            let parts = split(point, blocks).map(|(part, block)| block.log_density(part));
            log_view + parts.sum::<f64>()
        });
        joint.collect()
    }

    /// A random point; its cosine and sine are as drawn, not brought to the circle (see [`heading_of`]).
    pub fn sample<R: Rng + ?Sized>(&self, rng: &mut R) -> Vec<f64> {
        let view = draw(&self.log_views, rng);
        self.blocks[view].iter().flat_map(|block| block.sample(rng)).collect()
    }

    /// The mean point.
    pub fn mean(&self) -> Vec<f64> {
        let mut mean = Vec::new();
        for (log_view, blocks) in self.log_views.iter().zip(&self.blocks) {
            let own: Vec<f64> = blocks.iter().flat_map(MixtureDensity::mean).collect();
            mean.resize(own.len(), 0.0);
            mean.iter_mut().zip(&own).for_each(|(sum, m)| *sum += log_view.exp() * m);
        }
        mean
    }

    /// The `limit` highest modes, highest first.
    ///
    /// Within a view they are the combinations of its blocks' modes, which is exact; views are taken not to merge.
    pub fn modes(&self, limit: usize) -> Vec<Mode> {
        let mut modes: Vec<Mode> = Vec::new();
        for (log_view, blocks) in self.log_views.iter().zip(&self.blocks) {
            if *log_view == f64::NEG_INFINITY {
                continue;
            }
            // Log densities of blocks add up, so the best `limit` of each stage contain the best of the whole.
            let mut partial = vec![Mode { at: Vec::new(), log_density: *log_view }];
            for block in blocks {
                let block_modes = block.modes();
                partial = partial
                    .iter()
                    .flat_map(|start| {
                        block_modes.iter().map(|mode| Mode {
                            at: start.at.iter().chain(&mode.at).copied().collect(),
                            log_density: start.log_density + mode.log_density,
                        })
                    })
                    .collect();
                partial.sort_by(|a, b| b.log_density.total_cmp(&a.log_density));
                partial.truncate(limit);
            }
            modes.extend(partial);
        }
        for mode in &mut modes {
            mode.log_density = self.log_density(&mode.at);
        }
        modes.sort_by(|a, b| b.log_density.total_cmp(&a.log_density));
        modes.truncate(limit);
        modes
    }
}

/// Cuts a point into the parts of the blocks.
fn split<'a>(
    point: &'a [f64],
    blocks: &'a [MixtureDensity],
) -> impl Iterator<Item = (&'a [f64], &'a MixtureDensity)> {
    let dim: usize = blocks.iter().map(MixtureDensity::dim).sum();
    assert_eq!(point.len(), dim, "a point of {} for a density over {dim}", point.len());
    let mut rest = point;
    blocks.iter().map(move |block| {
        let (part, tail) = rest.split_at(block.dim());
        rest = tail;
        (part, block)
    })
}

/// How much of each sample is in each sector that has enough samples; the shares of a sample sum to 1.
fn memberships(headings: &[f64], params: &HierarchicalParams) -> Vec<Vec<f64>> {
    let n_views = params.config().n_views;
    let share = |heading: f64, view: usize| {
        let position = heading.rem_euclid(TAU) / TAU * n_views as f64;
        let away = (position - view as f64).rem_euclid(n_views as f64);
        if n_views == 1 { 1.0 } else { (1.0 - away.min(n_views as f64 - away)).max(0.0) }
    };
    let mut views: Vec<Vec<f64>> =
        (0..n_views).map(|view| headings.iter().map(|&h| share(h, view)).collect()).collect();
    let largest = views.iter().map(|v| v.iter().sum::<f64>()).fold(0.0, f64::max);
    let least = params.config().min_view_weight.min(largest);
    views.retain(|view| view.iter().sum::<f64>() >= least);
    for i in 0..headings.len() {
        let total: f64 = views.iter().map(|view| view[i]).sum();
        let n_kept = views.len() as f64;
        views.iter_mut().for_each(|view| view[i] = if total > 0.0 { view[i] / total } else { 1.0 / n_kept });
    }
    views
}
