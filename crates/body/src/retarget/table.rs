//! Which recorded segment each of ours follows, for the kinds of skeletons that we know.

use glam::DVec3;

use crate::skeleton::{JointId, Skeleton};

/// What one of our segments follows.
pub(super) struct Segment {
    pub joint: JointId,
    pub follows: Follows,
    pub lies: Lies,
}

#[derive(Clone, Copy)]
pub(super) enum Follows {
    One(&'static str),
    /// A share of the way from the first to the second.
    Between(&'static str, &'static str, f64),
}

/// How the recorded segment lies to ours, both at rest in the body frame.
#[derive(Clone, Copy)]
pub(super) enum Lies {
    /// Both stand upright and look ahead.
    Upright,
    /// They have a long axis, to the joints `end` and `our_end`, and a second direction in common.
    Along { end: &'static str, our_end: JointId, side: DVec3, our_side: DVec3 },
}

pub(super) struct Table {
    pub segments: Vec<Segment>,
    /// Hip, knee and ankle.
    pub left_leg: [&'static str; 3],
    pub right_hip: &'static str,
}

fn one(joint: JointId, name: &'static str, lies: Lies) -> Segment {
    Segment { joint, follows: Follows::One(name), lies }
}

/// The first axis of the angle called `name`, at rest.
fn axis(name: &str) -> DVec3 {
    let skeleton = Skeleton::human();
    skeleton.dofs()[skeleton.dof_index(name).expect("an angle of the skeleton")].axis
}

/// Names of our joints and angles on one side.
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
    use Lies::{Along, Upright};
    let mut segments = vec![
        one(JointId::PELVIS, "root", Upright),
        one(JointId::LUMBAR, "lowerback", Upright),
        one(JointId::MID_SPINE, "upperback", Upright),
        one(JointId::THORAX, "thorax", Upright),
        Segment {
            joint: JointId::NECK,
            follows: Follows::Between("lowerneck", "upperneck", 0.5),
            lies: Upright,
        },
        one(JointId::HEAD, "head", Upright),
    ];
    struct Names {
        side: Side,
        clavicle: &'static str,
        humerus: &'static str,
        radius: &'static str,
        wrist: &'static str,
        hand: &'static str,
        fingers_end: &'static str,
        femur: &'static str,
        tibia: &'static str,
        foot: &'static str,
        toes: &'static str,
    }
    let names = [
        Names {
            side: Side::new("left"),
            clavicle: "lclavicle",
            humerus: "lhumerus",
            radius: "lradius",
            wrist: "lwrist",
            hand: "lhand",
            fingers_end: "lfingers_end",
            femur: "lfemur",
            tibia: "ltibia",
            foot: "lfoot",
            toes: "ltoes",
        },
        Names {
            side: Side::new("right"),
            clavicle: "rclavicle",
            humerus: "rhumerus",
            radius: "rradius",
            wrist: "rwrist",
            hand: "rhand",
            fingers_end: "rfingers_end",
            femur: "rfemur",
            tibia: "rtibia",
            foot: "rfoot",
            toes: "rtoes",
        },
    ];
    for Names { side, clavicle, humerus, radius, wrist, hand, fingers_end, femur, tibia, foot, toes } in names
    {
        // From the files: `axis 180 -30 -90` of the left radius and `axis 0 0 20` of the left tibia, whose first axes are
        // the hinges.
        let (sin, cos) = 30f64.to_radians().sin_cos();
        let elbow = DVec3::new(0.0, -side.sign * cos, side.sign * sin);
        let (sin, cos) = 20f64.to_radians().sin_cos();
        let knee = DVec3::new(cos, side.sign * sin, 0.0);
        let along = |end, our_end, side, our_side| Along { end, our_end, side, our_side };
        segments.extend([
            one(side.clavicle, clavicle, Upright),
            one(side.shoulder, humerus, along(radius, side.elbow, elbow, side.elbow_hinge)),
            // The database turns the forearm behind two thirds of it, in the bone called wrist; its thumbs point ahead.
            one(side.elbow, wrist, along(hand, side.wrist, DVec3::Z, side.thumb)),
            one(side.wrist, hand, along(fingers_end, side.fingertip, DVec3::Z, side.thumb)),
            one(side.hip, femur, along(tibia, side.knee, knee, side.knee_hinge)),
            one(side.knee, tibia, along(foot, side.ankle, knee, side.knee_hinge)),
            one(side.ankle, foot, Upright),
            one(side.ball, toes, Upright),
        ]);
    }
    Table { segments, left_leg: ["lfemur", "ltibia", "lfoot"], right_hip: "rfemur" }
}

/// The 44-number humanoid: at rest arms and legs hang straight down, thumbs ahead.
pub(super) fn humanoid() -> Table {
    use Lies::{Along, Upright};
    let between =
        |joint, share| Segment { joint, follows: Follows::Between("root", "chest", share), lies: Upright };
    let mut segments = vec![
        one(JointId::PELVIS, "root", Upright),
        between(JointId::LUMBAR, 1.0 / 3.0),
        between(JointId::MID_SPINE, 2.0 / 3.0),
        one(JointId::THORAX, "chest", Upright),
        Segment { joint: JointId::NECK, follows: Follows::Between("chest", "neck", 0.5), lies: Upright },
        one(JointId::HEAD, "neck", Upright),
    ];
    let names = [
        (
            Side::new("left"),
            ["left_shoulder", "left_elbow", "left_wrist", "left_hip", "left_knee", "left_ankle"],
        ),
        (
            Side::new("right"),
            ["right_shoulder", "right_elbow", "right_wrist", "right_hip", "right_knee", "right_ankle"],
        ),
    ];
    for (side, [shoulder, elbow, wrist, hip, knee, ankle]) in names {
        let along = |end, our_end, side, our_side| Along { end, our_end, side, our_side };
        segments.extend([
            one(side.shoulder, shoulder, along(elbow, side.elbow, DVec3::NEG_X, side.elbow_hinge)),
            one(side.elbow, elbow, along(wrist, side.wrist, DVec3::Z, side.thumb)),
            one(side.hip, hip, along(knee, side.knee, DVec3::X, side.knee_hinge)),
            one(side.knee, knee, along(ankle, side.ankle, DVec3::X, side.knee_hinge)),
            one(side.ankle, ankle, Upright),
        ]);
    }
    Table { segments, left_leg: ["left_hip", "left_knee", "left_ankle"], right_hip: "right_hip" }
}
