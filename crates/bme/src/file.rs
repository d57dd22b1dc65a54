//! What models look like on disk: plain structs with a version, converted by hand and checked when they come back.

use serde::{Deserialize, Serialize};

use crate::linalg::Symmetric;
use crate::mixture::View;
use crate::rvm::{Memory, Remembered, SparseFunction};
use crate::{Decoder, MixtureOfExperts, Rvm, RvmClassifier, SpectralLatentModel};
use crate::{Gaussian, HierarchicalMixture, Inputs, InputsError, Kernel, KernelError, MixtureDensity};

/// The layout of the structs of this module; files of another one are refused.
pub const FILE_VERSION: u32 = 1;

/// Why a file's content is no model.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelFileError {
    /// Written by another version.
    #[error("`version` is {found}, expected {FILE_VERSION}")]
    Version {
        /// What the file says.
        found: u32,
    },
    /// A list of the wrong length.
    #[error("`{field}` has {found} entries, expected {expected}")]
    Length {
        /// Which list.
        field: &'static str,
        /// Its length.
        found: usize,
        /// The right length.
        expected: usize,
    },
    /// A basis that is no centre.
    #[error("`bases` names centre {found}, but there are {centres}")]
    Basis {
        /// What is named.
        found: u32,
        /// How many centres there are.
        centres: usize,
    },
    /// A number that is not finite, or not positive where it has to be.
    #[error("`{field}` holds {value}, expected a {expected} number")]
    Value {
        /// Which list.
        field: &'static str,
        /// What stands there.
        value: f64,
        /// `finite` or `positive`.
        expected: &'static str,
    },
    /// A kernel that cannot be.
    #[error("`kernel` cannot be used")]
    Kernel(#[source] KernelError),
    /// Centres that cannot be.
    #[error("`centres` cannot be used")]
    Centres(#[source] InputsError),
}

/// A kernel and what it is centred on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BasesFile {
    /// (coordinates, inverse width) of each block.
    pub kernel: Vec<(u32, f64)>,
    /// Centres, row after row.
    pub centres: Vec<f32>,
}

/// The posterior of one function's weights.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FunctionFile {
    /// Which centres; their number stands for the bias.
    pub bases: Vec<u32>,
    /// Prior precisions.
    pub precisions: Vec<f64>,
    /// Means of the weights.
    pub mean: Vec<f64>,
    /// The lower triangle of their covariance, row after row; empty for weights that are taken to be exact.
    pub covariance: Vec<f64>,
    /// Variance of the noise.
    pub noise_variance: f64,
    /// Log evidence.
    pub log_evidence: f64,
    /// Weight of the training samples.
    pub total_weight: f64,
}

/// The samples that a model keeps one by one, so that it can learn on. Without any, the centres stand for them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MemoryFile {
    /// Inputs, row after row.
    pub inputs: Vec<f32>,
    /// How much each counts, function after function.
    pub precisions: Vec<Vec<f64>>,
    /// That times its target.
    pub weighted_targets: Vec<Vec<f64>>,
}

/// An [`Rvm`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RvmFile {
    /// [`FILE_VERSION`].
    pub version: u32,
    /// Kernel and centres.
    pub bases: BasesFile,
    /// One function an output.
    pub outputs: Vec<FunctionFile>,
    /// Samples of the training.
    pub memory: MemoryFile,
}

/// An [`RvmClassifier`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RvmClassifierFile {
    /// [`FILE_VERSION`].
    pub version: u32,
    /// Kernel and centres.
    pub bases: BasesFile,
    /// How many classes there are.
    pub n_classes: u32,
    /// None for one class, one for two, else one each.
    pub logits: Vec<FunctionFile>,
    /// Log evidence.
    pub log_evidence: f64,
    /// Samples of the training.
    pub memory: MemoryFile,
}

/// A [`MixtureOfExperts`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MixtureFile {
    /// The gate.
    pub gate: RvmClassifierFile,
    /// The experts.
    pub experts: Vec<RvmFile>,
}

/// A [`HierarchicalMixture`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HierarchicalFile {
    /// The gate over the views.
    pub gate: RvmClassifierFile,
    /// The mixtures of each view, that of the heading last.
    pub views: Vec<Vec<MixtureFile>>,
}

impl HierarchicalFile {
    /// Leaves out the samples that models keep, two thirds of a file; what is learnt later then disturbs more of what was
    /// known.
    pub fn forget_samples(&mut self) {
        let gates = self.views.iter_mut().flatten().map(|block| &mut block.gate.memory);
        gates.chain([&mut self.gate.memory]).for_each(|memory| *memory = MemoryFile::default());
        let experts = self.views.iter_mut().flatten().flat_map(|block| &mut block.experts);
        experts.for_each(|expert| expert.memory = MemoryFile::default());
    }
}

/// A [`MixtureDensity`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DensityFile {
    /// Weights, not their logs.
    pub weights: Vec<f64>,
    /// Means of the components.
    pub means: Vec<Vec<f64>>,
    /// Variances of the components.
    pub variances: Vec<Vec<f64>>,
}

/// A [`SpectralLatentModel`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LatentFile {
    /// Prior over latent points.
    pub prior: DensityFile,
    /// Latent points to outputs: the plane, row after row, and
    pub slopes: Vec<f64>,
    /// what it leaves.
    pub decoder: RvmFile,
    /// Outputs to latent points.
    pub encoder: RvmFile,
}

impl LatentFile {
    /// Leaves out the samples that both maps keep, so that they cannot learn on as well, and how unsure the decoder is of its
    /// weights: its variance is then that of the noise.
    pub fn shrink(&mut self) {
        self.encoder.memory = MemoryFile::default();
        self.decoder.memory = MemoryFile::default();
        self.decoder.outputs.iter_mut().for_each(|output| output.covariance = Vec::new());
    }
}

fn same_length(field: &'static str, found: usize, expected: usize) -> Result<(), ModelFileError> {
    if found == expected { Ok(()) } else { Err(ModelFileError::Length { field, found, expected }) }
}

fn all_finite(field: &'static str, values: &[f64]) -> Result<(), ModelFileError> {
    match values.iter().find(|v| !v.is_finite()) {
        Some(&value) => Err(ModelFileError::Value { field, value, expected: "finite" }),
        None => Ok(()),
    }
}

fn all_positive(field: &'static str, values: &[f64]) -> Result<(), ModelFileError> {
    match values.iter().find(|&&v| !(v > 0.0 && v.is_finite())) {
        Some(&value) => Err(ModelFileError::Value { field, value, expected: "positive" }),
        None => Ok(()),
    }
}

fn this_version(found: u32) -> Result<(), ModelFileError> {
    if found == FILE_VERSION { Ok(()) } else { Err(ModelFileError::Version { found }) }
}

impl BasesFile {
    fn new(kernel: &Kernel, centres: &Inputs) -> Self {
        Self {
            kernel: kernel.blocks().map(|(dim, g)| (dim as u32, g)).collect(),
            centres: centres.values().to_vec(),
        }
    }

    fn read(self) -> Result<(Kernel, Inputs), ModelFileError> {
        let blocks: Vec<(usize, f64)> = self.kernel.iter().map(|&(dim, g)| (dim as usize, g)).collect();
        let kernel = Kernel::product(&blocks).map_err(ModelFileError::Kernel)?;
        let centres = Inputs::from_rows(kernel.dim(), self.centres.into_iter().map(f64::from));
        Ok((kernel, centres.map_err(ModelFileError::Centres)?))
    }
}

impl From<&SparseFunction> for FunctionFile {
    fn from(function: &SparseFunction) -> Self {
        Self {
            bases: function.bases.iter().map(|&basis| basis as u32).collect(),
            precisions: function.precisions.clone(),
            mean: function.mean.clone(),
            covariance: function.covariance.lower_triangle(),
            noise_variance: function.noise_variance,
            log_evidence: function.log_evidence,
            total_weight: function.total_weight,
        }
    }
}

impl FunctionFile {
    fn read(self, centres: usize) -> Result<SparseFunction, ModelFileError> {
        let n = self.bases.len();
        if let Some(&found) = self.bases.iter().find(|&&basis| basis as usize > centres) {
            return Err(ModelFileError::Basis { found, centres });
        }
        same_length("precisions", self.precisions.len(), n)?;
        same_length("mean", self.mean.len(), n)?;
        all_positive("precisions", &self.precisions)?;
        all_finite("mean", &self.mean)?;
        all_finite("covariance", &self.covariance)?;
        all_positive("noise_variance", &[self.noise_variance])?;
        all_positive("total_weight", &[self.total_weight])?;
        all_finite("log_evidence", &[self.log_evidence])?;
        let covariance = match self.covariance.as_slice() {
            [] => Symmetric::from_fn(n, |_, _| 0.0),
            triangle => Symmetric::from_lower_triangle(n, triangle).ok_or(ModelFileError::Length {
                field: "covariance",
                found: triangle.len(),
                expected: n * (n + 1) / 2,
            })?,
        };
        Ok(SparseFunction {
            bases: self.bases.into_iter().map(|basis| basis as usize).collect(),
            precisions: self.precisions,
            mean: self.mean,
            covariance,
            noise_variance: self.noise_variance,
            log_evidence: self.log_evidence,
            total_weight: self.total_weight,
        })
    }
}

impl From<&Memory> for MemoryFile {
    fn from(memory: &Memory) -> Self {
        let column = |part: fn(&Remembered) -> f64| {
            memory.parts.iter().map(|samples| samples.iter().map(part).collect()).collect()
        };
        Self {
            inputs: memory.inputs.values().to_vec(),
            precisions: column(|sample| sample.precision),
            weighted_targets: column(|sample| sample.weighted_target),
        }
    }
}

impl MemoryFile {
    fn read(
        self,
        kernel: &Kernel,
        centres: &Inputs,
        functions: &[SparseFunction],
    ) -> Result<Memory, ModelFileError> {
        if self.inputs.is_empty() {
            return Ok(Memory::of_centres(kernel, centres, functions));
        }
        let n_functions = functions.len();
        let inputs = Inputs::from_rows(kernel.dim(), self.inputs.into_iter().map(f64::from));
        let inputs = inputs.map_err(ModelFileError::Centres)?;
        same_length("memory.precisions", self.precisions.len(), n_functions)?;
        same_length("memory.weighted_targets", self.weighted_targets.len(), n_functions)?;
        let mut parts = Vec::with_capacity(n_functions);
        for (precisions, weighted_targets) in self.precisions.iter().zip(&self.weighted_targets) {
            same_length("memory.precisions", precisions.len(), inputs.len())?;
            same_length("memory.weighted_targets", weighted_targets.len(), inputs.len())?;
            all_finite("memory.precisions", precisions)?;
            all_finite("memory.weighted_targets", weighted_targets)?;
            let samples = precisions.iter().zip(weighted_targets);
            let sample = |(&precision, &weighted_target)| Remembered { precision, weighted_target };
            parts.push(samples.map(sample).collect());
        }
        Ok(Memory { inputs, parts })
    }
}

impl From<&Rvm> for RvmFile {
    fn from(model: &Rvm) -> Self {
        Self {
            version: FILE_VERSION,
            bases: BasesFile::new(&model.kernel, &model.centres),
            outputs: model.outputs.iter().map(FunctionFile::from).collect(),
            memory: (&model.memory).into(),
        }
    }
}

impl TryFrom<RvmFile> for Rvm {
    type Error = ModelFileError;

    fn try_from(file: RvmFile) -> Result<Self, ModelFileError> {
        this_version(file.version)?;
        let (kernel, centres) = file.bases.read()?;
        let outputs: Vec<SparseFunction> =
            file.outputs.into_iter().map(|f| f.read(centres.len())).collect::<Result<_, _>>()?;
        let memory = file.memory.read(&kernel, &centres, &outputs)?;
        Ok(Self { kernel, centres, outputs, memory })
    }
}

impl From<&RvmClassifier> for RvmClassifierFile {
    fn from(model: &RvmClassifier) -> Self {
        Self {
            version: FILE_VERSION,
            bases: BasesFile::new(&model.kernel, &model.centres),
            n_classes: model.n_classes as u32,
            logits: model.logits.iter().map(FunctionFile::from).collect(),
            log_evidence: model.log_evidence,
            memory: (&model.memory).into(),
        }
    }
}

impl TryFrom<RvmClassifierFile> for RvmClassifier {
    type Error = ModelFileError;

    fn try_from(file: RvmClassifierFile) -> Result<Self, ModelFileError> {
        this_version(file.version)?;
        let (kernel, centres) = file.bases.read()?;
        let n_classes = file.n_classes as usize;
        let n_logits = match n_classes {
            0 => return Err(ModelFileError::Value { field: "n_classes", value: 0.0, expected: "positive" }),
            1 => 0,
            2 => 1,
            more => more,
        };
        same_length("logits", file.logits.len(), n_logits)?;
        all_finite("log_evidence", &[file.log_evidence])?;
        let logits: Vec<SparseFunction> =
            file.logits.into_iter().map(|f| f.read(centres.len())).collect::<Result<_, _>>()?;
        let memory = file.memory.read(&kernel, &centres, &logits)?;
        Ok(Self { kernel, centres, logits, n_classes, log_evidence: file.log_evidence, memory })
    }
}

impl From<&MixtureOfExperts> for MixtureFile {
    fn from(model: &MixtureOfExperts) -> Self {
        Self { gate: (&model.gate).into(), experts: model.experts.iter().map(RvmFile::from).collect() }
    }
}

impl TryFrom<MixtureFile> for MixtureOfExperts {
    type Error = ModelFileError;

    fn try_from(file: MixtureFile) -> Result<Self, ModelFileError> {
        let gate = RvmClassifier::try_from(file.gate)?;
        same_length("experts", file.experts.len(), gate.n_classes)?;
        let experts: Vec<Rvm> = file.experts.into_iter().map(Rvm::try_from).collect::<Result<_, _>>()?;
        for expert in &experts {
            same_length("kernel", expert.kernel.dim(), gate.kernel.dim())?;
            same_length("outputs", expert.outputs.len(), experts[0].outputs.len())?;
        }
        Ok(Self { gate, experts })
    }
}

impl From<&HierarchicalMixture> for HierarchicalFile {
    fn from(model: &HierarchicalMixture) -> Self {
        let view = |view: &View| view.blocks.iter().map(MixtureFile::from).collect();
        Self { gate: (&model.gate).into(), views: model.views.iter().map(view).collect() }
    }
}

impl TryFrom<HierarchicalFile> for HierarchicalMixture {
    type Error = ModelFileError;

    fn try_from(file: HierarchicalFile) -> Result<Self, ModelFileError> {
        let gate = RvmClassifier::try_from(file.gate)?;
        same_length("views", file.views.len(), gate.n_classes)?;
        let views: Vec<View> = file
            .views
            .into_iter()
            .map(|blocks| {
                let blocks = blocks.into_iter().map(MixtureOfExperts::try_from).collect::<Result<_, _>>()?;
                Ok(View { blocks })
            })
            .collect::<Result<_, ModelFileError>>()?;
        for view in &views {
            same_length("views", view.blocks.len(), views[0].blocks.len())?;
            for block in &view.blocks {
                same_length("kernel", block.gate.kernel.dim(), gate.kernel.dim())?;
            }
        }
        Ok(Self { gate, views })
    }
}

impl From<&MixtureDensity> for DensityFile {
    fn from(density: &MixtureDensity) -> Self {
        Self {
            weights: density.log_weights.iter().map(|w| w.exp()).collect(),
            means: density.components.iter().map(|c| c.mean.clone()).collect(),
            variances: density.components.iter().map(|c| c.variance.clone()).collect(),
        }
    }
}

impl TryFrom<DensityFile> for MixtureDensity {
    type Error = ModelFileError;

    fn try_from(file: DensityFile) -> Result<Self, ModelFileError> {
        let n = file.weights.len();
        same_length("means", file.means.len(), n)?;
        same_length("variances", file.variances.len(), n)?;
        if let Some(&value) = file.weights.iter().find(|&&w| !(w >= 0.0 && w.is_finite())) {
            return Err(ModelFileError::Value { field: "weights", value, expected: "positive" });
        }
        let dim = file.means.first().map_or(0, Vec::len);
        for (mean, variance) in file.means.iter().zip(&file.variances) {
            same_length("means", mean.len(), dim)?;
            same_length("variances", variance.len(), dim)?;
            all_finite("means", mean)?;
            all_positive("variances", variance)?;
        }
        let components = file.means.into_iter().zip(file.variances);
        Ok(Self {
            log_weights: file.weights.iter().map(|w| w.ln()).collect(),
            components: components.map(|(mean, variance)| Gaussian { mean, variance }).collect(),
        })
    }
}

impl From<&SpectralLatentModel> for LatentFile {
    fn from(model: &SpectralLatentModel) -> Self {
        Self {
            prior: (&model.prior).into(),
            slopes: model.decoder.slopes.clone(),
            decoder: (&model.decoder.kernels).into(),
            encoder: (&model.encoder).into(),
        }
    }
}

impl TryFrom<LatentFile> for SpectralLatentModel {
    type Error = ModelFileError;

    fn try_from(file: LatentFile) -> Result<Self, ModelFileError> {
        let prior = MixtureDensity::try_from(file.prior)?;
        let kernels = Rvm::try_from(file.decoder)?;
        let encoder = Rvm::try_from(file.encoder)?;
        let (latent_dim, output_dim) = (kernels.kernel.dim(), kernels.outputs.len());
        same_length("prior", prior.dim(), latent_dim)?;
        same_length("slopes", file.slopes.len(), latent_dim * output_dim)?;
        all_finite("slopes", &file.slopes)?;
        same_length("outputs", encoder.outputs.len(), latent_dim)?;
        same_length("kernel", encoder.kernel.dim(), output_dim)?;
        Ok(Self { prior, decoder: Decoder { slopes: file.slopes, kernels }, encoder })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Design, Expert, MixtureConfig, MixtureParams, RvmParams};

    fn samples() -> (Design, Vec<f64>) {
        let x: Vec<f64> = (0..60).map(|i| f64::from(i) * 0.1 - 3.0).collect();
        let y = x.iter().enumerate().map(|(i, x)| x.sin() * if i % 2 == 0 { 1.0 } else { -3.0 }).collect();
        (Design::new(Kernel::gaussian(1, 0.7).unwrap(), Inputs::from_rows(1, x).unwrap()), y)
    }

    #[test]
    fn a_model_read_back_is_the_model() {
        let (design, y) = samples();
        let params = MixtureParams::new(MixtureConfig { n_experts: 2, ..MixtureConfig::default() }).unwrap();
        let (model, _) = MixtureOfExperts::fit(&design, &[y], &[1.0; 60], &params).unwrap();
        let text = serde_json::to_string(&MixtureFile::from(&model)).unwrap();
        let file: MixtureFile = serde_json::from_str(&text).unwrap();
        let again = MixtureOfExperts::try_from(file).unwrap();
        let (mut a, mut b) = (Gaussian::default(), Gaussian::default());
        for x in [-2.0, 0.3, 9.0] {
            model.predict(&[x], &mut a);
            again.predict(&[x], &mut b);
            assert_eq!(a, b);
        }
    }

    #[test]
    fn a_damaged_file_is_refused_by_name() {
        let (design, y) = samples();
        let model = Rvm::fit(&design, &[y], &[1.0; 60], &RvmParams::default()).unwrap();
        let file = RvmFile::from(&model);
        let error = |change: &dyn Fn(&mut RvmFile)| {
            let mut damaged = file.clone();
            change(&mut damaged);
            Rvm::try_from(damaged).unwrap_err().to_string()
        };
        assert_eq!(error(&|f| f.version = 9), "`version` is 9, expected 1");
        assert_eq!(
            error(&|f| f.outputs[0].noise_variance = -1.0),
            "`noise_variance` holds -1, expected a positive number"
        );
        assert_eq!(error(&|f| f.outputs[0].mean[0] = f64::NAN), "`mean` holds NaN, expected a finite number");
        assert!(
            error(&|f| f.outputs[0].bases[0] = 999).starts_with("`bases` names centre 999, but there are")
        );
        assert!(error(&|f| f.outputs[0].covariance.truncate(2)).starts_with("`covariance` has"));
        assert_eq!(error(&|f| f.bases.kernel.clear()), "`kernel` cannot be used");
    }
}
