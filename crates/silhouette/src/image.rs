//! Colour images: the borrowed 8-bit view that callers hand in, and the working planes that the models compute on.

/// A borrowed image of 8-bit RGB triples, row after row without padding.
#[derive(Clone, Copy, Debug)]
pub struct RgbView<'a> {
    /// Columns, pixels.
    pub width: u32,
    /// Rows, pixels.
    pub height: u32,
    /// `[height][width][3]`, gamma-coded as the camera gives it.
    pub data: &'a [u8],
}

/// An image whose data do not fill its size.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{found} bytes for an RGB image of {width} x {height}, expected {expected}")]
pub struct RgbSizeError {
    /// Columns, pixels.
    pub width: u32,
    /// Rows, pixels.
    pub height: u32,
    /// Bytes given.
    pub found: usize,
    /// Bytes that the size asks for.
    pub expected: usize,
}

impl<'a> RgbView<'a> {
    /// A view of `data`.
    ///
    /// # Errors
    /// When `data` does not hold three bytes a pixel.
    pub fn new(width: u32, height: u32, data: &'a [u8]) -> Result<Self, RgbSizeError> {
        let expected = 3 * width as usize * height as usize;
        if data.len() == expected {
            Ok(Self { width, height, data })
        } else {
            Err(RgbSizeError { width, height, found: data.len(), expected })
        }
    }
}

/// The size of a camera's frames and by how much they are reduced before work begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Geometry {
    /// Columns of a frame, pixels.
    pub width: u32,
    /// Rows of a frame, pixels.
    pub height: u32,
    /// A working pixel is the mean of `reduction` by `reduction` pixels of the frame.
    pub reduction: u32,
}

impl Geometry {
    /// Frames of up to this many pixels are worked on as they are.
    const MAX_WORKING_PIXELS: u64 = 640_000;

    /// Frames of `width` by `height` pixels, reduced by the least factor that leaves a moderate number of pixels:
    /// a VGA frame stays as it is, full HD is halved.
    ///
    /// ```
    /// use silhouette::Geometry;
    /// assert_eq!(Geometry::for_frames(640, 480).reduction, 1);
    /// assert_eq!(Geometry::for_frames(1920, 1080).reduction, 2);
    /// ```
    pub fn for_frames(width: u32, height: u32) -> Self {
        let pixels_at = |factor: u32| u64::from(width / factor) * u64::from(height / factor);
        let mut reduction = 1;
        while pixels_at(reduction) > Self::MAX_WORKING_PIXELS {
            reduction += 1;
        }
        Self { width, height, reduction }
    }

    /// Columns of a working image, pixels; columns that do not fill a working pixel are left out.
    pub fn working_width(&self) -> u32 {
        self.width / self.reduction
    }

    /// Rows of a working image, pixels; rows that do not fill a working pixel are left out.
    pub fn working_height(&self) -> u32 {
        self.height / self.reduction
    }

    /// Pixels of a working image.
    pub fn working_pixels(&self) -> usize {
        self.working_width() as usize * self.working_height() as usize
    }

    /// Whether `frame` has this size.
    pub fn fits(&self, frame: &RgbView<'_>) -> bool {
        (frame.width, frame.height) == (self.width, self.height)
    }

    fn check(&self, frame: &RgbView<'_>) {
        assert!(
            self.fits(frame),
            "a frame of {} x {} pixels where {} x {} were promised",
            frame.width,
            frame.height,
            self.width,
            self.height
        );
    }
}

/// A working image: red, green and blue apart, in grey levels from 0 to 255.
#[derive(Clone, Debug, PartialEq)]
pub struct RgbPlanes {
    /// Columns, pixels.
    pub width: usize,
    /// Rows, pixels.
    pub height: usize,
    /// `[3][height * width]`, grey levels.
    pub planes: [Vec<f32>; 3],
}

impl RgbPlanes {
    /// A black image of the working size.
    pub fn black(geometry: Geometry) -> Self {
        let plane = vec![0.0; geometry.working_pixels()];
        Self {
            width: geometry.working_width() as usize,
            height: geometry.working_height() as usize,
            planes: [plane.clone(), plane.clone(), plane],
        }
    }

    /// Red, green and blue of the pixel of index `y * width + x`.
    pub fn color(&self, pixel: usize) -> [f32; 3] {
        [self.planes[0][pixel], self.planes[1][pixel], self.planes[2][pixel]]
    }

    /// `frame` reduced to the working size.
    ///
    /// # Panics
    /// When the frame has another size than `geometry` says.
    pub fn from_view(frame: &RgbView<'_>, geometry: Geometry) -> Self {
        let mut image = Self::black(geometry);
        image.fill_from(frame, geometry);
        image
    }

    /// Overwrites this working image by `frame`, reduced.
    ///
    /// # Panics
    /// When the frame has another size than `geometry` says.
    pub fn fill_from(&mut self, frame: &RgbView<'_>, geometry: Geometry) {
        geometry.check(frame);
        let reduction = geometry.reduction as usize;
        let share = 1.0 / (reduction * reduction) as f32;
        let frame_stride = 3 * frame.width as usize;
        let mut sums = vec![0u16; 3 * self.width * reduction];
        for y in 0..self.height {
            sums.fill(0);
            for row in frame.data.chunks_exact(frame_stride).skip(y * reduction).take(reduction) {
                sums.iter_mut().zip(row).for_each(|(sum, &byte)| *sum += u16::from(byte));
            }
            let [red, green, blue] =
                self.planes.each_mut().map(|plane| &mut plane[y * self.width..][..self.width]);
            let pixels: &[[u16; 3]] = sums.as_chunks().0;
            for (x, block) in pixels.chunks_exact(reduction).enumerate() {
                let mut sum = [0u32; 3];
                for pixel in block {
                    sum.iter_mut().zip(pixel).for_each(|(sum, &value)| *sum += u32::from(value));
                }
                [red[x], green[x], blue[x]] = sum.map(|sum| sum as f32 * share);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_block_means() {
        let data: Vec<u8> = (0..5 * 3 * 3).map(|i| (i * 5) as u8).collect();
        let view = RgbView::new(5, 3, &data).unwrap();
        let image = RgbPlanes::from_view(&view, Geometry { width: 5, height: 3, reduction: 2 });
        assert_eq!((image.width, image.height), (2, 1));
        for (channel, plane) in image.planes.iter().enumerate() {
            for (x, &value) in plane.iter().enumerate() {
                let corners = [(0, 0), (1, 0), (0, 1), (1, 1)]
                    .map(|(dx, dy)| f32::from(data[3 * (dy * 5 + 2 * x + dx) + channel]));
                assert_eq!(value, corners.iter().sum::<f32>() / 4.0);
            }
        }
    }

    #[test]
    fn sizes_are_checked() {
        let error = RgbView::new(4, 2, &[0; 23]).unwrap_err();
        assert_eq!(error.to_string(), "23 bytes for an RGB image of 4 x 2, expected 24");
    }
}
