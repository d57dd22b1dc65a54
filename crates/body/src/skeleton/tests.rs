use super::*;

#[test]
fn has_49_angles_in_the_order_of_the_joints() {
    let skeleton = Skeleton::human();
    assert_eq!(skeleton.joints().len(), N_JOINTS);
    assert_eq!(skeleton.dofs().len(), N_DOF);
    assert!(skeleton.dofs().windows(2).all(|pair| pair[0].joint <= pair[1].joint));
    let counts = |name| skeleton.joint(JointId::from_name(name).unwrap()).dofs.len();
    for (name, expected) in [
        ("lumbar", 3),
        ("mid_spine", 3),
        ("thorax", 3),
        ("upper_chest", 0),
        ("neck", 3),
        ("head", 3),
        ("left_clavicle", 2),
        ("right_shoulder", 3),
        ("left_elbow", 2),
        ("right_wrist", 2),
        ("left_hip", 3),
        ("right_knee", 2),
        ("left_ankle", 2),
        ("right_ball", 1),
        ("left_heel", 0),
        ("head_top", 0),
    ] {
        assert_eq!(counts(name), expected, "{name}");
    }
}

#[test]
fn parents_come_first_and_mirror_undoes_itself() {
    for joint in JointId::all() {
        assert!(joint.parent().is_none_or(|parent| parent < joint));
        assert_eq!(joint.mirror().mirror(), joint);
        assert_eq!(joint.mirror().parent(), joint.parent().map(JointId::mirror));
        assert_eq!(joint.mirror().name(), swap_side(joint.name()));
    }
    for (index, dof) in Skeleton::human().dofs().iter().enumerate() {
        let mirror = &Skeleton::human().dofs()[dof.mirror];
        assert_eq!(mirror.mirror, index);
        assert_eq!(mirror.mirror_sign, dof.mirror_sign);
        if dof.joint != dof.joint.mirror() {
            assert_eq!(mirror.name, swap_side(&dof.name));
            assert_eq!(mirror.limits_rad, dof.limits_rad);
        }
    }
}

fn swap_side(name: &str) -> String {
    match (name.strip_prefix("left_"), name.strip_prefix("right_")) {
        (Some(rest), _) => format!("right_{rest}"),
        (_, Some(rest)) => format!("left_{rest}"),
        _ => name.to_string(),
    }
}

#[test]
fn axes_are_unit_and_limits_hold_the_rest_pose() {
    for dof in Skeleton::human().dofs() {
        assert!((dof.axis.length() - 1.0).abs() < 1e-12, "{}", dof.name);
        assert!(dof.limits_rad[0] < 0.0 && 0.0 < dof.limits_rad[1], "{} {:?}", dof.name, dof.limits_rad);
        assert_eq!(dof.clamp(9.0), dof.limits_rad[1]);
    }
}

/// Axes of one joint stay away from gimbal lock at rest: the middle one is square to its neighbours' plane.
#[test]
fn axes_of_a_joint_are_independent_at_rest() {
    let skeleton = Skeleton::human();
    for joint in skeleton.joints().iter().filter(|joint| joint.dofs.len() == 3) {
        let [a, b, c] = [0, 1, 2].map(|k| skeleton.dofs()[joint.dofs.start + k].axis);
        assert!(a.cross(b).dot(c).abs() > 0.8, "{} {}", joint.id.name(), a.cross(b).dot(c));
    }
}
