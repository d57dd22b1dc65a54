//! Errors of estimated joints against a reference: root aligned, split into image plane and depth, per joint.

use body::{JointId, N_JOINTS};
use glam::DVec3;

use super::reference::{JUDGED, ReferenceFrame, root};

/// Errors of the judged joints over frames, millimetres. Frames on which the person was lost are in it like all others.
#[derive(Clone, Debug, Default)]
pub struct JointErrors {
    /// Length of the error after both roots (midpoints of the hips) are put on each other, by judged joint.
    pub root_aligned_mm: [Vec<f64>; JUDGED.len()],
    /// Its part across the line of sight, by judged joint.
    pub image_plane_mm: [Vec<f64>; JUDGED.len()],
    /// Its part along the line of sight, without sign, by judged joint.
    pub depth_mm: [Vec<f64>; JUDGED.len()],
    /// Distance of the two roots, by frame.
    pub pelvis_mm: Vec<f64>,
    /// Mean of `root_aligned_mm` over the joints seen, by frame.
    pub frame_mm: Vec<f64>,
}

impl JointErrors {
    /// Adds one frame. `joints_world` are estimated joints in metres, `camera_centre` the centre of projection.
    /// A frame whose reference has no root is passed over.
    pub fn add(
        &mut self,
        joints_world: &[DVec3; N_JOINTS],
        reference: &ReferenceFrame,
        camera_centre: DVec3,
    ) {
        let Some(reference_root) = root(reference) else { return };
        let estimate = |joint: JointId| joints_world[joint.index()];
        let own_root = estimate(JointId::LEFT_HIP).midpoint(estimate(JointId::RIGHT_HIP));
        self.pelvis_mm.push(1000.0 * own_root.distance(reference_root));
        let mut sum_mm = 0.0;
        let mut seen = 0.0;
        for (slot, (_, joint)) in JUDGED.iter().enumerate() {
            let Some(truth) = reference[slot] else { continue };
            let error_mm = 1000.0 * ((estimate(*joint) - own_root) - (truth - reference_root));
            let line_of_sight = (truth - camera_centre).normalize();
            let along = error_mm.dot(line_of_sight);
            self.root_aligned_mm[slot].push(error_mm.length());
            self.depth_mm[slot].push(along.abs());
            self.image_plane_mm[slot].push((error_mm - along * line_of_sight).length());
            sum_mm += error_mm.length();
            seen += 1.0;
        }
        self.frame_mm.push(sum_mm / seen);
    }
}

/// Mean; NaN of nothing.
pub fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for value in values {
        sum += value;
        n += 1.0;
    }
    sum / n
}

/// Median; NaN of nothing.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    match sorted.len() {
        0 => f64::NAN,
        n if n % 2 == 1 => sorted[n / 2],
        n => sorted[n / 2 - 1].midpoint(sorted[n / 2]),
    }
}

/// Largest value; NaN of nothing.
pub fn largest(values: &[f64]) -> f64 {
    values.iter().copied().reduce(f64::max).unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_planted_offset_is_split_into_depth_and_image_plane() {
        let mut joints = [DVec3::ZERO; N_JOINTS];
        let mut reference = ReferenceFrame::default();
        for (slot, (_, joint)) in JUDGED.iter().enumerate() {
            let place = DVec3::new(5.0, 0.01 * slot as f64, 1.0);
            joints[joint.index()] = place + DVec3::new(0.3, 0.0, 0.0);
            reference[slot] = Some(place);
        }
        // Beside the common shift of 300 mm in depth, the left wrist is 40 mm too deep and 30 mm too high.
        joints[JointId::LEFT_WRIST.index()] += DVec3::new(0.04, 0.0, 0.03);
        let mut errors = JointErrors::default();
        errors.add(&joints, &reference, DVec3::new(-1000.0, 0.0, 1.0));
        let wrist = JUDGED.iter().position(|(name, _)| *name == "LWrist").expect("it is in the table");
        assert!((errors.root_aligned_mm[wrist][0] - 50.0).abs() < 1e-6);
        assert!((errors.depth_mm[wrist][0] - 40.0).abs() < 0.1);
        assert!((errors.image_plane_mm[wrist][0] - 30.0).abs() < 0.1);
        assert!((errors.pelvis_mm[0] - 300.0).abs() < 1e-6);
        assert!((errors.frame_mm[0] - 50.0 / 12.0).abs() < 1e-6);
    }

    #[test]
    fn median_of_odd_even_and_none() {
        assert_eq!(median(&[3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&[4.0, 1.0, 2.0, 3.0]), 2.5);
        assert!(median(&[]).is_nan());
    }
}
