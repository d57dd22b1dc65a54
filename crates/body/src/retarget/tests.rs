use std::path::{Path, PathBuf};

use super::*;
use crate::BodyModel;
use crate::io::mocap::{load_asf_amc, load_humanoid_json};

fn rest() -> RestJoints {
    *BodyModel::builtin().mean().rest_joints()
}

fn cmu_clip(data: &Path, name: &str) -> MocapClip {
    let subject = &name[..2];
    let folder = data.join("cmu/asfamc").join(subject);
    load_asf_amc(&folder.join(format!("{subject}.asf")), &folder.join(format!("{name}.amc")))
        .expect("a good clip")
}

/// The first `count` frames, so that tests stay quick.
fn beginning(mut clip: MocapClip, count: usize) -> MocapClip {
    clip.frames.truncate(count);
    clip
}

/// Angle at `middle` between the bones to the two other joints, degrees.
fn inner_angle_deg(a: DVec3, middle: DVec3, b: DVec3) -> f64 {
    (a - middle).angle_between(b - middle).to_degrees()
}

#[test]
fn limbs_bend_as_recorded_on_the_side_recorded() {
    let Some(data) = crate::test_data::folder() else { return };
    let rest = rest();
    // Walking, boxing with the right hand, running (validation subjects and another file format among them).
    let clips: [(MocapClip, [[&str; 3]; 4]); 4] = {
        let cmu = [
            ["lhumerus", "lradius", "lhand"],
            ["rhumerus", "rradius", "rhand"],
            ["lfemur", "ltibia", "lfoot"],
            ["rfemur", "rtibia", "rfoot"],
        ];
        let humanoid = [
            ["left_shoulder", "left_elbow", "left_wrist"],
            ["right_shoulder", "right_elbow", "right_wrist"],
            ["left_hip", "left_knee", "left_ankle"],
            ["right_hip", "right_knee", "right_ankle"],
        ];
        let running: PathBuf = data.join("cmu/json/09_02.json");
        [
            (beginning(cmu_clip(&data, "07_01"), 240), cmu),
            (beginning(cmu_clip(&data, "02_05"), 240), cmu),
            (beginning(cmu_clip(&data, "49_01"), 240), cmu),
            (load_humanoid_json(&running).expect("a good clip"), humanoid),
        ]
    };
    let ours = [
        [JointId::LEFT_SHOULDER, JointId::LEFT_ELBOW, JointId::LEFT_WRIST],
        [JointId::RIGHT_SHOULDER, JointId::RIGHT_ELBOW, JointId::RIGHT_WRIST],
        [JointId::LEFT_HIP, JointId::LEFT_KNEE, JointId::LEFT_ANKLE],
        [JointId::RIGHT_HIP, JointId::RIGHT_KNEE, JointId::RIGHT_ANKLE],
    ];
    for (clip, theirs) in clips {
        let (motion, error) = retarget(&clip, &rest, &RetargetConfig::default()).expect("a known skeleton");
        assert!(error.joint_mean_m < 0.010 && error.direction_mean_rad < 0.035, "{}: {error:?}", clip.name);
        let recorded = clip.resampled(60.0);
        assert_eq!(motion.poses.len(), recorded.frames.len());
        let (mut bend_error, mut direction_error, mut count) = (0.0, 0.0, 0.0);
        for (pose, frame) in motion.poses.iter().zip(&recorded.frames) {
            let frames = forward_kinematics(Skeleton::human(), &rest, pose);
            for (ours, theirs) in ours.iter().zip(theirs) {
                let [a, b, c] = ours.map(|joint| frames[joint.index()].translation);
                let [d, e, f] = theirs.map(|name| frame.positions[clip.joint(name).expect("it is there")]);
                bend_error += (inner_angle_deg(a, b, c) - inner_angle_deg(d, e, f)).abs();
                direction_error +=
                    (b - a).angle_between(e - d).to_degrees() + (c - b).angle_between(f - e).to_degrees();
                count += 1.0;
            }
        }
        assert!(
            bend_error / count < 3.0,
            "{}: limbs bend {} degrees otherwise",
            clip.name,
            bend_error / count
        );
        assert!(
            direction_error / count / 2.0 < 3.0,
            "{}: {} degrees",
            clip.name,
            direction_error / count / 2.0
        );
    }
}

#[test]
fn feet_stand_on_the_floor_and_limits_hold() {
    let Some(data) = crate::test_data::folder() else { return };
    let rest = rest();
    let (motion, _) = retarget(&beginning(cmu_clip(&data, "02_01"), 300), &rest, &RetargetConfig::default())
        .expect("a known skeleton");
    for pose in &motion.poses {
        let mut clamped = pose.clone();
        clamped.clamp();
        assert_eq!(*pose, clamped);
        let frames = forward_kinematics(Skeleton::human(), &rest, pose);
        let lowest = frames.iter().map(|frame| frame.translation.z).fold(f64::INFINITY, f64::min);
        assert!((-0.03..0.07).contains(&lowest), "the lowest joint is at {lowest} m");
    }
    // Two steps of a walk: the mirror image walks on the other leg, at the same speed.
    let mirrored = motion.mirrored();
    let travel = |motion: &Motion| {
        let (first, last) = (&motion.poses[0], &motion.poses[motion.poses.len() - 1]);
        last.root_position - first.root_position
    };
    assert!((travel(&motion).length() - travel(&mirrored).length()).abs() < 1e-12);
    let knee = |side: &str| Skeleton::human().dof_index(&format!("{side}_knee_flexion")).expect("an angle");
    for (pose, mirror) in motion.poses.iter().zip(&mirrored.poses) {
        assert_eq!(pose.angles[knee("left")], mirror.angles[knee("right")]);
    }
}

#[test]
fn refuses_skeletons_that_no_table_describes() {
    let joints =
        vec![crate::mocap::MocapJoint { name: "Hips".into(), parent: None, rest_position: DVec3::ZERO }];
    let clip = MocapClip { name: "dance".into(), frame_rate_hz: 30.0, joints, frames: Vec::new() };
    assert_eq!(
        retarget(&clip, &rest(), &RetargetConfig::default()).expect_err("unknown").to_string(),
        "dance: has no joint `root`, expected the joints of the CMU database or of the 44-number humanoid"
    );
}
