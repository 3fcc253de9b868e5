//! Skins. A skinned mesh stands where its joints put it. Its own node's transform counts for nothing.

use super::{File, Read, accessor, fault, json::Json};
use glam::{Mat3, Mat4, Vec3};

/// The joints that move a vertex, with their weights.
pub(super) type Influence = [(u16, f32); 8];

/// Returns, for each joint of skin `index`, the matrix from the mesh's space to the model's in rest pose.
/// `matrices` are those of the file's nodes, as far as they are drawn.
pub(super) fn joints(file: &File, index: usize, matrices: &[Option<Mat4>]) -> Read<Vec<Mat4>> {
    let user = format!("skin {index}");
    let skin = file.root.entry("skins", index);
    let nodes = skin.indices("joints");
    if nodes.is_empty() {
        return Err(fault(format!("{user}: has no joints")));
    }
    let inverse = match skin.index("inverseBindMatrices") {
        Some(accessor) => accessor::elements(file, accessor, &user)?.vectors::<16>(&user)?,
        None => Vec::new(),
    };
    let matrix = |(joint, node): (usize, &usize)| {
        let bind = inverse.get(joint).map_or(Mat4::IDENTITY, Mat4::from_cols_array);
        let placed = matrices.get(*node).copied().flatten();
        if placed.is_none() {
            file.warn(&user, "has a joint that is not in the scene: taken to stand at the origin");
        }
        placed.unwrap_or(Mat4::IDENTITY) * bind
    };
    Ok(nodes.iter().enumerate().map(matrix).collect())
}

/// Reads JOINTS_0 and WEIGHTS_0, and the second set if there is one.
pub(super) fn influences(file: &File, attributes: Json, vertices: usize, user: &str) -> Read<Vec<Influence>> {
    let mut out = vec![[(0, 0.0); 8]; vertices];
    for set in 0..2 {
        let index = |name: &str| attributes.index(&format!("{name}_{set}"));
        let (Some(joints), Some(weights)) = (index("JOINTS"), index("WEIGHTS")) else { continue };
        let joints = accessor::elements(file, joints, user)?.vectors::<4>(user)?;
        let weights = accessor::elements(file, weights, user)?.vectors::<4>(user)?;
        if joints.len() != vertices || weights.len() != vertices {
            return Err(fault(format!("{user}: joints and weights are not as many as its {vertices} vertices")));
        }
        for ((out, joints), weights) in out.iter_mut().zip(joints).zip(weights) {
            for k in 0..4 {
                let weight = if weights[k].is_finite() { weights[k].max(0.0) } else { 0.0 };
                out[4 * set + k] = (joints[k] as u16, weight);
            }
        }
    }
    Ok(out)
}

/// Returns the matrix of a vertex. Weights are made to sum to 1; without any, the first joint moves it.
fn blended(joints: &[Mat4], influence: &Influence) -> Mat4 {
    let known = influence.iter().filter_map(|(joint, weight)| Some((*joints.get(usize::from(*joint))?, *weight)));
    let sum: f32 = known.clone().map(|(_, weight)| weight).sum();
    if sum <= 0.0 {
        return joints[0];
    }
    known.fold(Mat4::ZERO, |blend, (joint, weight)| blend + joint * (weight / sum))
}

/// Moves vertices to where their joints put them. `joints` is not empty.
pub(super) fn pose(
    joints: &[Mat4],
    influences: &[Influence],
    positions: &mut [Vec3],
    normals: &mut [Vec3],
    tangents: &mut [[f32; 4]],
) {
    for (vertex, influence) in influences.iter().enumerate() {
        let matrix = blended(joints, influence);
        let linear = Mat3::from_mat4(matrix);
        positions[vertex] = matrix.transform_point3(positions[vertex]);
        // The cofactors turn normals as the transposed inverse does, and exist for flat matrices, too.
        if let Some(normal) = normals.get_mut(vertex) {
            let [x, y, z] = [linear.x_axis, linear.y_axis, linear.z_axis];
            let turned = Mat3::from_cols(y.cross(z), z.cross(x), x.cross(y)) * *normal;
            *normal = turned * linear.determinant().signum();
        }
        if let Some(tangent) = tangents.get_mut(vertex) {
            let [x, y, z, sign] = *tangent;
            let along = (linear * Vec3::new(x, y, z)).normalize_or_zero();
            *tangent = along.extend(sign).to_array();
        }
    }
}
