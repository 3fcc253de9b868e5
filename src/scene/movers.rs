//! What has moved since the last frame, and how far.

use super::{
    bounds::Bounds,
    packed::{Instance, Mover, NONE, PackedInstances, PackedScene, Punctual},
};
use glam::{Vec3, Vec4};
use std::collections::HashMap;

/// Where each instance was in the last frame, by id. Users move objects, too, so a scene's own motion does not
/// tell.
#[derive(Clone, Debug, Default)]
pub struct Movers {
    before: HashMap<u32, (Instance, Bounds)>,
    /// The ids of all instances in the last frame, in order.
    order: Vec<u32>,
    /// What had moved in the last frame.
    moved: Vec<Mover>,
    lights: Option<Vec<Punctual>>,
}

impl Movers {
    /// Forgets the last frame.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// Takes down where instances are, and tells them where they were. Returns what has moved, come or gone since
    /// the last frame, in metres relative to `centre`. `unit` is the radiance to which that of lamps is compared.
    pub fn advance(
        &mut self,
        packed: &PackedScene,
        state: &mut PackedInstances,
        centre: Vec3,
        unit: f32,
    ) -> Vec<Mover> {
        let mut before = std::mem::take(&mut self.before);
        let first = before.is_empty();
        let mut movers = Vec::new();
        for instance in &mut state.instances {
            let known = before.remove(&instance.id);
            if let Some((known, _)) = known {
                instance.previous_object_to_world = known.object_to_world;
            }
            let came = known.is_none() && !first;
            let pose = state.poses.iter().find(|pose| pose.placed.root == instance.root);
            let bounds = pose.map_or_else(|| at_rest(packed, instance), |pose| pose.bounds);
            if came || instance.step > 0.0 || instance.object_to_world != instance.previous_object_to_world {
                movers.extend(mover(packed, (instance, bounds), came, centre, unit));
            }
            self.before.insert(instance.id, (*instance, bounds));
        }
        movers.extend(before.values().filter_map(|(gone, bounds)| mover(packed, (gone, *bounds), true, centre, unit)));
        movers.extend(self.moved_lights(&state.lights, centre, unit));
        movers
    }

    /// Returns spheres outside of which objects look as they did in the last frame, from the same place. A surface that
    /// has stopped looks different once more, as its motion ends. Returns `None` if objects have come, gone or changed
    /// places. `movers` is what [`Movers::advance`] returned.
    pub fn touching(&mut self, state: &PackedInstances, movers: &[Mover]) -> Option<Vec<Mover>> {
        let order: Vec<u32> = state.instances.iter().map(|instance| instance.id).collect();
        let objects: Vec<Mover> = movers.iter().filter(|mover| mover.id != NONE).copied().collect();
        let same = std::mem::replace(&mut self.order, order) == self.order;
        let before = std::mem::replace(&mut self.moved, objects.clone());
        same.then(|| [objects, before].concat())
    }

    /// Takes down the lights, and returns those that are not what they were.
    fn moved_lights(&mut self, lights: &[Punctual], centre: Vec3, unit: f32) -> Vec<Mover> {
        let Some(before) = self.lights.replace(lights.to_vec()) else { return Vec::new() };
        let all = lights.len().max(before.len());
        let pairs = (0..all).filter_map(|at| match (lights.get(at), before.get(at)) {
            (Some(now), Some(before)) if now == before => None,
            (Some(now), Some(before)) => Some((now, before, false)),
            (now, before) => now.or(before).map(|light| (light, light, true)),
        });
        pairs.map(|(now, before, whole)| light_mover(now, before, whole, centre, unit)).collect()
    }
}

/// The box of a mesh that keeps its shape, object space.
fn at_rest(packed: &PackedScene, instance: &Instance) -> Bounds {
    packed.nodes.get(instance.root as usize).map_or(Bounds::EMPTY, |root| Bounds { min: root.min, max: root.max })
}

/// Returns spheres around an instance now and before. What came or went counts as having moved by its own size.
fn mover(
    packed: &PackedScene,
    (instance, bounds): (&Instance, Bounds),
    whole: bool,
    centre: Vec3,
    unit: f32,
) -> Option<Mover> {
    if bounds.is_empty() {
        return None;
    }
    let corners = bounds.corners();
    let [now, before] = [instance.object_to_world, instance.previous_object_to_world];
    let middle = bounds.center();
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
        glow: brightest(packed, instance) / unit.max(1e-20),
    })
}

/// Returns a light as a sphere that shines as brightly from afar.
fn light_mover(now: &Punctual, before: &Punctual, whole: bool, centre: Vec3, unit: f32) -> Mover {
    const RADIUS: f32 = 0.25;
    // What covers a part of a surface's sky may take no light from there. A light that moves surely does, so it counts
    // for more: histories keep an error of a few per cent.
    const SURE: f32 = 6.0;
    let directional = now.directional != 0;
    // A parallel light comes from half of all directions.
    let radius = if directional { 1e4 } else { RADIUS };
    let place = |light: &Punctual| if directional { light.direction * -radius } else { light.position - centre };
    let intensity = now.intensity.max(before.intensity).dot(LUMINANCE);
    let area = std::f32::consts::PI * if directional { 1.0 } else { radius * radius };
    let step = place(now).distance(place(before));
    let turn = if directional { 0.0 } else { now.direction.distance(before.direction) * radius };
    let changed = whole || now.intensity != before.intensity;
    Mover {
        now: place(now),
        radius,
        before: place(before),
        step: if changed { 2.0 * radius } else { step + turn },
        id: NONE,
        glow: SURE * intensity / area / unit.max(1e-20),
    }
}

const LUMINANCE: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);

fn transform(rows: &[[f32; 4]; 3], point: Vec3) -> Vec3 {
    rows.map(|row| Vec4::from(row).dot(point.extend(1.0))).into()
}

/// The greatest luminance that an instance emits.
fn brightest(packed: &PackedScene, instance: &Instance) -> f32 {
    let all = packed.triangles_of(instance.root).map(|triangle| packed.emissive(triangle, instance.first_material));
    all.map(|emissive| emissive.dot(LUMINANCE)).fold(0.0, f32::max)
}
