//! Axes and limits of the joint angles.
//!
//! Axes follow the limbs of the template at rest, so that equal angles left and right are a mirror-symmetric pose.
//! Where a joint has three axes, the first is the one along which its limb never points (gimbal lock): flexion before
//! lateral bending before axial rotation for trunk and hip. An arm reaches almost a half sphere, whose middle lies
//! forward and to the side; both ends of its first axis, 40 degrees behind the side and 50 degrees across the chest, are at
//! the rim of that reach.
//!
//! Limits are in anatomical angles of `[NorkinWhite2016]` (whose normal ranges go back to `[AAOS1965]`), widened by 5 to 15
//! degrees because skinning bends at points and people differ (`[BooneAzen1979]`: standard deviations of 4 to 9 degrees).
//! Ranges that the books give for whole regions are shared out: trunk 80 degrees forward and 25 back over three joints,
//! neck 45 and 60 over two. The angle that the rest pose already holds is subtracted.

use glam::DVec3;

use super::{Dof, JointId};

/// Joints of the left arm and leg of the mean body at rest, metres, body frame: they fix the axes, the same for all bodies.
mod rest {
    use glam::DVec3;
    pub const SHOULDER: DVec3 = DVec3::new(0.1796, 1.3442, 0.0207);
    pub const ELBOW: DVec3 = DVec3::new(0.3535, 1.1498, 0.0269);
    pub const WRIST: DVec3 = DVec3::new(0.4743, 1.0269, 0.1862);
    pub const FINGERTIP: DVec3 = DVec3::new(0.5332, 0.9024, 0.3243);
    /// From the styloid of the little finger's side to that of the thumb's side.
    pub const THUMBWARD: DVec3 = DVec3::new(-0.0260, 0.0233, 0.0525);
    pub const HIP: DVec3 = DVec3::new(0.1091, 0.9037, 0.0045);
    pub const KNEE: DVec3 = DVec3::new(0.1505, 0.5061, 0.0362);
    pub const ANKLE: DVec3 = DVec3::new(0.1916, 0.0766, 0.0091);
}

/// Azimuth behind the side of the shoulder's first axis, degrees.
const SHOULDER_POLE_DEG: f64 = 40.0;

/// A joint angle of the trunk or the left side: movement, axis, anatomical limits and anatomical angle at rest, degrees.
type Row = (&'static str, DVec3, [f64; 2], f64);

fn trunk(flexion: [f64; 2], side: f64, turn: f64) -> [Row; 3] {
    [
        ("flexion", DVec3::X, flexion, 0.0),
        ("left_bend", DVec3::NEG_Z, [-side, side], 0.0),
        ("left_turn", DVec3::Y, [-turn, turn], 0.0),
    ]
}

fn clavicle() -> [Row; 2] {
    [("protraction", DVec3::NEG_Y, [-25.0, 35.0], 0.0), ("elevation", DVec3::Z, [-10.0, 45.0], 0.0)]
}

fn shoulder() -> [Row; 3] {
    let arm = (rest::ELBOW - rest::SHOULDER).normalize();
    let (sin, cos) = SHOULDER_POLE_DEG.to_radians().sin_cos();
    // Raises the arm from hanging towards the middle of its reach, (sin, 0, cos).
    let raise = DVec3::new(-cos, 0.0, sin);
    let outward = raise.cross(arm).normalize();
    let latitude = -raise.dot(arm).asin();
    let longitude = DVec3::new(sin, 0.0, cos).dot(arm).atan2(-arm.y);
    [
        ("elevation", raise, [-65.0, 190.0], longitude.to_degrees()),
        ("abduction", outward, [-85.0, 85.0], latitude.to_degrees()),
        ("internal_rotation", arm, [-100.0, 100.0], 0.0),
    ]
}

fn elbow() -> [Row; 2] {
    let (upper, fore) = (rest::ELBOW - rest::SHOULDER, (rest::WRIST - rest::ELBOW).normalize());
    let bend = upper.angle_between(fore).to_degrees();
    [("flexion", upper.cross(fore).normalize(), [-5.0, 155.0], bend), ("pronation", fore, [-95.0, 95.0], 0.0)]
}

fn wrist() -> [Row; 2] {
    let hand = (rest::FINGERTIP - rest::WRIST).normalize();
    let palm = hand.cross(rest::THUMBWARD).normalize();
    [("flexion", hand.cross(palm), [-80.0, 85.0], 0.0), ("radial_deviation", palm, [-40.0, 30.0], 0.0)]
}

fn hip() -> [Row; 3] {
    let thigh = (rest::KNEE - rest::HIP).normalize();
    let (flexed, abducted) = (thigh.z.atan2(-thigh.y).to_degrees(), thigh.x.asin().to_degrees());
    [
        ("flexion", DVec3::NEG_X, [-45.0, 140.0], flexed),
        ("abduction", DVec3::Z, [-40.0, 65.0], abducted),
        ("internal_rotation", thigh, [-55.0, 55.0], 0.0),
    ]
}

fn knee() -> [Row; 2] {
    let (thigh, shank) = (rest::KNEE - rest::HIP, (rest::ANKLE - rest::KNEE).normalize());
    let bend = (thigh.z.atan2(-thigh.y) - shank.z.atan2(-shank.y)).to_degrees();
    [("flexion", DVec3::X, [-8.0, 155.0], bend), ("internal_rotation", shank, [-35.0, 35.0], 0.0)]
}

fn ankle() -> [Row; 2] {
    [("dorsiflexion", DVec3::NEG_X, [-60.0, 35.0], 0.0), ("inversion", DVec3::NEG_Z, [-25.0, 40.0], 0.0)]
}

fn ball() -> [Row; 1] {
    [("extension", DVec3::NEG_X, [-45.0, 75.0], 0.0)]
}

/// All joint angles, grouped by joint in the order of the joints.
pub(super) fn dofs() -> Vec<Dof> {
    let mut dofs: Vec<Dof> = JointId::all()
        .flat_map(|joint| {
            let is_right = joint.mirror() < joint;
            let left = if is_right { joint.mirror() } else { joint };
            rows(left).into_iter().map(move |(movement, axis, limits_deg, rest_deg)| Dof {
                name: format!("{}_{movement}", joint.name()),
                joint,
                // A reflection in x turns the sense of rotations about y and z, not about x.
                axis: if is_right { DVec3::new(axis.x, -axis.y, -axis.z) } else { axis },
                limits_rad: limits_deg.map(|limit| (limit - rest_deg).to_radians()),
                mirror: 0,
                mirror_sign: if joint == joint.mirror() && axis.x == 0.0 { -1.0 } else { 1.0 },
            })
        })
        .collect();
    for index in 0..dofs.len() {
        let (joint, first) = (dofs[index].joint, |id| dofs.iter().position(|dof| dof.joint == id));
        let offset = index - first(joint).expect("the joint has the angle at hand");
        dofs[index].mirror = first(joint.mirror()).expect("both sides have the same angles") + offset;
    }
    dofs
}

fn rows(left: JointId) -> Vec<Row> {
    match left {
        JointId::LUMBAR => trunk([-18.0, 40.0], 18.0, 12.0).to_vec(),
        JointId::MID_SPINE => trunk([-15.0, 35.0], 18.0, 18.0).to_vec(),
        JointId::THORAX => trunk([-15.0, 30.0], 18.0, 28.0).to_vec(),
        JointId::NECK | JointId::HEAD => trunk([-40.0, 35.0], 30.0, 45.0).to_vec(),
        JointId::LEFT_CLAVICLE => clavicle().to_vec(),
        JointId::LEFT_SHOULDER => shoulder().to_vec(),
        JointId::LEFT_ELBOW => elbow().to_vec(),
        JointId::LEFT_WRIST => wrist().to_vec(),
        JointId::LEFT_HIP => hip().to_vec(),
        JointId::LEFT_KNEE => knee().to_vec(),
        JointId::LEFT_ANKLE => ankle().to_vec(),
        JointId::LEFT_BALL => ball().to_vec(),
        _ => Vec::new(),
    }
}
