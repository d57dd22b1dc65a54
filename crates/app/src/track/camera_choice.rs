//! The camera of a clip: calibrated, or assumed from a focal length.

use std::path::PathBuf;

use anyhow::{Context as _, bail};
use body::io::cameras::load_camera;
use body::{Camera, Intrinsics};

use crate::input::SourceInfo;

/// Height above the floor of a camera that is assumed, metres: a tripod's.
const ASSUMED_HEIGHT_M: f64 = 1.5;

/// How the camera is known.
#[derive(Clone, Debug, PartialEq)]
pub enum CameraChoice {
    /// A calibration file.
    File(PathBuf),
    /// Focal length in pixels; the rest is assumed.
    Focal(f64),
    /// Horizontal field of view in degrees; the rest is assumed.
    FieldOfView(f64),
}

/// A camera, and what had to be assumed to have one.
#[derive(Clone, Debug)]
pub struct KnownCamera {
    /// The camera at the resolution of the clip.
    pub camera: Camera,
    /// Rate of the clip, where the calibration says it, frames a second.
    pub fps: Option<f64>,
    /// A line for the user on each assumption.
    pub assumptions: Vec<String>,
}

impl CameraChoice {
    /// The camera of a clip.
    ///
    /// # Errors
    /// When the file cannot be used, leaves out where the camera stands, or is for images of another size.
    pub fn resolve(&self, clip: &SourceInfo) -> anyhow::Result<KnownCamera> {
        let intrinsics = match self {
            Self::File(path) => {
                let file = load_camera(path)?;
                let camera = file.camera().with_context(|| {
                    format!(
                        "{}: has no `rotation` and `translation_m`, expected where the camera stands",
                        path.display()
                    )
                })?;
                let size = (camera.intrinsics().width, camera.intrinsics().height);
                if size != (clip.width, clip.height) {
                    bail!(
                        "{}: `image_size` is {} x {}, expected {} x {} as {}",
                        path.display(),
                        size.0,
                        size.1,
                        clip.width,
                        clip.height,
                        clip.path.display()
                    );
                }
                return Ok(KnownCamera { camera, fps: file.frame_rate_hz, assumptions: Vec::new() });
            }
            Self::Focal(focal_px) => Intrinsics::from_focal(clip.width, clip.height, *focal_px)
                .with_context(|| format!("`--focal-px` is {focal_px}"))?,
            Self::FieldOfView(fov_deg) => {
                Intrinsics::from_horizontal_fov(clip.width, clip.height, fov_deg.to_radians())
                    .with_context(|| format!("`--fov-deg` is {fov_deg}"))?
            }
        };
        let assumption = format!(
            "a level, upright camera {ASSUMED_HEIGHT_M} m above the floor, focal length {:.0} px, no distortion; \
             positions are relative to it",
            intrinsics.focal_px[0]
        );
        let camera = Camera::upright(intrinsics, ASSUMED_HEIGHT_M, 0.0)?;
        Ok(KnownCamera { camera, fps: None, assumptions: vec![assumption] })
    }
}
