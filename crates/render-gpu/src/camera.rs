//! The pinhole camera with lens distortion, as plain numbers.

/// The widest and tallest image that can be scored, in pixels.
pub const MAX_IMAGE_SIDE: u32 = 32_767;

/// A pinhole camera with radial and tangential distortion (the model of OpenCV), for meshes in the camera frame.
///
/// Camera frame: x right, y down, z forward, metres. Image: pixels, origin at the top-left *corner*, so that
/// pixel centres lie at +0.5 (the principal point of an OpenCV file is 0.5 smaller).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Focal lengths along x and y, pixels.
    pub focal_px: [f64; 2],
    /// Principal point, pixels from the top-left corner.
    pub principal_point_px: [f64; 2],
    /// k1, k2, p1, p2, k3 of normalised image coordinates; all zero for an ideal lens.
    pub distortion: [f64; 5],
}

/// Why an [`Intrinsics`] cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CameraError {
    /// The image has no pixel or is too large.
    #[error("the image is {width} x {height} px, expected sides of 1 to {MAX_IMAGE_SIDE} px")]
    ImageSize {
        /// Image width, pixels.
        width: u32,
        /// Image height, pixels.
        height: u32,
    },
    /// A focal length is not a positive finite number.
    #[error("`focal_px` is {focal_px:?}, expected two positive numbers")]
    Focal {
        /// The focal lengths as given.
        focal_px: [f64; 2],
    },
    /// The principal point is not finite.
    #[error("`principal_point_px` is {principal_point_px:?}, expected two finite numbers")]
    PrincipalPoint {
        /// The principal point as given.
        principal_point_px: [f64; 2],
    },
    /// A distortion coefficient is not finite.
    #[error("`distortion` is {distortion:?}, expected five finite numbers")]
    Distortion {
        /// The coefficients as given.
        distortion: [f64; 5],
    },
}

impl Intrinsics {
    /// An ideal lens of focal length `focal_px` pixels that looks through the middle of the image.
    pub fn centred(width: u32, height: u32, focal_px: f64) -> Self {
        Self {
            width,
            height,
            focal_px: [focal_px; 2],
            principal_point_px: [f64::from(width) / 2.0, f64::from(height) / 2.0],
            distortion: [0.0; 5],
        }
    }

    pub(crate) fn check(&self) -> Result<(), CameraError> {
        let &Self { width, height, focal_px, principal_point_px, distortion } = self;
        if [width, height].iter().any(|side| !(1..=MAX_IMAGE_SIDE).contains(side)) {
            return Err(CameraError::ImageSize { width, height });
        }
        if !focal_px.iter().all(|&f| f > 0.0 && f.is_finite()) {
            return Err(CameraError::Focal { focal_px });
        }
        if !principal_point_px.iter().all(|c| c.is_finite()) {
            return Err(CameraError::PrincipalPoint { principal_point_px });
        }
        if !distortion.iter().all(|k| k.is_finite()) {
            return Err(CameraError::Distortion { distortion });
        }
        Ok(())
    }
}
