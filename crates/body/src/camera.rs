//! A calibrated camera: pinhole with radial and tangential distortion, placed in the world.

use glam::{DAffine3, DMat3, DQuat, DVec2, DVec3};

use crate::camera_lens::Lens;

/// How far `R Rᵀ` of a file's rotation may be from the identity: files round to few digits.
pub const ROTATION_TOLERANCE: f64 = 1e-3;

/// Points closer to the camera's plane than this are not seen. Metres.
const NEAREST_DEPTH_M: f64 = 1e-6;

/// What maps camera coordinates to pixels.
///
/// Pixel coordinates have their origin at the top-left corner of the image, so that the centre of the first
/// pixel is at (0.5, 0.5).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Focal lengths along x and y, pixels.
    pub focal_px: [f64; 2],
    /// Principal point from the top-left corner, pixels.
    pub principal_point_px: [f64; 2],
    /// `k1 k2 p1 p2 k3` of the distortion model of `[Brown1966]`, in OpenCV's order.
    pub distortion: [f64; 5],
}

impl Intrinsics {
    /// An undistorted camera with square pixels and its axis through the middle of the image.
    ///
    /// # Errors
    /// [`BadCamera`] for an empty image or a focal length that is not positive.
    pub fn from_focal(width: u32, height: u32, focal_px: f64) -> Result<Self, BadCamera> {
        let intrinsics = Self {
            width,
            height,
            focal_px: [focal_px; 2],
            principal_point_px: [f64::from(width) / 2.0, f64::from(height) / 2.0],
            distortion: [0.0; 5],
        };
        intrinsics.check()?;
        Ok(intrinsics)
    }

    /// As [`Intrinsics::from_focal`], from the angle between the left and the right edge of the image.
    ///
    /// # Errors
    /// [`BadCamera`] for an empty image or an angle outside 0 to π.
    pub fn from_horizontal_fov(width: u32, height: u32, fov_rad: f64) -> Result<Self, BadCamera> {
        if !(fov_rad > 0.0 && fov_rad < std::f64::consts::PI) {
            return Err(BadCamera::FieldOfView { fov_rad });
        }
        Self::from_focal(width, height, f64::from(width) / 2.0 / (fov_rad / 2.0).tan())
    }

    /// The camera that sees the same image resampled by `factor`: sizes are rounded to whole pixels, the rest
    /// follows the rounded sizes, so that image corners stay image corners.
    ///
    /// # Panics
    /// When `factor` is not positive and finite.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        assert!(factor > 0.0 && factor.is_finite(), "image scale is {factor}, expected a positive number");
        let resize = |pixels: u32| (f64::from(pixels) * factor).round().max(1.0) as u32;
        let (width, height) = (resize(self.width), resize(self.height));
        let scale = [f64::from(width) / f64::from(self.width), f64::from(height) / f64::from(self.height)];
        Self {
            width,
            height,
            focal_px: [self.focal_px[0] * scale[0], self.focal_px[1] * scale[1]],
            principal_point_px: [
                self.principal_point_px[0] * scale[0],
                self.principal_point_px[1] * scale[1],
            ],
            distortion: self.distortion,
        }
    }

    fn check(&self) -> Result<(), BadCamera> {
        if self.width == 0 || self.height == 0 {
            return Err(BadCamera::ImageSize { width: self.width, height: self.height });
        }
        if !self.focal_px.iter().all(|f| *f > 0.0 && f.is_finite()) {
            return Err(BadCamera::Focal { focal_px: self.focal_px });
        }
        if !self.principal_point_px.iter().all(|c| c.is_finite()) {
            return Err(BadCamera::PrincipalPoint { principal_point_px: self.principal_point_px });
        }
        if !self.distortion.iter().all(|k| k.is_finite()) {
            return Err(BadCamera::Distortion { distortion: self.distortion });
        }
        Ok(())
    }
}

/// A half-line in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Start, metres, world.
    pub origin: DVec3,
    /// Unit direction, world.
    pub direction: DVec3,
}

impl Ray {
    /// Where the ray meets the horizontal plane `z = height_m`, if it does ahead of its start.
    #[must_use]
    pub fn at_height(&self, height_m: f64) -> Option<DVec3> {
        let distance = (height_m - self.origin.z) / self.direction.z;
        (distance.is_finite() && distance > 0.0).then(|| self.origin + distance * self.direction)
    }
}

/// A camera with a place in the world. World: z up, metres; camera: x right, y down, z forward.
///
/// ```
/// use body::camera::{Camera, Intrinsics};
/// use glam::{DVec2, DVec3};
///
/// let intrinsics = Intrinsics::from_focal(640, 480, 700.0)?;
/// let camera = Camera::look_at(intrinsics, DVec3::new(0.0, -4.0, 1.0), DVec3::new(0.0, 0.0, 1.0))?;
/// let pixel = camera.project(DVec3::new(0.0, 0.0, 1.0)).expect("it is in front of the camera");
/// assert!(pixel.distance(DVec2::new(320.0, 240.0)) < 1e-9);
/// # Ok::<(), body::camera::BadCamera>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    intrinsics: Intrinsics,
    lens: Lens,
    rotation: DMat3,
    translation_m: DVec3,
}

impl Camera {
    /// A camera from `x_camera = rotation * x_world + translation_m`.
    ///
    /// A rotation within [`ROTATION_TOLERANCE`] is replaced by the nearest exact one.
    ///
    /// # Errors
    /// [`BadCamera`] names the first value that cannot be: sizes, focal lengths, rotation, anything not finite.
    pub fn new(intrinsics: Intrinsics, rotation: DMat3, translation_m: DVec3) -> Result<Self, BadCamera> {
        intrinsics.check()?;
        let rotation = nearest_rotation(rotation)?;
        if !translation_m.is_finite() {
            return Err(BadCamera::Translation { translation_m: translation_m.to_array() });
        }
        Ok(Self { intrinsics, lens: Lens::new(intrinsics.distortion), rotation, translation_m })
    }

    /// A camera at `eye` whose axis goes through `target`, held upright (its x axis is horizontal).
    ///
    /// # Errors
    /// [`BadCamera`]; looking straight up or down is refused, as upright then means nothing.
    pub fn look_at(intrinsics: Intrinsics, eye: DVec3, target: DVec3) -> Result<Self, BadCamera> {
        let forward = (target - eye).normalize_or_zero();
        let right = forward.cross(DVec3::Z).normalize_or_zero();
        if right == DVec3::ZERO {
            return Err(BadCamera::NoHeading { eye: eye.to_array(), target: target.to_array() });
        }
        let down = forward.cross(right);
        let rotation = DMat3::from_cols(right, down, forward).transpose();
        Self::new(intrinsics, rotation, -(rotation * eye))
    }

    /// What to assume of a camera that nobody calibrated: upright at `height_m` above the world's origin,
    /// looking along +y and down by `pitch_down_rad`.
    ///
    /// # Errors
    /// [`BadCamera`] for bad intrinsics or a pitch of a right angle or more.
    pub fn upright(intrinsics: Intrinsics, height_m: f64, pitch_down_rad: f64) -> Result<Self, BadCamera> {
        if pitch_down_rad.is_nan() || pitch_down_rad.abs() >= std::f64::consts::FRAC_PI_2 {
            return Err(BadCamera::Pitch { pitch_down_rad });
        }
        let eye = DVec3::new(0.0, 0.0, height_m);
        let (sin, cos) = pitch_down_rad.sin_cos();
        Self::look_at(intrinsics, eye, eye + DVec3::new(0.0, cos, -sin))
    }

    /// The lens and image part.
    #[must_use]
    pub fn intrinsics(&self) -> &Intrinsics {
        &self.intrinsics
    }

    /// The rigid motion from world to camera coordinates, metres.
    #[must_use]
    pub fn camera_from_world(&self) -> DAffine3 {
        DAffine3::from_mat3_translation(self.rotation, self.translation_m)
    }

    /// The rotation of [`Camera::camera_from_world`].
    #[must_use]
    pub fn rotation(&self) -> DMat3 {
        self.rotation
    }

    /// The translation of [`Camera::camera_from_world`], metres.
    #[must_use]
    pub fn translation_m(&self) -> DVec3 {
        self.translation_m
    }

    /// The centre of projection, metres, world.
    #[must_use]
    pub fn centre_world(&self) -> DVec3 {
        -(self.rotation.transpose() * self.translation_m)
    }

    /// The pixel that shows a world point, which may lie outside the image. `None` behind the camera and
    /// beyond the radius at which the distortion model folds over.
    #[must_use]
    pub fn project(&self, point_world: DVec3) -> Option<DVec2> {
        self.project_from_camera(self.rotation * point_world + self.translation_m)
    }

    /// As [`Camera::project`], for a point in camera coordinates, metres.
    #[must_use]
    pub fn project_from_camera(&self, point_camera: DVec3) -> Option<DVec2> {
        if point_camera.z.is_nan() || point_camera.z < NEAREST_DEPTH_M {
            return None;
        }
        let distorted = self.lens.distort(point_camera.truncate() / point_camera.z)?;
        Some(
            distorted * DVec2::from(self.intrinsics.focal_px)
                + DVec2::from(self.intrinsics.principal_point_px),
        )
    }

    /// The point (x, y) at depth 1 in camera coordinates that a pixel shows; `None` where the distortion
    /// model reaches no pixel.
    #[must_use]
    pub fn undistort(&self, pixel: DVec2) -> Option<DVec2> {
        let distorted =
            (pixel - DVec2::from(self.intrinsics.principal_point_px)) / DVec2::from(self.intrinsics.focal_px);
        self.lens.undistort(distorted)
    }

    /// The ray from the camera's centre through a pixel.
    #[must_use]
    pub fn ray(&self, pixel: DVec2) -> Option<Ray> {
        let direction_camera = self.undistort(pixel)?.extend(1.0).normalize();
        Some(Ray { origin: self.centre_world(), direction: self.rotation.transpose() * direction_camera })
    }

    /// The same camera on the image resampled by `factor` (see [`Intrinsics::scaled`]).
    ///
    /// # Panics
    /// When `factor` is not positive and finite.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        Self { intrinsics: self.intrinsics.scaled(factor), ..*self }
    }
}

/// The rotation nearest to `matrix`, if that is a rotation but for rounding.
fn nearest_rotation(matrix: DMat3) -> Result<DMat3, BadCamera> {
    let bad =
        |determinant: f64| BadCamera::Rotation { rows: matrix.transpose().to_cols_array_2d(), determinant };
    let determinant = matrix.determinant();
    let error = matrix * matrix.transpose() - DMat3::IDENTITY;
    let within = error.to_cols_array().iter().all(|e| e.abs() <= ROTATION_TOLERANCE); // false for NaN
    if within && determinant > 0.0 {
        Ok(DMat3::from_quat(DQuat::from_mat3(&matrix).normalize()))
    } else {
        Err(bad(determinant))
    }
}

/// Why a camera cannot be.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum BadCamera {
    /// An image without pixels.
    #[error("image size is {width} x {height}, expected at least 1 x 1 pixels")]
    ImageSize { width: u32, height: u32 },
    /// A focal length that is not positive and finite.
    #[error("focal length is {focal_px:?} px, expected two positive numbers")]
    Focal { focal_px: [f64; 2] },
    /// A field of view that no pinhole camera has.
    #[error("field of view is {fov_rad} rad, expected more than 0 and less than pi")]
    FieldOfView { fov_rad: f64 },
    /// A principal point that is not finite.
    #[error("principal point is {principal_point_px:?} px, expected two finite numbers")]
    PrincipalPoint { principal_point_px: [f64; 2] },
    /// Distortion that is not finite.
    #[error("distortion is {distortion:?}, expected five finite numbers k1 k2 p1 p2 k3")]
    Distortion { distortion: [f64; 5] },
    /// A matrix that is no rotation.
    #[error(
        "rotation is {rows:?} with determinant {determinant:.3}, expected orthonormal rows with determinant 1 ± {ROTATION_TOLERANCE}"
    )]
    Rotation { rows: [[f64; 3]; 3], determinant: f64 },
    /// A translation that is not finite.
    #[error("translation is {translation_m:?} m, expected three finite numbers")]
    Translation { translation_m: [f64; 3] },
    /// A viewing direction for which "upright" says nothing.
    #[error("camera at {eye:?} looks at {target:?}, expected a direction that is not vertical")]
    NoHeading { eye: [f64; 3], target: [f64; 3] },
    /// A pitch of a right angle or more.
    #[error("pitch is {pitch_down_rad} rad, expected less than a right angle up or down")]
    Pitch { pitch_down_rad: f64 },
}

#[cfg(test)]
mod tests;
