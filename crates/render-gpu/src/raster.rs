//! The whole silhouette of one mesh, for overlays and fixtures.

use crate::camera::{CameraError, Intrinsics};
use crate::exact::SpanFiller;
use crate::project::Projector;
use crate::rows::{RowStep, ScanLines};
use crate::scorer::MaskView;
use crate::topology::{TopologyError, check_vertices};

/// A silhouette as bits, laid out as a [`MaskView`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Silhouette {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Words from one row to the next.
    pub words_per_row: usize,
    /// The bits, `[height * words_per_row]`; those past the width are zero.
    pub words: Vec<u64>,
}

impl Silhouette {
    /// The same bits, borrowed.
    pub fn view(&self) -> MaskView<'_> {
        let &Self { width, height, words_per_row, ref words } = self;
        MaskView { width, height, words_per_row, words }
    }

    /// Whether the centre of pixel `(x, y)` is inside.
    ///
    /// # Panics
    /// When the pixel is outside the image.
    pub fn contains(&self, x: u32, y: u32) -> bool {
        assert!(
            x < self.width && y < self.height,
            "pixel ({x}, {y}) of a {} x {} px image",
            self.width,
            self.height
        );
        self.words[y as usize * self.words_per_row + x as usize / 64] >> (x % 64) & 1 == 1
    }
}

/// Why a mesh cannot be drawn.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RasterizeError {
    /// The camera has impossible numbers.
    #[error("the camera cannot be used")]
    Camera(#[from] CameraError),
    /// A triangle names a vertex that does not exist.
    #[error("the triangles do not fit the vertices")]
    Triangles(#[from] TopologyError),
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} is not finite")]
    NotFinite {
        /// The first such vertex.
        vertex: usize,
    },
}

/// Draws the silhouette of one mesh by the rule that the scorers count by. The mesh need not be closed.
///
/// `positions_camera` in metres, camera frame.
pub fn rasterize(
    positions_camera: &[[f32; 3]],
    triangles: &[[u32; 3]],
    camera: &Intrinsics,
) -> Result<Silhouette, RasterizeError> {
    camera.check()?;
    check_vertices(triangles, positions_camera.len())?;
    let projector = Projector::new(camera);
    let lines = ScanLines::new(camera.height, RowStep::EVERY, projector.origin[1]);
    let words_per_row = camera.width.div_ceil(64) as usize;
    let mut words = vec![0; camera.height as usize * words_per_row];
    SpanFiller::default()
        .spans(&projector, &lines, camera.width, positions_camera, triangles, |span| {
            fill(&mut words[span.line * words_per_row..][..words_per_row], span.start, span.end);
        })
        .map_err(|bad| RasterizeError::NotFinite { vertex: bad.vertex })?;
    Ok(Silhouette { width: camera.width, height: camera.height, words_per_row, words })
}

/// Sets the bits `start..end` of a row; `start < end`.
fn fill(row: &mut [u64], start: u32, end: u32) {
    let (first, last) = ((start / 64) as usize, ((end - 1) / 64) as usize);
    for (word, bits) in row.iter_mut().enumerate().take(last + 1).skip(first) {
        let from = if word == first { start % 64 } else { 0 };
        let to = if word == last { (end - 1) % 64 } else { 63 };
        *bits |= (!0 >> (63 - to)) & (!0 << from);
    }
}
