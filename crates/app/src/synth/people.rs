//! People with known bodies: the population's full mesh, and what was measured on it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, bail};
use body::build::heel_vertices;
use body::io::bodies::BodiesData;
use body::pose::forward_kinematics;
use body::{JointId, N_JOINTS, Pose, RestJoints, Sex, Skeleton};
use glam::{Affine3A, DAffine3, DVec3, Vec3A};
use serde::Deserialize;

/// A folder of bodies on one mesh.
pub struct People {
    data: BodiesData,
    truths: Vec<Truth>,
    heels: [u32; 2],
    mesh: Arc<FullMesh>,
}

/// What is true of a body: measured on its full mesh, or known of the person it was made after.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Truth {
    /// Name of the body.
    #[serde(rename = "body_id")]
    pub id: String,
    /// `female` or `male`.
    #[serde(deserialize_with = "sex_from_text")]
    pub sex: Sex,
    /// Weight of the person, kg.
    pub weight_kg: f64,
    /// Stature, metres.
    pub stature_m: f64,
    /// Girth at the height of the nipples, metres.
    pub chest_m: f64,
    /// Girth at the navel, metres.
    pub waist_m: f64,
    /// Girth at the rearmost point of the buttocks, metres.
    pub hips_m: f64,
    /// Girth of the right thigh 2 cm below the crotch, metres.
    pub right_thigh_m: f64,
    /// Largest girth of the right calf, metres.
    pub right_calf_m: f64,
}

fn sex_from_text<'de, D: serde::Deserializer<'de>>(text: D) -> Result<Sex, D::Error> {
    match String::deserialize(text)?.as_str() {
        "female" => Ok(Sex::Female),
        "male" => Ok(Sex::Male),
        other => {
            Err(serde::de::Error::custom(format_args!("`sex` is `{other}`, expected `female` or `male`")))
        }
    }
}

/// What all bodies of a folder share.
struct FullMesh {
    triangles: Vec<[u32; 3]>,
    skin: Vec<Vec<(JointId, f32)>>,
}

/// One person's body on the population's mesh.
#[derive(Clone)]
pub struct FullBody {
    mesh: Arc<FullMesh>,
    rest_vertices: Vec<Vec3A>,
    rest_joints: RestJoints,
}

impl People {
    /// Reads a folder laid out as [`BodiesData::read`] says, and all columns of [`Truth`] from its `truth.csv`.
    ///
    /// # Errors
    /// Names the file at fault.
    pub fn read(folder: &Path) -> anyhow::Result<Self> {
        let data = BodiesData::read(folder)?;
        let truths = read_truths(&folder.join("truth.csv"))?;
        if truths.len() != data.coefficients.len() {
            bail!(
                "{}: {} rows below the header, expected {}, one a body",
                folder.join("truth.csv").display(),
                truths.len(),
                data.coefficients.len()
            );
        }
        let heels = heel_vertices(&data)?;
        let mesh = Arc::new(FullMesh { triangles: data.triangles.clone(), skin: data.skin.clone() });
        Ok(Self { data, truths, heels, mesh })
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.truths.len()
    }

    /// Whether there is nobody.
    pub fn is_empty(&self) -> bool {
        self.truths.is_empty()
    }

    /// The arrays they are made of.
    pub fn data(&self) -> &BodiesData {
        &self.data
    }

    /// What is true of each, `[n_people]`.
    pub fn truths(&self) -> &[Truth] {
        &self.truths
    }

    /// The body of person `index`.
    ///
    /// # Panics
    /// When there are not so many.
    pub fn body(&self, index: usize) -> FullBody {
        let vertices = self.data.vertices(index);
        let mut rest_joints = [DVec3::ZERO; N_JOINTS];
        let joints = self.data.joints(index);
        let heels = self.heels.map(|heel| vertices[heel as usize]);
        for (place, joint) in rest_joints.iter_mut().zip(joints.into_iter().chain(heels)) {
            *place = joint;
        }
        let rest_vertices = vertices.iter().map(|vertex| vertex.as_vec3a()).collect();
        FullBody { mesh: self.mesh.clone(), rest_vertices, rest_joints }
    }
}

fn read_truths(path: &PathBuf) -> anyhow::Result<Vec<Truth>> {
    let rows = csv::Reader::from_path(path).and_then(|mut reader| reader.deserialize().collect());
    rows.with_context(|| format!("{}: not a table of bodies", path.display()))
}

impl FullBody {
    /// Joints at rest, metres, body frame.
    pub fn rest_joints(&self) -> &RestJoints {
        &self.rest_joints
    }

    /// Vertices at rest, metres, body frame, `[n_vertices]`.
    pub fn rest_vertices(&self) -> &[Vec3A] {
        &self.rest_vertices
    }

    /// Triangles, outward by the right-hand rule.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.mesh.triangles
    }

    /// Joint positions in `pose`, metres, world.
    pub fn joints_world(&self, pose: &Pose) -> [DVec3; N_JOINTS] {
        forward_kinematics(Skeleton::human(), &self.rest_joints, pose).map(|frame| frame.translation)
    }

    /// Vertices of the posed body by linear blend skinning, metres, in the frame that `target_from_world` leads to.
    pub fn skin_into(&self, target_from_world: &DAffine3, pose: &Pose, out: &mut Vec<[f32; 3]>) {
        let frames = forward_kinematics(Skeleton::human(), &self.rest_joints, pose);
        let mut target_from_rest = [Affine3A::IDENTITY; N_JOINTS];
        for ((target, world_from_joint), rest) in
            target_from_rest.iter_mut().zip(&frames).zip(&self.rest_joints)
        {
            let frame = *target_from_world * *world_from_joint * DAffine3::from_translation(-*rest);
            *target = Affine3A::from_mat3_translation(frame.matrix3.as_mat3(), frame.translation.as_vec3());
        }
        let posed = self.rest_vertices.iter().zip(&self.mesh.skin).map(|(&vertex, influences)| {
            let terms = influences
                .iter()
                .map(|&(joint, weight)| weight * target_from_rest[joint.index()].transform_point3a(vertex));
            terms.sum::<Vec3A>().to_array()
        });
        out.clear();
        out.extend(posed);
    }
}
