//! Registration: brings the template onto a scan of a person, vertex by vertex.
//!
//! Minimises E = α E_V + β E_L + γ E_R, coarse to fine. E_V: squared distances from the vertices to the scan's surface, where it has
//! one near them that faces the same way. E_L: squared distances of named landmarks. E_R keeps the shape of a body, in two ways,
//! one after the other: first the vertices stay in the shape space of the [`BodyModel`], posed by its skeleton, and E_R is
//! the prior of coefficients and joint angles; then they leave it (`[Allen2003]` section 4), and E_R is the squared difference
//! of the displacements of neighbours. Both are least-squares problems; the second one is sparse.
//!
//! Deviation: `[Allen2003]` starts from one mesh and lets affine maps differ between neighbours; starting from a shape space
//! leaves millimetres to the second step, for which displacements do.

use glam::{DAffine3, DMat3, DQuat, DVec3};

use crate::ik::rigid_fit;
use crate::mesh::{TriangleTree, area_normal, corners, crossing_triangles};
use crate::model::{Body, BodyModel, Landmark};
use crate::pose::Pose;
use crate::skeleton::{JointId, N_DOF, Skeleton};

mod deform;
mod model_fit;
mod scan;
mod start;
#[cfg(test)]
mod tests;

use deform::{Stiffness, deform};
use model_fit::{LandmarkPair, ModelFit, Round, vertex_normals};
pub use scan::{Scan, ScanError, SurfacePlane};

/// A landmark of a scan.
#[derive(Clone, Debug, PartialEq)]
pub struct ScanLandmark {
    /// As the template has it, as in `Rt Acromion`.
    pub name: String,
    /// Metres, the scan's frame.
    pub position: DVec3,
}

/// A registered body.
#[derive(Clone, Debug)]
pub struct Registration {
    /// Vertices of the template on the scan, metres, the scan's frame, `[n_vertices]`.
    pub vertices: Vec<DVec3>,
    /// The nearest body of the shape space, standard deviations, `[n_components]`.
    pub coefficients_sd: Vec<f64>,
    /// Its pose in the scan's frame.
    pub pose: Pose,
    /// Distance of each vertex to the scan's surface, metres; none where the scan has a hole, `[n_vertices]`.
    pub distances_m: Vec<Option<f64>>,
    /// Names of landmarks that the template does not have: they were not used.
    pub unknown_landmarks: Vec<String>,
    /// Share of the scan's points that lie farther than [`STRAY_M`] from the registered body: other people, furniture.
    pub stray_share: f64,
    /// Triangles that face the other way than they do on the body of the shape space.
    pub flipped: Vec<u32>,
    /// Pairs of triangles that cross, and do not on the body of the shape space.
    pub crossing: Vec<[u32; 2]>,
}

/// Points of the scan farther than this from the body are not of it.
pub const STRAY_M: f64 = 0.1;

/// Why a scan cannot be registered.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RegisterError {
    /// Landmarks are given, but hardly any is known or they lie in a line.
    #[error(
        "{known} of {given} landmarks are known, expected 3 or more that are not in a line, or none at all"
    )]
    TooFewLandmarks {
        /// Landmarks with a name of the template.
        known: usize,
        /// Landmarks given.
        given: usize,
    },
    /// The scan is not the height of a person.
    #[error("the scan is {height_m:.2} m high, expected a person of 1.2 to 2.3 m who stands along y")]
    NotAPerson {
        /// Height from the lowest to the highest point.
        height_m: f64,
    },
    /// Feet up.
    #[error("the scan stands on its head, expected the head at the larger y")]
    UpsideDown,
    /// The template found no surface to lie on.
    #[error(
        "the scan has a surface near {share:.0} % of the body, expected {LEAST_COVERED_PERCENT} % or more"
    )]
    NotCovered {
        /// Vertices with a surface near them, per cent.
        share: f64,
    },
}

const LEAST_COVERED_PERCENT: f64 = 50.0;

/// Rounds of the fit in the shape space, after the landmarks alone: ever nearer surfaces count, ever more.
const ROUNDS: [Round; 5] = [
    Round { farthest_m: 0.08, surface_sd_m: 0.03, landmark_sd_m: 0.006, steps: 3 },
    Round { farthest_m: 0.05, surface_sd_m: 0.015, landmark_sd_m: 0.006, steps: 3 },
    Round { farthest_m: 0.03, surface_sd_m: 0.008, landmark_sd_m: 0.006, steps: 4 },
    Round { farthest_m: 0.02, surface_sd_m: 0.005, landmark_sd_m: 0.006, steps: 4 },
    Round { farthest_m: 0.015, surface_sd_m: 0.003, landmark_sd_m: 0.006, steps: 6 },
];
const LANDMARKS_ALONE: Round = Round { farthest_m: 0.0, surface_sd_m: 1.0, landmark_sd_m: 0.006, steps: 12 };
/// Rounds that leave the shape space.
const STIFFNESSES: [Stiffness; 4] = [
    Stiffness { edges: 10.0, landmarks: 0.1, farthest_m: 0.015 },
    Stiffness { edges: 3.0, landmarks: 0.05, farthest_m: 0.012 },
    Stiffness { edges: 1.0, landmarks: 0.02, farthest_m: 0.010 },
    Stiffness { edges: 0.4, landmarks: 0.01, farthest_m: 0.010 },
];
const SETTLE_ROUNDS: usize = 20;
/// A shorter beginning of a landmark's name is not enough.
const LEAST_LETTERS: usize = 6;
/// Surface farther than this from the registered body is not its own.
const OWN_SURFACE_M: f64 = 0.02;

/// Registers the template of `model` to `scan`, which stands along y (any heading). Landmarks may be missing; without any, the
/// person must be alone or the largest thing in the scan, and in a pose not far from the rest pose.
///
/// # Errors
/// When the landmarks do not say where the body is, or the scan is no standing person, or is mostly holes.
pub fn register(
    model: &BodyModel,
    mut scan: Scan,
    landmarks: &[ScanLandmark],
) -> Result<Registration, RegisterError> {
    let looked_at: Vec<DVec3> = scan.points().iter().copied().step_by(10).collect();
    let (pairs, unknown_landmarks) = pair_landmarks(model, landmarks);
    let mut fit = if landmarks.is_empty() {
        start::without_landmarks(model, &mut scan)?
    } else {
        let given = landmarks.len();
        let too_few = RegisterError::TooFewLandmarks { known: pairs.len(), given };
        let mut fit = start::from_landmarks(model, &pairs).ok_or(too_few)?;
        fit.run(&scan, &pairs, &LANDMARKS_ALONE);
        fit
    };
    for round in &ROUNDS {
        orient(&mut scan, &fit.vertices, model.triangles());
        fit.run(&scan, &pairs, round);
    }
    let edges = edges(model.triangles());
    let mut vertices = fit.vertices.clone();
    for stiffness in &STIFFNESSES {
        vertices = deform(&fit.vertices, &vertices, model.triangles(), &edges, &scan, &pairs, stiffness);
    }
    settle(&fit.vertices, &mut vertices, model.triangles(), &edges);
    let distances_m = distances_m(&scan, &vertices, model.triangles());
    let share = 100.0 * distances_m.iter().flatten().count() as f64 / vertices.len() as f64;
    if share < LEAST_COVERED_PERCENT {
        return Err(RegisterError::NotCovered { share });
    }
    Ok(Registration {
        stray_share: stray_share(&looked_at, &vertices, model.triangles()),
        flipped: flipped(&fit.vertices, &vertices, model.triangles()),
        crossing: new_crossings(&fit.vertices, &vertices, model.triangles()),
        vertices,
        coefficients_sd: fit.coefficients_sd,
        pose: fit.pose,
        distances_m,
        unknown_landmarks,
    })
}

impl Registration {
    /// The vertices taken back to the rest pose, body frame, metres, `[n_vertices]`: the inverse of linear blend skinning.
    pub fn rest_vertices(&self, model: &BodyModel) -> Vec<DVec3> {
        let body = model.shape(&self.coefficients_sd);
        let reposer = Reposer::new(&body, &self.pose, &Pose::rest(body.rest_joints()));
        reposer.carry_all(&self.vertices, &model.template().influences)
    }

    /// The pose in which the body is measured: facing +z, arms and legs as at rest, trunk and head as they were. A posture is
    /// part of a trunk's girths, and no fit tells it well from a shape.
    pub fn standing_pose(&self, body: &Body) -> Pose {
        let rest = Pose::rest(body.rest_joints());
        let facing = self.pose.root_orientation * DVec3::Z;
        let turn_back = DQuat::from_rotation_y(-facing.x.atan2(facing.z));
        let mut pose = Pose { root_orientation: turn_back * self.pose.root_orientation, ..rest };
        for (dof, angle) in Skeleton::human().dofs().iter().zip(pose.angles.iter_mut().zip(&self.pose.angles))
        {
            if dof.joint <= JointId::HEAD {
                *angle.0 = *angle.1;
            }
        }
        pose
    }
}

/// Carries points of a body's surface from one pose to another.
pub struct Reposer {
    from_rest: Vec<DAffine3>,
    to_rest: Vec<DAffine3>,
}

impl Reposer {
    /// For the surface of `body`, from the pose `from` to the pose `to`.
    pub fn new(body: &Body, from: &Pose, to: &Pose) -> Self {
        let frames = |pose: &Pose| {
            let posed = body.world_from_joints(pose).into_iter().zip(body.rest_joints());
            posed.map(|(frame, rest)| frame * DAffine3::from_translation(-*rest)).collect()
        };
        Self { from_rest: frames(from), to_rest: frames(to) }
    }

    /// Where a point at `place`, whose skin weights are `influences`, goes; metres.
    pub fn carry(&self, place: DVec3, influences: &[(JointId, f32)]) -> DVec3 {
        let blend = |frames: &[DAffine3]| {
            influences.iter().fold((DMat3::ZERO, DVec3::ZERO), |(matrix, translation), &(joint, weight)| {
                let (frame, weight) = (frames[joint.index()], f64::from(weight));
                (matrix + frame.matrix3 * weight, translation + frame.translation * weight)
            })
        };
        let (from_matrix, from_translation) = blend(&self.from_rest);
        let (to_matrix, to_translation) = blend(&self.to_rest);
        to_matrix * (from_matrix.inverse() * (place - from_translation)) + to_translation
    }

    /// As [`Reposer::carry`], for points with their skin weights.
    ///
    /// # Panics
    /// When there are more points than weights.
    pub fn carry_all(&self, places: &[DVec3], influences: &[Vec<(JointId, f32)>]) -> Vec<DVec3> {
        assert!(places.len() <= influences.len(), "{} points, {} weights", places.len(), influences.len());
        places.iter().zip(influences).map(|(place, own)| self.carry(*place, own)).collect()
    }
}

/// Landmarks of the template with their places on the scan, and names that the template does not have.
fn pair_landmarks(model: &BodyModel, landmarks: &[ScanLandmark]) -> (Vec<LandmarkPair>, Vec<String>) {
    let (mut pairs, mut unknown) = (Vec::new(), Vec::new());
    for landmark in landmarks {
        match find_landmark(&model.template().landmarks, &landmark.name) {
            None => unknown.push(landmark.name.clone()),
            Some(known) => pairs.push(LandmarkPair {
                vertices: known.vertices,
                barycentric: known.barycentric.map(f64::from),
                position: landmark.position,
            }),
        }
    }
    (pairs, unknown)
}

/// The landmark that `name` stands for. Files of the CAESAR survey write `Lt. Axilla, An` for `Lt Axilla, Ant.`: letters and digits
/// count, and the beginning of a name is enough if only one name begins so.
fn find_landmark<'a>(landmarks: &'a [Landmark], name: &str) -> Option<&'a Landmark> {
    let plain = |name: &str| -> String {
        name.chars().filter(char::is_ascii_alphanumeric).map(|c| c.to_ascii_lowercase()).collect()
    };
    let wanted = plain(name);
    if let Some(exact) = landmarks.iter().find(|landmark| plain(&landmark.name) == wanted) {
        return Some(exact);
    }
    let mut begun = landmarks.iter().filter(|landmark| plain(&landmark.name).starts_with(&wanted));
    let first = begun.next().filter(|_| wanted.len() >= LEAST_LETTERS)?;
    begun.next().is_none().then_some(first)
}

/// Turns the normals of a cloud to the side of the nearest triangle of the body.
fn orient(scan: &mut Scan, vertices: &[DVec3], triangles: &[[u32; 3]]) {
    let tree = TriangleTree::new(vertices, triangles);
    scan.orient(|point| area_normal(corners(vertices, triangles[tree.nearest(point).triangle as usize])));
}

/// Every edge once.
fn edges(triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let of_triangle = |&[a, b, c]: &[u32; 3]| [[a, b], [b, c], [c, a]];
    // In a closed mesh each edge is run along both ways.
    triangles.iter().flat_map(of_triangle).filter(|[from, to]| from < to).collect()
}

/// Takes back what the last step spoilt: displacements of vertices on flipped or crossing triangles become the mean of their
/// neighbours', until no such triangle is left or the rounds are over.
fn settle(before: &[DVec3], after: &mut [DVec3], triangles: &[[u32; 3]], edges: &[[u32; 2]]) {
    for _ in 0..SETTLE_ROUNDS {
        let mut spoilt = flipped(before, after, triangles);
        spoilt.extend(new_crossings(before, after, triangles).into_iter().flatten());
        if spoilt.is_empty() {
            return;
        }
        let mut sums = vec![(DVec3::ZERO, 0.0); after.len()];
        for &[a, b] in edges {
            for (to, from) in [(a as usize, b as usize), (b as usize, a as usize)] {
                sums[to].0 += after[from] - before[from];
                sums[to].1 += 1.0;
            }
        }
        for vertex in spoilt.into_iter().flat_map(|triangle| triangles[triangle as usize]) {
            let (sum, count) = sums[vertex as usize];
            after[vertex as usize] = before[vertex as usize] + sum / count;
        }
    }
}

fn distances_m(scan: &Scan, vertices: &[DVec3], triangles: &[[u32; 3]]) -> Vec<Option<f64>> {
    let normals = vertex_normals(vertices, triangles);
    let distance = |(&place, &normal): (&DVec3, &DVec3)| {
        let plane = scan.surface_near(place, normal, OWN_SURFACE_M, model_fit::LEAST_COSINE)?;
        Some(plane.height_m(place).abs())
    };
    vertices.iter().zip(&normals).map(distance).collect()
}

fn stray_share(points: &[DVec3], vertices: &[DVec3], triangles: &[[u32; 3]]) -> f64 {
    let tree = TriangleTree::new(vertices, triangles);
    let is_stray = |point: &&DVec3| tree.nearest(**point).distance_m > STRAY_M;
    points.iter().filter(is_stray).count() as f64 / points.len() as f64
}

fn flipped(before: &[DVec3], after: &[DVec3], triangles: &[[u32; 3]]) -> Vec<u32> {
    let is_flipped = |triangle: [u32; 3]| {
        area_normal(corners(before, triangle)).dot(area_normal(corners(after, triangle))) <= 0.0
    };
    (0u32..).zip(triangles).filter(|(_, triangle)| is_flipped(**triangle)).map(|(index, _)| index).collect()
}

fn new_crossings(before: &[DVec3], after: &[DVec3], triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let old = crossing_triangles(before, triangles);
    let mut new = crossing_triangles(after, triangles);
    new.retain(|pair| old.binary_search(pair).is_err());
    new
}
