use glam::{DQuat, DVec3};

use super::file::{MAGIC, PriorFile, VERSION};
use super::*;
use crate::container;

/// Numbers between -1 and 1, the same each time.
fn numbers() -> impl FnMut() -> f64 {
    let mut state = 1u64;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// A walker who swings both knees in opposition with 0.4 rad, moves on by 0.02 m a frame and turns by 0.01 rad.
fn swinging(n_frames: usize) -> Motion {
    let mut noise = numbers();
    let skeleton = Skeleton::human();
    let [left, right] =
        ["left_knee_flexion", "right_knee_flexion"].map(|name| skeleton.dof_index(name).expect("an angle"));
    let mut pose = Pose::upright(DVec3::new(0.0, 0.0, 0.9), 0.3);
    let poses = (0..n_frames).map(|frame| {
        // Ahead is the body's z, up its y.
        pose.root_position += pose.root_orientation * DVec3::new(0.0, 0.0, 0.02);
        pose.root_orientation *= DQuat::from_rotation_y(0.01);
        pose.angles.iter_mut().for_each(|angle| *angle = 0.01 * noise());
        let swing = 0.4 * (frame as f64 * std::f64::consts::TAU / 50.0).sin();
        pose.angles[left] = 0.6 + swing;
        pose.angles[right] = 0.6 - swing;
        pose.clone()
    });
    Motion { name: "swing".into(), frame_rate_hz: 60.0, poses: poses.collect() }
}

fn prior() -> PosePrior {
    PosePrior::learn(&[swinging(500)], "made up", &PosePriorConfig::default()).expect("enough poses")
}

#[test]
fn learns_the_swing() {
    let prior = prior();
    let skeleton = Skeleton::human();
    let [left, right] =
        ["left_knee_flexion", "right_knee_flexion"].map(|name| skeleton.dof_index(name).expect("an angle"));
    assert!((prior.mean_rad()[left] - 0.6).abs() < 1e-9);
    // A sine of amplitude a has the standard deviation a / sqrt 2; the floor of 2 degrees comes on top.
    let expected = (0.08 + 2f64.to_radians().powi(2)).sqrt();
    assert!((prior.sd_rad()[left] - expected).abs() < 1e-6, "{} {expected}", prior.sd_rad()[left]);
    assert!((prior.covariance()[(left, right)] + 0.95 * 0.08).abs() < 1e-6);
    // Both knees swing in one direction of the space of angles: 0.4 sqrt 2 / sqrt 2 along it.
    assert!((prior.component_sd_rad()[0] - 0.4).abs() < 1e-3, "{}", prior.component_sd_rad()[0]);
    assert!(prior.component_sd_rad()[1] < 0.01);
    assert!((prior.range_rad()[right][1] - 1.0).abs() < 0.01);
}

#[test]
fn steps_are_in_the_pelvis_frame_and_turn_both_ways() {
    let steps = prior();
    let moment = |i: usize| steps.step_covariance()[(i, i)].sqrt();
    // 0.02 m ahead, nothing sideways; 0.01 rad about the vertical, to the left in one image and to the right in the other.
    assert!((moment(2) - 0.02f64.hypot(0.0005)).abs() < 1e-4, "{}", moment(2));
    assert!((moment(0) - 0.0005).abs() < 1e-4, "{}", moment(0));
    assert!((moment(4) - 0.01f64.hypot(0.1f64.to_radians())).abs() < 1e-6);
    assert!(steps.step_covariance()[(2, 4)].abs() < 1e-9);
    let factor = steps.step_factor();
    assert!((factor * factor.transpose() - steps.step_covariance()).amax() < 1e-12);
}

#[test]
fn jumps_are_left_out_of_the_steps() {
    let mut jumping = swinging(500);
    jumping.poses.iter_mut().skip(250).for_each(|pose| pose.angles[0] += 2.0);
    let with_jump = PosePrior::learn(&[jumping], "", &PosePriorConfig::default()).expect("enough poses");
    assert!((with_jump.step_covariance()[(6, 6)] - prior().step_covariance()[(6, 6)]).abs() < 1e-6);
}

#[test]
fn left_and_right_are_alike() {
    let prior = PosePrior::builtin();
    for (dof, angle) in Skeleton::human().dofs().iter().enumerate() {
        assert!(
            (prior.mean_rad()[dof] - angle.mirror_sign * prior.mean_rad()[angle.mirror]).abs() < 1e-9,
            "{}",
            angle.name
        );
        let (sd, mirror) = (prior.sd_rad()[dof], prior.sd_rad()[angle.mirror]);
        assert!((sd - mirror).abs() < 1e-9, "{}", angle.name);
    }
    for odd in [0, 4, 5] {
        assert!(prior.step_covariance()[(odd, 2)].abs() < 1e-12, "sideways and ahead go together");
    }
}

#[test]
fn stepping_undoes_the_difference() {
    let motion = swinging(60);
    for pair in motion.poses.windows(2) {
        let reached = stepped(&pair[0], step(&pair[0], &pair[1]).as_slice());
        assert!(reached.root_position.distance(pair[1].root_position) < 1e-12);
        assert!(reached.root_orientation.angle_between(pair[1].root_orientation) < 1e-7);
        for (a, b) in reached.angles.iter().zip(&pair[1].angles) {
            assert!((a - b).abs() < 1e-12);
        }
    }
}

#[test]
fn all_components_give_the_pose_back_and_few_come_near() {
    let prior = PosePrior::builtin();
    let mut noise = numbers();
    let away: Vec<f64> = prior.mean_rad().iter().map(|mean| mean + 0.3 * noise()).collect();
    let back = prior.reconstruct(&prior.project(&away, N_DOF));
    for (a, b) in away.iter().zip(&back) {
        assert!((a - b).abs() < 1e-6);
    }
    assert_eq!(prior.reconstruct(&[]), prior.mean_rad());
    let one = prior.reconstruct(&[2.0]);
    assert!((prior.project(&one, 3)[0] - 2.0).abs() < 1e-9 && prior.project(&one, 3)[1].abs() < 1e-9);
}

#[test]
fn the_distance_is_that_of_the_covariance() {
    let prior = prior();
    assert_eq!(prior.mahalanobis_squared(prior.mean_rad()), 0.0);
    let mut noise = numbers();
    let away = DVector::from_fn(N_DOF, |_, _| 0.1 * noise());
    let angles: Vec<f64> = prior.mean_rad().iter().zip(&away).map(|(mean, away)| mean + away).collect();
    let inverse = prior.covariance().clone().try_inverse().expect("it is positive definite");
    let expected = (away.transpose() * inverse * &away)[(0, 0)];
    assert!((prior.mahalanobis_squared(&angles) / expected - 1.0).abs() < 1e-9);
}

#[test]
fn survives_the_file_and_says_what_is_wrong_with_others() {
    let prior = prior();
    let bytes = prior.to_bytes();
    assert_eq!(PosePrior::from_bytes(&bytes), Ok(prior.clone()));
    assert_eq!(prior.notice(), "made up");
    assert_eq!(PosePrior::from_bytes(&bytes[..90]).expect_err("short").to_string(), "not a pose prior");

    let message = |change: &dyn Fn(&mut PriorFile)| {
        let mut file: PriorFile =
            postcard::from_bytes(container::open(MAGIC, VERSION, &bytes).expect("it is sound"))
                .expect("it is sound");
        change(&mut file);
        let data = postcard::to_stdvec(&file).expect("writing to memory cannot fail");
        PosePrior::from_bytes(&container::seal(MAGIC, VERSION, &data)).expect_err("a bad file").to_string()
    };
    assert_eq!(message(&|file| file.mean_rad.truncate(3)), "`mean_rad` has 3 elements, expected 49");
    assert_eq!(message(&|file| file.covariance[0] = -1.0), "`covariance` is not positive definite");
    assert_eq!(
        message(&|file| file.step_covariance[0] = f64::NAN),
        "`step_covariance` is not positive definite"
    );
}

#[test]
fn too_little_motion_is_refused() {
    let config = PosePriorConfig::default();
    assert_eq!(
        PosePrior::learn(&[swinging(10)], "", &config).expect_err("too few").to_string(),
        "the motions have 10 poses, expected at least 49"
    );
    let slow = Motion { name: "slow".into(), frame_rate_hz: 30.0, ..swinging(60) };
    assert_eq!(
        PosePrior::learn(&[swinging(60), slow], "", &config).expect_err("two rates").to_string(),
        "slow: has 30 frames a second, expected 60 as in the first motion"
    );
}

#[test]
fn the_builtin_prior_knows_people() {
    let prior = PosePrior::builtin();
    assert!(prior.notice().contains("mocap.cs.cmu.edu"));
    assert!(prior.n_poses() > 10_000);
    assert_eq!(prior.frame_rate_hz(), 60.0);
    // The range seen is inside the limits.
    for (dof, range) in Skeleton::human().dofs().iter().zip(prior.range_rad()) {
        let [least, largest] = dof.limits_rad;
        assert!(range[0] >= least - 1e-9 && range[1] <= largest + 1e-9, "{}", dof.name);
    }
    // 20 components hold most of the variance, as in published work on gait and daily movement.
    let variance = |sd: &[f64]| sd.iter().map(|sd| sd * sd).sum::<f64>();
    let share = variance(&prior.component_sd_rad()[..20]) / variance(prior.component_sd_rad());
    assert!((0.9..1.0).contains(&share), "{share}");
}

#[test]
fn a_walker_it_was_not_learned_from_is_plausible_and_one_with_crossed_angles_is_not() {
    let Some(data) = crate::test_data::folder() else { return };
    let folder = data.join("cmu/asfamc/06");
    let clip = crate::io::mocap::load_asf_amc(&folder.join("06.asf"), &folder.join("06_01.amc"))
        .expect("a good clip");
    let rest = *crate::BodyModel::builtin().mean().rest_joints();
    let (motion, _) = crate::retarget::retarget(&clip, &rest, &crate::retarget::RetargetConfig::default())
        .expect("a known skeleton");
    let prior = PosePrior::builtin();
    let mean = |change: &dyn Fn(&mut Vec<f64>)| {
        let distances = motion.poses.iter().map(|pose| {
            let mut angles = pose.angles.clone();
            change(&mut angles);
            prior.mahalanobis_squared(&angles)
        });
        distances.sum::<f64>() / motion.poses.len() as f64
    };
    // Draws from the prior itself have a mean of 49; this walker has 30.5.
    assert!((15.0..98.0).contains(&mean(&|_| ())), "{}", mean(&|_| ()));
    assert!(mean(&|angles| angles.reverse()) > 490.0);
}
