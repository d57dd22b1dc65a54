use glam::{DQuat, DVec3};
use proptest::prelude::*;

use super::*;

/// Joints of the mean body of `data/bodies` at rest, rounded to millimetres, heels below the ankles.
fn mean_joints() -> RestJoints {
    let left_or_middle = [
        [0.0, 0.913, 0.012],
        [0.0, 0.991, -0.026],
        [0.0, 1.058, -0.011],
        [0.0, 1.138, -0.011],
        [0.0, 1.261, -0.025],
        [0.0, 1.440, 0.008],
        [0.0, 1.544, 0.045],
        [0.0, 1.694, 0.054],
        [0.023, 1.368, 0.023],
        [0.180, 1.344, 0.021],
        [0.354, 1.150, 0.027],
        [0.474, 1.027, 0.186],
        [0.533, 0.902, 0.324],
        [0.109, 0.904, 0.005],
        [0.150, 0.506, 0.036],
        [0.192, 0.077, 0.009],
        [0.203, 0.028, 0.150],
        [0.191, 0.015, 0.211],
        [0.190, 0.020, -0.040],
    ];
    std::array::from_fn(|joint| {
        let joint = JointId::from_index(joint).expect("one of the joints");
        let is_right = joint.mirror() < joint;
        let source = if is_right { joint.mirror() } else { joint };
        let [x, y, z] = left_or_middle[if source == JointId::LEFT_HEEL { 18 } else { source.index() }];
        DVec3::new(if is_right { -x } else { x }, y, z)
    })
}

/// A pose with every angle at a `share` (0 to 1) of its range.
fn pose_from(shares: &[f64], root: [f64; 3], turn: [f64; 3]) -> Pose {
    let angle = |(share, dof): (&f64, &crate::Dof)| {
        let [least, largest] = dof.limits_rad;
        least + share * (largest - least)
    };
    Pose {
        root_position: root.into(),
        root_orientation: DQuat::from_scaled_axis(turn.into()),
        angles: shares.iter().zip(Skeleton::human().dofs()).map(angle).collect(),
    }
}

fn all_joints(rest: &RestJoints, pose: &Pose) -> Vec<Target> {
    let frames = forward_kinematics(Skeleton::human(), rest, pose);
    JointId::all().map(|joint| Target::joint(joint, frames[joint.index()].translation)).collect()
}

fn worst(solution: &IkSolution) -> f64 {
    solution.residuals_m.iter().copied().fold(0.0, f64::max)
}

fn assert_inside_limits(pose: &Pose) {
    for (angle, dof) in pose.angles.iter().zip(Skeleton::human().dofs()) {
        let [least, largest] = dof.limits_rad;
        assert!((least..=largest).contains(angle), "{} is {angle}, outside {least} to {largest}", dof.name);
    }
}

#[test]
fn the_jacobian_is_the_derivative_of_the_cost() {
    let rest = mean_joints();
    let pose = pose_from(&[0.4; N_DOF], [0.3, -0.2, 0.9], [0.4, 1.0, -0.3]);
    let mut targets = all_joints(&rest, &pose_from(&[0.55; N_DOF], [0.2, 0.0, 1.0], [0.0, 0.7, 0.1]));
    targets[11].offset_m = DVec3::new(0.01, 0.05, -0.03);
    targets[4].weight = 2.5;
    let (reference, metres_per_rad) = (vec![0.1; N_DOF], vec![0.02; N_DOF]);
    let pull = Pull { reference: &reference, metres_per_rad: &metres_per_rad };
    let problem = Problem { skeleton: Skeleton::human(), rest: &rest, targets: &targets, pull: Some(pull) };
    let cost = |pose: &Pose| problem.cost(pose, &forward_kinematics(Skeleton::human(), &rest, pose));
    let gradient = problem.linearise(&pose, &forward_kinematics(Skeleton::human(), &rest, &pose)).gradient;
    for unknown in 0..N_UNKNOWNS {
        let mut step = DVector::zeros(N_UNKNOWNS);
        step[unknown] = 1e-6;
        let slope = (cost(&problem.moved(&pose, &step)) - cost(&problem.moved(&pose, &-step))) / 2e-6;
        // The gradient is that of half the cost.
        assert!((slope - 2.0 * gradient[unknown]).abs() < 1e-6, "{unknown}: {slope} {}", gradient[unknown]);
    }
}

#[test]
fn the_initial_pose_is_a_rigid_motion_of_the_rest_pose() {
    let rest = mean_joints();
    let mut pose = Pose::upright(DVec3::new(1.0, 2.0, 0.8), 0.7);
    let guess = initial_pose(&rest, &all_joints(&rest, &pose));
    assert!(guess.root_position.distance(pose.root_position) < 1e-9);
    assert!(guess.root_orientation.angle_between(pose.root_orientation) < 1e-6);

    // A subset without the pelvis: shoulders and neck still say where the trunk is.
    pose.angles[0] = 0.0;
    let few: Vec<Target> = all_joints(&rest, &pose)
        .into_iter()
        .filter(|t| [JointId::NECK, JointId::LEFT_SHOULDER, JointId::RIGHT_SHOULDER].contains(&t.joint))
        .collect();
    let guess = initial_pose(&rest, &few);
    assert!(guess.root_position.distance(pose.root_position) < 1e-6);
    assert_eq!(initial_pose(&rest, &few[..1]).root_position, few[0].position);
}

#[test]
fn unreachable_targets_are_approached_along_the_straight_arm() {
    let rest = mean_joints();
    let start = Pose::upright(DVec3::new(0.0, 0.0, 0.9), 0.0);
    let mut targets = all_joints(&rest, &start);
    targets
        .retain(|t| ![JointId::LEFT_ELBOW, JointId::LEFT_WRIST, JointId::LEFT_FINGERTIP].contains(&t.joint));
    for target in &mut targets {
        target.weight = 100.0;
    }
    // World +x is ahead, +y to the left: two metres ahead and to the left of the left shoulder.
    let shoulder =
        forward_kinematics(Skeleton::human(), &rest, &start)[JointId::LEFT_SHOULDER.index()].translation;
    let goal = shoulder + DVec3::new(1.4, 1.4, 0.0);
    targets.push(Target::joint(JointId::LEFT_WRIST, goal).weighted(0.01));
    let solution = solve(&rest, &targets, &start, None, &IkConfig::default());
    assert_inside_limits(&solution.pose);
    let frames = forward_kinematics(Skeleton::human(), &rest, &solution.pose);
    let arm = frames[JointId::LEFT_WRIST.index()].translation - shoulder;
    assert!(arm.angle_between(goal - shoulder) < 0.05, "the arm points along {arm}");
    assert!(arm.length() > 0.48, "the arm is {} m long, of 0.50 m when straight", arm.length());
    assert!(*solution.residuals_m.last().expect("the wrist") > 1.3);
}

#[test]
fn a_pull_decides_what_targets_leave_open() {
    let rest = mean_joints();
    let start = Pose::upright(DVec3::new(0.0, 0.0, 0.9), 0.0);
    let reference: Vec<f64> = Skeleton::human().dofs().iter().map(|dof| dof.clamp(0.2)).collect();
    let pelvis_only = &all_joints(&rest, &start)[..1];
    let metres_per_rad = vec![0.01; N_DOF];
    let pull = Pull { reference: &reference, metres_per_rad: &metres_per_rad };
    let solution = solve(&rest, pelvis_only, &start, Some(pull), &IkConfig::default());
    assert_eq!(solution.status, IkStatus::Converged);
    for (angle, reference) in solution.pose.angles.iter().zip(&reference) {
        assert!((angle - reference).abs() < 1e-5);
    }
    assert!(worst(&solution) < 1e-9);
}

#[test]
#[should_panic(expected = "targets must be finite")]
fn refuses_targets_that_are_nowhere() {
    let target = Target::joint(JointId::PELVIS, DVec3::NAN);
    let _ = solve(&mean_joints(), &[target], &Pose::upright(DVec3::ZERO, 0.0), None, &IkConfig::default());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn reachable_poses_are_reached_to_a_millimetre(
        shares in prop::collection::vec(0.05..0.95f64, N_DOF),
        root in prop::array::uniform3(-2.0..2.0f64),
        turn in prop::array::uniform3(-2.0..2.0f64),
    ) {
        let rest = mean_joints();
        let targets = all_joints(&rest, &pose_from(&shares, root, turn));
        let solution = solve_from_scratch(&rest, &targets, None, &IkConfig::default());
        assert_inside_limits(&solution.pose);
        prop_assert!(worst(&solution) < 1e-3, "{} m after {} steps, {:?}", worst(&solution), solution.steps, solution.status);
    }

    #[test]
    fn a_warm_start_reaches_the_next_pose_in_a_few_steps(
        shares in prop::collection::vec(0.1..0.9f64, N_DOF),
        changes in prop::collection::vec(-0.03..0.03f64, N_DOF),
    ) {
        let rest = mean_joints();
        let start = pose_from(&shares, [0.0, 0.0, 0.9], [0.0, 0.0, 0.3]);
        let mut next = start.clone();
        next.root_position += DVec3::new(0.02, -0.01, 0.005);
        next.angles.iter_mut().zip(&changes).for_each(|(angle, change)| *angle += change);
        next.clamp();
        let solution = solve(&rest, &all_joints(&rest, &next), &start, None, &IkConfig::default());
        prop_assert!(worst(&solution) < 1e-3, "{} m", worst(&solution));
        prop_assert!(solution.steps <= 30, "{} steps", solution.steps);
    }

    #[test]
    fn wild_targets_do_no_harm(
        positions in prop::collection::vec(prop::array::uniform3(-50.0..50.0f64), 1..30),
    ) {
        let rest = mean_joints();
        let targets: Vec<Target> = JointId::all().zip(positions).map(|(j, p)| Target::joint(j, p.into())).collect();
        let solution = solve(&rest, &targets, &initial_pose(&rest, &targets), None, &IkConfig::default());
        assert_inside_limits(&solution.pose);
        prop_assert!(solution.residuals_m.iter().all(|r| r.is_finite()));
        prop_assert!((solution.pose.root_orientation.length() - 1.0).abs() < 1e-9);
    }
}
