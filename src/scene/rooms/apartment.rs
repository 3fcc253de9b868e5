//! `apartment`: a living room 5 m × 4.5 m × 2.7 m with a large window, a floor lamp and a textured floor.
//!
//! Plan (metres, origin below the capture point): x from −2.4 (window) to 2.6 (bookcase), z from −3 (sofa) to
//! 1.5 (door).

use super::furniture::{self, Upholstery, place};
use super::kit::{Builder, block};
use super::shell::{Opening, Shell};
use super::{Room, objects, textures};
use crate::scene::animation::Track;
use crate::scene::camera::{Aim, CameraTrack};
use glam::{Affine3A, Vec2, Vec3, vec2, vec3};
use std::sync::Arc;

const MIN: Vec3 = vec3(-2.4, 0.0, -3.0);
const MAX: Vec3 = vec3(2.6, 2.7, 1.5);
const WINDOW: Opening = Opening { low: vec2(-2.05, 0.82), high: vec2(-0.15, 2.28), depth: 0.24 };

/// Makes the room, its virtual objects and the view of them.
pub fn apartment() -> Room {
    let mut b = Builder::default();
    shell(&mut b);
    window(&mut b);
    furnish(&mut b);
    let capture_position = vec3(0.0, 1.4, 0.0);
    Room {
        name: "apartment",
        model: Arc::new(b.model("apartment")),
        capture_position,
        video: None,
        objects: objects::apartment(),
        camera: CameraTrack {
            aim: Aim::LookAt(Track::constant(vec3(-0.02, 0.68, -1.9))),
            fov_y_degrees: Track::constant(70.0),
            ..CameraTrack::at_point(capture_position)
        },
    }
}

fn shell(b: &mut Builder) {
    let floor = b.painted("floor", textures::planks());
    let ceiling = b.paint("ceiling", [0.80, 0.80, 0.78]);
    let wall = b.paint("wall", [0.66, 0.63, 0.57]);
    let accent = b.paint("accent wall", [0.30, 0.41, 0.42]);
    let trim = b.paint("trim", [0.76, 0.76, 0.73]);
    Shell { min: MIN, max: MAX, floor, ceiling, walls: [accent, wall, wall, wall], trim, window: Some(WINDOW) }.build(
        b,
        Vec2::splat(1.0 / 2.4),
        Vec2::ONE,
    );
}

/// Adds reveal, frame, mullions, sill, and the bright outside.
fn window(b: &mut Builder) {
    let Opening { low, high, .. } = WINDOW;
    let reveal = b.paint("reveal", [0.74, 0.74, 0.72]);
    // Above the horizon is the sky, below it the sunlit street.
    let sky = b.light("sky", [6.6, 8.0, 9.8]);
    let haze = b.light("haze", [7.6, 8.0, 8.2]);
    let street = b.light("street", [3.4, 3.3, 2.9]);
    WINDOW.reveal(b, MIN.x, reveal, &[(0.30, street), (0.42, haze), (1.0, sky)]);
    let frame = b.paint("window frame", [0.78, 0.78, 0.76]);
    let x = MIN.x - 0.15;
    let bar = |z0: f32, z1: f32, y0: f32, y1: f32, t: f32| block(vec3(x - t, y0, z0), vec3(x + t, y1, z1));
    let f = 0.055;
    let (z0, z1, y0, y1) = (low.x - 0.004, high.x + 0.004, low.y - 0.004, high.y + 0.004);
    let mut bars = bar(z0, z1, y0, y0 + f, 0.03).and(bar(z0, z1, y1 - f, y1, 0.03));
    bars = bars.and(bar(z0, z0 + f, y0 + f, y1 - f, 0.03)).and(bar(z1 - f, z1, y0 + f, y1 - f, 0.03));
    let third = (high.x - low.x) / 3.0;
    for i in 1..3 {
        let z = low.x + third * i as f32;
        bars = bars.and(bar(z - 0.03, z + 0.03, y0 + f - 0.01, y1 - f + 0.01, 0.027));
    }
    bars = bars.and(bar(z0 + f - 0.01, z1 - f + 0.01, 1.86, 1.895, 0.022));
    b.add(bars, Affine3A::IDENTITY, frame);
    let sill = block(vec3(MIN.x - 0.1, low.y - 0.012, low.x - 0.06), vec3(MIN.x + 0.13, low.y + 0.022, high.x + 0.06));
    b.add(sill, Affine3A::IDENTITY, frame);
    let middle = (low.x + high.x) * 0.5;
    let inside = place(MIN.x, 0.0, middle, 90.0);
    let cloth = b.painted("curtain", textures::cloth(vec3(0.62, 0.52, 0.36), 3));
    let metal = b.paint("black metal", [0.035, 0.035, 0.038]);
    furniture::curtains(b, inside, high.x - low.x, 2.44, cloth, metal);
    let radiator = b.paint("radiator", [0.75, 0.75, 0.73]);
    furniture::radiator(b, inside, 1.3, radiator);
}

fn furnish(b: &mut Builder) {
    let walnut = b.painted("walnut", textures::wood(vec3(0.075, 0.036, 0.018), vec3(0.20, 0.105, 0.052), 21));
    let oak = b.painted("oak", textures::wood(vec3(0.36, 0.21, 0.10), vec3(0.56, 0.37, 0.20), 22));
    let black = b.paint("black", [0.03, 0.03, 0.032]);
    let white = b.paint("white lacquer", [0.74, 0.74, 0.71]);
    let inks = [
        [0.42, 0.055, 0.04],
        [0.05, 0.12, 0.28],
        [0.07, 0.22, 0.12],
        [0.62, 0.48, 0.22],
        [0.70, 0.66, 0.56],
        [0.10, 0.09, 0.09],
        [0.50, 0.22, 0.06],
        [0.22, 0.10, 0.22],
        [0.16, 0.30, 0.34],
    ];
    let books: Vec<u32> = inks.iter().enumerate().map(|(i, &c)| b.paint(&format!("book {i}"), c)).collect();

    let rug = b.painted("rug", textures::rug());
    let lying = block(vec3(-1.35, 0.0, -0.9), vec3(1.35, 0.012, 0.9));
    // One picture covers the top, with planar coordinates for every face.
    let mut lying = lying;
    for (uv, p) in lying.uvs.iter_mut().zip(&lying.positions) {
        *uv = vec2((p.x + 1.35) / 2.7, (p.z + 0.9) / 1.8);
    }
    b.add(lying, place(0.15, -0.002, -1.35, 0.0), rug);

    let grey = b.painted("sofa cloth", textures::cloth(vec3(0.34, 0.36, 0.40), 1));
    let mustard = b.painted("mustard cloth", textures::cloth(vec3(0.66, 0.38, 0.07), 2));
    let brick = b.painted("brick cloth", textures::cloth(vec3(0.48, 0.12, 0.07), 4));
    let green = b.painted("green cloth", textures::cloth(vec3(0.12, 0.24, 0.15), 5));
    let sofa = Upholstery { cloth: grey, wood: walnut, pillows: vec![mustard, brick] };
    furniture::sofa(b, place(0.15, 0.0, -2.5, 0.0), 3, &sofa);
    let armchair = Upholstery { cloth: green, wood: walnut, pillows: vec![] };
    furniture::sofa(b, place(1.95, 0.0, 0.40, -116.0), 1, &armchair);
    furniture::coffee_table(b, place(0.15, 0.0, -1.42, 0.0), vec2(1.05, 0.56), oak, black);
    furniture::magazines(b, place(0.47, 0.42, -1.50, 18.0), &[books[4], books[1], books[0]]);
    furniture::bookcase(b, place(MAX.x - 0.002, 0.0, -1.25, -90.0), walnut, &books, white);
    furniture::sideboard(b, place(0.75, 0.0, MAX.z - 0.016, 180.0), 1.56, oak, white, black);
    furniture::door(b, place(-1.35, 0.0, MAX.z, 180.0), white, white, black);

    let shade = b.light("lamp shade", [20.0, 13.4, 7.2]);
    furniture::floor_lamp(b, place(1.86, 0.0, -2.62, 0.0), black, shade);
    let terracotta = b.paint("terracotta", [0.48, 0.20, 0.11]);
    let soil = b.paint("soil", [0.05, 0.032, 0.02]);
    let stem = b.paint("stem", [0.13, 0.15, 0.05]);
    let leaves = [b.paint("leaf", [0.06, 0.19, 0.045]), b.paint("young leaf", [0.13, 0.28, 0.06])];
    furniture::plant(b, place(-1.92, 0.0, -2.58, 0.0), terracotta, soil, stem, leaves);
    furniture::vase(b, place(0.35, 0.74, MAX.z - 0.22, 0.0), terracotta, soil);
    furniture::magazines(b, place(1.15, 0.74, MAX.z - 0.22, 172.0), &[books[2], books[6], books[4]]);
    furniture::basket(b, place(-2.1, 0.0, 0.62, 0.0), books[8]);

    for (i, x) in [-0.72, 0.15, 1.02].into_iter().enumerate() {
        let canvas = b.painted(&format!("picture {i}"), textures::picture(i as u32));
        let frame = if i == 1 { black } else { oak };
        furniture::picture(b, place(x, 1.62, MIN.z, 0.0), vec2(0.52, 0.65), canvas, frame);
    }
    let canvas = b.painted("large picture", textures::picture(2));
    furniture::picture(b, place(0.85, 1.55, MAX.z, 180.0), vec2(0.72, 0.90), canvas, walnut);
}
