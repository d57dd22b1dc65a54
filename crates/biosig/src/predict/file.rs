//! The predictors' file: postcard in a container, without the people they were trained on.

use bme::file::{MemoryFile, ModelFileError, RvmClassifierFile, RvmFile};
use bme::{Expert as _, Gate as _, Rvm, RvmClassifier};
use body::container;
use serde::{Deserialize, Serialize};

use super::{LoadPredictorsError, N_SHAPE_FEATURES, Predictor, Predictors, Regression, Scaling};

const MAGIC: &str = "UMBRABIO";
/// Version of the file that this build reads and writes.
pub const VERSION: u32 = 1;
const N_GIRTHS: usize = 5;

#[derive(Serialize, Deserialize)]
struct PredictorsFile {
    shape: PredictorFile,
    girths: PredictorFile,
    girths_and_stature: PredictorFile,
}

#[derive(Serialize, Deserialize)]
struct PredictorFile {
    means: Vec<f64>,
    sds: Vec<f64>,
    directions: [Vec<f64>; 3],
    stature: RegressionFile,
    log_weight: RegressionFile,
    gender: RvmClassifierFile,
}

#[derive(Serialize, Deserialize)]
struct RegressionFile {
    mean: f64,
    slope: f64,
    rest: RvmFile,
}

impl RegressionFile {
    fn of(regression: &Regression) -> Self {
        let mut rest = RvmFile::from(&regression.rest);
        forget(&mut rest.memory);
        Self { mean: regression.mean, slope: regression.slope, rest }
    }

    fn read(self, score: usize) -> Result<Regression, ModelFileError> {
        Ok(Regression { score, mean: self.mean, slope: self.slope, rest: Rvm::try_from(self.rest)? })
    }
}

/// A memory of nobody: measurements of single people stay out of the file, the machines cannot learn on.
fn forget(memory: &mut MemoryFile) {
    memory.inputs.clear();
    memory.precisions.iter_mut().for_each(Vec::clear);
    memory.weighted_targets.iter_mut().for_each(Vec::clear);
}

impl PredictorFile {
    fn of(predictor: &Predictor) -> Self {
        let mut file = Self {
            means: predictor.scaling.means.clone(),
            sds: predictor.scaling.sds.clone(),
            directions: predictor.directions.clone(),
            stature: RegressionFile::of(&predictor.stature),
            log_weight: RegressionFile::of(&predictor.log_weight),
            gender: RvmClassifierFile::from(&predictor.gender),
        };
        forget(&mut file.gender.memory);
        file
    }

    fn read(self, predictor: &'static str, expected: usize) -> Result<Predictor, LoadPredictorsError> {
        let machine = |machine| move |source| LoadPredictorsError::Machine { machine, source };
        let read = Predictor {
            stature: self.stature.read(0).map_err(machine("stature"))?,
            log_weight: self.log_weight.read(1).map_err(machine("log_weight"))?,
            gender: RvmClassifier::try_from(self.gender).map_err(machine("gender"))?,
            scaling: Scaling { means: self.means, sds: self.sds },
            directions: self.directions,
        };
        let features = [read.scaling.means.len(), read.scaling.sds.len()];
        let of_directions = read.directions.iter().map(Vec::len);
        if let Some(found) = features.into_iter().chain(of_directions).find(|&found| found != expected) {
            return Err(LoadPredictorsError::Features { predictor, found, expected });
        }
        let machines = [read.stature.rest.input_dim(), read.log_weight.rest.input_dim()];
        let scores = machines.into_iter().chain([read.gender.input_dim()]);
        let mut scores = scores;
        match scores.find(|&found| found != read.directions.len()) {
            Some(found) => Err(LoadPredictorsError::Scores { predictor, found }),
            None => Ok(read),
        }
    }
}

impl Predictors {
    /// The bytes of the file.
    pub fn to_bytes(&self) -> Vec<u8> {
        let file = PredictorsFile {
            shape: PredictorFile::of(&self.shape),
            girths: PredictorFile::of(&self.girths),
            girths_and_stature: PredictorFile::of(&self.girths_and_stature),
        };
        container::seal(MAGIC, VERSION, &postcard::to_stdvec(&file).expect("writing to memory cannot fail"))
    }

    /// Undoes [`Predictors::to_bytes`].
    ///
    /// # Errors
    /// On another kind or version of file, or content that is no predictor.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, LoadPredictorsError> {
        let data = container::open(MAGIC, VERSION, bytes)?;
        let file: PredictorsFile = postcard::from_bytes(data).map_err(LoadPredictorsError::Decode)?;
        Ok(Self {
            shape: file.shape.read("shape", N_SHAPE_FEATURES)?,
            girths: file.girths.read("girths", N_GIRTHS)?,
            girths_and_stature: file.girths_and_stature.read("girths_and_stature", N_GIRTHS + 1)?,
        })
    }
}
