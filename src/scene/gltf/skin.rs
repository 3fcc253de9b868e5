//! Skins. A skinned mesh stands where its joints put it. Its own node's transform counts for nothing.

use super::{File, Read, accessor, fault, json::Json};
use crate::scene::deform::{Influences, Skin};
use glam::Mat4;

/// Reads skin `index`. `place` maps nodes of the file to nodes of the model.
pub(super) fn load(file: &File, index: usize, place: &[Option<usize>]) -> Read<Skin> {
    let user = format!("skin {index}");
    let skin = file.root.entry("skins", index);
    let nodes = skin.indices("joints");
    if nodes.is_empty() {
        return Err(fault(format!("{user}: has no joints")));
    }
    let inverse = match skin.index("inverseBindMatrices") {
        Some(accessor) => accessor::elements(file, accessor, &user).and_then(|matrices| matrices.vectors::<16>(&user)),
        None => Ok(vec![Mat4::IDENTITY.to_cols_array(); nodes.len()]),
    };
    let inverse = inverse.unwrap_or_else(|fault| {
        file.instead("replaced by identity matrices", fault);
        vec![Mat4::IDENTITY.to_cols_array(); nodes.len()]
    });
    let bind = |joint: usize| {
        let matrix = inverse.get(joint).map(Mat4::from_cols_array).filter(Mat4::is_finite);
        matrix.unwrap_or_else(|| {
            file.warn(&user, "has a joint without an inverse bind matrix of finite numbers: identity is taken");
            Mat4::IDENTITY
        })
    };
    let joint = |node: &usize| {
        let placed = place.get(*node).copied().flatten();
        if placed.is_none() {
            file.warn(&user, "has a joint that does not exist: taken to stand at the origin");
        }
        placed
    };
    Ok(Skin { joints: nodes.iter().map(joint).collect(), inverse_bind: (0..nodes.len()).map(bind).collect() })
}

/// What moves a vertex of which no joint is known: the first.
pub(super) const STILL: [(u16, f32); 1] = [(0, 1.0)];

/// Reads all sets of JOINTS_n and WEIGHTS_n, as many as there are; without any there are no influences. Weights are made
/// to sum to 1; a vertex without any has [`STILL`]. Joints that the skin does not have are left out.
pub(super) fn influences(
    file: &File,
    attributes: Json,
    vertices: usize,
    joints: usize,
    user: &str,
) -> Read<Vec<Influences>> {
    let mut out = Vec::new();
    for set in 0.. {
        let index = |name: &str| attributes.index(&format!("{name}_{set}"));
        let (Some(numbers), Some(weights)) = (index("JOINTS"), index("WEIGHTS")) else { break };
        let numbers = accessor::elements(file, numbers, user)?.vectors::<4>(user)?;
        let weights = accessor::elements(file, weights, user)?.vectors::<4>(user)?;
        if numbers.len() != vertices || weights.len() != vertices {
            return Err(fault(format!("{user}: joints and weights are not as many as its {vertices} vertices")));
        }
        file.count_corners(vertices)?;
        out.resize(vertices, Influences::new());
        for ((out, numbers), weights) in out.iter_mut().zip(numbers).zip(weights) {
            let known = numbers.into_iter().zip(weights).filter(|(joint, weight)| {
                *weight > 0.0 && weight.is_finite() && *joint >= 0.0 && (*joint as usize) < joints
            });
            out.extend(known.map(|(joint, weight)| (joint as u16, weight)));
        }
    }
    for influences in &mut out {
        let sum: f32 = influences.iter().map(|(_, weight)| weight).sum();
        if sum > 0.0 && sum.is_finite() {
            influences.iter_mut().for_each(|(_, weight)| *weight /= sum);
        } else {
            *influences = STILL.to_vec();
        }
    }
    Ok(out)
}
