//! The modelling kit of the built-in rooms: closed shapes with outward normals and texture coordinates in
//! metres, and the builder that collects them into one mesh. The same call gives the same bits.

use crate::scene::material::{Material, Slot, Texture};
use crate::scene::model::{Mesh, Model};
use glam::{Affine3A, Mat3, Vec2, Vec3, vec2, vec3};
use std::{
    collections::HashMap,
    f32::consts::{FRAC_PI_4, TAU},
    sync::Arc,
};

/// Returns an integer hash of three coordinates, uniform in 0..1.
pub fn hash(x: i32, y: i32, seed: u32) -> f32 {
    let mut h =
        (x as u32).wrapping_mul(0x9E37_79B1) ^ (y as u32).wrapping_mul(0x85EB_CA77) ^ seed.wrapping_mul(0xC2B2_AE3D);
    h = (h ^ (h >> 15)).wrapping_mul(0x2C1B_3C6D);
    h = (h ^ (h >> 12)).wrapping_mul(0x297A_2D39);
    h ^= h >> 15;
    (h >> 8) as f32 / (1 << 24) as f32
}

/// A closed shape without a material.
#[derive(Clone, Debug, Default)]
pub struct Solid {
    /// Metres.
    pub positions: Vec<Vec3>,
    /// Unit length, outward.
    pub normals: Vec<Vec3>,
    /// Metres along the surface.
    pub uvs: Vec<Vec2>,
    /// Counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Solid {
    fn vertex(&mut self, position: Vec3, normal: Vec3, uv: Vec2) -> u32 {
        self.positions.push(position);
        self.normals.push(normal);
        self.uvs.push(uv);
        self.positions.len() as u32 - 1
    }

    /// Adds a triangle, unless two of its corners coincide.
    fn triangle(&mut self, a: u32, b: u32, c: u32) {
        let [p, q, r] = [a, b, c].map(|i| self.positions[i as usize]);
        if (q - p).cross(r - p).length_squared() > 1e-18 {
            self.triangles.push([a, b, c]);
        }
    }

    /// Adds two triangles. Corners are counter-clockwise.
    fn quad(&mut self, a: u32, b: u32, c: u32, d: u32) {
        self.triangle(a, b, c);
        self.triangle(a, c, d);
    }

    /// Moves the shape.
    pub fn placed(mut self, at: Affine3A) -> Self {
        let normal_matrix = Mat3::from(at.matrix3).inverse().transpose();
        self.positions.iter_mut().for_each(|p| *p = at.transform_point3(*p));
        self.normals.iter_mut().for_each(|n| *n = (normal_matrix * *n).normalize_or_zero());
        self
    }

    /// Multiplies texture coordinates by `factor` (one over the texture's size in metres).
    pub fn uv_scaled(mut self, factor: Vec2) -> Self {
        self.uvs.iter_mut().for_each(|uv| *uv *= factor);
        self
    }

    /// Joins both shapes.
    pub fn and(mut self, other: Solid) -> Self {
        let first = self.positions.len() as u32;
        self.positions.extend(other.positions);
        self.normals.extend(other.normals);
        self.uvs.extend(other.uvs);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|i| i + first)));
        self
    }

    /// Averages normals over all vertices at the same place, weighted by area.
    fn smoothed(mut self) -> Self {
        let key = |p: Vec3| (p * 1e5).round().as_ivec3();
        let mut sums: HashMap<_, Vec3> = HashMap::new();
        for t in &self.triangles {
            let [a, b, c] = t.map(|i| self.positions[i as usize]);
            for p in [a, b, c] {
                *sums.entry(key(p)).or_default() += (b - a).cross(c - a);
            }
        }
        for (position, normal) in self.positions.iter().zip(&mut self.normals) {
            *normal = sums.get(&key(*position)).copied().unwrap_or(*normal).normalize_or(*normal);
        }
        self
    }
}

/// A rectangle from `corner` along `u` and `v`, facing `u × v`.
pub fn quad(corner: Vec3, u: Vec3, v: Vec3) -> Solid {
    let mut part = Solid::default();
    let normal = u.cross(v).normalize();
    let (w, h) = (u.length(), v.length());
    let a = part.vertex(corner, normal, vec2(0.0, h));
    let b = part.vertex(corner + u, normal, vec2(w, h));
    let c = part.vertex(corner + u + v, normal, vec2(w, 0.0));
    let d = part.vertex(corner + v, normal, vec2(0.0, 0.0));
    part.quad(a, b, c, d);
    part
}

/// An axis-aligned box with sharp edges.
pub fn block(min: Vec3, max: Vec3) -> Solid {
    let s = max - min;
    let (x, y, z) = (s * Vec3::X, s * Vec3::Y, s * Vec3::Z);
    [
        quad(min + z, x, y),
        quad(min + x, -x, y),
        quad(min + x + z, -z, y),
        quad(min, z, y),
        quad(min + y + z, x, -z),
        quad(min, x, z),
    ]
    .into_iter()
    .fold(Solid::default(), Solid::and)
}

/// A box about the origin with edges rounded by `radius` in `arc` steps. If `puff` is above 0, its faces are
/// cut in `inner`² pieces and bulge by that much like a cushion's.
pub fn rounded_block(size: Vec3, radius: f32, arc: usize, inner: usize, puff: f32) -> Solid {
    let half = size * 0.5;
    let core = half - Vec3::splat(radius);
    // Positions along one axis of a face: the place on the core, and the tangent of the angle at which the
    // edge bends.
    let steps = |h: f32| -> Vec<(f32, f32)> {
        let bend = |i: usize| (FRAC_PI_4 * i as f32 / arc as f32).tan();
        let mut out: Vec<_> = (1..=arc).rev().map(|i| (-h, -bend(i))).collect();
        out.extend((0..=inner).map(|i| (h * (2.0 * i as f32 / inner as f32 - 1.0), 0.0)));
        out.extend((1..=arc).map(|i| (h, bend(i))));
        out
    };
    let mut part = Solid::default();
    for axis in 0..3 {
        for sign in [-1.0f32, 1.0] {
            let (a, b) = if sign > 0.0 { ((axis + 1) % 3, (axis + 2) % 3) } else { ((axis + 2) % 3, (axis + 1) % 3) };
            let (columns, rows) = (steps(core[a]), steps(core[b]));
            let puff = puff * core[a].min(core[b]) / core.max_element(); // Narrow sides stay nearly flat.
            let first = part.positions.len() as u32;
            for &(pb, tb) in &rows {
                for &(pa, ta) in &columns {
                    let (mut normal, mut position) = (Vec3::ZERO, Vec3::ZERO);
                    (normal[a], normal[b], normal[axis]) = (ta, tb, sign);
                    normal = normal.normalize();
                    (position[a], position[b], position[axis]) = (pa, pb, core[axis] * sign);
                    position += normal * radius;
                    position[axis] += sign * puff * (1.0 - (pa / core[a]).powi(2)) * (1.0 - (pb / core[b]).powi(2));
                    part.vertex(position, normal, vec2(position[a], position[b]));
                }
            }
            let n = columns.len() as u32;
            for j in 0..rows.len() as u32 - 1 {
                for i in 0..n - 1 {
                    let k = first + j * n + i;
                    part.quad(k, k + 1, k + n + 1, k + n);
                }
            }
        }
    }
    if puff > 0.0 { part.smoothed() } else { part }
}

/// A body of revolution about +Y from a profile of (radius, height). The profile runs from the axis at the
/// bottom outwards and up, and down inside again for a vessel. Bends above 35° stay sharp. Texture
/// coordinates are the turn, 0..1, and the share of the profile's length from its end.
pub fn lathe(profile: &[Vec2], segments: u32) -> Solid {
    let tangents: Vec<Vec2> = profile.windows(2).map(|w| (w[1] - w[0]).normalize()).collect();
    let outward = |t: Vec2| vec2(t.y, -t.x);
    let joint = |own: usize, other: Option<&Vec2>| match other {
        Some(&t) if t.dot(tangents[own]) > 0.82 => outward((t + tangents[own]).normalize()),
        _ => outward(tangents[own]),
    };
    let length: f32 = profile.windows(2).map(|w| w[0].distance(w[1])).sum();
    let mut part = Solid::default();
    let mut along = 0.0;
    for (k, w) in profile.windows(2).enumerate() {
        let normals = [joint(k, k.checked_sub(1).and_then(|i| tangents.get(i))), joint(k, tangents.get(k + 1))];
        let v = [1.0 - along / length, 1.0 - (along + w[0].distance(w[1])) / length];
        along += w[0].distance(w[1]);
        let first = part.positions.len() as u32;
        for i in 0..=segments {
            let turn = i as f32 / segments as f32;
            // The seam's two ends are the same bits.
            let (sin, cos) = if i == segments { (0.0, 1.0) } else { (turn * TAU).sin_cos() };
            for end in 0..2 {
                let (p, n) = (w[end], normals[end]);
                part.vertex(vec3(p.x * sin, p.y, p.x * cos), vec3(n.x * sin, n.y, n.x * cos), vec2(turn, v[end]));
            }
        }
        for i in 0..segments {
            let k = first + 2 * i;
            part.quad(k, k + 2, k + 3, k + 1);
        }
    }
    part
}

/// A sphere about the origin. Texture coordinates 0..1 are a globe's map.
pub fn sphere(radius: f32, segments: u32) -> Solid {
    let rings = segments / 2;
    let profile: Vec<Vec2> = (0..=rings)
        .map(|i| {
            let angle = std::f32::consts::PI * i as f32 / rings as f32;
            vec2(if i == 0 || i == rings { 0.0 } else { angle.sin() }, -angle.cos()) * radius
        })
        .collect();
    lathe(&profile, segments)
}

/// An upright cylinder with its base at the origin.
pub fn cylinder(radius: f32, height: f32, segments: u32) -> Solid {
    lathe(&[vec2(0.0, 0.0), vec2(radius, 0.0), vec2(radius, height), vec2(0.0, height)], segments)
}

/// A round bar along `path` with flat ends. Its radius is given per point.
pub fn tube(path: &[Vec3], radii: &[f32], segments: u32) -> Solid {
    let last = path.len() - 1;
    let tangent = |i: usize| (path[(i + 1).min(last)] - path[i.saturating_sub(1)]).normalize();
    let mut side = tangent(0).any_orthonormal_vector();
    let mut part = Solid::default();
    let mut along = 0.0;
    let mut caps = [(0, Vec3::ZERO), (0, Vec3::ZERO)];
    for i in 0..=last {
        let t = tangent(i);
        side = (side - t * side.dot(t)).normalize();
        let up = t.cross(side);
        if i > 0 {
            along += path[i].distance(path[i - 1]);
        }
        if i == 0 || i == last {
            caps[(i == last) as usize] = (part.positions.len() as u32, if i == 0 { -t } else { t });
        }
        for k in 0..=segments {
            let turn = k as f32 / segments as f32;
            let (sin, cos) = if k == segments { (0.0, 1.0) } else { (turn * TAU).sin_cos() };
            let normal = side * cos + up * sin;
            part.vertex(path[i] + normal * radii[i], normal, vec2(turn * TAU * radii[i], along));
        }
        if i > 0 {
            let row = segments + 1;
            let first = part.positions.len() as u32 - 2 * row;
            for k in first..first + segments {
                part.quad(k, k + 1, k + 1 + row, k + row);
            }
        }
    }
    for (end, (ring, normal)) in caps.into_iter().enumerate() {
        let centre = part.vertex(path[end * last], normal, Vec2::ZERO);
        let first = part.positions.len() as u32;
        for k in 0..=segments {
            part.vertex(part.positions[(ring + k) as usize], normal, Vec2::ZERO);
        }
        for k in first..first + segments {
            if end == 0 { part.triangle(centre, k + 1, k) } else { part.triangle(centre, k, k + 1) }
        }
    }
    part
}

/// A leaf from the origin along +Z that bends down by `droop` metres at its tip. It is closed and 2 mm thick.
pub fn leaf(length: f32, width: f32, rise: f32, droop: f32) -> Solid {
    const PIECES: usize = 7;
    let mut part = Solid::default();
    let at = |i: usize| {
        let t = i as f32 / PIECES as f32;
        let half = width * 0.5 * (std::f32::consts::PI * t.powf(0.75)).sin().max(0.0);
        (vec3(0.0, rise * t - droop * t * t, length * t * (1.0 - 0.15 * t)), if i == PIECES { 0.0 } else { half })
    };
    for i in 0..PIECES {
        let ((p, w), (q, x)) = (at(i), at(i + 1));
        let edge = |p: Vec3, w: f32| p + vec3(w, w.abs() * 0.25, 0.0);
        let thick = |i: usize| if i == 0 || i == PIECES { Vec3::ZERO } else { Vec3::Y * 0.001 };
        let uv = vec2(i as f32 / PIECES as f32, 0.5);
        for up in [1.0f32, -1.0] {
            let (r, s) = (p + thick(i) * up, q + thick(i + 1) * up);
            for (a, b, c, d) in [(edge(p, -w), edge(q, -x), s, r), (r, s, edge(q, x), edge(p, w))] {
                let normal = (c - a).cross(d - b).normalize_or(Vec3::Y) * up;
                let k = [a, b, c, d].map(|p| part.vertex(p, normal, uv));
                if up > 0.0 { part.quad(k[0], k[1], k[2], k[3]) } else { part.quad(k[3], k[2], k[1], k[0]) }
            }
        }
    }
    part
}

/// A hanging cloth, `width` along X and `height` down to the origin's level, with folds of depth `fold` in Z.
pub fn curtain(width: f32, height: f32, folds: u32, fold: f32) -> Solid {
    let count = folds * 10;
    let half_thickness = 0.0015;
    let points: Vec<Vec2> = (0..=count)
        .map(|i| {
            let t = i as f32 / count as f32;
            let phase = t * folds as f32 * TAU + 0.7 * (t * 9.0).sin();
            vec2((t - 0.5) * width, fold * phase.sin() * (0.8 + 0.2 * (t * 17.0).sin()))
        })
        .collect();
    let last = points.len() - 1;
    let normals: Vec<Vec2> = (0..=last)
        .map(|i| {
            let t = (points[(i + 1).min(last)] - points[i.saturating_sub(1)]).normalize();
            vec2(-t.y, t.x) // This points towards +Z for a cloth that runs along +X.
        })
        .collect();
    let mut part = Solid::default();
    let place = |p: Vec2, y: f32| vec3(p.x, y, p.y);
    let side = |i: usize, s: f32| points[i] + normals[i] * half_thickness * s;
    let mut along = 0.0;
    for i in 0..last {
        let next = along + points[i].distance(points[i + 1]);
        for s in [1.0f32, -1.0] {
            let k =
                [(i, 0.0, along), (i + 1, 0.0, next), (i + 1, height, next), (i, height, along)].map(|(j, y, u)| {
                    part.vertex(place(side(j, s), y), vec3(normals[j].x, 0.0, normals[j].y) * s, vec2(u, y))
                });
            if s > 0.0 { part.quad(k[0], k[1], k[2], k[3]) } else { part.quad(k[3], k[2], k[1], k[0]) }
        }
        for (y, up) in [(height, true), (0.0, false)] {
            let k = [side(i, 1.0), side(i + 1, 1.0), side(i + 1, -1.0), side(i, -1.0)]
                .map(|p| part.vertex(place(p, y), if up { Vec3::Y } else { Vec3::NEG_Y }, Vec2::ZERO));
            if up { part.quad(k[0], k[1], k[2], k[3]) } else { part.quad(k[3], k[2], k[1], k[0]) }
        }
        along = next;
    }
    for (i, direction) in [(0, Vec3::NEG_X), (last, Vec3::X)] {
        let s = if i == 0 { -1.0 } else { 1.0 };
        let k = [(s, 0.0), (-s, 0.0), (-s, height), (s, height)]
            .map(|(s, y)| part.vertex(place(side(i, s), y), direction, Vec2::ZERO));
        part.quad(k[0], k[1], k[2], k[3]);
    }
    part
}

/// Makes a purely diffuse material.
pub fn lambert(name: &str, base_color: Vec3) -> Material {
    Material { specular: 0.0, ..Material::plain(name, base_color, 1.0) }
}

/// Collects parts, materials and textures into one mesh.
#[derive(Clone, Debug, Default)]
pub struct Builder {
    mesh: Mesh,
    materials: Vec<Material>,
    textures: Vec<Arc<Texture>>,
}

impl Builder {
    /// Adds a material and returns its index.
    pub fn material(&mut self, material: Material) -> u32 {
        self.materials.push(material);
        self.materials.len() as u32 - 1
    }

    /// Adds pure Lambert of one linear colour.
    pub fn paint(&mut self, name: &str, color: [f32; 3]) -> u32 {
        self.material(lambert(name, color.into()))
    }

    /// Adds `material` coloured by a texture.
    pub fn textured(&mut self, material: Material, texture: Texture) -> u32 {
        let place = self.textures.len();
        self.textures.push(Arc::new(Texture { name: material.name.clone(), ..texture }));
        self.material(Material { base_color: Vec3::ONE, ..material }.with_texture(Slot::BaseColor, place))
    }

    /// Adds pure Lambert coloured by a texture.
    pub fn painted(&mut self, name: &str, texture: Texture) -> u32 {
        self.textured(lambert(name, Vec3::ONE), texture)
    }

    /// Adds a light of the given radiance that reflects nothing.
    pub fn light(&mut self, name: &str, radiance: [f32; 3]) -> u32 {
        self.material(Material { emissive: radiance.into(), ..lambert(name, Vec3::ZERO) })
    }

    /// Adds a part.
    pub fn add(&mut self, part: Solid, at: Affine3A, material: u32) {
        let part = part.placed(at);
        let first = self.mesh.positions.len() as u32;
        self.mesh.positions.extend(part.positions);
        self.mesh.normals.extend(part.normals);
        self.mesh.uvs.extend(part.uvs);
        self.mesh.materials.extend(part.triangles.iter().map(|_| material));
        self.mesh.triangles.extend(part.triangles.iter().map(|t| t.map(|i| i + first)));
    }

    /// Returns the finished model.
    pub fn model(self, name: &str) -> Model {
        let mesh = Mesh { name: name.into(), ..self.mesh };
        let mut model = Model::from_mesh(mesh, Material::default());
        (model.materials, model.textures) = (self.materials, self.textures);
        model
    }
}
