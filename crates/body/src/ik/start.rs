//! Inverse kinematics without a pose to begin with.

use glam::{DAffine3, DMat3, DQuat, DVec3};
use nalgebra::{Matrix3, Vector3};

use super::{IkConfig, IkSolution, Pull, Target, solve};
use crate::pose::{Pose, RestJoints};
use crate::skeleton::{JointId, N_DOF, Skeleton};

/// Other starts that a limb tries, and the distance at which a target counts as reached.
const LIMB_RESTARTS: usize = 20;
const REACHED_M: f64 = 5e-4;

/// As [`solve`], without a pose to begin with: the root is placed by the pelvis and the trunk, then targets join in
/// from the pelvis outwards, so that no wrist twists a trunk that is still wrong. A limb that does not reach its target
/// tries other starts, spread over its limits.
///
/// # Panics
/// As [`solve`].
#[must_use]
pub fn solve_from_scratch(
    rest: &RestJoints,
    targets: &[Target],
    pull: Option<Pull<'_>>,
    config: &IkConfig,
) -> IkSolution {
    let mut solution = solve(rest, &[], &initial_pose(rest, targets), None, config);
    for reach in 0..=targets.iter().map(|t| depth(t.joint)).max().unwrap_or(0) {
        let near: Vec<Target> = targets.iter().filter(|t| depth(t.joint) <= reach).copied().collect();
        if near.len() == solution.residuals_m.len() {
            continue;
        }
        solution = solve(rest, &near, &solution.pose, pull, config);
        for attempt in 1..=LIMB_RESTARTS {
            let missed =
                near.iter().zip(&solution.residuals_m).filter(|(_, residual)| **residual > REACHED_M);
            let missed: Vec<JointId> = missed.map(|(target, _)| target.joint).collect();
            if missed.is_empty() {
                break;
            }
            let other = solve(rest, &near, &with_other_limbs(&solution.pose, &missed, attempt), pull, config);
            if weighted_square(&near, &other) < weighted_square(&near, &solution) {
                solution = other;
            }
        }
    }
    solution
}

/// Joints between this one and the pelvis, itself counted.
fn depth(joint: JointId) -> usize {
    std::iter::successors(joint.parent(), |parent| parent.parent()).count()
}

/// `pose` with the limbs that end in the `missed` joints bent otherwise: angles of attempt k at the shares frac(k √p) of
/// their ranges, with a prime p for each angle of a limb, which fill the ranges evenly.
fn with_other_limbs(pose: &Pose, missed: &[JointId], attempt: usize) -> Pose {
    const PRIMES: [f64; 10] = [2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0, 23.0, 29.0];
    let skeleton = Skeleton::human();
    let mut other = pose.clone();
    for &end in missed {
        let limb =
            std::iter::successors(Some(end), |joint| joint.parent()).take_while(|joint| !is_trunk(*joint));
        let dofs = limb.flat_map(|joint| skeleton.joint(joint).dofs.clone());
        for (dof, prime) in dofs.zip(PRIMES) {
            let [least, largest] = skeleton.dofs()[dof].limits_rad;
            other.angles[dof] = least + (attempt as f64 * prime.sqrt()).fract() * (largest - least);
        }
    }
    other
}

fn is_trunk(joint: JointId) -> bool {
    joint <= JointId::UPPER_CHEST
}

fn weighted_square(targets: &[Target], solution: &IkSolution) -> f64 {
    targets
        .iter()
        .zip(&solution.residuals_m)
        .map(|(target, residual)| target.weight * residual * residual)
        .sum()
}

/// A pose to begin with when no earlier one is known: angles of the rest pose, root placed by the targets.
///
/// # Panics
/// When a target is not finite.
#[must_use]
pub fn initial_pose(rest: &RestJoints, targets: &[Target]) -> Pose {
    // Pelvis, lumbar and hips are one rigid piece; without three of them the whole trunk must do, then everything.
    let pelvic = |t: &Target| t.joint == JointId::PELVIS || t.joint.parent() == Some(JointId::PELVIS);
    let trunk = |t: &Target| pelvic(t) || (t.joint.index() <= JointId::NECK.index()) || is_shoulder(t.joint);
    let pairs = |part: &dyn Fn(&Target) -> bool| -> Vec<(DVec3, DVec3)> {
        let used = targets.iter().filter(|t| t.offset_m == DVec3::ZERO && part(t));
        used.map(|t| (rest[t.joint.index()], t.position)).collect()
    };
    let placed = [pairs(&pelvic), pairs(&trunk), pairs(&|_| true)].iter().find_map(|pairs| rigid_fit(pairs));
    let Some(world_from_body) = placed else {
        let middle = targets.iter().map(|t| t.position).sum::<DVec3>() / targets.len().max(1) as f64;
        return Pose::upright(middle, 0.0);
    };
    let (_, root_orientation, _) = world_from_body.to_scale_rotation_translation();
    Pose {
        root_position: world_from_body.transform_point3(rest[JointId::PELVIS.index()]),
        root_orientation,
        angles: vec![0.0; N_DOF],
    }
}

fn is_shoulder(joint: JointId) -> bool {
    joint == JointId::LEFT_SHOULDER || joint == JointId::RIGHT_SHOULDER
}

/// The rigid motion that brings the first points of `pairs` closest to the second ones (`[Kabsch1976]`); `None` when
/// fewer than three or all in a line.
pub(crate) fn rigid_fit(pairs: &[(DVec3, DVec3)]) -> Option<DAffine3> {
    if pairs.len() < 3 {
        return None;
    }
    let count = pairs.len() as f64;
    let from = pairs.iter().map(|p| p.0).sum::<DVec3>() / count;
    let to = pairs.iter().map(|p| p.1).sum::<DVec3>() / count;
    let vector = |v: DVec3| Vector3::new(v.x, v.y, v.z);
    let covariance: Matrix3<f64> =
        pairs.iter().map(|(a, b)| vector(*b - to) * vector(*a - from).transpose()).sum();
    let svd = covariance.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let mut spread: Vec<f64> = svd.singular_values.iter().copied().collect();
    spread.sort_by(|a, b| b.total_cmp(a));
    if spread[1] < 1e-6 * spread[0] || spread[0] <= 0.0 {
        return None;
    }
    let handedness = (u * v_t).determinant().signum();
    let smallest = svd.singular_values.imin();
    let mut signs = Vector3::from_element(1.0);
    signs[smallest] = handedness;
    let r = u * Matrix3::from_diagonal(&signs) * v_t;
    let rotation = DMat3::from_cols_slice(r.as_slice());
    let rotation = DQuat::from_mat3(&rotation).normalize();
    Some(DAffine3::from_rotation_translation(rotation, to - rotation * from))
}
