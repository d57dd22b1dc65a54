//! The figure cut out, scaled to one height, and its principal components: plainer than shape contexts, and a hard
//! rival to beat.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};

use super::Descriptor;
use crate::mask::{Mask, PixelRect};

/// Columns of the crop.
pub const CROP_WIDTH: u32 = 48;
/// Rows of the crop: the figure's height.
pub const CROP_HEIGHT: u32 = 96;
/// Directions searched for each one asked for: the last ones settle slowly where variances fall slowly `[Halko2011]`.
const OVERSAMPLING: usize = 2;
/// Rounds of subspace iteration.
const ROUNDS: usize = 4;

/// Person's share of each pixel of the figure scaled to [`CROP_HEIGHT`] rows, row after row; `None` without a person.
///
/// The crop is as high as the figure's bounding box and half as wide, its middle is that of the box; what reaches
/// farther out is cut off.
pub fn crop_coverage(mask: &Mask) -> Option<Vec<f32>> {
    let figure = mask.crop(mask.bounding_box()?);
    // Pad or cut the figure to the aspect ratio of the crop; doubled, so that halves stay whole.
    let figure = figure.enlarged(2);
    let width = (figure.height() * CROP_WIDTH / CROP_HEIGHT).max(1);
    let crop = if figure.width() > width {
        let x0 = (figure.width() - width) / 2;
        figure.crop(PixelRect { x0, y0: 0, x1: x0 + width, y1: figure.height() })
    } else {
        let margin = (width - figure.width()) / 2;
        Mask::from_fn(width, figure.height(), |x, y| {
            figure.get_or_background(i64::from(x) - i64::from(margin), i64::from(y))
        })
    };
    Some(crop.coverage(CROP_WIDTH, CROP_HEIGHT))
}

/// Settings of the search for components.
#[derive(Clone, Debug)]
pub struct CropComponentsConfig {
    /// Components.
    pub n_components: usize,
    /// Seed of the first directions.
    pub seed: u64,
}

impl Default for CropComponentsConfig {
    fn default() -> Self {
        Self { n_components: 60, seed: 0 }
    }
}

/// Why there are no components.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CropComponentsError {
    /// Fewer crops than components.
    #[error("{found} crops to learn from, expected more than {n_components}, the number of components")]
    TooFewCrops {
        /// Crops given.
        found: usize,
        /// Components wanted.
        n_components: usize,
    },
    /// A row of another length than a crop has pixels.
    #[error("{what} holds {found} numbers, expected {expected}, the pixels of a crop")]
    Length {
        /// Which row.
        what: &'static str,
        /// Its length.
        found: usize,
        /// Pixels of a crop.
        expected: usize,
    },
}

/// Principal components of crops.
#[derive(Clone, Debug, PartialEq)]
pub struct CropComponents {
    mean: DVector<f32>,
    /// One component a column, of length 1.
    components: DMatrix<f32>,
}

impl CropComponents {
    /// Learns from the crops of many masks ([`crop_coverage`]) by randomised subspace iteration `[Halko2011]`.
    ///
    /// Components come in falling order of variance; the sign of each is chosen so that its largest entry is positive.
    ///
    /// # Errors
    /// When there are not more crops than components, or a crop has another number of pixels.
    pub fn learn(crops: &[Vec<f32>], config: &CropComponentsConfig) -> Result<Self, CropComponentsError> {
        let n_components = config.n_components;
        if crops.len() <= n_components {
            return Err(CropComponentsError::TooFewCrops { found: crops.len(), n_components });
        }
        crops.iter().try_for_each(|crop| check_length("a crop", crop.len()))?;
        let n_pixels = (CROP_WIDTH * CROP_HEIGHT) as usize;
        // One crop a column, less the mean.
        let mut centered = DMatrix::from_fn(n_pixels, crops.len(), |pixel, crop| crops[crop][pixel]);
        let mean = centered.column_mean();
        centered.column_iter_mut().for_each(|mut crop| crop -= &mean);

        let n_directions = (n_components * OVERSAMPLING).min(crops.len());
        let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
        let signs =
            DMatrix::from_fn(
                crops.len(),
                n_directions,
                |_, _| if rng.next_u32() & 1 == 0 { -1.0 } else { 1.0 },
            );
        let mut directions = (&centered * signs).qr().q();
        for _ in 0..ROUNDS {
            directions = (&centered * centered.tr_mul(&directions)).qr().q();
        }
        let projected = directions.tr_mul(&centered);
        let eigen = SymmetricEigen::new(&projected * projected.transpose());
        let mut order: Vec<usize> = (0..n_directions).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let mut components = directions * eigen.eigenvectors.select_columns(&order[..n_components]);
        for mut component in components.column_iter_mut() {
            if component[component.icamax()] < 0.0 {
                component.neg_mut();
            }
        }
        Ok(Self { mean, components })
    }

    /// Known components, as read from a file: the mean crop and one row a component.
    ///
    /// # Errors
    /// When one has another length than a crop has pixels.
    pub fn from_parts(mean: Vec<f32>, components: &[Vec<f32>]) -> Result<Self, CropComponentsError> {
        check_length("the mean", mean.len())?;
        components.iter().try_for_each(|component| check_length("a component", component.len()))?;
        let columns = DMatrix::from_fn(mean.len(), components.len(), |pixel, index| components[index][pixel]);
        Ok(Self { mean: DVector::from_vec(mean), components: columns })
    }

    /// The mean crop, row after row.
    pub fn mean(&self) -> &[f32] {
        self.mean.as_slice()
    }

    /// The components in falling order of variance, each of length 1, row after row.
    pub fn components(&self) -> impl Iterator<Item = &[f32]> {
        self.components.as_slice().chunks_exact(self.mean.len())
    }
}

impl Descriptor for CropComponents {
    fn dimension(&self) -> usize {
        self.components.ncols()
    }

    fn describe(&self, mask: &Mask) -> Option<Vec<f64>> {
        let crop = DVector::from_vec(crop_coverage(mask)?) - &self.mean;
        Some(self.components.tr_mul(&crop).iter().map(|&value| f64::from(value)).collect())
    }
}

fn check_length(what: &'static str, found: usize) -> Result<(), CropComponentsError> {
    let expected = (CROP_WIDTH * CROP_HEIGHT) as usize;
    if found == expected { Ok(()) } else { Err(CropComponentsError::Length { what, found, expected }) }
}
