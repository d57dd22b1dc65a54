//! Filters over time: jumps out, noise down.

use glam::{DQuat, DVec3};

use crate::pose::Pose;

/// Replaces each angle by the median of five frames where it is off by more than this, radians. Recorded angles jump now
/// and then for a frame or two; a fast limb moves by about 0.2 rad in a 60th of a second, but in one direction.
const SPIKE_RAD: f64 = 0.1;

/// Takes out jumps of one or two frames.
pub(super) fn despike(poses: &mut [Pose]) {
    let original: Vec<Vec<f64>> = poses.iter().map(|pose| pose.angles.clone()).collect();
    for frame in 2..original.len().saturating_sub(2) {
        for (dof, angle) in poses[frame].angles.iter_mut().enumerate() {
            let mut near: [f64; 5] = std::array::from_fn(|i| original[frame + i - 2][dof]);
            near.sort_by(f64::total_cmp);
            if (*angle - near[2]).abs() > SPIKE_RAD {
                *angle = near[2];
            }
        }
    }
}

/// Smooths root and angles by a Gaussian with a standard deviation of `sigma_frames`; at the ends it is cut off.
///
/// # Panics
/// When `sigma_frames` is negative.
pub(super) fn gaussian(poses: &mut [Pose], sigma_frames: f64) {
    assert!(sigma_frames >= 0.0, "a smoothing of {sigma_frames} frames");
    if sigma_frames == 0.0 {
        return;
    }
    let original = poses.to_vec();
    let reach = (3.0 * sigma_frames).ceil() as usize;
    for (frame, pose) in poses.iter_mut().enumerate() {
        let near = frame.saturating_sub(reach)..(frame + reach + 1).min(original.len());
        let weight = |other: usize| (-0.5 * ((other as f64 - frame as f64) / sigma_frames).powi(2)).exp();
        let total: f64 = near.clone().map(weight).sum();
        let (mut position, mut turn) = (DVec3::ZERO, DVec3::ZERO);
        pose.angles.fill(0.0);
        for other in near {
            let share = weight(other) / total;
            position += share * original[other].root_position;
            let away = original[other].root_orientation * original[frame].root_orientation.inverse();
            turn += share * shortest(away).to_scaled_axis();
            for (angle, other) in pose.angles.iter_mut().zip(&original[other].angles) {
                *angle += share * other;
            }
        }
        pose.root_position = position;
        pose.root_orientation =
            (DQuat::from_scaled_axis(turn) * original[frame].root_orientation).normalize();
    }
}

/// The one of q and −q, which are the same rotation, that turns by less than half a turn.
fn shortest(q: DQuat) -> DQuat {
    if q.w < 0.0 { -q } else { q }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::skeleton::N_DOF;

    fn poses(angle: impl Fn(usize) -> f64) -> Vec<Pose> {
        (0..40)
            .map(|frame| Pose {
                root_position: DVec3::new(0.1 * frame as f64, 0.0, 1.0),
                root_orientation: DQuat::from_rotation_z(0.3 * frame as f64),
                angles: vec![angle(frame); N_DOF],
            })
            .collect()
    }

    #[test]
    fn a_jump_of_two_frames_goes_and_a_fast_sweep_stays() {
        let sweep = |frame: usize| 0.2 * frame as f64;
        let mut spiked = poses(|frame| sweep(frame) + if frame == 20 || frame == 21 { 3.0 } else { 0.0 });
        despike(&mut spiked);
        for (frame, pose) in spiked.iter().enumerate() {
            assert!((pose.angles[7] - sweep(frame)).abs() < 0.45, "frame {frame}");
        }
        let mut clean = poses(sweep);
        despike(&mut clean);
        assert_eq!(clean, poses(sweep));
    }

    #[test]
    fn steady_motion_stays_as_it_is_inside_the_clip() {
        let mut smoothed = poses(|frame| 0.05 * frame as f64);
        let before = smoothed.clone();
        gaussian(&mut smoothed, 1.5);
        for (a, b) in smoothed.iter().zip(&before).take(35).skip(5) {
            assert!(a.root_position.distance(b.root_position) < 1e-12);
            assert!(a.root_orientation.angle_between(b.root_orientation) < 1e-6);
            assert!((a.angles[3] - b.angles[3]).abs() < 1e-12);
        }
    }

    #[test]
    fn half_of_the_amplitude_is_left_where_the_formula_says() {
        // A Gaussian of sigma s leaves exp(-(2 pi f s)^2 / 2) of the frequency f: half at f s = 0.1874.
        let mut wave = poses(|frame| (std::f64::consts::TAU * 0.1874 / 1.5 * frame as f64).cos());
        let before = wave.clone();
        gaussian(&mut wave, 1.5);
        for frame in 10..30 {
            assert!((wave[frame].angles[0] - 0.5 * before[frame].angles[0]).abs() < 0.01);
        }
    }
}
