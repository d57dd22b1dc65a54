//! Which recorded segment each of ours follows, for the kinds of skeletons that we know.

use glam::DVec3;

use crate::skeleton::{JointId, Skeleton};

/// What one of our segments follows.
pub(super) struct Segment {
    pub joint: JointId,
    /// A share of the way from the rotation of the first recorded segment to that of the second.
    pub follows: [String; 2],
    pub share: f64,
    pub lies: Lies,
}

/// How the recorded segment lies to ours, both at rest in the body frame.
pub(super) enum Lies {
    /// Both stand upright and look ahead.
    Upright,
    /// They have a long axis, to the joints `end` and `our_end`, and a second direction in common.
    Along { end: String, our_end: JointId, side: DVec3, our_side: DVec3 },
}

pub(super) struct Table {
    pub segments: Vec<Segment>,
    /// Hip, knee and ankle.
    pub left_leg: [&'static str; 3],
    pub right_hip: &'static str,
}

fn one(joint: JointId, name: &str, lies: Lies) -> Segment {
    Segment { joint, follows: [name.to_owned(), name.to_owned()], share: 0.0, lies }
}

fn between(joint: JointId, first: &str, second: &str, share: f64) -> Segment {
    Segment { joint, follows: [first.to_owned(), second.to_owned()], share, lies: Lies::Upright }
}

/// The axis of the angle called `name`, at rest.
fn axis(name: &str) -> DVec3 {
    let skeleton = Skeleton::human();
    skeleton.dofs()[skeleton.dof_index(name).expect("an angle of the skeleton")].axis
}

/// Our joints and their axes on one side.
struct Side {
    /// Factor of x: 1 on the left.
    sign: f64,
    clavicle: JointId,
    shoulder: JointId,
    elbow: JointId,
    wrist: JointId,
    fingertip: JointId,
    hip: JointId,
    knee: JointId,
    ankle: JointId,
    ball: JointId,
    elbow_hinge: DVec3,
    knee_hinge: DVec3,
    thumb: DVec3,
}

impl Side {
    fn new(name: &str) -> Self {
        let joint =
            |part: &str| JointId::from_name(&format!("{name}_{part}")).expect("a joint of the skeleton");
        // The wrist's flexion axis lies across the palm. On the left it points away from the thumb; a mirror turns axes
        // over, so that on the right it points to the thumb.
        let across_palm = axis(&format!("{name}_wrist_flexion"));
        let is_left = name == "left";
        Self {
            sign: if is_left { 1.0 } else { -1.0 },
            clavicle: joint("clavicle"),
            shoulder: joint("shoulder"),
            elbow: joint("elbow"),
            wrist: joint("wrist"),
            fingertip: joint("fingertip"),
            hip: joint("hip"),
            knee: joint("knee"),
            ankle: joint("ankle"),
            ball: joint("ball"),
            elbow_hinge: axis(&format!("{name}_elbow_flexion")),
            knee_hinge: axis(&format!("{name}_knee_flexion")),
            thumb: if is_left { -across_palm } else { across_palm },
        }
    }
}

/// Skeletons of the CMU database: at rest arms straight to the sides, palms down, legs spread by 20 degrees.
pub(super) fn cmu() -> Table {
    use Lies::Upright;
    let mut segments = vec![
        one(JointId::PELVIS, "root", Upright),
        one(JointId::LUMBAR, "lowerback", Upright),
        one(JointId::MID_SPINE, "upperback", Upright),
        one(JointId::THORAX, "thorax", Upright),
        between(JointId::NECK, "lowerneck", "upperneck", 0.5),
        one(JointId::HEAD, "head", Upright),
    ];
    for (side, l) in [(Side::new("left"), 'l'), (Side::new("right"), 'r')] {
        // From the files: `axis 180 -30 -90` of the left radius and `axis 0 0 20` of the left tibia, whose first axes are
        // the hinges.
        let (sin, cos) = 30f64.to_radians().sin_cos();
        let elbow = DVec3::new(0.0, -side.sign * cos, side.sign * sin);
        let (sin, cos) = 20f64.to_radians().sin_cos();
        let knee = DVec3::new(cos, side.sign * sin, 0.0);
        let named = |joint, name: &str, lies| one(joint, &format!("{l}{name}"), lies);
        let along = |end: &str, our_end, side, our_side| Lies::Along {
            end: format!("{l}{end}"),
            our_end,
            side,
            our_side,
        };
        segments.extend([
            named(side.clavicle, "clavicle", Upright),
            named(side.shoulder, "humerus", along("radius", side.elbow, elbow, side.elbow_hinge)),
            // The database turns the forearm behind two thirds of it, in the bone called wrist; its thumbs point ahead.
            named(side.elbow, "wrist", along("hand", side.wrist, DVec3::Z, side.thumb)),
            named(side.wrist, "hand", along("fingers_end", side.fingertip, DVec3::Z, side.thumb)),
            named(side.hip, "femur", along("tibia", side.knee, knee, side.knee_hinge)),
            named(side.knee, "tibia", along("foot", side.ankle, knee, side.knee_hinge)),
            named(side.ankle, "foot", Upright),
            named(side.ball, "toes", Upright),
        ]);
    }
    Table { segments, left_leg: ["lfemur", "ltibia", "lfoot"], right_hip: "rfemur" }
}

/// The 44-number humanoid: at rest arms and legs hang straight down, thumbs ahead.
pub(super) fn humanoid() -> Table {
    use Lies::Upright;
    let mut segments = vec![
        one(JointId::PELVIS, "root", Upright),
        between(JointId::LUMBAR, "root", "chest", 1.0 / 3.0),
        between(JointId::MID_SPINE, "root", "chest", 2.0 / 3.0),
        one(JointId::THORAX, "chest", Upright),
        between(JointId::NECK, "chest", "neck", 0.5),
        one(JointId::HEAD, "neck", Upright),
    ];
    for name in ["left", "right"] {
        let side = Side::new(name);
        let named = |joint, part: &str, lies| one(joint, &format!("{name}_{part}"), lies);
        let along = |end: &str, our_end, side, our_side| Lies::Along {
            end: format!("{name}_{end}"),
            our_end,
            side,
            our_side,
        };
        segments.extend([
            named(side.shoulder, "shoulder", along("elbow", side.elbow, DVec3::NEG_X, side.elbow_hinge)),
            named(side.elbow, "elbow", along("wrist", side.wrist, DVec3::Z, side.thumb)),
            named(side.hip, "hip", along("knee", side.knee, DVec3::X, side.knee_hinge)),
            named(side.knee, "knee", along("ankle", side.ankle, DVec3::X, side.knee_hinge)),
            named(side.ankle, "ankle", Upright),
        ]);
    }
    Table { segments, left_leg: ["left_hip", "left_knee", "left_ankle"], right_hip: "right_hip" }
}
