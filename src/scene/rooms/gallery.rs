//! `gallery`: an exhibition hall 8 m × 6.4 m × 3.5 m with thin posts, barriers, plinths, a large real mirror
//! and bright ceiling panels. A painted screen swings about its post, so this room's real geometry moves.
//!
//! Plan (metres, origin below the capture point): x from −4 to 4 (mirror), z from −4.2 (paintings) to 2.2
//! (door).

use super::furniture::{self, place};
use super::kit::{Builder, block, quad, rounded_block, tube};
use super::shell::Shell;
use super::{Room, Video, exhibits, gallery_objects, textures};
use crate::scene::animation::{Track, Transform};
use crate::scene::camera::{Aim, CameraTrack};
use crate::scene::clip::{Channel, Clip, Join, Property};
use crate::scene::material::Material;
use crate::scene::model::Model;
use glam::{Affine3A, Quat, Vec2, Vec3, Vec4, vec2, vec3};
use std::f32::consts::TAU;
use std::sync::Arc;

const MIN: Vec3 = vec3(-4.0, 0.0, -4.2);
const MAX: Vec3 = vec3(4.0, 3.5, 2.2);
/// The video holds one swing of the screen, there and back. All motion of the built-in scenes repeats after
/// it.
const VIDEO: Video = Video { frames: 8, fps: 2.0, size: [896, 448], samples: 8 };
const PIVOT: Vec3 = vec3(-1.75, 0.0, -2.35);
/// Degrees to either side of its middle position.
const SWING: f32 = 32.0;

/// Makes the room, its virtual objects and the view of them.
pub fn gallery() -> Room {
    let mut b = Builder::default();
    let floor = b.painted("polished concrete", textures::concrete());
    let ceiling = b.paint("ceiling", [0.78, 0.78, 0.78]);
    let white = b.painted("plaster", textures::plaster(vec3(0.74, 0.73, 0.71), 61));
    let petrol = b.painted("petrol plaster", textures::plaster(vec3(0.10, 0.22, 0.25), 62));
    let trim = b.paint("shadow gap", [0.16, 0.16, 0.16]);
    Shell { min: MIN, max: MAX, floor, ceiling, walls: [petrol, white, white, white], trim, window: None }.build(
        &mut b,
        Vec2::splat(1.0 / 3.2),
        Vec2::splat(1.0 / 2.5),
    );
    furnish(&mut b);
    let mut screen = Builder::default();
    exhibits::screen(&mut screen);
    let capture_position = vec3(0.0, 1.5, 0.0);
    Room {
        name: "gallery",
        model: Arc::new(swinging(b, screen)),
        capture_position,
        video: Some(VIDEO),
        objects: gallery_objects::gallery(),
        camera: CameraTrack {
            aim: Aim::LookAt(Track::constant(vec3(0.25, 1.0, -2.4))),
            fov_y_degrees: Track::constant(70.0),
            ..CameraTrack::at_point(capture_position)
        },
    }
}

/// Makes room and screen two nodes, and the swing the model's only clip. Between video frames the screen
/// rests, as they show it.
fn swinging(room: Builder, screen: Builder) -> Model {
    let mut model = room.model("gallery");
    let node = model.add(screen.model("screen"), Transform { translation: PIVOT, ..Transform::IDENTITY });
    let count = VIDEO.frames as i32;
    let angle = |frame: i32| {
        // Out and back are the same positions, bit for bit, so each is captured once.
        let there = frame.min(count - frame);
        20.0 + SWING * (TAU * there as f32 / count as f32).cos()
    };
    let rotation = |frame: i32| Vec4::from(Quat::from_rotation_y(angle(frame).to_radians()));
    let rotations = Channel {
        node,
        property: Property::Rotation,
        join: Join::Step,
        times: (0..=count).map(|frame| (f64::from(frame) / VIDEO.fps) as f32).collect(),
        values: (0..=count).map(|frame| rotation(frame % count)).collect(),
    };
    model.rig.clips.push(Clip { name: "swing".into(), channels: [rotations].into(), ..Clip::default() });
    model
}

fn furnish(b: &mut Builder) {
    let black = b.paint("black steel", [0.03, 0.03, 0.032]);
    let lacquer = b.paint("white lacquer", [0.78, 0.78, 0.76]);
    let oak = b.painted("oak", textures::wood(vec3(0.34, 0.20, 0.10), vec3(0.55, 0.37, 0.20), 42));
    let brass = b.paint("dull brass", [0.45, 0.31, 0.11]);
    let rope = b.paint("red rope", [0.38, 0.03, 0.035]);

    // Bright panels are in the ceiling, each in a dark frame.
    let glow = b.light("ceiling panel", [7.0, 6.7, 6.2]);
    for x in [-2.2, 0.0, 2.2] {
        for z in [-2.9, -0.4] {
            b.add(
                block(vec3(x - 0.62, MAX.y - 0.04, z - 0.62), vec3(x + 0.62, MAX.y + 0.01, z + 0.62)),
                Affine3A::IDENTITY,
                black,
            );
            // Only one face shines, because light drawn from hidden faces would be lost.
            let pane = quad(vec3(x - 0.58, MAX.y - 0.044, z - 0.58), Vec3::X * 1.16, Vec3::Z * 1.16);
            b.add(pane, Affine3A::IDENTITY, glow);
        }
    }
    exhibits::track(b, place(0.0, MAX.y, -1.65, 0.0), 6.4, black);

    // Thin posts reach from floor to ceiling, the screen's among them.
    for (x, z, r) in
        [(-2.9, -1.2, 0.03), (-0.55, -3.1, 0.025), (1.05, -3.1, 0.025), (2.55, -1.5, 0.03), (2.9, 1.0, 0.03)]
    {
        b.add(tube(&[vec3(x, -0.005, z), vec3(x, MAX.y + 0.005, z)], &[r; 2], 20), Affine3A::IDENTITY, black);
        b.add(exhibits::collar(r), place(x, 0.0, z, 0.0), black);
    }
    let pivot = place(PIVOT.x, 0.0, PIVOT.z, 0.0);
    b.add(tube(&[vec3(0.0, -0.005, 0.0), vec3(0.0, MAX.y + 0.005, 0.0)], &[0.02; 2], 16), pivot, brass);
    b.add(exhibits::collar(0.02), pivot, brass);

    // A barrier stands in front of the large painting.
    let stands = [vec3(-0.75, 0.0, -3.3), vec3(0.25, 0.0, -3.3), vec3(1.25, 0.0, -3.3)];
    exhibits::barrier(b, &stands, brass, rope);

    for (x, z, size) in
        [(2.0, -2.5, vec3(0.42, 1.0, 0.42)), (-0.15, -2.15, vec3(0.5, 0.8, 0.5)), (-2.75, -3.3, vec3(0.4, 1.1, 0.4))]
    {
        exhibits::plinth(b, place(x, 0.0, z, 0.0), size, lacquer);
    }
    exhibits::bench(b, place(1.35, 0.0, -1.35, 28.0), 1.3, oak, black);
    exhibits::bench(b, place(-1.9, 0.0, 1.25, 180.0), 1.5, oak, black);

    for (i, x) in [-2.95, 0.25, 3.0].into_iter().enumerate() {
        let canvas = b.painted(&format!("painting {i}"), textures::painting(i as u32));
        let size = if i == 1 { vec2(1.9, 1.35) } else { vec2(0.9, 1.2) };
        furniture::picture(b, place(x, 1.65, MIN.z, 0.0), size, canvas, if i == 1 { brass } else { black });
    }
    for (i, z) in [-2.6, -0.6, 1.2].into_iter().enumerate() {
        let canvas = b.painted(&format!("print {i}"), textures::picture(i as u32));
        furniture::picture(b, place(MIN.x, 1.6, z, 90.0), vec2(0.72, 0.90), canvas, oak);
    }
    let canvas = b.painted("triptych", textures::painting(2));
    furniture::picture(b, place(-1.9, 1.65, MAX.z, 180.0), vec2(1.6, 1.1), canvas, black);
    furniture::door(b, place(1.6, 0.0, MAX.z, 180.0), lacquer, black, brass);

    // Only the mirror is not diffuse.
    let mirror = b.material(Material { metallic: 1.0, ..Material::plain("mirror", vec3(0.90, 0.91, 0.90), 0.0) });
    furniture::picture(b, place(MAX.x, 1.45, -1.3, -90.0), vec2(1.5, 2.1), mirror, brass);
    let shelf = rounded_block(vec3(0.9, 0.04, 0.24), 0.008, 2, 1, 0.0).uv_scaled(Vec2::splat(1.2));
    b.add(shelf, place(MAX.x - 0.115, 0.95, 0.75, -90.0), oak);
    furniture::vase(b, place(MAX.x - 0.12, 0.97, 0.95, 0.0), rope, black);
    furniture::magazines(b, place(MAX.x - 0.13, 0.97, 0.55, 75.0), &[lacquer, rope, black]);
}
