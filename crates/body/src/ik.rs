//! Inverse kinematics: joint angles from the positions of joints, by damped least squares inside the joint limits.
//!
//! Minimises `Σ wᵢ |pᵢ(x) − tᵢ|² + Σ (sₖ (θₖ − refₖ))²` over root and angles `x`: points `pᵢ` fixed to joint frames,
//! their targets `tᵢ`, and an optional pull of the angles to a reference. Steps are those of `[Marquardt1963]` (for
//! kinematic chains also called damped least squares, `[Buss2004]`), each the minimum of the local
//! quadratic model inside the limits.

use glam::{DQuat, DVec3};
use nalgebra::{DMatrix, DVector};

use crate::pose::{JointTransforms, Pose, RestJoints, forward_kinematics};
use crate::skeleton::{JointId, N_DOF, Skeleton};

mod start;

pub(crate) use start::rigid_fit;
pub use start::{initial_pose, solve_from_scratch};

/// Unknowns: root position, small rotation of the root about the world's axes, joint angles.
const N_UNKNOWNS: usize = 6 + N_DOF;

/// Damping counts an unknown as at least this stiff, relative to the stiffest: some move no target at all.
const SMALLEST_STIFFNESS: f64 = 1e-6;

/// The damping factor that begins a search, and the largest that is tried.
const FIRST_DAMPING: f64 = 1e-3;
const LARGEST_DAMPING: f64 = 1e8;

/// Where a point that is fixed to a joint's frame should be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// The joint whose frame carries the point.
    pub joint: JointId,
    /// The point in that frame (axes of the body frame at rest), metres; zero is the joint itself.
    pub offset_m: DVec3,
    /// Where it should be, metres, world.
    pub position: DVec3,
    /// Weight of its squared distance; 1 is usual.
    pub weight: f64,
}

impl Target {
    /// The joint itself, with weight 1.
    #[must_use]
    pub fn joint(joint: JointId, position: DVec3) -> Self {
        Self { joint, offset_m: DVec3::ZERO, position, weight: 1.0 }
    }

    /// The same target with another weight.
    #[must_use]
    pub fn weighted(self, weight: f64) -> Self {
        Self { weight, ..self }
    }
}

/// A weak spring at every angle: says what targets leave open.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pull<'a> {
    /// Angles to be pulled to, `[n_dof]`, radians.
    pub reference: &'a [f64],
    /// Stiffness, `[n_dof]`: being one radian off costs as much as a target this many metres off.
    pub metres_per_rad: &'a [f64],
}

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IkConfig {
    /// Steps at most.
    pub max_steps: usize,
    /// A step that moves no unknown by more than this (radians or metres) ends the search.
    pub smallest_step: f64,
}

impl Default for IkConfig {
    fn default() -> Self {
        Self { max_steps: 60, smallest_step: 1e-6 }
    }
}

/// How the search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IkStatus {
    /// No step inside the limits comes closer: a minimum, though not always the lowest.
    Converged,
    /// The steps ran out while the pose was still getting better.
    StepsRanOut,
}

/// What [`solve`] found.
#[derive(Clone, Debug, PartialEq)]
pub struct IkSolution {
    /// The pose, inside the joint limits.
    pub pose: Pose,
    /// Distance of each target from its point, `[n_targets]`, metres.
    pub residuals_m: Vec<f64>,
    /// Steps taken.
    pub steps: usize,
    /// How it ended.
    pub status: IkStatus,
}

/// The pose of a person with joints `rest` that comes closest to `targets`, searched from `start`.
///
/// Unreachable targets are approached as far as limits and bones allow. From a far start the minimum may be a local
/// one: begin with the pose of the frame before or with [`initial_pose`].
///
/// # Panics
/// When a slice of `pull` or the angles of `start` have not [`N_DOF`] values, or a target or `start` is not finite.
#[must_use]
pub fn solve(
    rest: &RestJoints,
    targets: &[Target],
    start: &Pose,
    pull: Option<Pull<'_>>,
    config: &IkConfig,
) -> IkSolution {
    assert!(
        targets.iter().all(|t| t.position.is_finite() && t.offset_m.is_finite() && t.weight >= 0.0),
        "targets must be finite and their weights not negative"
    );
    assert_eq!(start.angles.len(), N_DOF, "a start of {} angles for {N_DOF}", start.angles.len());
    assert!(
        start.root_position.is_finite()
            && start.root_orientation.is_finite()
            && start.angles.iter().all(|a| a.is_finite()),
        "the start must be finite"
    );
    if let Some(pull) = pull {
        let lengths = (pull.reference.len(), pull.metres_per_rad.len());
        assert_eq!(lengths, (N_DOF, N_DOF), "a pull of {} and {} values for {N_DOF}", lengths.0, lengths.1);
    }
    let problem = Problem { skeleton: Skeleton::human(), rest, targets, pull };
    problem.minimise(start, config)
}

struct Problem<'a> {
    skeleton: &'a Skeleton,
    rest: &'a RestJoints,
    targets: &'a [Target],
    pull: Option<Pull<'a>>,
}

/// Half the cost near a pose.
struct Quadratic {
    gradient: DVector<f64>,
    /// Its lower triangle; the rest is zero.
    hessian: DMatrix<f64>,
}

impl Problem<'_> {
    fn minimise(&self, start: &Pose, config: &IkConfig) -> IkSolution {
        let mut pose = start.clone();
        pose.clamp();
        let mut frames = forward_kinematics(self.skeleton, self.rest, &pose);
        let mut cost = self.cost(&pose, &frames);
        let mut damping = FIRST_DAMPING;
        let mut steps = 0;
        let mut status = IkStatus::StepsRanOut;
        'search: while steps < config.max_steps {
            steps += 1;
            let quadratic = self.linearise(&pose, &frames);
            let room = self.room(&pose);
            loop {
                let Some(step) = damped_step(&quadratic, &room, damping) else {
                    damping = 4.0 * damping.max(f64::EPSILON);
                    continue;
                };
                let candidate = self.moved(&pose, &step);
                let candidate_frames = forward_kinematics(self.skeleton, self.rest, &candidate);
                let candidate_cost = self.cost(&candidate, &candidate_frames);
                let is_small = step.amax() <= config.smallest_step;
                if candidate_cost < cost {
                    (pose, frames, cost) = (candidate, candidate_frames, candidate_cost);
                    damping = (damping * 0.2).max(1e-12);
                    if is_small && damping < FIRST_DAMPING {
                        status = IkStatus::Converged;
                        break 'search;
                    }
                    break;
                }
                damping *= 4.0;
                if is_small || damping > LARGEST_DAMPING {
                    status = IkStatus::Converged;
                    break 'search;
                }
            }
        }
        let distance = |t: &Target| frames[t.joint.index()].transform_point3(t.offset_m).distance(t.position);
        IkSolution { residuals_m: self.targets.iter().map(distance).collect(), pose, steps, status }
    }

    fn cost(&self, pose: &Pose, frames: &JointTransforms) -> f64 {
        let miss = |t: &Target| {
            t.weight * frames[t.joint.index()].transform_point3(t.offset_m).distance_squared(t.position)
        };
        let targets: f64 = self.targets.iter().map(miss).sum();
        let pull: f64 = self.pull.map_or(0.0, |pull| {
            let springs = pull.reference.iter().zip(pull.metres_per_rad).zip(&pose.angles);
            springs.map(|((reference, stiffness), angle)| (stiffness * (angle - reference)).powi(2)).sum()
        });
        targets + pull
    }

    /// Gradient `Jᵀ W r` and Gauss-Newton matrix `Jᵀ W J` with the geometric Jacobian: a point p turns about an axis a
    /// through o with velocity a × (p − o).
    fn linearise(&self, pose: &Pose, frames: &JointTransforms) -> Quadratic {
        let axes = world_axes(self.skeleton, frames, pose);
        let mut gradient = DVector::zeros(N_UNKNOWNS);
        let mut hessian = DMatrix::zeros(N_UNKNOWNS, N_UNKNOWNS);
        let mut columns: Vec<(usize, DVec3)> = Vec::with_capacity(N_UNKNOWNS);
        for target in self.targets {
            let point = frames[target.joint.index()].transform_point3(target.offset_m);
            let residual = point - target.position;
            columns.clear();
            for (axis, unit) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().enumerate() {
                columns.push((axis, unit));
                columns.push((3 + axis, unit.cross(point - pose.root_position)));
            }
            let mut moved_by = Some(target.joint);
            while let Some(joint) = moved_by {
                let lever = point - frames[joint.index()].translation;
                for dof in self.skeleton.joint(joint).dofs.clone() {
                    columns.push((6 + dof, axes[dof].cross(lever)));
                }
                moved_by = joint.parent();
            }
            for (index, &(i, velocity)) in columns.iter().enumerate() {
                let velocity = target.weight * velocity;
                gradient[i] += velocity.dot(residual);
                for &(j, other) in &columns[..=index] {
                    hessian[(i.max(j), i.min(j))] += velocity.dot(other);
                }
            }
        }
        if let Some(pull) = self.pull {
            for dof in 0..N_DOF {
                let stiffness = pull.metres_per_rad[dof].powi(2);
                gradient[6 + dof] += stiffness * (pose.angles[dof] - pull.reference[dof]);
                hessian[(6 + dof, 6 + dof)] += stiffness;
            }
        }
        Quadratic { gradient, hessian }
    }

    /// How far each unknown may go down and up: the root anywhere, an angle to its limits.
    fn room(&self, pose: &Pose) -> Vec<[f64; 2]> {
        let free = [f64::NEG_INFINITY, f64::INFINITY];
        let angles = self.skeleton.dofs().iter().zip(&pose.angles);
        let room = angles.map(|(dof, angle)| dof.limits_rad.map(|limit| limit - angle));
        std::iter::repeat_n(free, 6).chain(room).collect()
    }

    fn moved(&self, pose: &Pose, step: &DVector<f64>) -> Pose {
        let mut moved = pose.clone();
        moved.root_position += DVec3::new(step[0], step[1], step[2]);
        let turn = DQuat::from_scaled_axis(DVec3::new(step[3], step[4], step[5]));
        moved.root_orientation = (turn * pose.root_orientation).normalize();
        for (angle, change) in moved.angles.iter_mut().zip(step.iter().skip(6)) {
            *angle += change;
        }
        moved.clamp();
        moved
    }
}

/// The axis of every angle in the world, `[n_dof]`: each is turned by the angles before it at its joint. `frames` are those
/// that [`forward_kinematics`] gives for `pose`.
pub fn world_axes(skeleton: &Skeleton, frames: &JointTransforms, pose: &Pose) -> [DVec3; N_DOF] {
    let mut axes = [DVec3::ZERO; N_DOF];
    for joint in JointId::all() {
        let Some(parent) = joint.parent() else { continue };
        let mut turned = DQuat::from_mat3(&frames[parent.index()].matrix3);
        for dof in skeleton.joint(joint).dofs.clone() {
            let axis = skeleton.dofs()[dof].axis;
            axes[dof] = turned * axis;
            turned *= DQuat::from_axis_angle(axis, pose.angles[dof]);
        }
    }
    axes
}

/// Minimises `½ stepᵀ (H + damping · diag H) step + gradientᵀ step` with each unknown inside its `room`.
///
/// What a solution carries out of its room is held at the wall, and the rest solved anew, until all are inside; nothing
/// is let go again within one step. `None` when rounding made the matrix indefinite, which more damping cures.
fn damped_step(quadratic: &Quadratic, room: &[[f64; 2]], damping: f64) -> Option<DVector<f64>> {
    let Quadratic { gradient, hessian } = quadratic;
    let floor = SMALLEST_STIFFNESS * hessian.diagonal().amax();
    let entry = |i: usize, j: usize| {
        let entry = hessian[(i.max(j), i.min(j))];
        if i == j { entry + damping * entry.max(floor) + f64::MIN_POSITIVE } else { entry }
    };
    let mut step = DVector::zeros(N_UNKNOWNS);
    // At a wall already and pushed against it.
    let is_held =
        |&i: &usize| (room[i][0] >= 0.0 && gradient[i] > 0.0) || (room[i][1] <= 0.0 && gradient[i] < 0.0);
    let (mut held, mut free): (Vec<usize>, Vec<usize>) = (0..N_UNKNOWNS).partition(is_held);
    loop {
        let matrix =
            DMatrix::from_fn(
                free.len(),
                free.len(),
                |i, j| {
                    if j <= i { entry(free[i], free[j]) } else { 0.0 }
                },
            );
        let downhill = DVector::from_fn(free.len(), |i, _| {
            let from_held: f64 = held.iter().map(|&j| entry(free[i], j) * step[j]).sum();
            -gradient[free[i]] - from_held
        });
        let solution = matrix.cholesky()?.solve(&downhill);
        for (i, &unknown) in free.iter().enumerate() {
            step[unknown] = solution[i].clamp(room[unknown][0], room[unknown][1]);
        }
        let mut inside = solution.iter().zip(&free).map(|(change, &unknown)| *change == step[unknown]);
        let (still_free, newly_held): (Vec<usize>, Vec<usize>) =
            free.iter().partition(|_| inside.next().expect("one for each free unknown"));
        if newly_held.is_empty() {
            return Some(step);
        }
        free = still_free;
        held.extend(newly_held);
    }
}

#[cfg(test)]
mod tests;
