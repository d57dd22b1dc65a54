//! The tape: measures bodies that share one part-labelled mesh.

use body::model::{Landmark, Template};
use body::{Body, JointId, RestJoints};
use glam::DVec3;

use crate::extremum::{bracket, maximum};
use crate::girth::Girth;
use crate::hull::{convex_hull, perimeter};
use crate::section::{Piece, Plane, heights_along, position_of};

#[cfg(test)]
mod tests;

/// Heights of extremal girths are found to this.
const HEIGHT_TOLERANCE_M: f64 = 1e-3;
/// The thigh is measured this far below the crotch; the hips begin as far above it.
const BELOW_CROTCH_M: f64 = 0.02;
/// Ends of the range of [`Girth::SmallestWaist`].
const BELOW_NAVEL_M: f64 = 0.02;
const BELOW_BUST_M: f64 = 0.06;
/// The largest hips lie below this share of the way from the crotch to the navel.
const HIPS_SHARE: f64 = 0.75;
/// The largest calf lies between these shares of the way from knee to ankle.
const CALF_RANGE: [f64; 2] = [0.22, 0.60];
/// The arm is measured at this share of the way from shoulder to elbow.
const ARM_SHARE: f64 = 0.55;

/// What a mesh must come with to be measured.
#[derive(Clone, Copy, Debug)]
pub struct Labels<'a> {
    /// Outward by the right-hand rule.
    pub triangles: &'a [[u32; 3]],
    /// Body part of each vertex: index into `part_names`.
    pub parts: &'a [u8],
    /// Names of the body parts, as in `right_thigh`.
    pub part_names: &'a [String],
    /// Named points of the surface.
    pub landmarks: &'a [Landmark],
}

impl<'a> From<&'a Template> for Labels<'a> {
    fn from(template: &'a Template) -> Self {
        Self {
            triangles: &template.triangles,
            parts: &template.parts,
            part_names: &template.part_names,
            landmarks: &template.landmarks,
        }
    }
}

/// Why a mesh's labels do not suffice.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LabelsError {
    /// A landmark that says where to measure.
    #[error("the landmark `{name}` is missing")]
    MissingLandmark {
        /// Its name.
        name: &'static str,
    },
    /// A body part that is measured or left out.
    #[error("the body part `{name}` is missing")]
    MissingPart {
        /// Its name.
        name: &'static str,
    },
    /// A triangle or landmark of a vertex that has no label.
    #[error("vertex {vertex} is used, but there are {count} labels")]
    VertexOutOfRange {
        /// Vertex named.
        vertex: u32,
        /// Number of labels.
        count: usize,
    },
}

/// Why a girth cannot be taken.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeasureError {
    /// The plane does not meet the part of the body.
    #[error("`{girth}`: the plane at a height of {height_m:.3} m does not meet that part of the body")]
    NothingThere {
        /// Name of the girth.
        girth: &'static str,
        /// Height of its plane where it meets the body's axis.
        height_m: f64,
    },
    /// A vertex that is nowhere.
    #[error("`vertices[{vertex}]` is {position:?}, expected finite numbers")]
    NotFinite {
        /// Which.
        vertex: usize,
        /// Where.
        position: [f32; 3],
    },
}

/// One girth of one body.
#[derive(Clone, Debug, PartialEq)]
pub struct TapeReading {
    /// Perimeter of the hull.
    pub girth_m: f64,
    /// Where the tape lies.
    pub plane: Plane,
}

/// What is measured of one body.
#[derive(Clone, Debug, PartialEq)]
pub struct Measurements {
    /// In the order of [`Girth::ALL`].
    pub girths: [TapeReading; Girth::ALL.len()],
    /// From the lowest to the highest vertex.
    pub stature_m: f64,
    /// The point between the legs above the soles.
    pub crotch_height_m: f64,
    /// Enclosed volume.
    pub volume_m3: f64,
}

impl Measurements {
    /// One girth, metres.
    pub fn girth_m(&self, girth: Girth) -> f64 {
        self.girths[girth.index()].girth_m
    }

    /// Plane of a girth.
    pub fn plane(&self, girth: Girth) -> Plane {
        self.girths[girth.index()].plane
    }
}

/// Measures bodies on one labelled mesh, at rest in the body frame: y up, facing +z, metres.
///
/// ```
/// use biosig::{Girth, Tape};
/// let model = body::BodyModel::builtin();
/// let tape = Tape::of_model(&model);
/// let measured = tape.measure_body(&model.mean()).unwrap();
/// assert!((0.7..1.2).contains(&measured.girth_m(Girth::Waist)));
/// ```
#[derive(Clone, Debug)]
pub struct Tape {
    triangles: Vec<[u32; 3]>,
    /// Triangles without a corner on an arm.
    trunk: Piece,
    /// Triangles with a corner on the part.
    thigh: Piece,
    calf: Piece,
    arm: Piece,
    /// Triangles all of whose corners are on neck, head or chest.
    neck: Piece,
    pelvis_vertices: Vec<u32>,
    points: Points,
}

/// Landmarks that say where to measure.
#[derive(Clone, Debug)]
struct Points {
    bust: [Landmark; 2],
    navel: Landmark,
    crotch: Landmark,
    adams_apple: Landmark,
}

impl Points {
    fn of(landmarks: &[Landmark]) -> Result<Self, LabelsError> {
        let find = |name: &'static str| {
            let found = landmarks.iter().find(|landmark| landmark.name == name);
            found.cloned().ok_or(LabelsError::MissingLandmark { name })
        };
        Ok(Self {
            bust: [find("Rt Thelion/Bustpoint")?, find("Lt Thelion/Bustpoint")?],
            navel: find("Navel")?,
            crotch: find("Crotch")?,
            adams_apple: find("Below Adam's Apple")?,
        })
    }
}

impl Tape {
    /// A tape for the mesh that these labels describe.
    ///
    /// # Errors
    /// When a landmark or a body part that is measured is missing.
    pub fn new(labels: Labels<'_>) -> Result<Self, LabelsError> {
        let count = labels.parts.len();
        let of_landmarks = labels.landmarks.iter().flat_map(|landmark| landmark.vertices);
        let mut used = labels.triangles.iter().flatten().copied().chain(of_landmarks);
        if let Some(vertex) = used.find(|&vertex| vertex as usize >= count) {
            return Err(LabelsError::VertexOutOfRange { vertex, count });
        }
        let part = |name: &'static str| {
            let place = labels.part_names.iter().position(|known| known == name);
            place.map(|place| place as u8).ok_or(LabelsError::MissingPart { name })
        };
        let on = |parts: &[u8], vertex: u32| parts.contains(&labels.parts[vertex as usize]);
        let select = |is_in: &dyn Fn(&[u32; 3]) -> bool| {
            Piece::new(labels.triangles.iter().copied().filter(|triangle| is_in(triangle)).collect())
        };
        let touching = |parts: &[u8]| select(&|triangle| triangle.iter().any(|&vertex| on(parts, vertex)));
        let arms = [
            part("left_upper_arm")?,
            part("right_upper_arm")?,
            part("left_forearm")?,
            part("right_forearm")?,
            part("left_hand")?,
            part("right_hand")?,
        ];
        let around_neck = [part("head")?, part("neck")?, part("chest")?];
        let pelvis = part("pelvis")?;
        Ok(Self {
            triangles: labels.triangles.to_vec(),
            trunk: select(&|triangle| !triangle.iter().any(|&vertex| on(&arms, vertex))),
            thigh: touching(&[part("right_thigh")?]),
            calf: touching(&[part("right_calf")?]),
            arm: touching(&[part("right_upper_arm")?]),
            neck: select(&|triangle| triangle.iter().all(|&vertex| on(&around_neck, vertex))),
            pelvis_vertices: (0..count as u32).filter(|&vertex| on(&[pelvis], vertex)).collect(),
            points: Points::of(labels.landmarks)?,
        })
    }

    /// A tape for the bodies of a model.
    ///
    /// # Panics
    /// When the model's template lacks parts or landmarks; the built-in one has them.
    pub fn of_model(model: &body::BodyModel) -> Self {
        Self::new(model.template().into()).expect("the template has the labels that measuring needs")
    }

    /// Measures a body of the model at rest.
    ///
    /// # Errors
    /// As [`Tape::measure`].
    pub fn measure_body(&self, body: &Body) -> Result<Measurements, MeasureError> {
        self.measure(body.rest_vertices(), body.rest_joints())
    }

    /// Measures a mesh: `vertices` (one for each label) and joints in metres, body frame, at rest. Of the joints, the right
    /// shoulder, elbow, knee and ankle, the neck and the head count.
    ///
    /// # Errors
    /// When a vertex is not finite, or the mesh has nothing where a girth is to be taken.
    ///
    /// # Panics
    /// When there are fewer vertices than labels.
    pub fn measure(&self, vertices: &[[f32; 3]], joints: &RestJoints) -> Result<Measurements, MeasureError> {
        if let Some(vertex) = vertices.iter().position(|vertex| vertex.iter().any(|x| !x.is_finite())) {
            return Err(MeasureError::NotFinite { vertex, position: vertices[vertex] });
        }
        let heights = heights_along(vertices, DVec3::Y);
        let (low, high) =
            heights.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), &y| (l.min(y), h.max(y)));
        let (low, high) = (f64::from(low), f64::from(high));
        let mut body = Measuring { tape: self, vertices, heights, joints, scratch: Vec::new() };
        let planes = Girth::ALL.map(|girth| body.plane_of(girth));
        let mut girths = Vec::with_capacity(planes.len());
        for (girth, plane) in Girth::ALL.into_iter().zip(planes) {
            let girth_m = body.around(self.piece_of(girth), &plane);
            if girth_m <= 0.0 {
                return Err(MeasureError::NothingThere { girth: girth.name(), height_m: plane.point.y });
            }
            girths.push(TapeReading { girth_m, plane });
        }
        Ok(Measurements {
            girths: girths.try_into().expect("one for each girth"),
            stature_m: high - low,
            crotch_height_m: body.place(&self.points.crotch).y - low,
            volume_m3: self.volume_m3(vertices),
        })
    }

    /// The corners of the tape of a girth that lies in `plane`, metres, body frame: for pictures.
    ///
    /// # Panics
    /// When there are fewer vertices than labels.
    pub fn loop_of(&self, vertices: &[[f32; 3]], girth: Girth, plane: &Plane) -> Vec<DVec3> {
        let mut points = Vec::new();
        self.piece_of(girth).cut(vertices, &heights_along(vertices, plane.normal), plane, &mut points);
        convex_hull(&mut points).into_iter().map(|corner| plane.lift(corner)).collect()
    }

    fn piece_of(&self, girth: Girth) -> &Piece {
        match girth {
            Girth::Chest | Girth::Waist | Girth::Hips | Girth::SmallestWaist | Girth::LargestHips => {
                &self.trunk
            }
            Girth::RightThigh => &self.thigh,
            Girth::RightCalf => &self.calf,
            Girth::Neck => &self.neck,
            Girth::RightUpperArm => &self.arm,
        }
    }

    /// Volume of a closed mesh: signed tetrahedra over its triangles.
    fn volume_m3(&self, vertices: &[[f32; 3]]) -> f64 {
        let corner = |vertex| position_of(vertices, vertex);
        let six = |&[a, b, c]: &[u32; 3]| corner(a).dot(corner(b).cross(corner(c)));
        self.triangles.iter().map(six).sum::<f64>() / 6.0
    }
}

/// One body under the tape.
struct Measuring<'a> {
    tape: &'a Tape,
    vertices: &'a [[f32; 3]],
    /// Of the vertices, metres.
    heights: Vec<f32>,
    joints: &'a RestJoints,
    scratch: Vec<[f64; 2]>,
}

impl Measuring<'_> {
    fn plane_of(&mut self, girth: Girth) -> Plane {
        let (tape, points) = (self.tape, &self.tape.points);
        let height = |landmark: &Landmark| self.place(landmark).y;
        let bust = height(&points.bust[0]).midpoint(height(&points.bust[1]));
        let (navel, crotch) = (height(&points.navel), height(&points.crotch));
        let joint = |joint: JointId| self.joints[joint.index()];
        match girth {
            Girth::Chest => Plane::horizontal(bust),
            Girth::Waist => Plane::horizontal(navel),
            Girth::Hips => Plane::horizontal(self.rearmost_of_pelvis().y),
            Girth::RightThigh => Plane::horizontal(crotch - BELOW_CROTCH_M),
            Girth::RightCalf => {
                let (knee, ankle) = (joint(JointId::RIGHT_KNEE).y, joint(JointId::RIGHT_ANKLE).y);
                let ends = CALF_RANGE.map(|share| knee + share * (ankle - knee));
                self.extremal(&tape.calf, [ends[1], ends[0]], 1.0)
            }
            Girth::Neck => {
                let normal = (joint(JointId::HEAD) - joint(JointId::NECK)).normalize();
                Plane { point: self.place(&points.adams_apple), normal }
            }
            Girth::RightUpperArm => {
                let (shoulder, elbow) = (joint(JointId::RIGHT_SHOULDER), joint(JointId::RIGHT_ELBOW));
                Plane { point: shoulder.lerp(elbow, ARM_SHARE), normal: (elbow - shoulder).normalize() }
            }
            Girth::SmallestWaist => {
                self.extremal(&tape.trunk, [navel - BELOW_NAVEL_M, bust - BELOW_BUST_M], -1.0)
            }
            Girth::LargestHips => {
                let top = crotch + HIPS_SHARE * (navel - crotch);
                self.extremal(&tape.trunk, [crotch + BELOW_CROTCH_M, top], 1.0)
            }
        }
    }

    /// The horizontal plane in which the girth, times `sign`, is largest.
    fn extremal(&mut self, piece: &Piece, range_m: [f64; 2], sign: f64) -> Plane {
        let reaching = piece.between(&self.heights, range_m);
        let bracket =
            bracket(|height_m| sign * self.around(&reaching, &Plane::horizontal(height_m)), range_m);
        let nearer = reaching.between(&self.heights, bracket.ends);
        let girth_at = |height_m| sign * self.around(&nearer, &Plane::horizontal(height_m));
        Plane::horizontal(maximum(girth_at, bracket, HEIGHT_TOLERANCE_M).0)
    }

    /// Perimeter of the hull of a section, metres; 0 when the plane does not meet the piece.
    fn around(&mut self, piece: &Piece, plane: &Plane) -> f64 {
        self.scratch.clear();
        if plane.normal == DVec3::Y {
            piece.cut(self.vertices, &self.heights, plane, &mut self.scratch);
        } else {
            let heights = heights_along(self.vertices, plane.normal);
            piece.cut(self.vertices, &heights, plane, &mut self.scratch);
        }
        perimeter(&convex_hull(&mut self.scratch))
    }

    fn place(&self, landmark: &Landmark) -> DVec3 {
        let corner = |(&v, w): (&u32, f32)| self.position(v) * f64::from(w);
        landmark.vertices.iter().zip(landmark.barycentric).map(corner).sum()
    }

    fn rearmost_of_pelvis(&self) -> DVec3 {
        let points = self.tape.pelvis_vertices.iter().map(|&vertex| self.position(vertex));
        points.min_by(|a, b| a.z.total_cmp(&b.z)).expect("a part that is named has vertices")
    }

    fn position(&self, vertex: u32) -> DVec3 {
        position_of(self.vertices, vertex)
    }
}
