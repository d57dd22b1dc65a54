//! A predictor as a file: postcard in a container with version, length and checksum.

use std::fs;
use std::path::Path;

use anyhow::Context as _;
use bme::HierarchicalMixture;
use bme::file::{HierarchicalFile, ModelFileError};
use body::container::{self, ContainerError};
use serde::{Deserialize, Serialize};

use super::descriptor::DescriptorFile;
use super::pose_space::PoseSpace;
use super::predictor::{PosePredictor, Training};
use crate::run_folder::WriteRunError;
use crate::whole_file::write_whole;

const MAGIC: &str = "UMBRAPRE";
/// Version of the file that this build reads and writes.
const VERSION: u32 = 1;

#[derive(Serialize, Deserialize)]
struct PredictorFile {
    training: Training,
    descriptor: DescriptorFile,
    space: PoseSpace,
    experts: HierarchicalFile,
}

/// Why bytes are not a predictor.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LoadPredictorError {
    /// Another kind or version of file, cut short, or damaged.
    #[error(transparent)]
    Container(#[from] ContainerError),
    /// The checksum fits but the data do not decode.
    #[error("cannot decode the data")]
    Decode(#[source] postcard::Error),
    /// A descriptor that cannot be.
    #[error("`descriptor` holds what no descriptor does")]
    Descriptor,
    /// Coordinates that cannot be.
    #[error("`space` holds rows of other lengths than a pose has numbers, or numbers that are not finite")]
    Space,
    /// Experts that cannot be.
    #[error("`experts` cannot be used")]
    Experts(#[source] ModelFileError),
    /// Parts of different predictors.
    #[error("`experts` work on {found:?} numbers in and out, expected {expected:?}")]
    Parts {
        /// Length of the experts' inputs and outputs.
        found: [usize; 2],
        /// What descriptor and space ask for.
        expected: [usize; 2],
    },
}

impl PosePredictor {
    /// The file of this predictor.
    pub fn to_bytes(&self) -> Vec<u8> {
        sealed(&self.file())
    }

    /// Reads a predictor from a file.
    ///
    /// # Errors
    /// When there is none, or it is of another version or damaged; the message names the file.
    pub fn read(path: &Path) -> anyhow::Result<Self> {
        let bytes = fs::read(path).with_context(|| format!("{}: cannot read", path.display()))?;
        Self::from_bytes(&bytes).with_context(|| format!("{}: not a predictor of poses", path.display()))
    }

    /// Writes the file of [`Self::to_bytes`], whole or not at all.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), WriteRunError> {
        write_whole(path, &self.to_bytes())
    }

    /// Writes the file of [`Self::to_small_bytes`], whole or not at all.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write_small(&self, path: &Path) -> Result<(), WriteRunError> {
        write_whole(path, &self.to_small_bytes())
    }

    /// A file of a third the size, of a predictor that cannot learn on as well.
    pub fn to_small_bytes(&self) -> Vec<u8> {
        let mut file = self.file();
        file.experts.forget_samples();
        sealed(&file)
    }

    fn file(&self) -> PredictorFile {
        PredictorFile {
            training: self.training.clone(),
            descriptor: (&self.descriptor).into(),
            space: self.space.clone(),
            experts: (&self.experts).into(),
        }
    }

    /// Reads what [`Self::to_bytes`] wrote.
    ///
    /// # Errors
    /// [`LoadPredictorError`] says what is wrong; the caller knows the path.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, LoadPredictorError> {
        let data = container::open(MAGIC, VERSION, bytes)?;
        let file: PredictorFile = postcard::from_bytes(data).map_err(LoadPredictorError::Decode)?;
        let descriptor = file.descriptor.read().ok_or(LoadPredictorError::Descriptor)?;
        if !file.space.is_sound() {
            return Err(LoadPredictorError::Space);
        }
        let experts = HierarchicalMixture::try_from(file.experts).map_err(LoadPredictorError::Experts)?;
        let found = [experts.input_dim(), experts.output_dim()];
        let expected = [descriptor.descriptor().dimension(), file.space.dim() + 2];
        if found != expected {
            return Err(LoadPredictorError::Parts { found, expected });
        }
        Ok(Self { training: file.training, descriptor, space: file.space, experts })
    }
}

fn sealed(file: &PredictorFile) -> Vec<u8> {
    let data = postcard::to_stdvec(file).expect("plain numbers and strings always encode");
    container::seal(MAGIC, VERSION, &data)
}
