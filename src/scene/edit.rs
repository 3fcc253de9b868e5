//! Changes a scene while it is shown. A clone shares triangles and textures, and moving an object changes
//! neither.

use super::{
    animation::{Lerp, Placement, Track, Transform, Turn},
    bvh,
    packed::NONE,
    state::{self, Object, Scene},
};
use crate::Result;
use glam::{Affine3A, Mat3A, Vec3, Vec3A};
use std::sync::Arc;

impl Placement {
    /// Moves the whole motion elsewhere: at `time` it is `to`, and at all times it is as far from where it
    /// was.
    pub fn moved(&self, time: f64, to: Transform) -> Self {
        let now = self.at(time);
        let (shift, turn, grow) =
            (to.translation - now.translation, to.rotation * now.rotation.inverse(), to.scale / now.scale);
        Self {
            translation: mapped(&self.translation, |value| value + shift),
            rotation: mapped(&self.rotation, |value| Turn { by: (turn * value.by).normalize(), ..value }),
            scale: mapped(&self.scale, |value| value * grow),
        }
    }
}

fn mapped<T: Lerp>(track: &Track<T>, change: impl Fn(T) -> T) -> Track<T> {
    let keys: Vec<_> = track.keys().map(|(time, value)| (time, change(value))).collect();
    let default = change(track.at(0.0));
    if track.is_constant() { Track::constant(default) } else { Track::from_keys(keys, default) }
}

impl Scene {
    /// Returns the objects, in order.
    pub fn objects(&self) -> impl Iterator<Item = &Object> {
        self.placed.iter().map(|placed| &placed.object)
    }

    /// Puts object `index` elsewhere. Nothing is packed again.
    pub fn place(&mut self, index: usize, placement: Placement) {
        if let Some(placed) = self.placed.get_mut(index) {
            placed.object.placement = placement;
        }
    }

    /// Returns the same scene with other objects, packed anew.
    ///
    /// # Errors
    /// Fails as [`Scene::assemble`] does.
    pub fn with_objects(&self, objects: &[Object]) -> Result<Self> {
        let (packed, placed, warnings) = state::place(objects)?;
        Ok(Self { packed: Arc::new(packed), placed, warnings, ..self.clone() })
    }

    /// Returns the seconds after which everything has moved once: the video, key frames, clips.
    pub fn duration(&self) -> f64 {
        let mut end = self.panorama.frame_count() as f64 / self.panorama.fps;
        for object in self.objects() {
            let Placement { translation, rotation, scale } = &object.placement;
            let last = |keys: &mut dyn Iterator<Item = f64>| keys.fold(0.0, f64::max);
            end = end
                .max(last(&mut translation.keys().map(|(time, _)| time)))
                .max(last(&mut rotation.keys().map(|(time, _)| time)))
                .max(last(&mut scale.keys().map(|(time, _)| time)));
            if let Some(clip) = object.clip.and_then(|clip| object.model.rig.clips.get(clip)) {
                end = end.max(f64::from(clip.duration()) / object.speed.abs().max(1e-3));
            }
        }
        end
    }

    /// Returns the first object that a ray meets at a time, and its distance in lengths of `direction`.
    /// World, metres.
    pub fn first_object(&self, origin: Vec3, direction: Vec3, time: f64) -> Option<(usize, f32)> {
        let mut best: Option<(usize, f32)> = None;
        for (index, placed) in self.placed.iter().enumerate() {
            let matrices = placed.matrices(time);
            for (node, mesh, _) in &placed.instances {
                let to_world = matrices[*node];
                if !super::animation::is_invertible(&to_world) {
                    continue;
                }
                let to_object = to_world.inverse();
                let most = best.map_or(f32::INFINITY, |(_, t)| t);
                if let Some(t) = self.first_triangle(mesh.root, &to_object, origin, direction, most) {
                    best = Some((index, t));
                }
            }
        }
        best
    }

    fn first_triangle(&self, root: u32, to_object: &Affine3A, origin: Vec3, way: Vec3, most: f32) -> Option<f32> {
        let (o, d) = (to_object.transform_point3(origin), to_object.transform_vector3(way));
        let inverse = d.recip();
        let meets = |low: Vec3, high: Vec3, most: f32| {
            let (a, b) = ((low - o) * inverse, (high - o) * inverse);
            let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
            leave >= enter.max(0.0) && enter < most
        };
        let (mut best, mut found) = (most, None);
        let mut at = root;
        while at != NONE {
            let node = &self.packed.nodes[at as usize];
            if !meets(node.min, node.max, best) {
                at = node.next;
                continue;
            }
            for triangle in bvh::leaf(node).map(|triangle| &self.packed.triangles[triangle as usize]) {
                // The equation is o + t·d = v0 + u·e1 + v·e2.
                let system = Mat3A::from_cols((-d).into(), triangle.e1.into(), triangle.e2.into());
                if system.determinant().abs() < 1e-20 {
                    continue;
                }
                let solved = system.inverse() * Vec3A::from(o - triangle.v0);
                let (t, u, v) = (solved.x, solved.y, solved.z);
                if t > 0.0 && t < best && u >= 0.0 && v >= 0.0 && u + v <= 1.0 {
                    (best, found) = (t, Some(t));
                }
            }
            at = if node.leaf == 0 { at + 1 } else { node.next };
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        panorama::source::{PanoramaFrame, PanoramaSource},
        scene::{camera::CameraTrack, file::RenderSettings, material::Material, model::Model, shapes::Shape},
    };
    use glam::{Quat, vec3};

    fn scene(objects: Vec<Object>) -> Scene {
        let frame = PanoramaFrame {
            color_size: [2, 1],
            radiance: vec![[1.0; 4]; 2].into(),
            depth_size: [2, 1],
            depth: vec![3.0; 2],
            ..Default::default()
        };
        let panorama = PanoramaSource::from_frames(vec![frame], 30.0, Vec3::ZERO, 0.0).unwrap();
        Scene::assemble("test", panorama, CameraTrack::at_point(Vec3::ZERO), objects, RenderSettings::default())
            .unwrap()
    }

    fn object(shape: Shape, at: Vec3) -> Object {
        let material = Material::plain("grey", Vec3::ONE, 1.0);
        Object {
            name: "object".into(),
            model: Arc::new(Model::from_mesh(shape.mesh(Vec3::ONE), material)),
            placement: Placement::fixed(Transform { translation: at, ..Transform::IDENTITY }),
            clip: None,
            speed: 1.0,
        }
    }

    #[test]
    fn the_nearest_object_is_found_where_it_now_stands() {
        let mut scene = scene(vec![object(Shape::Box, vec3(0.0, 0.0, -6.0)), object(Shape::Box, vec3(0.0, 0.0, -3.0))]);
        let shared = Arc::clone(&scene.packed);
        let (index, t) = scene.first_object(Vec3::ZERO, Vec3::NEG_Z, 0.0).unwrap();
        assert_eq!(index, 1);
        assert!((t - 2.5).abs() < 1e-4, "{t}");
        assert!(scene.first_object(Vec3::ZERO, Vec3::Z, 0.0).is_none());
        let aside = Transform { translation: vec3(2.0, 0.0, -3.0), ..Transform::IDENTITY };
        scene.place(1, Placement::fixed(aside));
        let (index, t) = scene.first_object(Vec3::ZERO, Vec3::NEG_Z, 0.0).unwrap();
        assert_eq!((index, (t - 5.5).abs() < 1e-4), (0, true));
        assert!(Arc::ptr_eq(&shared, &scene.packed), "nothing was packed again");
    }

    #[test]
    fn a_motion_moves_as_a_whole() {
        let translation = Track::from_keys(vec![(0.0, Vec3::ZERO), (2.0, Vec3::X)], Vec3::ZERO);
        let placement = Placement { translation, ..Placement::fixed(Transform::IDENTITY) };
        let to = Transform {
            translation: vec3(0.5, 1.0, 0.0),
            rotation: Quat::from_rotation_y(1.0),
            scale: Vec3::splat(2.0),
        };
        let moved = placement.moved(1.0, to);
        assert_eq!(moved.at(0.0).translation, Vec3::Y);
        assert_eq!(moved.at(2.0).translation, vec3(1.0, 1.0, 0.0));
        assert!(moved.at(1.0).rotation.angle_between(to.rotation) < 1e-3);
        assert_eq!(moved.at(0.3).scale, Vec3::splat(2.0));
    }
}
