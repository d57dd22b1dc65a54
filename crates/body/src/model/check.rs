//! Do the arrays of a body model's file fit each other?

use super::{MAX_INFLUENCES, WEIGHT_SUM_TOLERANCE};
use crate::asset::{BodyFile, LoadBodyModelError};
use crate::skeleton::N_JOINTS;

pub(super) fn check(file: &BodyFile) -> Result<(), LoadBodyModelError> {
    let (n_vertices, n_components) = (file.parts.len(), file.variance_shares.len());
    for (field, found, expected) in [
        ("influence_counts", file.influence_counts.len(), n_vertices),
        (
            "influences",
            file.influences.len(),
            file.influence_counts.iter().map(|&count| usize::from(count)).sum(),
        ),
        ("mean_vertices", file.mean_vertices.len(), 3 * n_vertices),
        ("vertex_basis", file.vertex_basis.len(), 3 * n_vertices * n_components),
        ("mean_joints", file.mean_joints.len(), 3 * N_JOINTS),
        ("joint_basis", file.joint_basis.len(), 3 * N_JOINTS * n_components),
        ("source_vertices", file.source_vertices.len(), n_vertices),
    ] {
        if found != expected {
            return Err(LoadBodyModelError::FieldLength { field, found, expected });
        }
    }
    for line in &file.stature_lines {
        for (field, found) in
            [("mean_scores", line.mean_scores.len()), ("scores_per_m", line.scores_per_m.len())]
        {
            if found != n_components {
                return Err(LoadBodyModelError::FieldLength { field, found, expected: n_components });
            }
        }
    }
    let corners =
        file.triangles.iter().enumerate().flat_map(|(t, corners)| corners.map(|vertex| (t, vertex.into())));
    all_below("triangles", corners, n_vertices)?;
    let parts = file.parts.iter().enumerate().map(|(vertex, &part)| (vertex, part.into()));
    all_below("parts", parts, file.part_names.len())?;
    let landmarks =
        file.landmarks.iter().enumerate().map(|(index, landmark)| (index, landmark.triangle as usize));
    all_below("landmarks", landmarks, file.triangles.len())?;
    let joints = file.influences.iter().enumerate().map(|(index, &(joint, _))| (index, joint.into()));
    all_below("influences", joints, N_JOINTS)?;
    let counts = file.influence_counts.iter().enumerate().map(|(vertex, &count)| (vertex, count.into()));
    all_below("influence_counts", counts, MAX_INFLUENCES + 1)?;
    for (field, values) in [
        ("mean_vertices", &file.mean_vertices),
        ("vertex_basis", &file.vertex_basis),
        ("mean_joints", &file.mean_joints),
        ("joint_basis", &file.joint_basis),
    ] {
        if let Some(element) = values.iter().position(|value| !value.is_finite()) {
            return Err(LoadBodyModelError::NotFinite { field, element, value: values[element] });
        }
    }
    let mut rest = &file.influences[..];
    for (vertex, &count) in file.influence_counts.iter().enumerate() {
        let (own, others) = rest.split_at(count.into());
        rest = others;
        let sum: f32 = own.iter().map(|&(_, weight)| weight).sum();
        if !((sum - 1.0).abs() <= WEIGHT_SUM_TOLERANCE && own.iter().all(|&(_, weight)| weight >= 0.0)) {
            return Err(LoadBodyModelError::WeightSum { vertex, sum });
        }
    }
    Ok(())
}

fn all_below(
    field: &'static str,
    indices: impl Iterator<Item = (usize, usize)>,
    count: usize,
) -> Result<(), LoadBodyModelError> {
    match { indices }.find(|&(_, value)| value >= count) {
        None => Ok(()),
        Some((element, value)) => Err(LoadBodyModelError::OutOfRange { field, element, value, count }),
    }
}
