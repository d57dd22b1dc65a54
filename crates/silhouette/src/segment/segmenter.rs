//! The pipeline: light, evidence, smoothing, clean-up, person, outline.

use super::SCORE_LIMIT;
use super::appearance::Appearance;
use super::evidence::{Evidence, EvidenceConfig};
use super::ghost::without_ghosts;
use super::outline;
use super::smooth::{Smoother, SmoothingConfig};
use crate::background::{BackgroundModel, IlluminationMatch, IlluminationReport};
use crate::clean::{PersonTracker, PersonTrackerConfig, Window};
use crate::image::{Geometry, RgbPlanes, RgbView};
use crate::mask::Mask;

/// Score down to which a pixel is not yet clearly background.
const UNCLEAR: f32 = -0.5 * SCORE_LIMIT;

/// Settings of [`Segmenter`]. Lengths are in working pixels.
#[derive(Clone, Debug)]
pub struct SegmenterConfig {
    /// What counts as different from the background.
    pub evidence: EvidenceConfig,
    /// How evidence is shared among neighbours.
    pub smoothing: SmoothingConfig,
    /// Pieces thinner than this go, pixels.
    pub open_px: u32,
    /// Edges about a piece in the frame are at least this many times as strong as those of the background there.
    pub outline_ratio: f32,
    /// Cracks thinner than this are closed, pixels.
    pub close_px: u32,
    /// Holes of up to this share of the person are filled unless the background shows clearly in them.
    pub hole_share: f64,
    /// Which components are the person.
    pub person: PersonTrackerConfig,
    /// A pixel of the rim is person when the person covers at least this share of it.
    pub rim_share: f32,
    /// The light and the background are not learned this close to the person, pixels.
    pub keep_off_px: u32,
}

impl Default for SegmenterConfig {
    fn default() -> Self {
        Self {
            evidence: EvidenceConfig::default(),
            smoothing: SmoothingConfig::default(),
            open_px: 2,
            outline_ratio: 1.2,
            close_px: 5,
            hole_share: 0.02,
            person: PersonTrackerConfig::default(),
            rim_share: 0.4,
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
                return Err(SegmenterParamsError { field, value, expected: "a number above 0" });
            }
        }
        let shares = [
            ("evidence.darkest_shadow", f64::from(evidence.darkest_shadow)),
            ("rim_share", f64::from(config.rim_share)),
            ("hole_share", config.hole_share),
            ("person.minimum_share", person.minimum_share),
            ("person.piece_share", person.piece_share),
            ("person.piece_gap", person.piece_gap),
            ("person.piece_overlap", person.piece_overlap),
        ];
        for (field, value) in shares {
            if !(0.0..=1.0).contains(&value) {
                return Err(SegmenterParamsError { field, value, expected: "a share from 0 to 1" });
            }
        }
        let not_negative = [
            ("evidence.edge_jitter_px", f64::from(evidence.edge_jitter_px)),
            ("outline_ratio", f64::from(config.outline_ratio)),
            ("evidence.appearance_bias", f64::from(evidence.appearance_bias)),
            ("evidence.shadow_appearance", f64::from(evidence.shadow_appearance)),
            ("evidence.shadow_cost", f64::from(evidence.shadow_cost)),
        ];
        for (field, value) in not_negative {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(SegmenterParamsError { field, value, expected: "0 or more" });
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
    appearance: Appearance,
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
            appearance: Appearance::new(),
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
        let illumination = self.measure();
        // The first person seen is judged twice: the first look learns the colours.
        let is_first = !self.appearance.is_learned();
        let (mut changed, mut person) = self.look();
        if is_first && self.appearance.is_learned() {
            (changed, person) = self.look();
        }
        self.model.learn(&self.frame, &person.dilated(Window::radius(self.config.keep_off_px)));
        let coverage = outline::coverage(&person, &self.frame, self.illumination.matched());
        let mask = outline::enlarged(&coverage, self.geometry, self.config.rim_share);
        let n_pixels = self.geometry.working_pixels() as f64;
        let diagnostics = Diagnostics {
            illumination,
            changed_share: changed.area() as f64 / n_pixels,
            person_share: person.area() as f64 / n_pixels,
        };
        Ok(Segmentation { mask, diagnostics })
    }

    /// Brings the background under the frame's light and measures how far each pixel is from it.
    fn measure(&mut self) -> IlluminationReport {
        let (width, height) = (self.frame.width as u32, self.frame.height as u32);
        let keep_off = Window::radius(self.config.keep_off_px);
        let last_person =
            self.tracker.previous().map_or_else(|| Mask::new(width, height), |m| m.dilated(keep_off));
        let expected = self.model.expected(&self.frame);
        let report = self.illumination.fit(&self.frame, expected.mean, &last_person);
        let background = self.illumination.matched();
        self.evidence.measure(
            &self.frame,
            background,
            expected.noise,
            report.noise_sd,
            &self.config.evidence,
        );
        report
    }

    /// The pixels that are neither background nor its shadow, and the person among them; learns the person's colours
    /// from the pixels that neither neighbours nor colours had to decide.
    fn look(&mut self) -> (Mask, Mask) {
        self.evidence.score(&self.frame, &self.appearance, &self.config.evidence);
        let background = self.illumination.matched();
        self.smoother.smooth(&mut self.evidence.score, &self.frame, background, &self.config.smoothing);
        let changed = self.above(0.0);
        let person = self.person_of(&changed);
        let mut clear = self.evidence.clear_pixels(self.frame.width, &self.config.evidence);
        // The rim is a blend of person and background: it would teach the colours of shadows.
        clear.intersect_with(&person.eroded(Window::radius(1)));
        self.appearance.learn(&self.frame, self.illumination.matched(), &clear);
        (changed, person)
    }

    /// The pixels whose score is above `least`.
    fn above(&self, least: f32) -> Mask {
        let width = self.frame.width;
        Mask::from_fn(width as u32, self.frame.height as u32, |x, y| {
            self.evidence.score[y as usize * width + x as usize] > least
        })
    }

    /// The person among the changed pixels, without cracks and holes.
    fn person_of(&mut self, changed: &Mask) -> Mask {
        let changed = changed.opened(self.config.open_px);
        let background = self.illumination.matched();
        let last_person = self.tracker.previous();
        let solid = without_ghosts(&changed, &self.frame, background, last_person, self.config.outline_ratio);
        let person = self.tracker.follow(&solid);
        // A gap between the legs shows the background clearly; a crack in the evidence does not.
        let mut whole = person.closed(self.config.close_px);
        whole.intersect_with(&self.above(UNCLEAR));
        whole.union_with(&person);
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
            is_hole[hole] && area <= largest && sums[hole] / area as f64 > f64::from(UNCLEAR)
        }));
        whole
    }
}
