//! The figure cut out, scaled to one height, as distances from its outline, and their principal components: plainer than shape contexts, and a hard
//! rival to beat.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};

use super::Descriptor;
use crate::mask::Mask;

/// Columns of the crop.
pub const CROP_WIDTH: u32 = 48;
/// Rows of the crop: the figure's height.
pub const CROP_HEIGHT: u32 = 96;
/// Distances from the outline beyond this many pixels of the crop are not told apart.
pub const FARTHEST_PX: f32 = 6.0;
/// Directions searched for each one asked for: the last ones settle slowly where variances fall slowly `[Halko2011]`.
const OVERSAMPLING: usize = 2;
/// Rounds of subspace iteration.
const ROUNDS: usize = 4;

/// Signed distance from the outline of each pixel of the figure scaled to [`CROP_HEIGHT`] rows, positive inside, in units
/// of [`FARTHEST_PX`] and cut off there, row after row; `None` without a person.
///
/// The crop is as high as the figure's bounding box and half as wide, its middle is the centroid; what reaches farther
/// out is cut off. Distances rather than coverage: a limb that moves by its own width is then near where it was, and
/// the same regressions come 10 mm closer to the true pose.
pub fn crop_distances(mask: &Mask) -> Option<Vec<f32>> {
    let figure = mask.crop(mask.bounding_box()?);
    let middle = figure.centroid_px()?[0];
    // Doubled, so that half pixels are whole.
    let figure = figure.enlarged(2);
    let width = (figure.height() * CROP_WIDTH / CROP_HEIGHT).max(1);
    let x0 = (2.0 * middle).round() as i64 - i64::from(width / 2);
    let mut crop = Mask::new(width, figure.height());
    let column = |x: u32| (i64::from(x) - x0).clamp(0, i64::from(width)) as u32;
    for y in 0..figure.height() {
        figure.runs(y).for_each(|(first, end)| crop.fill_run(y, column(first), column(end)));
    }
    let is_inside: Vec<bool> =
        crop.coverage(CROP_WIDTH, CROP_HEIGHT).iter().map(|&share| share >= 0.5).collect();
    Some(signed_distances(&is_inside))
}

/// Exact distances to the nearest pixel of the other kind, less the half that lies beyond the outline: along columns
/// first, then the least over each row's neighbours.
fn signed_distances(is_inside: &[bool]) -> Vec<f32> {
    let (width, height) = (CROP_WIDTH as usize, CROP_HEIGHT as usize);
    let reach = FARTHEST_PX as usize + 1;
    let mut distances = vec![0.0; is_inside.len()];
    // For both kinds: how far along its column each pixel is from the nearest pixel that is not of that kind.
    for kind in [true, false] {
        let mut along_column = vec![reach; is_inside.len()];
        for x in 0..width {
            let mut since = reach;
            for y in 0..height {
                since = if is_inside[y * width + x] == kind { (since + 1).min(reach) } else { 0 };
                along_column[y * width + x] = since;
            }
            since = reach;
            for y in (0..height).rev() {
                since = if is_inside[y * width + x] == kind { (since + 1).min(reach) } else { 0 };
                along_column[y * width + x] = since.min(along_column[y * width + x]);
            }
        }
        for (at, distance) in distances.iter_mut().enumerate().filter(|(at, _)| is_inside[*at] == kind) {
            let (x, row) = (at % width, at - at % width);
            let neighbours = x.saturating_sub(reach)..(x + reach + 1).min(width);
            let square = neighbours
                .map(|other| along_column[row + other].pow(2) + other.abs_diff(x).pow(2))
                .min()
                .unwrap_or(reach * reach);
            let length = ((square as f32).sqrt() - 0.5).min(FARTHEST_PX) / FARTHEST_PX;
            *distance = if kind { length } else { -length };
        }
    }
    distances
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
    /// Learns from the crops of many masks ([`crop_distances`]) by randomised subspace iteration `[Halko2011]`.
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
        let crop = DVector::from_vec(crop_distances(mask)?) - &self.mean;
        Some(self.components.tr_mul(&crop).iter().map(|&value| f64::from(value)).collect())
    }
}

fn check_length(what: &'static str, found: usize) -> Result<(), CropComponentsError> {
    let expected = (CROP_WIDTH * CROP_HEIGHT) as usize;
    if found == expected { Ok(()) } else { Err(CropComponentsError::Length { what, found, expected }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_of_a_box_are_known() {
        // A box of 24 x 96 crop pixels, its walls at x = 12 and x = 36.
        let mask = Mask::from_fn(200, 200, |x, y| (50..74).contains(&x) && (40..136).contains(&y));
        let distances = crop_distances(&mask).unwrap();
        let at = |x: usize, y: usize| distances[y * CROP_WIDTH as usize + x] * FARTHEST_PX;
        for (x, expected) in [(12, 0.5), (13, 1.5), (17, 5.5), (24, 6.0), (11, -0.5), (8, -3.5), (0, -6.0)] {
            assert!((at(x, 48) - expected).abs() < 1e-5, "x {x}: {}", at(x, 48));
        }
    }

    #[test]
    fn distances_agree_with_a_search_of_all_pixels() {
        let (width, height) = (CROP_WIDTH as usize, CROP_HEIGHT as usize);
        let is_inside: Vec<bool> =
            (0..width * height).map(|i| (i * 7919 / 13) % 17 < 9 && (i % width) / 7 % 2 == 0).collect();
        let distances = signed_distances(&is_inside);
        for (at, distance) in distances.iter().enumerate() {
            let others = (0..width * height).filter(|&other| is_inside[other] != is_inside[at]);
            let nearest = others.map(|other| {
                let (dx, dy) = ((other % width).abs_diff(at % width), (other / width).abs_diff(at / width));
                ((dx * dx + dy * dy) as f32).sqrt()
            });
            let expected = (nearest.fold(f32::INFINITY, f32::min) - 0.5).min(FARTHEST_PX) / FARTHEST_PX;
            assert!((distance.abs() - expected).abs() < 1e-6 && (*distance > 0.0) == is_inside[at]);
        }
    }
}
