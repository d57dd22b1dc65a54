//! The pipeline: light, evidence, smoothing, clean-up, person, outline.

use super::evidence::{Evidence, EvidenceConfig};
use super::outline;
use super::smooth::{Smoother, SmoothingConfig};
use crate::background::{BackgroundModel, IlluminationMatch, IlluminationReport};
use crate::clean::{PersonTracker, PersonTrackerConfig, Window};
use crate::image::{Geometry, RgbPlanes, RgbView};
use crate::mask::Mask;

/// Settings of [`Segmenter`]. Lengths are in working pixels.
#[derive(Clone, Debug)]
pub struct SegmenterConfig {
    /// What counts as different from the background.
    pub evidence: EvidenceConfig,
    /// How evidence is shared among neighbours.
    pub smoothing: SmoothingConfig,
    /// Pieces thinner than this go, pixels.
    pub open_px: u32,
    /// Cracks thinner than this are closed, pixels.
    pub close_px: u32,
    /// Holes of up to this share of the person are filled unless the background shows clearly in them.
    pub hole_share: f64,
    /// Which components are the person.
    pub person: PersonTrackerConfig,
    /// The light and the background are not learned this close to the person, pixels.
    pub keep_off_px: u32,
}

impl Default for SegmenterConfig {
    fn default() -> Self {
        Self {
            evidence: EvidenceConfig::default(),
            smoothing: SmoothingConfig::default(),
            open_px: 2,
            close_px: 5,
            hole_share: 0.02,
            person: PersonTrackerConfig::default(),
            keep_off_px: 8,
        }
    }
}

/// A setting outside its range.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("`{field}` is {value}, expected {expected}")]
pub struct SegmenterParamsError {
    /// Name of the setting.
    pub field: &'static str,
    /// Its value.
    pub value: f64,
    /// Its range.
    pub expected: &'static str,
}

/// Checked settings of [`Segmenter`].
#[derive(Clone, Debug)]
pub struct SegmenterParams(SegmenterConfig);

impl SegmenterParams {
    /// Checks the settings.
    ///
    /// # Errors
    /// When one lies outside its range.
    pub fn new(config: SegmenterConfig) -> Result<Self, SegmenterParamsError> {
        let (evidence, smoothing, person) = (&config.evidence, &config.smoothing, &config.person);
        let positive = [
            ("evidence.threshold_sd", f64::from(evidence.threshold_sd)),
            ("evidence.noise_factor", f64::from(evidence.noise_factor)),
            ("evidence.minimum_noise", f64::from(evidence.minimum_noise)),
            ("smoothing.reach_px", f64::from(smoothing.reach_px)),
            ("smoothing.contrast", f64::from(smoothing.contrast)),
        ];
        for (field, value) in positive {
            if !(value > 0.0 && value.is_finite()) {
                return Err(SegmenterParamsError {
                    field,
                    value,
                    expected: "a number above 0",
                });
            }
        }
        let shares = [
            ("evidence.darkest_shadow", f64::from(evidence.darkest_shadow)),
            ("hole_share", config.hole_share),
            ("person.minimum_share", person.minimum_share),
            ("person.piece_share", person.piece_share),
            ("person.piece_gap", person.piece_gap),
            ("person.piece_overlap", person.piece_overlap),
        ];
        for (field, value) in shares {
            if !(0.0..=1.0).contains(&value) {
                return Err(SegmenterParamsError {
                    field,
                    value,
                    expected: "a share from 0 to 1",
                });
            }
        }
        let not_negative = [
            ("evidence.edge_jitter_px", f64::from(evidence.edge_jitter_px)),
            ("evidence.shadow_cost", f64::from(evidence.shadow_cost)),
        ];
        for (field, value) in not_negative {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(SegmenterParamsError {
                    field,
                    value,
                    expected: "0 or more",
                });
            }
        }
        Ok(Self(config))
    }
}

/// A frame that cannot be segmented.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SegmentError {
    /// The frame has another size than the background.
    #[error(
        "the frame has {width} x {height} pixels, expected {expected_width} x {expected_height} as the background"
    )]
    FrameSize {
        /// Columns of the frame.
        width: u32,
        /// Rows of the frame.
        height: u32,
        /// Columns of the background.
        expected_width: u32,
        /// Rows of the background.
        expected_height: u32,
    },
}

/// How a frame's mask came about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Diagnostics {
    /// Light and noise of the frame against the background.
    pub illumination: IlluminationReport,
    /// Pixels of the frame unlike the background, person or not, as a share of the image.
    pub changed_share: f64,
    /// Pixels of the person as a share of the image.
    pub person_share: f64,
}

/// A frame's person.
#[derive(Clone, Debug)]
pub struct Segmentation {
    /// The person, in the frame's size; empty when there is none.
    pub mask: Mask,
    /// How it came about.
    pub diagnostics: Diagnostics,
}

/// Cuts the person out of frame after frame of one camera.
pub struct Segmenter {
    config: SegmenterConfig,
    model: Box<dyn BackgroundModel>,
    geometry: Geometry,
    frame: RgbPlanes,
    illumination: IlluminationMatch,
    evidence: Evidence,
    smoother: Smoother,
    tracker: PersonTracker,
}

impl Segmenter {
    /// A segmenter before its first frame.
    pub fn new(params: SegmenterParams, model: Box<dyn BackgroundModel>) -> Self {
        let SegmenterParams(config) = params;
        let geometry = model.geometry();
        let frame = RgbPlanes::black(geometry);
        Self {
            illumination: IlluminationMatch::new(&frame),
            evidence: Evidence::new(geometry.working_pixels()),
            smoother: Smoother::new(frame.width, frame.height),
            tracker: PersonTracker::new(config.person.clone()),
            config,
            model,
            geometry,
            frame,
        }
    }

    /// The person in `frame`, the next one of the clip.
    ///
    /// # Errors
    /// When the frame has another size than the background.
    pub fn segment(&mut self, frame: &RgbView<'_>) -> Result<Segmentation, SegmentError> {
        if !self.geometry.fits(frame) {
            return Err(SegmentError::FrameSize {
                width: frame.width,
                height: frame.height,
                expected_width: self.geometry.width,
                expected_height: self.geometry.height,
            });
        }
        self.frame.fill_from(frame, self.geometry);
        let (changed, illumination) = self.changed_pixels();
        let person = self.person_of(&changed);
        self.model.learn(
            &self.frame,
            &person.dilated(Window::radius(self.config.keep_off_px)),
        );
        let coverage = outline::coverage(&person, &self.frame, self.illumination.matched());
        let Geometry {
            width,
            height,
            reduction,
        } = self.geometry;
        let mask = outline::enlarged_half(&coverage, self.frame.width, reduction, width, height);
        let n_pixels = self.geometry.working_pixels() as f64;
        let diagnostics = Diagnostics {
            illumination,
            changed_share: changed.area() as f64 / n_pixels,
            person_share: person.area() as f64 / n_pixels,
        };
        Ok(Segmentation { mask, diagnostics })
    }

    /// The pixels that are neither background nor its shadow.
    fn changed_pixels(&mut self) -> (Mask, IlluminationReport) {
        let (width, height) = (self.frame.width as u32, self.frame.height as u32);
        let keep_off = Window::radius(self.config.keep_off_px);
        let last_person = self
            .tracker
            .previous()
            .map_or_else(|| Mask::new(width, height), |m| m.dilated(keep_off));
        let expected = self.model.expected(&self.frame);
        let report = self.illumination.fit(&self.frame, expected.mean, &last_person);
        let background = self.illumination.matched();
        self.evidence.score(
            &self.frame,
            background,
            expected.noise,
            report.noise_sd,
            &self.config.evidence,
        );
        let score = &mut self.evidence.score;
        self.smoother
            .smooth(score, &self.frame, background, &self.config.smoothing);
        let changed = Mask::from_fn(width, height, |x, y| {
            score[y as usize * width as usize + x as usize] > 0.0
        });
        (changed, report)
    }

    /// The person among the changed pixels, without cracks and holes.
    fn person_of(&mut self, changed: &Mask) -> Mask {
        let person = self.tracker.follow(&changed.opened(self.config.open_px));
        let mut whole = person.closed(self.config.close_px);
        let (holes, is_hole) = whole.holes();
        let mut sums = vec![0.0f64; holes.all().len()];
        holes.for_each_run(|hole, y, x0, x1| {
            let row = y as usize * self.frame.width;
            let scores = &self.evidence.score[row + x0 as usize..row + x1 as usize];
            sums[hole] += scores.iter().map(|&score| f64::from(score)).sum::<f64>();
        });
        let largest = (self.config.hole_share * whole.area() as f64) as u64;
        whole.union_with(&holes.select(|hole| {
            let area = holes.all()[hole].area;
            // A gap between arm and trunk shows the background clearly; a hole in the evidence does not.
            let is_weak = sums[hole] / area as f64 > -f64::from(super::SCORE_LIMIT) / 2.0;
            is_hole[hole] && area <= largest && is_weak
        }));
        whole
    }
}
