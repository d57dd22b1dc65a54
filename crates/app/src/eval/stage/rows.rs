//! The rows of the table: every tracker on one sequence, from one camera, over all seeds.

use anyhow::Context as _;
use bme::Coverage;
use rayon::prelude::*;
use serde::Serialize;
use silhouette::Mask;

use super::coverage::{Associations, FrameCoverage};
use super::score::{TrackErrors, TrueFrame, score};
use super::{Prepared, StageEval};
use crate::config::{Method, TrackConfig, TrackParams};
use crate::eval::joint_error::mean;
use crate::run_folder::{FrameRecord, Status};
use crate::track::follower::Follower;
use crate::track::tracker::Scene;
use crate::train::sequence_masks;

/// Masks beyond the current one that a tracker is shown.
pub(super) const LOOK_AHEAD: usize = 12;
/// One line of the table: means over seeds and their spread (standard deviation).
#[derive(Clone, Debug, Serialize)]
pub struct StageRow {
    /// Subject.
    pub subject: String,
    /// Activity.
    pub activity: String,
    /// Camera.
    pub camera: String,
    /// Tracker.
    pub method: Method,
    /// Kind of masks.
    pub masks: String,
    /// Share of the associations between masks and poses that the particles hit as they were proposed, sum over frames and
    /// seeds; none where nothing was learned from the sequence.
    pub coverage: Option<f64>,
    /// The same of the particles after the last layer.
    pub coverage_posterior: Option<f64>,
    /// Means over seeds.
    #[serde(flatten)]
    pub mean: TrackErrors,
    /// Standard deviations over seeds.
    pub spread: TrackErrors,
    /// Each seed.
    pub seeds: Vec<SeedErrors>,
}

/// The errors of one run.
#[derive(Clone, Debug, Serialize)]
pub struct SeedErrors {
    /// Means over frames.
    #[serde(flatten)]
    pub mean: TrackErrors,
    /// The root-relative error of each frame, mm.
    pub frames_root_mm: Vec<f64>,
    /// What the particles of each frame covered; nothing where nothing was learned from the sequence.
    #[serde(rename = "frames_coverage", serialize_with = "shares")]
    pub(super) coverage: Vec<FrameCoverage>,
}

/// The share of each frame, as the particles were proposed.
fn shares<S: serde::Serializer>(coverage: &[FrameCoverage], to: S) -> Result<S::Ok, S::Error> {
    to.collect_seq(coverage.iter().map(|frame| frame.proposed.share()))
}

/// The records of the frames of `range`; `masks` are those of all frames. `look` sees the follower after each frame.
pub(super) fn follow(
    follower: &mut Follower,
    masks: &[Mask],
    range: std::ops::Range<usize>,
    mut look: impl FnMut(&Follower, usize),
) -> anyhow::Result<Vec<FrameRecord>> {
    let mut records = Vec::with_capacity(range.len());
    for frame in range {
        let window: Vec<&Mask> = masks[frame..].iter().take(LOOK_AHEAD).collect();
        records.extend(follower.step(frame as u64, &window)?);
        look(follower, frame);
    }
    while let Some(record) = follower.finish()? {
        records.push(record);
    }
    Ok(records)
}

impl Prepared {
    /// The rows of one camera and kind of masks: one for each tracker.
    pub(super) fn rows(
        &self,
        eval: &StageEval,
        camera: &str,
        kind: &str,
        associations: Option<&Associations>,
    ) -> anyhow::Result<Vec<StageRow>> {
        let masks = self.masks(camera, kind)?;
        let runs: Vec<(Method, u64)> =
            eval.methods.iter().flat_map(|method| (1..=eval.seeds).map(|seed| (*method, seed))).collect();
        let errors: Vec<SeedErrors> = runs
            .into_par_iter()
            .map(|(method, seed)| {
                let config = TrackConfig { seed, method, ..eval.config.clone() };
                let (records, coverage) = self.track(config, camera, &masks, associations)?;
                let frames_root_mm = (0..records.len())
                    .filter(|frame| self.sequence.markers[self.sequence.test.start + frame].is_some())
                    .map(|frame| self.score_from(&records[frame..=frame], frame).root_mm)
                    .collect();
                Ok(SeedErrors { mean: self.score_from(&records, 0), frames_root_mm, coverage })
            })
            .collect::<anyhow::Result<_>>()?;
        let by_method = eval.methods.iter().zip(errors.chunks(eval.seeds as usize));
        let rows = by_method.map(|(method, seeds)| {
            let (mean, spread) = mean_and_spread(seeds);
            let mut covered = FrameCoverage::default();
            seeds.iter().flat_map(|seed| &seed.coverage).for_each(|frame| covered += *frame);
            let of = |covered: Coverage| associations.is_some().then(|| covered.share());
            StageRow {
                subject: self.sequence.subject.clone(),
                activity: self.sequence.activity.clone(),
                camera: camera.to_owned(),
                method: *method,
                masks: kind.to_owned(),
                coverage: of(covered.proposed),
                coverage_posterior: of(covered.posterior),
                mean,
                spread,
                seeds: seeds.to_vec(),
            }
        });
        Ok(rows.collect())
    }

    pub(super) fn n_frames(&self) -> usize {
        self.truth.motion.poses.len()
    }

    /// The masks of the test frames.
    pub(super) fn masks(&self, camera: &str, kind: &str) -> anyhow::Result<Vec<Mask>> {
        let start = self.sequence.test.start;
        sequence_masks(&self.sequence, camera, kind, &(start..start + self.n_frames()))
    }

    /// The scene before `camera`.
    pub(super) fn scene(&self, config: TrackConfig, camera: &str) -> anyhow::Result<Scene> {
        let config = TrackConfig { stature_m: Some(self.sequence.stature_m), ..config };
        Ok(Scene {
            body: self.body.clone(),
            camera: self.sequence.camera(camera)?,
            model: self.model.clone(),
            predictor: self.predictor.clone().filter(|_| config.method.asks_predictor()),
            transitions: self.transitions.clone(),
            refiner: Some(self.refiner.clone()),
            fps: self.sequence.fps,
            params: TrackParams::new(config)?,
        })
    }

    /// A follower of the person before `camera` that has seen nothing yet.
    pub(super) fn follower(&self, config: TrackConfig, camera: &str) -> anyhow::Result<Follower> {
        Ok(Follower::new(self.scene(config, camera)?))
    }

    /// The record of every frame, and what its particles covered.
    fn track(
        &self,
        config: TrackConfig,
        camera: &str,
        masks: &[Mask],
        associations: Option<&Associations>,
    ) -> anyhow::Result<(Vec<FrameRecord>, Vec<FrameCoverage>)> {
        let mut follower = self.follower(config, camera)?;
        let camera_world = self.sequence.camera(camera)?.centre_world();
        let mut coverage = Vec::new();
        let records = follow(&mut follower, masks, 0..masks.len(), |follower, frame| {
            coverage.extend(associations.map(|a| a.coverage(follower, &masks[frame], camera_world)));
        })?;
        let first = records.first().with_context(|| {
            format!("{}: nobody on any of {} masks", self.sequence.folder.display(), masks.len())
        })?;
        // A person who is not seen at first is lost there, and stands where they are found.
        let unseen =
            (0..first.frame).map(|frame| FrameRecord { frame, status: Status::Lost, ..first.clone() });
        let records = unseen.chain(records.iter().cloned()).collect();
        Ok((records, coverage))
    }

    /// The errors of `records`, the first of which is about test frame `first`.
    pub(super) fn score_from(&self, records: &[FrameRecord], first: usize) -> TrackErrors {
        let (mut kept, mut truth) = (Vec::new(), Vec::new());
        for (index, record) in (first..).zip(records) {
            let frame = self.sequence.test.start + index;
            if let Some(markers) = &self.sequence.markers[frame] {
                kept.push(record.clone());
                truth.push(TrueFrame {
                    markers,
                    rotations: &self.sequence.rotations[frame],
                    fitted: &self.truth.motion.poses[index],
                });
            }
        }
        score(&kept, &truth, self.body.rest_joints(), &self.moving_dofs)
    }
}

fn mean_and_spread(seeds: &[SeedErrors]) -> (TrackErrors, TrackErrors) {
    let over = |figure: fn(&TrackErrors) -> f64| {
        let average = mean(seeds.iter().map(|seed| figure(&seed.mean)));
        let variance = seeds.iter().map(|seed| (figure(&seed.mean) - average).powi(2)).sum::<f64>();
        (average, (variance / (seeds.len().max(2) - 1) as f64).sqrt())
    };
    let figures: [(f64, f64); 7] = [
        over(|e| e.root_mm),
        over(|e| e.abs_mm),
        over(|e| e.aligned_mm),
        over(|e| e.euler_deg),
        over(|e| e.geodesic_deg),
        over(|e| e.lost),
        over(|e| e.far_off),
    ];
    let errors = |pick: fn(&(f64, f64)) -> f64| {
        let [root_mm, abs_mm, aligned_mm, euler_deg, geodesic_deg, lost, far_off] =
            [0, 1, 2, 3, 4, 5, 6].map(|i| pick(&figures[i]));
        TrackErrors { root_mm, abs_mm, aligned_mm, euler_deg, geodesic_deg, lost, far_off }
    };
    (errors(|f| f.0), errors(|f| f.1))
}
