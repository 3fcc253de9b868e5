//! What has moved since the last frame, and how far.

use super::packed::{BvhNode, Instance, Mover, NONE, PackedScene};
use glam::{Vec3, Vec4};
use std::collections::HashMap;

/// Where each instance was in the last frame, by id. Users move objects, too, so a scene's own motion does not
/// tell.
#[derive(Clone, Debug, Default)]
pub struct Movers {
    before: HashMap<u32, Instance>,
}

impl Movers {
    /// Forgets the last frame.
    pub fn clear(&mut self) {
        self.before.clear();
    }

    /// Takes down where instances are, and tells them where they were. Returns what has moved, come or gone since
    /// the last frame, in metres relative to `centre`. `unit` is the radiance to which that of lamps is compared.
    pub fn advance(&mut self, packed: &PackedScene, instances: &mut [Instance], centre: Vec3, unit: f32) -> Vec<Mover> {
        let mut before = std::mem::take(&mut self.before);
        let first = before.is_empty();
        let mut movers = Vec::new();
        for instance in instances {
            let known = before.remove(&instance.id);
            if let Some(known) = known {
                instance.previous_object_to_world = known.object_to_world;
            }
            let came = known.is_none() && !first;
            if came || instance.step > 0.0 || instance.object_to_world != instance.previous_object_to_world {
                movers.extend(mover(packed, instance, came, centre, unit));
            }
            self.before.insert(instance.id, *instance);
        }
        movers.extend(before.values().filter_map(|gone| mover(packed, gone, true, centre, unit)));
        movers
    }
}

/// Returns spheres around an instance now and before. What came or went counts as having moved by its own size.
fn mover(packed: &PackedScene, instance: &Instance, whole: bool, centre: Vec3, unit: f32) -> Option<Mover> {
    let root = packed.nodes.get(instance.root as usize)?;
    let corners = [0, 1, 2, 3, 4, 5, 6, 7].map(|k| {
        let pick = |axis: usize| if k >> axis & 1 == 0 { root.min[axis] } else { root.max[axis] };
        Vec3::new(pick(0), pick(1), pick(2))
    });
    let [now, before] = [instance.object_to_world, instance.previous_object_to_world];
    let middle = 0.5 * (root.min + root.max);
    let [at, was] = [transform(&now, middle), transform(&before, middle)];
    let reach = |rows, middle: Vec3| corners.iter().map(|c| transform(rows, *c).distance(middle)).fold(0.0, f32::max);
    let radius = reach(&now, at).max(reach(&before, was)).max(1e-4);
    let step = corners.iter().map(|c| transform(&now, *c).distance(transform(&before, *c))).fold(0.0, f32::max);
    // What changes its shape adds the way of its vertices, at the largest scale.
    let scale = (0..3).map(|axis| Vec3::from_array(now.map(|row| row[axis])).length()).fold(0.0, f32::max);
    let step = step + scale * instance.step;
    let radius = radius + scale * instance.step;
    Some(Mover {
        now: at - centre,
        radius,
        before: was - centre,
        step: if whole { 2.0 * radius } else { step },
        id: instance.id,
        glow: brightest(packed, instance.root) / unit.max(1e-20),
    })
}

fn transform(rows: &[[f32; 4]; 3], point: Vec3) -> Vec3 {
    rows.map(|row| Vec4::from(row).dot(point.extend(1.0))).into()
}

/// The greatest luminance that a mesh emits.
fn brightest(packed: &PackedScene, root: u32) -> f32 {
    let nodes = packed.nodes.get(root as usize..).unwrap_or_default();
    let end =
        nodes.iter().position(|node: &BvhNode| node.leaf != 0 && node.next == NONE).map_or(nodes.len(), |n| n + 1);
    let triangles = nodes[..end].iter().filter(|node| node.leaf != 0);
    let materials = triangles
        .flat_map(|node| node.leaf >> 3..(node.leaf >> 3) + (node.leaf & 7))
        .filter_map(|triangle| packed.materials.get(packed.shading.get(triangle as usize)?.material as usize));
    materials.map(|material| material.emissive.dot(Vec3::new(0.2126, 0.7152, 0.0722))).fold(0.0, f32::max)
}
