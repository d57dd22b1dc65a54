//! Labels for a mesh that has none: from the template registered to it.

use body::mesh::{Nearest, TriangleTree};
use body::model::{Landmark, Template};
use body::register::{Registration, Reposer};
use body::{BodyModel, JointId, N_JOINTS, RestJoints};
use glam::DVec3;

use crate::tape::{Labels, MeasureError, Measurements, Tape};

/// A mesh with the labels of the template that was registered to it, in the [standing pose](Registration::standing_pose).
#[derive(Clone, Debug)]
pub struct LabelledMesh {
    /// Metres, y up, facing +z.
    pub vertices: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    parts: Vec<u8>,
    part_names: Vec<String>,
    landmarks: Vec<Landmark>,
    joints: RestJoints,
}

impl LabelledMesh {
    /// The registered template itself: for scans without triangles.
    pub fn of_template(model: &BodyModel, registration: &Registration) -> Self {
        let template = model.template();
        let standing = Standing::of(model, registration);
        let vertices = standing.reposer.carry_all(&registration.vertices, &template.influences);
        Self {
            vertices: vertices.into_iter().map(single).collect(),
            triangles: template.triangles.clone(),
            parts: template.parts.clone(),
            part_names: template.part_names.clone(),
            landmarks: template.landmarks.clone(),
            joints: standing.joints,
        }
    }

    /// Gives each vertex (metres, the scan's frame) the skin weights of the nearest point of the registered template, moves it
    /// to the standing pose with them, and labels it with the part that most of the weight belongs to. Landmarks go to
    /// the nearest points of the mesh.
    ///
    /// # Panics
    /// When the mesh has no triangles, or one names a vertex that is not there.
    pub fn transfer(
        model: &BodyModel,
        registration: &Registration,
        vertices: &[[f32; 3]],
        triangles: &[[u32; 3]],
    ) -> Self {
        let template = model.template();
        let on_template = TriangleTree::new(&registration.vertices, &template.triangles);
        let standing = Standing::of(model, registration);
        let part_of = parts_of_joints(template);
        let (mut moved, mut parts) = (Vec::new(), Vec::new());
        for vertex in vertices {
            let place = double(*vertex);
            let nearest = on_template.nearest(place);
            let corners = template.triangles[nearest.triangle as usize];
            let weights = blended_weights(&template.influences, corners, &nearest);
            moved.push(single(standing.reposer.carry(place, &weights)));
            parts.push(heaviest_part(&weights, &part_of));
        }
        let points: Vec<DVec3> = vertices.iter().copied().map(double).collect();
        let on_mesh = TriangleTree::new(&points, triangles);
        let landmarks = template.landmarks.iter().map(|landmark| {
            let corners = landmark.vertices.iter().zip(landmark.barycentric);
            let place = corners.map(|(&v, w)| registration.vertices[v as usize] * f64::from(w)).sum();
            let nearest = on_mesh.nearest(place);
            Landmark {
                name: landmark.name.clone(),
                vertices: triangles[nearest.triangle as usize],
                barycentric: nearest.barycentric.map(|w| w as f32),
            }
        });
        Self {
            landmarks: landmarks.collect(),
            vertices: moved,
            parts,
            triangles: triangles.to_vec(),
            part_names: template.part_names.clone(),
            joints: standing.joints,
        }
    }

    /// Measures the mesh.
    ///
    /// # Errors
    /// When it has nothing where a girth is to be taken.
    pub fn measure(&self) -> Result<Measurements, MeasureError> {
        let labels = Labels {
            triangles: &self.triangles,
            parts: &self.parts,
            part_names: &self.part_names,
            landmarks: &self.landmarks,
        };
        let tape = Tape::new(labels).expect("the template has the labels that measuring needs");
        tape.measure(&self.vertices, &self.joints)
    }
}

fn double(point: [f32; 3]) -> DVec3 {
    DVec3::from_array(point.map(f64::from))
}

fn single(point: DVec3) -> [f32; 3] {
    point.to_array().map(|x| x as f32)
}

/// The way to the standing pose, and the joints there.
struct Standing {
    reposer: Reposer,
    joints: RestJoints,
}

impl Standing {
    fn of(model: &BodyModel, registration: &Registration) -> Self {
        let body = model.shape(&registration.coefficients_sd);
        let pose = registration.standing_pose(&body);
        Self { reposer: Reposer::new(&body, &registration.pose, &pose), joints: body.joints_world(&pose) }
    }
}

/// The part that most of the weight of each joint lies on.
fn parts_of_joints(template: &Template) -> [u8; N_JOINTS] {
    let mut weights = vec![[0.0; N_JOINTS]; template.part_names.len()];
    for (influences, part) in template.influences.iter().zip(&template.parts) {
        for &(joint, weight) in influences {
            weights[usize::from(*part)][joint.index()] += weight;
        }
    }
    std::array::from_fn(|joint| {
        let heavier = |a: &usize, b: &usize| weights[*a][joint].total_cmp(&weights[*b][joint]);
        (0..weights.len()).max_by(heavier).expect("the template has parts") as u8
    })
}

fn heaviest_part(weights: &[(JointId, f32)], part_of: &[u8; N_JOINTS]) -> u8 {
    let weight_of = |part: u8| -> f32 {
        weights.iter().filter(|(joint, _)| part_of[joint.index()] == part).map(|(_, weight)| weight).sum()
    };
    let parts = weights.iter().map(|(joint, _)| part_of[joint.index()]);
    parts.max_by(|&a, &b| weight_of(a).total_cmp(&weight_of(b))).expect("every point has weights")
}

/// Skin weights of a point on a triangle.
fn blended_weights(
    influences: &[Vec<(JointId, f32)>],
    corners: [u32; 3],
    nearest: &Nearest,
) -> Vec<(JointId, f32)> {
    let mut weights: Vec<(JointId, f32)> = Vec::new();
    for (corner, share) in corners.into_iter().zip(nearest.barycentric) {
        for &(joint, weight) in &influences[corner as usize] {
            let weight = weight * share as f32;
            match weights.iter_mut().find(|(known, _)| *known == joint) {
                Some((_, sum)) => *sum += weight,
                None => weights.push((joint, weight)),
            }
        }
    }
    weights
}

#[cfg(test)]
mod tests {
    use body::register::{Scan, register};
    use body::{Pose, Sex, Skeleton};
    use glam::DQuat;

    use super::*;
    use crate::girth::Girth;

    #[test]
    fn a_posed_body_without_labels_has_the_girths_of_the_labelled_one() {
        let model = BodyModel::builtin();
        let body = model.shape_for_stature(1.72, Some(Sex::Female));
        let mut pose = Pose {
            root_position: body.rest_joints()[0] + DVec3::new(0.2, 0.0, -0.1),
            root_orientation: DQuat::from_rotation_y(0.3),
            angles: vec![0.0; body::N_DOF],
        };
        pose.angles[Skeleton::human().dof_index("right_shoulder_abduction").unwrap()] = -0.25;
        pose.angles[Skeleton::human().dof_index("right_knee_flexion").unwrap()] = 0.2;
        let mut posed = vec![[0.0; 3]; body.n_vertices()];
        body.skin_into(&pose, &mut posed);
        let scan = Scan::new(&posed, body.triangles()).unwrap();
        let registration = register(&model, scan, &[]).unwrap();
        let labelled = LabelledMesh::transfer(&model, &registration, &posed, body.triangles());
        let found = labelled.measure().unwrap();
        let expected = Tape::of_model(&model).measure_body(&body).unwrap();
        for girth in Girth::ALL {
            let error_m = found.girth_m(girth) - expected.girth_m(girth);
            assert!(error_m.abs() < 0.012, "{}: {error_m}", girth.name());
        }
        assert!((found.stature_m - 1.72).abs() < 0.01, "{}", found.stature_m);
        assert!((found.volume_m3 / expected.volume_m3 - 1.0).abs() < 0.01);
    }
}
