//! `bedroom`: 4.2 m × 3.9 m × 2.5 m at night, with one small warm lamp beside the bed, a little moonlight
//! between the curtains, and corners that are nearly dark.
//!
//! Plan (metres, origin below the capture point): x from −2.3 (window) to 1.9 (wardrobe), z from −2.4
//! (headboard) to 1.5 (door).

use super::furniture::{self, place};
use super::kit::{Builder, block, quad};
use super::shell::{Opening, Shell};
use super::{Room, bedroom_objects, sleeping, textures};
use crate::scene::animation::Track;
use crate::scene::camera::{Aim, CameraTrack};
use glam::{Affine3A, Vec2, Vec3, vec2, vec3};
use std::sync::Arc;

const MIN: Vec3 = vec3(-2.3, 0.0, -2.4);
const MAX: Vec3 = vec3(1.9, 2.5, 1.5);
const WINDOW: Opening = Opening { low: vec2(-1.25, 0.95), high: vec2(0.05, 2.1), depth: 0.2 };

/// Makes the room, its virtual objects and the view of them.
pub fn bedroom() -> Room {
    let mut b = Builder::default();
    let floor = b.painted("floor", textures::dark_planks());
    let ceiling = b.paint("ceiling", [0.74, 0.73, 0.70]);
    let wall = b.painted("wallpaper", textures::wallpaper());
    let plain = b.paint("wall", [0.58, 0.53, 0.46]);
    let trim = b.paint("trim", [0.72, 0.70, 0.66]);
    Shell { min: MIN, max: MAX, floor, ceiling, walls: [wall, plain, plain, plain], trim, window: Some(WINDOW) }.build(
        &mut b,
        Vec2::splat(1.0 / 1.8),
        Vec2::splat(1.0 / 1.2),
    );
    window(&mut b);
    furnish(&mut b);
    let capture_position = vec3(0.0, 1.35, 0.0);
    Room {
        name: "bedroom",
        model: Arc::new(b.model("bedroom")),
        capture_position,
        video: None,
        objects: bedroom_objects::bedroom(),
        camera: CameraTrack {
            aim: Aim::LookAt(Track::constant(vec3(-0.12, 0.62, -1.5))),
            fov_y_degrees: Track::constant(72.0),
            ..CameraTrack::at_point(capture_position)
        },
    }
}

/// Adds reveal, cross bars, sill, curtains half drawn, and the night outside.
fn window(b: &mut Builder) {
    let Opening { low, high, depth } = WINDOW;
    let night = b.light("night", [0.05, 0.075, 0.13]);
    let frame = b.paint("window frame", [0.66, 0.65, 0.62]);
    WINDOW.reveal(b, MIN.x, frame, &[(1.0, night)]);
    let x = MIN.x - depth + 0.09;
    let bar = |z0: f32, z1: f32, y0: f32, y1: f32, t: f32| block(vec3(x - t, y0, z0), vec3(x + t, y1, z1));
    let f = 0.05;
    let (z0, z1, y0, y1) = (low.x - 0.004, high.x + 0.004, low.y - 0.004, high.y + 0.004);
    let middle = (low.x + high.x) * 0.5;
    let bars = bar(z0, z1, y0, y0 + f, 0.025)
        .and(bar(z0, z1, y1 - f, y1, 0.025))
        .and(bar(z0, z0 + f, y0 + f, y1 - f, 0.025))
        .and(bar(z1 - f, z1, y0 + f, y1 - f, 0.025))
        .and(bar(middle - 0.025, middle + 0.025, y0 + f - 0.01, y1 - f + 0.01, 0.022))
        .and(bar(z0 + f - 0.01, z1 - f + 0.01, 1.66, 1.695, 0.018));
    b.add(bars, Affine3A::IDENTITY, frame);
    b.add(
        block(vec3(MIN.x - 0.1, low.y - 0.012, low.x - 0.05), vec3(MIN.x + 0.12, low.y + 0.02, high.x + 0.05)),
        Affine3A::IDENTITY,
        frame,
    );
    let inside = place(MIN.x, 0.0, middle, 90.0);
    let cloth = b.painted("curtain", textures::cloth(vec3(0.28, 0.09, 0.10), 7));
    let metal = b.paint("curtain rod", [0.05, 0.04, 0.035]);
    furniture::curtains(b, inside, high.x - low.x, 2.28, cloth, metal);
}

fn furnish(b: &mut Builder) {
    let oak = b.painted("oak", textures::wood(vec3(0.26, 0.14, 0.06), vec3(0.46, 0.28, 0.14), 32));
    let walnut = b.painted("walnut", textures::wood(vec3(0.085, 0.042, 0.022), vec3(0.22, 0.12, 0.06), 33));
    let white = b.paint("cream lacquer", [0.68, 0.64, 0.56]);
    let black = b.paint("black", [0.03, 0.03, 0.03]);
    let brass = b.paint("dull brass", [0.42, 0.29, 0.10]);
    let linen = b.painted("linen", textures::cloth(vec3(0.74, 0.71, 0.64), 11));
    let blue = b.painted("blue cotton", textures::stripes(vec3(0.10, 0.17, 0.30), vec3(0.62, 0.60, 0.54), 12));
    let ochre = b.painted("ochre wool", textures::cloth(vec3(0.52, 0.28, 0.06), 13));
    let rust = b.painted("rust velvet", textures::cloth(vec3(0.34, 0.10, 0.05), 14));
    let slate = b.painted("slate felt", textures::cloth(vec3(0.16, 0.19, 0.22), 15));
    let bedding = sleeping::Bedding {
        wood: walnut,
        headboard: slate,
        sheet: linen,
        duvet: blue,
        blanket: ochre,
        pillows: [linen, rust],
    };
    sleeping::bed(b, place(-0.45, 0.0, MIN.z, 0.0), &bedding);
    for x in [-1.62, 0.72] {
        sleeping::nightstand(b, place(x, 0.0, MIN.z, 0.0), walnut, oak, brass);
    }
    let shade = b.light("lamp shade", [120.0, 65.0, 25.0]);
    sleeping::table_lamp(b, place(0.74, 0.5, MIN.z + 0.17, 0.0), brass, shade);
    let covers = [b.paint("red cover", [0.42, 0.06, 0.04]), b.paint("grey cover", [0.30, 0.32, 0.34]), white];
    furniture::magazines(b, place(-1.62, 0.5, MIN.z + 0.2, 78.0), &covers);
    sleeping::wardrobe(b, place(MAX.x, 0.0, 0.38, -90.0), 1.62, oak, white, brass);
    sleeping::dresser(b, place(-0.55, 0.0, MAX.z, 180.0), 1.2, oak, white, brass);
    furniture::vase(b, place(-0.9, 0.8, MAX.z - 0.22, 0.0), covers[1], black);
    furniture::magazines(b, place(-0.35, 0.8, MAX.z - 0.24, 12.0), &[covers[2], covers[0]]);
    sleeping::chair(b, place(-1.85, 0.0, 0.85, 128.0), oak, rust);
    furniture::door(b, place(0.72, 0.0, MAX.z, 180.0), white, white, brass);
    furniture::basket(b, place(-2.02, 0.0, 0.25, 0.0), ochre);
    sleeping::paper_globe(b, place(-0.45, MAX.y, -1.05, 0.0), 0.21, linen, black);

    let rug = b.painted("rug", textures::rug());
    let mut lying = block(vec3(-1.0, 0.0, -0.66), vec3(1.0, 0.012, 0.66));
    for (uv, p) in lying.uvs.iter_mut().zip(&lying.positions) {
        *uv = vec2((p.x + 1.0) / 2.0, (p.z + 0.66) / 1.32);
    }
    b.add(lying, place(0.05, -0.002, 0.18, 0.0), rug);
    for (x, kind, size) in [(-0.95, 1, vec2(0.42, 0.52)), (-0.45, 0, vec2(0.42, 0.52)), (0.05, 2, vec2(0.42, 0.52))] {
        let canvas = b.painted(&format!("picture {kind}"), textures::picture(kind));
        furniture::picture(b, place(x, 1.62, MIN.z, 0.0), size, canvas, walnut);
    }
    let canvas = b.painted("landscape", textures::picture(0));
    furniture::picture(b, place(-0.55, 1.55, MAX.z, 180.0), vec2(0.56, 0.70), canvas, black);
    // A poster without a frame hangs on the wall between wardrobe and bed.
    let poster = b.painted("poster", textures::picture(1));
    let sheet = quad(vec3(-0.3, -0.4, 0.002), Vec3::X * 0.6, Vec3::Y * 0.8).uv_scaled(vec2(1.0 / 0.6, 1.0 / 0.8));
    b.add(sheet, place(MAX.x, 1.55, -1.35, -90.0), poster);
}
