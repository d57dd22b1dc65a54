//! Errors of a track against the true joints and rotations of a sequence.

use body::retarget::Motion;
use body::{Pose, RestJoints, Skeleton};
use glam::{DMat3, DVec3};
use nalgebra::Matrix3;

use crate::run_folder::{FrameRecord, Status};
use crate::stage::{Markers, Rotations, SEGMENTS, markers_of, rotations_of};

/// A frame whose root-relative error is larger than this counts as beyond rescue.
pub const FAR_OFF_MM: f64 = 150.0;

/// Mean errors of one track over its frames; lost frames are in it like all others.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct TrackErrors {
    /// Mean over the markers after the midpoints of the hips are put on each other, mm.
    pub root_mm: f64,
    /// Mean over the markers as they are, mm.
    pub abs_mm: f64,
    /// Mean over the markers after the best rotation and translation of each frame, mm.
    pub aligned_mm: f64,
    /// Mean absolute difference of the joint angles (Euler angles of our skeleton) that the true motion moves, degrees.
    pub euler_deg: f64,
    /// Mean angle between the true and the estimated rotation of a segment against its parent, degrees.
    pub geodesic_deg: f64,
    /// Frames that the tracker gave up.
    pub lost: f64,
    /// Frames with a root-relative error beyond [`FAR_OFF_MM`].
    pub far_off: f64,
}

/// The truth of one frame.
pub struct TrueFrame<'a> {
    /// Positions of the markers, metres.
    pub markers: &'a Markers,
    /// Rotations of the segments since rest.
    pub rotations: &'a Rotations,
    /// Joint angles of our skeleton fitted to the markers.
    pub fitted: &'a Pose,
}

/// Compares a track with the truth, frame by frame. `rest` are the joints of the tracked body.
///
/// # Panics
/// Without frames.
pub fn score(
    records: &[FrameRecord],
    truth: &[TrueFrame<'_>],
    rest: &RestJoints,
    moving: &[usize],
) -> TrackErrors {
    assert!(
        !records.is_empty() && records.len() == truth.len(),
        "{} frames, {} true",
        records.len(),
        truth.len()
    );
    let mut sum = TrackErrors::default();
    for (record, truth) in records.iter().zip(truth) {
        let own = markers_of(&record.joints_world);
        let root_mm = mean_distance_mm(&from_root(&own), &from_root(truth.markers));
        sum.root_mm += root_mm;
        sum.abs_mm += mean_distance_mm(&own, truth.markers);
        sum.aligned_mm += mean_distance_mm(&aligned(&own, truth.markers), truth.markers);
        let degrees = |dof: &usize| (record.pose.angles[*dof] - truth.fitted.angles[*dof]).abs().to_degrees();
        sum.euler_deg += moving.iter().map(degrees).sum::<f64>() / moving.len().max(1) as f64;
        sum.geodesic_deg += geodesic_deg(&rotations_of(rest, &record.pose), truth.rotations);
        sum.lost += f64::from(u8::from(record.status == Status::Lost));
        sum.far_off += f64::from(u8::from(root_mm > FAR_OFF_MM));
    }
    let n = records.len() as f64;
    TrackErrors {
        root_mm: sum.root_mm / n,
        abs_mm: sum.abs_mm / n,
        aligned_mm: sum.aligned_mm / n,
        euler_deg: sum.euler_deg / n,
        geodesic_deg: sum.geodesic_deg / n,
        ..sum
    }
}

/// The joint angles that a fitted motion moves by more than a degree (standard deviation): markers do not tell the others.
pub fn moving_dofs(fitted: &Motion) -> Vec<usize> {
    let n = fitted.poses.len() as f64;
    (0..Skeleton::human().dofs().len())
        .filter(|&dof| {
            let angles = || fitted.poses.iter().map(|pose| pose.angles[dof]);
            let mean = angles().sum::<f64>() / n;
            let variance = angles().map(|angle| (angle - mean).powi(2)).sum::<f64>() / n;
            variance.sqrt() > 1f64.to_radians()
        })
        .collect()
}

/// The markers from the midpoint of the hips.
fn from_root(markers: &Markers) -> Markers {
    markers.map(|marker| marker - markers[1])
}

fn mean_distance_mm(a: &Markers, b: &Markers) -> f64 {
    1000.0 * a.iter().zip(b).map(|(a, b)| a.distance(*b)).sum::<f64>() / a.len() as f64
}

/// `own` after the rotation and translation that bring it nearest to `truth` in the least squares sense [Kabsch1976].
fn aligned(own: &Markers, truth: &Markers) -> Markers {
    let centre = |markers: &Markers| markers.iter().sum::<DVec3>() / markers.len() as f64;
    let (own_centre, true_centre) = (centre(own), centre(truth));
    let mut covariance = Matrix3::zeros();
    for (a, b) in own.iter().zip(truth) {
        let column = nalgebra::Vector3::from((b - true_centre).to_array());
        let row = nalgebra::RowVector3::from((a - own_centre).to_array());
        covariance += column * row;
    }
    let svd = covariance.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return *own };
    let sign = (u * v_t).determinant().signum();
    let rotation = u * Matrix3::from_diagonal(&nalgebra::Vector3::new(1.0, 1.0, sign)) * v_t;
    let rotation = DMat3::from_cols_slice(rotation.as_slice());
    own.map(|marker| true_centre + rotation * (marker - own_centre))
}

/// Mean angle between rotations of segments against their parents, degrees.
fn geodesic_deg(own: &Rotations, truth: &Rotations) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for (segment, (_, parent)) in SEGMENTS.iter().enumerate() {
        let Some(parent) = *parent else { continue };
        let relative = |rotations: &Rotations| rotations[parent].inverse() * rotations[segment];
        sum += relative(own).angle_between(relative(truth)).to_degrees();
        n += 1.0;
    }
    sum / n
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    fn markers() -> Markers {
        std::array::from_fn(|i| {
            let t = i as f64;
            DVec3::new((0.7 * t).sin(), (1.3 * t).cos(), 0.1 * t)
        })
    }

    #[test]
    fn a_rigid_motion_is_aligned_away_and_a_reflection_is_not() {
        let truth = markers();
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 2.0);
        let moved = truth.map(|marker| turn * marker + DVec3::new(1.0, 2.0, 3.0));
        assert!(mean_distance_mm(&aligned(&moved, &truth), &truth) < 1e-6);
        let reflected = truth.map(|marker| marker * DVec3::new(-1.0, 1.0, 1.0));
        assert!(mean_distance_mm(&aligned(&reflected, &truth), &truth) > 50.0);
    }

    #[test]
    fn a_planted_turn_of_a_segment_shows_in_two_joints() {
        let truth = [DQuat::IDENTITY; SEGMENTS.len()];
        let mut own = truth;
        own[6] = DQuat::from_rotation_x(0.32);
        let expected = 2.0 * 0.32f64.to_degrees() / 16.0;
        assert!((geodesic_deg(&own, &truth) - expected).abs() < 1e-9);
    }
}
