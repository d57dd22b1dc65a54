use proptest::prelude::*;

use super::*;
use crate::model::BodyModel;
use crate::skeleton::N_DOF;

/// The textbook formula in f64: each vertex is the weighted mean of where its joints would carry it.
fn plain(body: &Body, target_from_world: &DAffine3, pose: &Pose) -> Vec<DVec3> {
    let frames = body.world_from_joints(pose);
    let template = body.template();
    let carried = |(vertex, influences): (&[f32; 3], &Vec<(JointId, f32)>)| {
        let rest = DVec3::from_array(vertex.map(f64::from));
        let terms = influences.iter().map(|&(joint, weight)| {
            let world_from_rest =
                frames[joint.index()] * DAffine3::from_translation(-body.rest_joints()[joint.index()]);
            target_from_world.transform_point3(world_from_rest.transform_point3(rest)) * f64::from(weight)
        });
        terms.sum::<DVec3>()
    };
    body.rest_vertices().iter().zip(&template.influences).map(carried).collect()
}

fn poses(angles: &[Vec<f64>]) -> Vec<Pose> {
    let pose = |angles: &Vec<f64>| {
        let mut pose =
            Pose::upright(DVec3::new(angles[0], 2.0 * angles[1], 1.0 + angles[2]), 3.0 * angles[3]);
        pose.angles.clone_from(angles);
        pose
    };
    angles.iter().map(pose).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]
    #[test]
    fn equals_the_plain_formula(
        angles in prop::collection::vec(prop::collection::vec(-1.2..1.2f64, N_DOF), 1..12),
        turn in prop::array::uniform3(-2.0..2.0f64),
    ) {
        let body = BodyModel::builtin().shape(&[1.0, -0.5, 2.0]);
        let camera_from_world = DAffine3::from_rotation_translation(
            glam::DQuat::from_scaled_axis(turn.into()), DVec3::new(0.1, -0.4, 4.0));
        let poses = poses(&angles);
        let mut found = vec![[0.0; 3]; poses.len() * body.n_vertices()];
        body.skin_batch_into(&camera_from_world, &poses, &mut found);
        let expected = poses.iter().flat_map(|pose| plain(&body, &camera_from_world, pose));
        for (found, expected) in found.iter().zip(expected) {
            let found = DVec3::from_array(found.map(f64::from));
            // f32 holds metres to half a micrometre here; sums of up to six terms lose a little more.
            prop_assert!(found.distance(expected) < 3e-6, "{found} instead of {expected}");
        }
    }

    /// A pose gives the same bits alone and in any place of a batch.
    #[test]
    fn batches_do_not_change_bits(angles in prop::collection::vec(prop::collection::vec(-1.0..1.0f64, N_DOF), 1..20)) {
        let body = BodyModel::builtin().mean();
        let (n, poses) = (body.n_vertices(), poses(&angles));
        let mut batch = vec![[0.0; 3]; poses.len() * n];
        body.skin_batch_into(&DAffine3::IDENTITY, &poses, &mut batch);
        let mut alone = vec![[0.0; 3]; n];
        for (pose, mesh) in poses.iter().zip(batch.chunks(n)) {
            body.skin_into(pose, &mut alone);
            prop_assert_eq!(&alone[..], mesh);
        }
    }
}

#[test]
fn the_rest_pose_is_the_rest_mesh() {
    let body = BodyModel::builtin().mean();
    let pose = Pose {
        root_position: body.rest_joints()[0],
        root_orientation: glam::DQuat::IDENTITY,
        angles: vec![0.0; N_DOF],
    };
    let mut vertices = vec![[0.0; 3]; body.n_vertices()];
    body.skin_into(&pose, &mut vertices);
    for (found, rest) in vertices.iter().flatten().zip(body.rest_vertices().iter().flatten()) {
        assert!((found - rest).abs() < 1e-6);
    }
}

#[test]
#[should_panic(expected = "room for 3 vertices")]
fn says_when_the_output_does_not_fit() {
    let body = BodyModel::builtin().mean();
    body.skin_into(&Pose::upright(DVec3::ZERO, 0.0), &mut [[0.0; 3]; 3]);
}
