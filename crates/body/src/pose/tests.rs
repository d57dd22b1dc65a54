use std::f64::consts::FRAC_PI_2;

use glam::DMat3;
use proptest::prelude::*;

use super::*;

/// A man of round numbers: hips 0.1 m to the sides, thigh and shank 0.4 m straight down, upper arm along +x.
fn rest() -> RestJoints {
    let mut rest = [DVec3::new(0.0, 1.0, 0.0); N_JOINTS];
    for (joint, position) in [
        (JointId::LEFT_HIP, [0.1, 0.9, 0.0]),
        (JointId::LEFT_KNEE, [0.1, 0.5, 0.0]),
        (JointId::LEFT_ANKLE, [0.1, 0.1, 0.0]),
        (JointId::LEFT_BALL, [0.1, 0.0, 0.2]),
        (JointId::RIGHT_HIP, [-0.1, 0.9, 0.0]),
        (JointId::RIGHT_KNEE, [-0.1, 0.5, 0.0]),
        (JointId::HEAD, [0.0, 1.5, 0.0]),
    ] {
        rest[joint.index()] = DVec3::from_array(position);
    }
    rest
}

fn pose_with(angles: &[(&str, f64)]) -> Pose {
    let mut pose = Pose::upright(DVec3::new(0.0, 0.0, 1.0), -FRAC_PI_2); // faces world -y, left is world +x
    for &(name, angle) in angles {
        pose.angles[Skeleton::human().dof_index(name).unwrap()] = angle;
    }
    pose
}

fn joint_at(pose: &Pose, joint: JointId) -> DVec3 {
    forward_kinematics(Skeleton::human(), &rest(), pose)[joint.index()].translation
}

fn assert_near(found: DVec3, expected: [f64; 3]) {
    assert!(found.distance(DVec3::from_array(expected)) < 1e-12, "found {found}, expected {expected:?}");
}

#[test]
fn rest_pose_stands_upright() {
    let pose = pose_with(&[]);
    assert_near(joint_at(&pose, JointId::LEFT_KNEE), [0.1, 0.0, 0.5]);
    assert_near(joint_at(&pose, JointId::LEFT_BALL), [0.1, -0.2, 0.0]);
    assert!((pose.heading_rad() + FRAC_PI_2).abs() < 1e-12);
}

#[test]
fn sitting_by_hand() {
    // Thigh forward (world -y), shank hanging down: knee at 0.4 ahead of the hip, ankle 0.4 below the knee.
    let sitting = pose_with(&[("left_hip_flexion", FRAC_PI_2), ("left_knee_flexion", FRAC_PI_2)]);
    assert_near(joint_at(&sitting, JointId::LEFT_KNEE), [0.1, -0.4, 0.9]);
    assert_near(joint_at(&sitting, JointId::LEFT_ANKLE), [0.1, -0.4, 0.5]);
    assert_near(joint_at(&sitting, JointId::LEFT_BALL), [0.1, -0.6, 0.4]);
    assert_near(joint_at(&sitting, JointId::RIGHT_KNEE), [-0.1, 0.0, 0.5]);
}

#[test]
fn movements_go_where_their_names_say() {
    let moved =
        |name: &str, joint| joint_at(&pose_with(&[(name, 0.3)]), joint) - joint_at(&pose_with(&[]), joint);
    // World directions for this heading: forward -y, left +x, up +z.
    assert!(moved("lumbar_flexion", JointId::HEAD).y < -0.05);
    assert!(moved("lumbar_left_bend", JointId::HEAD).x > 0.05);
    assert!(moved("left_hip_flexion", JointId::LEFT_KNEE).y < -0.05);
    assert!(moved("left_hip_abduction", JointId::LEFT_KNEE).x > 0.05);
    assert!(moved("right_hip_abduction", JointId::RIGHT_KNEE).x < -0.05);
    assert!(moved("left_knee_flexion", JointId::LEFT_ANKLE).y > 0.05);
    assert!(moved("left_ankle_dorsiflexion", JointId::LEFT_BALL).z > 0.02);
    assert!(moved("left_hip_internal_rotation", JointId::LEFT_BALL).x < -0.02);
    assert!(moved("left_ankle_inversion", JointId::LEFT_BALL).x < -0.02); // the sole turns inwards
}

#[test]
fn three_turns_multiply_first_to_last() {
    let skeleton = Skeleton::human();
    let range = skeleton.joint(JointId::LEFT_SHOULDER).dofs.clone();
    let mut angles = vec![0.0; N_DOF];
    angles[range.clone()].copy_from_slice(&[0.7, -0.4, 1.1]);
    let by_matrices = range.fold(DMat3::IDENTITY, |product, dof| {
        product * DMat3::from_axis_angle(skeleton.dofs()[dof].axis, angles[dof])
    });
    let found = DMat3::from_quat(joint_rotation(skeleton, JointId::LEFT_SHOULDER, &angles));
    assert!((found - by_matrices).to_cols_array().iter().all(|x| x.abs() < 1e-12));
}

proptest! {
    /// The mirror image of every joint is the mirrored joint of the mirrored pose.
    #[test]
    fn mirror_shows_the_other_side(angles in prop::collection::vec(-1.0..1.0f64, N_DOF), turn in prop::array::uniform3(-2.0..2.0f64)) {
        let mut rest = rest();
        for joint in JointId::all() { // a symmetric body
            let p = rest[joint.index()] + DVec3::new(0.01, 0.02, 0.03) * joint.index() as f64;
            rest[joint.index()] = if joint == joint.mirror() { DVec3::new(0.0, p.y, p.z) } else { p };
            if joint.mirror() < joint {
                rest[joint.index()] = rest[joint.mirror().index()] * DVec3::new(-1.0, 1.0, 1.0);
            }
        }
        let pose = Pose { root_position: DVec3::new(0.3, -2.0, 1.0), root_orientation: DQuat::from_scaled_axis(turn.into()), angles };
        let frames = forward_kinematics(Skeleton::human(), &rest, &pose);
        let mirrored = forward_kinematics(Skeleton::human(), &rest, &pose.mirror());
        for joint in JointId::all() {
            let image = frames[joint.index()].translation * DVec3::new(-1.0, 1.0, 1.0);
            prop_assert!(image.distance(mirrored[joint.mirror().index()].translation) < 1e-12);
        }
        prop_assert_eq!(pose.mirror().mirror(), pose);
    }
}
