//! The triangles that shine, in a table from which one is drawn by area × luminance.

use super::packed::{Instance, Light, PackedInstances, PackedScene, TriangleGeometry};
use glam::{DVec3, Vec3, Vec4, vec3};
use std::collections::HashMap;

/// The most triangles that are aimed at. Where more shine, rays find them by chance.
const MOST: usize = 1 << 20;

/// All lights of a scene at one time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneLights {
    pub lights: Vec<Light>,
    /// Σ area · luminance, m² · radiance. A point of a light is found with a density per area of luminance /
    /// power.
    pub power: f64,
    /// The centre of that power.
    pub center: Vec3,
    /// How far it is from the centre, as a root of the mean square, metres.
    pub radius: f32,
}

/// The triangles that shine of each mesh as it is used, with their luminance.
#[derive(Clone, Debug, Default)]
pub struct Shining(HashMap<(u32, u32), Vec<(u32, f32)>>);

impl Shining {
    /// Looks through all materials. Textured emission counts with its factor, which is an upper bound.
    pub fn of(scene: &PackedScene) -> Self {
        let shines = scene.materials.iter().any(|material| luminance(material.emissive) > 0.0);
        let of = |used: &(u32, u32)| {
            let all =
                scene.triangles_of(used.0).map(|triangle| (triangle, luminance(scene.emissive(triangle, used.1))));
            let mut found: Vec<_> = all.filter(|(_, luminance)| *luminance > 0.0).collect();
            found.sort_unstable_by_key(|(triangle, _)| *triangle);
            (*used, found)
        };
        let found = scene.uses.keys().filter(|_| shines).map(of).filter(|(_, triangles)| !triangles.is_empty());
        Self(found.collect())
    }

    /// Returns how many lights a scene has at most.
    pub fn most(&self, scene: &PackedScene) -> usize {
        let all: usize =
            self.0.iter().map(|(used, triangles)| triangles.len() * scene.uses.get(used).unwrap_or(&0)).sum();
        if all <= MOST { all } else { 0 }
    }

    /// Collects the lights of a scene at one time. If they may be too many, there are none.
    pub fn lights(&self, scene: &PackedScene, state: &PackedInstances) -> SceneLights {
        if self.most(scene) == 0 {
            return SceneLights::default();
        }
        let mut lights = Vec::new();
        let mut weights = Vec::new();
        let mut centers = Vec::new();
        for (index, instance) in state.instances.iter().enumerate() {
            for (triangle, luminance) in self.0.get(&instance.used()).into_iter().flatten() {
                let shape = shape(scene, state, *triangle);
                let weight = f64::from(*luminance) * area(shape, instance);
                if weight > 0.0 {
                    centers.push(center(shape, instance));
                    lights.push(Light { instance: index as u32, triangle: *triangle, ..Default::default() });
                    weights.push(weight);
                }
            }
        }
        let power = weights.iter().sum::<f64>();
        let mut below = 0.0;
        for (light, weight) in lights.iter_mut().zip(&weights) {
            light.below = (below / power) as f32;
            below += weight;
        }
        let mean = |of: &dyn Fn(&DVec3) -> DVec3| {
            let sum: DVec3 = centers.iter().zip(&weights).map(|(at, weight)| *weight * of(at)).sum();
            if power > 0.0 { sum / power } else { DVec3::ZERO }
        };
        let center = mean(&|at| *at);
        let square = mean(&|at| DVec3::splat(at.distance_squared(center))).x;
        SceneLights { lights, power, center: center.as_vec3(), radius: square.sqrt() as f32 }
    }
}

/// Collects the lights.
pub fn light_table(scene: &PackedScene, state: &PackedInstances) -> SceneLights {
    Shining::of(scene).lights(scene, state)
}

/// Returns a triangle as it is now.
fn shape(scene: &PackedScene, state: &PackedInstances, triangle: u32) -> TriangleGeometry {
    let posed = state.poses.iter().find_map(|pose| pose.triangle(triangle));
    posed.unwrap_or(scene.triangles[triangle as usize])
}

fn luminance(color: Vec3) -> f32 {
    color.dot(vec3(0.2126, 0.7152, 0.0722))
}

/// Returns the world-space area of a triangle, m².
fn area(shape: TriangleGeometry, instance: &Instance) -> f64 {
    let world = |edge: Vec3| {
        let row = |i: usize| Vec3::from_slice(&instance.object_to_world[i]).as_dvec3().dot(edge.as_dvec3());
        glam::dvec3(row(0), row(1), row(2))
    };
    0.5 * world(shape.e1).cross(world(shape.e2)).length()
}

/// Returns where the middle of a triangle is in the world.
fn center(shape: TriangleGeometry, instance: &Instance) -> DVec3 {
    let middle = (shape.v0 + (shape.e1 + shape.e2) / 3.0).extend(1.0).as_dvec4();
    DVec3::from_array(instance.object_to_world.map(|row| Vec4::from(row).as_dvec4().dot(middle)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::packed::{BvhNode, PackedMaterial, TriangleShading};

    /// Makes triangles of these legs (area ½ leg²), each of its own material that shines with `radiance`.
    fn scene(triangles: &[(f32, f32)]) -> (PackedScene, PackedInstances) {
        let count = triangles.len() as u32;
        let scene = PackedScene {
            triangles: triangles
                .iter()
                .map(|(leg, _)| TriangleGeometry { v0: Vec3::ZERO, e1: Vec3::X * *leg, e2: Vec3::Y * *leg })
                .collect(),
            shading: (0..count).map(|material| TriangleShading { material, ..Default::default() }).collect(),
            materials: triangles
                .iter()
                .map(|(_, radiance)| PackedMaterial { emissive: Vec3::splat(*radiance), ..Default::default() })
                .collect(),
            nodes: vec![BvhNode { min: Vec3::ZERO, max: Vec3::ONE, leaf: count, next: u32::MAX }],
            uses: [((0, 0), 1)].into(),
            ..Default::default()
        };
        let mut instance = Instance::default();
        for axis in 0..3 {
            instance.object_to_world[axis][axis] = 1.0;
        }
        (scene, PackedInstances { instances: vec![instance], ..Default::default() })
    }

    #[test]
    fn drawn_by_area_and_luminance() {
        let triangles = [(1.0, 3.0), (2.0, 0.0), (0.5, 40.0), (3.0, 0.25), (0.1, 7.0)];
        let (scene, state) = scene(&triangles);
        let table = light_table(&scene, &state);
        assert_eq!(table.lights.iter().map(|l| l.triangle).collect::<Vec<_>>(), [0, 2, 3, 4]);
        let weight = |i: u32| f64::from(triangles[i as usize].0.powi(2) * 0.5 * triangles[i as usize].1);
        let power: f64 = (0..5).map(weight).sum();
        assert!((table.power / power - 1.0).abs() < 1e-5);
        let ends = table.lights.iter().skip(1).map(|l| l.below).chain([1.0]);
        for (light, end) in table.lights.iter().zip(ends) {
            let share = f64::from(end - light.below);
            assert!((share - weight(light.triangle) / power).abs() < 1e-6, "{}: {share}", light.triangle);
        }
    }

    #[test]
    fn scale_counts_and_darkness_is_empty() {
        let (mut dark, state) = scene(&[(1.0, 0.0)]);
        assert_eq!(light_table(&dark, &state), SceneLights::default());
        dark.materials[0].emissive = Vec3::ONE;
        let mut larger = state;
        for axis in 0..3 {
            larger.instances[0].object_to_world[axis][axis] = 2.0;
        }
        assert!((light_table(&dark, &larger).power - 2.0).abs() < 1e-6);
    }
}
