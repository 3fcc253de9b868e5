//! Small worlds that are known in closed form. One description gives the panorama that a camera at the origin
//! captures, the scene that is rendered, and what the picture should be.
//!
//! Real surfaces are diffuse and send what `paint` says. The lamp is a square that shines on top of that.
//! Virtual things are Lambert surfaces, lamps or mirrors. Boxes may have a pattern. Light is followed as the model does with
//! `relight_levels = 0`: real surfaces send their captured radiance, whoever looks at them. In a world that
//! is `relit`, mirrors show them in their new light.

use super::pattern::Pattern;
use crate::panorama::{
    mapping::{bilinear, coordinates, texel_direction},
    source::PanoramaFrame,
};
use glam::{Vec2, Vec3, vec2};
use rayon::prelude::*;
use std::f32::consts::{PI, TAU};

/// A box that is aligned with the axes, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Block {
    pub low: Vec3,
    pub high: Vec3,
}

impl Block {
    /// Makes a box from its middle and full extents.
    pub fn around(middle: Vec3, size: Vec3) -> Self {
        Self { low: middle - 0.5 * size, high: middle + 0.5 * size }
    }

    /// Returns where a ray enters and leaves the box, if it meets it.
    fn span(&self, origin: Vec3, d: Vec3) -> Option<[f32; 2]> {
        let (a, b) = ((self.low - origin) / d, (self.high - origin) / d);
        let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
        (enter < leave && leave > 0.0).then_some([enter, leave])
    }

    /// Returns the outward normal of the face that a point of the surface is on.
    fn normal(&self, point: Vec3) -> Vec3 {
        let half = 0.5 * (self.high - self.low);
        let at = (point - 0.5 * (self.high + self.low)) / half;
        let axis = at.abs().max_position();
        Vec3::AXES[axis] * at[axis].signum()
    }

    /// Returns where a point is on its face, from 0 to 1.
    fn face(&self, point: Vec3) -> Vec2 {
        let at = (point - self.low) / (self.high - self.low);
        match self.normal(point).abs().max_position() {
            0 => vec2(at.y, at.z),
            1 => vec2(at.x, at.z),
            _ => vec2(at.x, at.y),
        }
    }
}

/// A square lamp in the ceiling.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// Its middle, x and z.
    pub at: Vec2,
    /// Half its side, metres.
    pub half: f32,
    /// Its radiance.
    pub radiance: Vec3,
}

/// The form of a virtual thing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    Ball(f32),
    Box(Vec3),
}

/// A virtual thing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thing {
    pub form: Form,
    /// Its middle.
    pub at: Vec3,
    /// The albedo of its Lambert surface.
    pub albedo: Vec3,
    /// The radiance that it sends by itself.
    pub emission: Vec3,
    /// Whether it is a perfect mirror instead.
    pub mirror: bool,
    /// What is on the faces of a box.
    pub pattern: Pattern,
}

impl Thing {
    /// Makes a grey Lambert ball.
    pub fn ball(radius: f32, albedo: f32, at: Vec3) -> Self {
        let (form, albedo) = (Form::Ball(radius), Vec3::splat(albedo));
        Self { form, at, albedo, emission: Vec3::ZERO, mirror: false, pattern: Pattern::Plain }
    }

    /// Makes a grey Lambert box.
    pub fn block(size: Vec3, albedo: f32, at: Vec3) -> Self {
        Self { form: Form::Box(size), ..Self::ball(0.0, albedo, at) }
    }

    fn meet(&self, origin: Vec3, d: Vec3) -> Option<f32> {
        match self.form {
            Form::Ball(radius) => {
                let from = origin - self.at;
                let b = from.dot(d);
                let root = (b * b - (from.length_squared() - radius * radius)).max(-1.0);
                if root <= 0.0 {
                    return None;
                }
                let (near, far) = (-b - root.sqrt(), -b + root.sqrt());
                if near > 1e-4 { Some(near) } else { (far > 1e-4).then_some(far) }
            }
            Form::Box(size) => {
                let block = Block::around(self.at, size);
                block.span(origin, d)?.into_iter().find(|t| *t > 1e-4)
            }
        }
    }

    fn albedo_at(&self, point: Vec3) -> Vec3 {
        match self.form {
            Form::Box(size) => self.albedo * self.pattern.albedo(Block::around(self.at, size).face(point)),
            Form::Ball(_) => self.albedo,
        }
    }

    fn normal(&self, point: Vec3) -> Vec3 {
        match self.form {
            Form::Ball(_) => (point - self.at).normalize(),
            Form::Box(size) => Block::around(self.at, size).normal(point),
        }
    }
}

/// A camera at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Eye {
    pub at: Vec3,
    pub target: Vec3,
    /// Full vertical angle, degrees.
    pub fov_y: f32,
}

/// What real surfaces send, by place and normal.
pub type SurfaceRadiance = fn(Vec3, Vec3) -> Vec3;

/// A world at one time. The capture point is the origin.
#[derive(Clone, Debug)]
pub struct World {
    /// The room, seen from inside.
    pub room: Block,
    /// Real boxes in it.
    pub furniture: Vec<Block>,
    pub lamp: Option<Lamp>,
    pub paint: SurfaceRadiance,
    pub things: Vec<Thing>,
    pub eye: Eye,
    /// Whether mirrors show real surfaces as the things light and shade them, and not as captured.
    pub relit: bool,
}

/// What a picture should be.
#[derive(Clone, Debug)]
pub struct WorldTruth {
    pub size: [u32; 2],
    /// Radiance, as a picture holds it.
    pub texels: Vec<[f32; 4]>,
    /// What a picture without the virtual things would be.
    pub without: Vec<[f32; 4]>,
    /// The share of each pixel that shows real surfaces.
    pub coverage: Vec<f32>,
    /// The place of the real surface along the pixel's centre.
    pub position: Vec<Vec3>,
}

impl WorldTruth {
    /// Returns the pixels that are less than half real.
    pub fn shows_things(&self) -> Vec<bool> {
        self.coverage.iter().map(|m| *m < 0.5).collect()
    }

    /// Returns the wholly real pixels that the things change by more than this share.
    pub fn changed(&self, share: f32) -> Vec<bool> {
        let sum = |t: &[f32; 4]| t[0] + t[1] + t[2];
        let pairs = self.texels.iter().zip(&self.without).zip(&self.coverage);
        pairs.map(|((a, b), m)| *m == 1.0 && (sum(a) - sum(b)).abs() > share * sum(b)).collect()
    }

    /// Returns both: all pixels that the things make or change.
    pub fn concerned(&self) -> Vec<bool> {
        self.shows_things().iter().zip(self.changed(0.02)).map(|(a, b)| *a || b).collect()
    }
}

#[derive(Clone, Copy)]
struct Hit {
    t: f32,
    normal: Vec3,
    thing: Option<usize>,
}

/// The number of directions of one irradiance, and of points along a side of the lamp.
const DIRECTIONS: u32 = 768;
const LAMP_SIDE: u32 = 12;

impl World {
    fn real_hit(&self, origin: Vec3, d: Vec3) -> Hit {
        let leave = self.room.span(origin, d).map_or(1e4, |[_, leave]| leave);
        let mut hit = Hit { t: leave, normal: -self.room.normal(origin + d * leave), thing: None };
        for block in &self.furniture {
            if let Some([enter, _]) = block.span(origin, d).filter(|[enter, _]| *enter > 1e-4 && *enter < hit.t) {
                hit = Hit { t: enter, normal: block.normal(origin + d * enter), thing: None };
            }
        }
        hit
    }

    fn thing_hit(&self, origin: Vec3, d: Vec3, before: f32) -> Option<Hit> {
        let mut nearest: Option<Hit> = None;
        for (i, thing) in self.things.iter().enumerate() {
            let limit = nearest.map_or(before, |hit| hit.t);
            if let Some(t) = thing.meet(origin, d).filter(|t| *t < limit) {
                let outward = thing.normal(origin + d * t);
                let normal = if outward.dot(d) > 0.0 { -outward } else { outward };
                nearest = Some(Hit { t, normal, thing: Some(i) });
            }
        }
        nearest
    }

    fn on_lamp(&self, point: Vec3) -> Option<Lamp> {
        let height = self.room.high.y;
        self.lamp.filter(|lamp| {
            (point.y - height).abs() < 1e-3 && (vec2(point.x, point.z) - lamp.at).abs().max_element() <= lamp.half
        })
    }

    /// Returns what a real surface sends, the lamp included.
    fn sent(&self, point: Vec3, normal: Vec3) -> Vec3 {
        (self.paint)(point, normal) + self.on_lamp(point).map_or(Vec3::ZERO, |lamp| lamp.radiance)
    }

    /// Returns irradiance without and with the things. Paint is integrated over directions, the lamp over its
    /// area.
    fn irradiance(&self, x: Vec3, normal: Vec3, directions: u32, lamp_side: u32, turn: Vec2, depth: u32) -> [Vec3; 2] {
        let (tangent, other) = normal.any_orthonormal_pair();
        let origin = x + 1e-4 * normal;
        let [mut real, mut mixed] = [Vec3::ZERO; 2];
        for k in 0..directions {
            let u = r2(k, turn);
            let (sin, cos) = (TAU * u.y).sin_cos();
            let up = (1.0 - u.x).sqrt();
            let d = (u.x.sqrt() * (tangent * cos + other * sin) + normal * up).normalize();
            let hit = self.real_hit(origin, d);
            let point = origin + d * hit.t;
            let sent = (self.paint)(point, hit.normal);
            real += sent;
            mixed += match self.thing_hit(origin, d, hit.t) {
                Some(thing) => self.thing_radiance(&thing, origin, d, u, depth),
                None => sent,
            };
        }
        let scale = PI / directions as f32;
        let (mut real, mut mixed) = (real * scale, mixed * scale);
        let Some(lamp) = self.lamp else { return [real, mixed] };
        let weight = 4.0 * lamp.half * lamp.half / (lamp_side * lamp_side) as f32;
        for k in 0..lamp_side * lamp_side {
            let cell = vec2((k % lamp_side) as f32, (k / lamp_side) as f32) + turn;
            let at = lamp.at + lamp.half * (2.0 * cell / lamp_side as f32 - 1.0);
            let to = Vec3::new(at.x, self.room.high.y, at.y) - origin;
            let distance = to.length();
            let d = to / distance;
            let cosines = d.dot(normal) * d.y;
            if d.dot(normal) <= 0.0 || d.y <= 0.0 || self.real_hit(origin, d).t < distance * (1.0 - 1e-4) {
                continue;
            }
            let light = lamp.radiance * (cosines * weight / (distance * distance));
            real += light;
            if self.thing_hit(origin, d, distance).is_none() {
                mixed += light;
            }
        }
        [real, mixed]
    }

    fn thing_radiance(&self, hit: &Hit, origin: Vec3, d: Vec3, turn: Vec2, depth: u32) -> Vec3 {
        let Some(thing) = hit.thing.map(|i| self.things[i]) else { return Vec3::ZERO };
        let point = origin + d * hit.t;
        if thing.mirror {
            let away = d - 2.0 * d.dot(hit.normal) * hit.normal;
            return if depth == 0 {
                Vec3::ZERO
            } else {
                self.radiance(point + 1e-4 * hit.normal, away, turn, depth - 1)
            };
        }
        if thing.albedo == Vec3::ZERO || depth == 0 {
            return thing.emission;
        }
        let (directions, side) = if depth > 1 { (DIRECTIONS, LAMP_SIDE) } else { (24, 2) };
        let [_, mixed] = self.irradiance(point, hit.normal, directions, side, turn, depth - 1);
        thing.emission + thing.albedo_at(point) * mixed / PI
    }

    fn radiance(&self, origin: Vec3, d: Vec3, turn: Vec2, depth: u32) -> Vec3 {
        let real = self.real_hit(origin, d);
        match self.thing_hit(origin, d, real.t) {
            Some(hit) => self.thing_radiance(&hit, origin, d, turn, depth),
            None if self.relit && depth > 0 => {
                let point = origin + d * real.t;
                let painted = (self.paint)(point, real.normal);
                self.sent(point, real.normal) + self.relight(point, real.normal, painted, turn)
            }
            None => self.sent(origin + d * real.t, real.normal),
        }
    }

    /// Returns what the things add to a real surface's own radiance `painted`. Its reflectance is at most
    /// 1/π, as in the paper.
    fn relight(&self, point: Vec3, normal: Vec3, painted: Vec3, turn: Vec2) -> Vec3 {
        let [before, after] = self.irradiance(point, normal, DIRECTIONS, LAMP_SIDE, turn, 1);
        (after - before) * (painted / before.max(Vec3::splat(1e-20))).min(Vec3::splat(1.0 / PI))
    }

    /// Returns the panorama that a camera at the origin takes, without the things. Radiance is the mean of
    /// 4×4 rays a texel, depth that of the ray through its centre. `yaw_degrees` turns the panorama, not the
    /// world.
    pub fn capture(&self, size: [u32; 2], yaw_degrees: f32) -> PanoramaFrame {
        let turn = glam::Quat::from_rotation_y(yaw_degrees.to_radians());
        const SIDE: u32 = 4;
        let fine = size.map(|n| n * SIDE);
        let ray = |x: u32, y: u32, size| turn * texel_direction(x, y, size).as_vec3();
        let texel = |i: u32| {
            let (x, y) = (i % size[0], i / size[0]);
            let mut sum = Vec3::ZERO;
            for k in 0..SIDE * SIDE {
                let d = ray(x * SIDE + k % SIDE, y * SIDE + k / SIDE, fine);
                let hit = self.real_hit(Vec3::ZERO, d);
                sum += (self.paint)(d * hit.t, hit.normal);
            }
            let depth = self.real_hit(Vec3::ZERO, ray(x, y, size)).t;
            ((sum / (SIDE * SIDE) as f32).extend(1.0).to_array(), depth)
        };
        let (mut radiance, depth): (Vec<[f32; 4]>, Vec<f32>) =
            (0..size[0] * size[1]).into_par_iter().map(texel).unzip();
        self.shine_on(&mut radiance, size, -yaw_degrees);
        PanoramaFrame {
            color_size: size,
            radiance: radiance.into(),
            depth_size: size,
            depth,
            ..PanoramaFrame::default()
        }
    }

    /// Adds the lamp to a captured panorama: all of its light, however small it is in texels.
    fn shine_on(&self, radiance: &mut [[f32; 4]], size: [u32; 2], unturn_degrees: f32) {
        const SIDE: u32 = 256;
        let Some(lamp) = self.lamp else { return };
        let unturn = glam::Quat::from_rotation_y(unturn_degrees.to_radians());
        let area = (2.0 * lamp.half / SIDE as f32).powi(2);
        for k in 0..SIDE * SIDE {
            let at =
                lamp.at + lamp.half * (2.0 * (vec2((k % SIDE) as f32, (k / SIDE) as f32) + 0.5) / SIDE as f32 - 1.0);
            let point = Vec3::new(at.x, self.room.high.y, at.y);
            let distance = point.length();
            if self.real_hit(Vec3::ZERO, point / distance).t < distance * (1.0 - 1e-4) {
                continue;
            }
            let solid_angle = area * point.y / distance.powi(3);
            let uv = coordinates((unturn * point).as_dvec3()).as_vec2();
            let (x, y) = ((uv.x * size[0] as f32) as u32 % size[0], ((uv.y * size[1] as f32) as u32).min(size[1] - 1));
            let row = |j: u32| (PI * j as f32 / size[1] as f32).cos();
            let texel = TAU / size[0] as f32 * (row(y) - row(y + 1));
            let sent = lamp.radiance * (solid_angle / texel);
            let [r, g, b, _] = &mut radiance[(y * size[0] + x) as usize];
            (*r, *g, *b) = (*r + sent.x, *g + sent.y, *b + sent.z);
        }
    }

    /// Returns what the picture should be. The camera sees real surfaces as `panorama` has them, bilinear, so
    /// that its resolution is not counted as an error. How they change follows from the world.
    pub fn truth(&self, size: [u32; 2], panorama: &PanoramaFrame, yaw_degrees: f32) -> WorldTruth {
        let unturn = glam::Quat::from_rotation_y(-yaw_degrees.to_radians());
        let camera = crate::scene::camera::CameraTrack {
            aim: crate::scene::camera::Aim::LookAt(crate::scene::animation::Track::constant(self.eye.target)),
            ..crate::scene::camera::CameraTrack::at_point(self.eye.at)
        };
        let rotation = camera.at(0.0).rotation;
        let tan = (0.5 * self.eye.fov_y.to_radians()).tan();
        let aspect = size[0] as f32 / size[1] as f32;
        let ray = |pixel: Vec2| {
            let ndc = pixel / vec2(size[0] as f32, size[1] as f32) * 2.0 - 1.0;
            (rotation * Vec3::new(ndc.x * tan * aspect, -ndc.y * tan, -1.0)).normalize()
        };
        let eye = self.eye.at;
        let patterned = self.things.iter().any(|thing| thing.pattern != Pattern::Plain);
        let samples = if patterned { 256 } else { 16 };
        let pixel = |i: u32| {
            let at = vec2((i % size[0]) as f32, (i / size[0]) as f32);
            let turn = vec2(hash(i), hash(i ^ 0x9e37_79b9));
            let d = ray(at + 0.5);
            let real = self.real_hit(eye, d);
            let point = eye + d * real.t;
            let captured = bilinear(panorama, (unturn * point).normalize());
            // The real and virtual points nearest to the pixel's centre stand for all that the pixel shows of
            // either kind. What mirrors show differs from point to point: that is the mean.
            let (mut share, mut nearest, mut shown, mut lit) = (0.0, [f32::INFINITY; 2], None, (real, point));
            let mut mirrors = (Vec3::ZERO, 0.0);
            let mut albedos = (Vec3::ZERO, 0.0);
            for k in 0..samples {
                let offset = r2(k, Vec2::splat(0.5));
                let (d, off_centre) = (ray(at + offset), (offset - 0.5).length_squared());
                let behind = self.real_hit(eye, d);
                match self.thing_hit(eye, d, behind.t) {
                    None => {
                        share += 1.0 / samples as f32;
                        if off_centre < nearest[0] {
                            (nearest[0], lit) = (off_centre, (behind, eye + d * behind.t));
                        }
                    }
                    Some(hit) => {
                        if patterned && let Some(i) = hit.thing {
                            albedos.0 += self.things[i].albedo_at(eye + d * hit.t);
                            albedos.1 += 1.0;
                        }
                        if hit.thing.is_some_and(|i| self.things[i].mirror) {
                            mirrors.0 += self.thing_radiance(&hit, eye, d, turn, 2);
                            mirrors.1 += 1.0;
                        }
                        if off_centre < nearest[1] {
                            (nearest[1], shown) = (off_centre, Some((hit, d)));
                        }
                    }
                }
            }
            let mut radiance = Vec3::ZERO;
            if share > 0.0 {
                radiance += share * (captured + self.relight(lit.1, lit.0.normal, captured, turn)).max(Vec3::ZERO);
            }
            if let Some((hit, d)) = shown {
                let is_mirror = hit.thing.is_some_and(|i| self.things[i].mirror);
                let seen = if is_mirror { mirrors.0 / mirrors.1 } else { self.thing_radiance(&hit, eye, d, turn, 2) };
                // Of a pattern the pixel shows the mean.
                let seen = match hit.thing.map(|i| self.things[i].albedo_at(eye + d * hit.t)) {
                    Some(here) if patterned && here.min_element() > 0.0 => seen / here * (albedos.0 / albedos.1),
                    _ => seen,
                };
                radiance += (1.0 - share) * seen;
            }
            (radiance.extend(1.0).to_array(), captured.extend(1.0).to_array(), share, point)
        };
        let all: Vec<_> = (0..size[0] * size[1]).into_par_iter().map(pixel).collect();
        WorldTruth {
            size,
            texels: all.iter().map(|p| p.0).collect(),
            without: all.iter().map(|p| p.1).collect(),
            coverage: all.iter().map(|p| p.2).collect(),
            position: all.iter().map(|p| p.3).collect(),
        }
    }
}

/// The R2 sequence (Roberts 2018), turned.
fn r2(k: u32, turn: Vec2) -> Vec2 {
    (turn + k as f32 * vec2(0.754_877_7, 0.569_840_3)).fract()
}

fn hash(x: u32) -> f32 {
    let mut x = x.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    x = ((x >> ((x >> 28) + 4)) ^ x).wrapping_mul(277_803_737);
    ((x >> 22) ^ x) as f32 / u32::MAX as f32
}
