//! Learning while tracking: the best particles of a frame tell the predictor what its mask shows.
//!
//! `[Kanaujia2014]` adds, re-estimates and deletes bases of gates and experts for the best 1 to 5 % of the particles of
//! every frame. All filters of a person share one predictor, which learns between frames from the filter that explains the
//! masks best: so the answer does not depend on threads, nor on time. What bounds the time is the number of changes that a
//! frame may make ([`PosePredictor::learn`]).

use std::sync::Arc;

use anyhow::Context as _;
use body::Pose;
use glam::DVec3;
use silhouette::Mask;

use crate::predict::{PosePredictor, ViewedPose};
use crate::run_folder::{FrameRecord, Learned, Status};

/// Overlap of body and mask under which a frame teaches nothing: its poses may be wrong.
const LEAST_IOU: f64 = 0.8;

/// A predictor that may learn.
#[derive(Clone)]
pub struct Learner {
    predictor: Arc<PosePredictor>,
    n_particles: usize,
    /// Frames learned from.
    n_frames: u64,
}

impl Learner {
    /// `predictor`, to learn from so many particles of each frame; from none it stays as it is.
    pub fn new(predictor: Arc<PosePredictor>, n_particles: usize) -> Self {
        Self { predictor, n_particles, n_frames: 0 }
    }

    /// Particles of a frame that it learns from.
    pub fn n_particles(&self) -> usize {
        self.n_particles
    }

    /// The predictor as it is now.
    pub fn predictor(&self) -> &PosePredictor {
        &self.predictor
    }

    /// The predictor with a note of what it has learned.
    pub fn noted(&self) -> PosePredictor {
        let mut predictor = PosePredictor::clone(&self.predictor);
        if self.n_frames > 0 {
            predictor.note_lessons(self.n_frames);
        }
        predictor
    }

    /// Whether there is something to learn from a frame that came out so.
    pub fn wants(&self, record: &FrameRecord) -> bool {
        self.n_particles > 0 && record.status == Status::Tracked && record.iou >= LEAST_IOU
    }

    /// Learns what the mask of a frame shows: the poses of its best particles with their weights, heaviest first, before a
    /// camera at `camera_world`, metres.
    ///
    /// # Errors
    /// When a pose is not finite.
    pub fn learn(
        &mut self,
        mask: &Mask,
        camera_world: DVec3,
        particles: &[(Pose, f64)],
    ) -> anyhow::Result<Learned> {
        let heaviest = particles.first().map_or(1.0, |(_, weight)| *weight);
        let lessons: Vec<(ViewedPose, f64)> = particles
            .iter()
            .map(|(pose, weight)| {
                (ViewedPose::of(pose, camera_world), (weight / heaviest).clamp(f64::EPSILON, 1.0))
            })
            .collect();
        let report = Arc::make_mut(&mut self.predictor)
            .learn(mask, &lessons)
            .context("the predictor cannot learn from the particles")?;
        self.n_frames += 1;
        Ok(Learned {
            frames: 1,
            added: report.added as u64,
            deleted: report.deleted as u64,
            reestimated: report.reestimated as u64,
            log_evidence_gain: report.log_evidence_gain,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use body::N_JOINTS;

    use crate::predict::Activity;

    fn record(status: Status, iou: f64) -> FrameRecord {
        FrameRecord {
            frame: 0,
            status,
            pose: Pose::upright(DVec3::new(0.0, 4.0, 0.95), 0.3),
            joints_world: [DVec3::ZERO; N_JOINTS],
            joint_sd_m: [0.0; N_JOINTS],
            iou,
            effective_sample_size: 1.0,
            unique_ancestors: 1,
            log_evidence: 0.0,
            learned: None,
        }
    }

    #[test]
    fn frames_that_may_be_wrong_teach_nothing() {
        let predictor = Arc::new(Activity::Any.predictor());
        let learner = Learner::new(predictor.clone(), 4);
        assert!(learner.wants(&record(Status::Tracked, 0.9)));
        assert!(!learner.wants(&record(Status::Tracked, 0.7)));
        assert!(!learner.wants(&record(Status::Tracked, f64::NAN)));
        assert!(!learner.wants(&record(Status::Lost, 0.9)));
        assert!(!learner.wants(&record(Status::Coasting, 0.9)));
        assert!(!Learner::new(predictor, 0).wants(&record(Status::Tracked, 0.9)));
    }

    #[test]
    fn a_lesson_is_noted_and_leaves_the_teacher_as_it_was() {
        let shipped = Arc::new(Activity::Any.predictor());
        let mut learner = Learner::new(shipped.clone(), 2);
        assert_eq!(learner.noted().training(), shipped.training());
        let mask = Mask::from_fn(80, 160, |x, y| (30..50).contains(&x) && (10..150).contains(&y));
        let pose = record(Status::Tracked, 0.9).pose;
        let learned =
            learner.learn(&mask, DVec3::new(0.0, 0.0, 1.5), &[(pose.clone(), 0.02), (pose, 0.0)]).unwrap();
        assert_eq!(learned.frames, 1);
        assert!(
            learned.log_evidence_gain >= 0.0 && learned.added + learned.deleted + learned.reestimated > 0
        );
        assert!(learner.noted().training().notice.ends_with("learned on from 1 masks while tracking"));
        assert_eq!(learner.noted().training().n_masks, shipped.training().n_masks + 1);
        let mean = |predictor: &PosePredictor| predictor.density(&mask).unwrap().mean();
        assert_ne!(mean(learner.predictor()), mean(&shipped));
        assert_eq!(mean(&shipped), mean(&Activity::Any.predictor()));
    }
}
