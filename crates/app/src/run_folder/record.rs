//! What is kept of a frame.

use body::{N_JOINTS, Pose};
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::draw::Outline;

/// What became of the person on a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// Seen and explained by the body.
    Tracked,
    /// Not seen: the pose is carried on from the frames before.
    Coasting,
    /// Not seen for too long, or not explained by any pose.
    Lost,
}

impl Status {
    /// As in the tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tracked => "tracked",
            Self::Coasting => "coasting",
            Self::Lost => "lost",
        }
    }
}

/// What a predictor made of one frame, or of several added up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Learned {
    /// Frames.
    pub frames: u64,
    /// Bases that came in.
    pub added: u64,
    /// Bases that went out.
    pub deleted: u64,
    /// Precisions that moved.
    pub reestimated: u64,
    /// Gain in log marginal likelihood by these changes.
    pub log_evidence_gain: f64,
}

impl std::ops::AddAssign for Learned {
    fn add_assign(&mut self, other: Self) {
        self.frames += other.frames;
        self.added += other.added;
        self.deleted += other.deleted;
        self.reestimated += other.reestimated;
        self.log_evidence_gain += other.log_evidence_gain;
    }
}

/// The result of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameRecord {
    /// Number of the frame in its source, from 0.
    pub frame: u64,
    /// Whether to rely on it.
    pub status: Status,
    /// The estimated pose.
    pub pose: Pose,
    /// Joint positions of that pose, metres, world.
    pub joints_world: [DVec3; N_JOINTS],
    /// Standard deviation of each joint's position, metres.
    pub joint_sd_m: [f64; N_JOINTS],
    /// Intersection over union of body and mask.
    pub iou: f64,
    /// Effective sample size of the last layer.
    pub effective_sample_size: f64,
    /// Particles of the frame before that have a descendant in the last layer.
    pub unique_ancestors: u64,
    /// The filter's log evidence of the frame.
    pub log_evidence: f64,
    /// What the predictor made of the frame, where it learned from it.
    pub learned: Option<Learned>,
}

/// Outlines of a frame in the pixels of its overlay.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Outlines {
    pub mask: Vec<Outline>,
    pub body: Vec<Outline>,
}

/// A frame as the journal holds it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Entry {
    pub record: FrameRecord,
    pub outlines: Outlines,
    /// The tracker's state after the frame, where it was given.
    pub checkpoint: Option<Vec<u8>>,
}

/// The form of [`Entry`] on disk, version 3 of the journal.
#[derive(Serialize, Deserialize)]
pub(super) struct EntryFile {
    frame: u64,
    status: Status,
    root_position: [f64; 3],
    root_orientation: [f64; 4],
    angles: Vec<f64>,
    joints_world: Vec<[f64; 3]>,
    joint_sd_m: Vec<f64>,
    iou: f64,
    effective_sample_size: f64,
    unique_ancestors: u64,
    log_evidence: f64,
    learned: Option<Learned>,
    outlines: Outlines,
    checkpoint: Option<Vec<u8>>,
}

impl EntryFile {
    pub fn from_entry(entry: &Entry) -> Self {
        let record = &entry.record;
        Self {
            frame: record.frame,
            status: record.status,
            root_position: record.pose.root_position.to_array(),
            root_orientation: record.pose.root_orientation.to_array(),
            angles: record.pose.angles.clone(),
            joints_world: record.joints_world.iter().map(DVec3::to_array).collect(),
            joint_sd_m: record.joint_sd_m.to_vec(),
            iou: record.iou,
            effective_sample_size: record.effective_sample_size,
            unique_ancestors: record.unique_ancestors,
            log_evidence: record.log_evidence,
            learned: record.learned,
            outlines: entry.outlines.clone(),
            checkpoint: entry.checkpoint.clone(),
        }
    }

    /// `None` when the number of joints is not that of the skeleton.
    pub fn into_entry(self) -> Option<Entry> {
        let joints: [[f64; 3]; N_JOINTS] = self.joints_world.try_into().ok()?;
        let record = FrameRecord {
            frame: self.frame,
            status: self.status,
            pose: Pose {
                root_position: DVec3::from_array(self.root_position),
                root_orientation: DQuat::from_array(self.root_orientation),
                angles: self.angles,
            },
            joints_world: joints.map(DVec3::from_array),
            joint_sd_m: self.joint_sd_m.try_into().ok()?,
            iou: self.iou,
            effective_sample_size: self.effective_sample_size,
            unique_ancestors: self.unique_ancestors,
            log_evidence: self.log_evidence,
            learned: self.learned,
        };
        Some(Entry { record, outlines: self.outlines, checkpoint: self.checkpoint })
    }
}
