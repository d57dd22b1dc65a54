//! The description of a mask that experts work on.

use serde::{Deserialize, Serialize};
use silhouette::Mask;
use silhouette::clean::{Components, Connectivity};
use silhouette::descriptor::{Codebook, CropComponents, Descriptor, ShapeContext, ShapeContextHistogram};

/// One of the two rival descriptors.
#[derive(Clone, Debug)]
pub enum MaskDescriptor {
    /// Principal components of the figure scaled to one height.
    Crop(CropComponents),
    /// Histogram of shape contexts.
    Histogram(ShapeContextHistogram),
}

impl MaskDescriptor {
    /// What it does.
    pub fn descriptor(&self) -> &dyn Descriptor {
        match self {
            Self::Crop(crop) => crop,
            Self::Histogram(histogram) => histogram,
        }
    }

    /// The description of the person in `mask`; `None` when there is none.
    pub fn describe(&self, mask: &Mask) -> Option<Vec<f64>> {
        self.descriptor().describe(&person_in(mask)?)
    }
}

/// The largest component of `mask`, cut out, its holes filled; `None` when the mask is empty. One stray speckle would
/// change the box that a crop is scaled by.
pub fn person_in(mask: &Mask) -> Option<Mask> {
    let components = Components::of(mask, Connectivity::Eight);
    let largest = components.largest()?;
    let person = components.select(|component| component == largest);
    Some(person.crop(person.bounding_box()?).with_holes_filled(u64::MAX))
}

/// What a file holds of a descriptor. Components and prototypes as they are in memory, one after the other.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) enum DescriptorFile {
    Crop { mean: Vec<f32>, components: Vec<Vec<f32>> },
    Histogram { prototypes: Vec<Vec<f32>>, sharpness: i32 },
}

impl From<&MaskDescriptor> for DescriptorFile {
    fn from(descriptor: &MaskDescriptor) -> Self {
        match descriptor {
            MaskDescriptor::Crop(crop) => Self::Crop {
                mean: crop.mean().to_vec(),
                components: crop.components().map(<[f32]>::to_vec).collect(),
            },
            MaskDescriptor::Histogram(histogram) => Self::Histogram {
                prototypes: histogram.codebook().prototypes().iter().map(|p| p.to_vec()).collect(),
                sharpness: histogram.sharpness(),
            },
        }
    }
}

impl DescriptorFile {
    /// `None` when lengths or values are not those of a descriptor.
    pub(super) fn read(self) -> Option<MaskDescriptor> {
        match self {
            Self::Crop { mean, components } => {
                CropComponents::from_parts(mean, &components).ok().map(MaskDescriptor::Crop)
            }
            Self::Histogram { prototypes, sharpness } => {
                let prototypes = prototypes
                    .into_iter()
                    .map(|p| ShapeContext::try_from(p).ok())
                    .collect::<Option<Vec<_>>>()?;
                let codebook = Codebook::from_prototypes(prototypes).ok()?;
                (sharpness >= 1)
                    .then(|| MaskDescriptor::Histogram(ShapeContextHistogram::new(codebook, sharpness)))
            }
        }
    }
}
