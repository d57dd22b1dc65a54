use std::path::Path;

use glam::DVec3;

use super::asf::{Skeleton, parse_amc};
use super::bvh::parse_bvh;
use super::humanoid::parse_humanoid;
use super::*;

const ASF: &str = "\
# a leg
:version 1.10
:units
  length 0.5
  angle deg
:root
  order TX TY TZ RX RY RZ
  axis XYZ
  position 0 0 0
:bonedata
  begin
    id 1
    name femur
    direction 0 -1 0
    length 10
    axis 0 0 20 XYZ
    dof rx rz
    limits (-10 20)
           (-30 30)
  end
  begin
    id 2
    name tibia
    direction 0 -1 0
    length 8
    axis 0 0 0 XYZ
    dof rx
  end
:hierarchy
  begin
    root femur
    femur tibia
  end
";
const AMC: &str = ":FULLY-SPECIFIED\n:DEGREES\n1\nroot 1 2 3 0 90 0\nfemur 0 0\ntibia 90\n";

fn amc(text: &str) -> Result<crate::mocap::MocapClip, LoadMocapError> {
    parse_amc(&Skeleton::parse(Path::new("leg.asf"), ASF)?, Path::new("leg.amc"), text)
}

#[test]
fn a_bent_knee_by_hand() {
    let clip = amc(AMC).expect("a good motion");
    let names: Vec<&str> = clip.joints.iter().map(|joint| joint.name.as_str()).collect();
    assert_eq!(names, ["root", "femur", "tibia", "tibia_end"]);
    // One unit is 0.0254 / 0.5 = 0.0508 m. The root stands at (1, 2, 3) units, y up, turned to its left by 90 degrees: the
    // person faces room +x, which is world +y. A positive knee angle throws the shank back.
    let unit = 0.0508;
    let frame = &clip.frames[0];
    assert!(frame.positions[0].distance(unit * DVec3::new(3.0, 1.0, 2.0)) < 1e-12);
    assert!(frame.positions[2].distance(unit * DVec3::new(3.0, 1.0, -8.0)) < 1e-12);
    assert!(
        frame.positions[3].distance(unit * DVec3::new(3.0, -7.0, -8.0)) < 1e-12,
        "{}",
        frame.positions[3]
    );
    assert!((frame.rotations[0] * DVec3::Z).distance(DVec3::Y) < 1e-12);
}

#[test]
fn recorded_clips_agree_with_an_independent_computation() {
    let Some(data) = crate::test_data::folder() else { return };
    let folder = data.join("cmu/asfamc/07");
    let clip = load_asf_amc(&folder.join("07.asf"), &folder.join("07_01.amc")).expect("a good motion");
    assert_eq!((clip.frames.len(), clip.frame_rate_hz), (316, 120.0));
    // Frame 100 by a few lines of numpy with 3 x 3 matrices and the formula x C M C^-1: ends of bones, metres, world.
    for (joint, position) in [
        ("root", [-0.670707, 0.533717, 0.951061]),
        ("ltibia", [-0.623572, 0.615908, 0.463603]),
        ("lfoot", [-0.723678, 0.568765, 0.06054]),
        ("ltoes", [-0.615047, 0.582566, 0.033084]),
        ("rfoot", [-0.668489, 0.48705, 0.150128]),
        ("lclavicle", [-0.689433, 0.541109, 1.325698]),
        ("head_end", [-0.695508, 0.544885, 1.574466]),
        ("lwrist", [-0.552075, 0.754912, 0.941913]),
        ("rwrist", [-0.659188, 0.313286, 0.911715]),
        ("rfingers_end", [-0.615733, 0.277926, 0.771914]),
        ("ltoes_end", [-0.559031, 0.591148, 0.037167]),
    ] {
        let ours = clip.frames[100].positions[clip.joint(joint).expect("it is there")];
        assert!(ours.distance(position.into()) < 2e-6, "{joint}: {ours} against {position:?}");
    }
}

#[test]
fn bvh_by_hand() {
    let text = "\
HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Leg
  {
    OFFSET 10 0 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 -40 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.025
0 90 0 0 0 0 0 0 0
0 90 5 0 0 90 90 30 0
";
    let clip = parse_bvh(Path::new("leg.bvh"), text, 0.01).expect("a good motion");
    assert_eq!((clip.frame_rate_hz, clip.frames.len()), (40.0, 2));
    assert_eq!(clip.joints[2].name, "Leg_end");
    assert!(clip.joints[2].rest_position.distance(DVec3::new(0.1, -0.4, 0.0)) < 1e-12);
    // At rest: left is world +y.
    assert!(clip.frames[0].positions[2].distance(DVec3::new(0.0, 0.1, 0.5)) < 1e-12);
    // Turned to the left by 90 degrees about the vertical, the left leg is behind the room's z = 0.05: at -0.05. The leg
    // turns about its x (0, cos 30, sin 30), then about z: (0, -40, 0) -> (0, -34.64, -20) -> (34.64, 0, -20); then with the
    // root (x, z) -> (z, -x): (-20, 0, -34.64) in the room, (-0.3464, -0.2, 0) in the world.
    let end = clip.frames[1].positions[2] - clip.frames[1].positions[1];
    assert!(clip.frames[1].positions[1].distance(DVec3::new(-0.05, 0.0, 0.9)) < 1e-12);
    assert!(end.distance(DVec3::new(-0.4 * 30f64.to_radians().cos(), -0.2, 0.0)) < 1e-12, "{end}");

    let message =
        |text: &str| parse_bvh(Path::new("leg.bvh"), text, 0.01).expect_err("a bad file").to_string();
    assert_eq!(
        message(&text.replace("Zrotation", "Wrotation")),
        "leg.bvh: line 5: found `Wrotation`, expected a channel such as Xposition or Zrotation"
    );
    assert_eq!(message(&text.replace("0 90 5 ", "")), "leg.bvh: frame 1 has 6 numbers, expected 9");
    assert_eq!(
        message(&text.replace("Frames: 2", "Frames: 3")),
        "leg.bvh: the file ends, expected as many frames as `Frames:` says"
    );
    assert_eq!(message(&text.replace("90 30", "90 nan")), "leg.bvh: line 20: found `nan`, expected a number");
    assert_eq!(message(&text[..100]), "leg.bvh: the file ends, expected a channel");
}

#[test]
fn humanoid_by_hand() {
    // A person at height 0.9 that has turned to its left by 90 degrees, right knee and left elbow bent by 90 degrees.
    let mut numbers = vec![0.0; 44];
    for quaternion in [4, 8, 12, 16, 21, 25, 30, 35, 39] {
        numbers[quaternion] = 1.0;
    }
    numbers[0] = 0.05;
    numbers[2] = 0.9;
    let half = std::f64::consts::FRAC_PI_4;
    (numbers[4], numbers[6]) = (half.cos(), half.sin());
    numbers[20] = -std::f64::consts::FRAC_PI_2;
    numbers[43] = std::f64::consts::FRAC_PI_2;
    let text = serde_json::json!({ "Loop": "none", "Frames": [numbers] }).to_string();
    let clip = parse_humanoid(Path::new("run.json"), &text).expect("a good motion");
    assert!((clip.frame_rate_hz - 20.0).abs() < 1e-9);
    let at = |name: &str| clip.frames[0].positions[clip.joint(name).expect("it is there")];
    // Ahead is now +y and left -x.
    assert!(at("left_hip").distance(DVec3::new(-0.085, 0.0, 0.9)) < 1e-9);
    assert!((at("right_ankle") - at("right_knee")).distance(DVec3::new(0.0, -0.41, 0.0)) < 1e-9);
    assert!((at("left_wrist") - at("left_elbow")).distance(DVec3::new(0.0, 0.259, 0.0)) < 1e-9);
    assert_eq!(
        parse_humanoid(Path::new("run.json"), "{\"Frames\": [[0.03, 1, 2]]}").expect_err("short").to_string(),
        "run.json: frame 0 has 3 numbers, expected 44"
    );
    assert_eq!(
        parse_humanoid(Path::new("run.json"), "{\"Frames\": []}").expect_err("empty").to_string(),
        "run.json: has no frames"
    );
}

#[test]
fn messages_name_file_line_and_word() {
    let message = |text: &str| amc(text).expect_err("a bad motion").to_string();
    assert_eq!(message(":DEGREES\n"), "leg.amc: has no frames");
    assert_eq!(
        message(&AMC.replace("tibia 90", "tibia x")),
        "leg.amc: line 6: found `x`, expected a number for each channel of the bone"
    );
    assert_eq!(
        message(&AMC.replace("tibia 90", "hand 90")),
        "leg.amc: line 6: found `hand`, expected a bone of the skeleton"
    );
    assert_eq!(message(&AMC.replace("tibia 90", "")), "leg.amc: frame 0 has no line of bone `tibia`");
    let asf = |text: &str| {
        Skeleton::parse(Path::new("leg.asf"), text).map(|_| ()).expect_err("a bad skeleton").to_string()
    };
    assert_eq!(asf("nothing"), "leg.asf: the file ends, expected `:bonedata` and `:hierarchy`");
    assert_eq!(
        asf(&ASF.replace("femur tibia", "")),
        "leg.asf: the file ends, expected each bone in `:hierarchy`, joined to the root"
    );
    assert_eq!(
        asf(&ASF.replace("direction 0 -1", "direction 0 down")),
        "leg.asf: line 14: found `down`, expected a direction"
    );
}
