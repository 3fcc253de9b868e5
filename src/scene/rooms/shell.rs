//! The shell that a room stands in: floor, ceiling, walls, skirting, cornice, and an opening for a window.

use super::kit::{Builder, Solid, block, quad};
use glam::{Affine3A, Vec2, Vec3, vec3};

/// A window's opening in the wall of least x.
#[derive(Clone, Copy, Debug)]
pub struct Opening {
    /// Least z and y, metres.
    pub low: Vec2,
    /// Greatest z and y.
    pub high: Vec2,
    /// The depth from the wall's inside to the pane.
    pub depth: f32,
}

/// A box room seen from inside. Materials are given by index.
#[derive(Clone, Copy, Debug)]
pub struct Shell {
    pub min: Vec3,
    pub max: Vec3,
    pub floor: u32,
    pub ceiling: u32,
    /// The walls at least z, greatest z, greatest x and least x.
    pub walls: [u32; 4],
    pub trim: u32,
    /// The window in the wall of least x.
    pub window: Option<Opening>,
}

impl Shell {
    /// Adds the shell. Texture coordinates of floor and walls are metres times these.
    pub fn build(&self, b: &mut Builder, floor_uv: Vec2, wall_uv: Vec2) {
        let (min, max) = (self.min, self.max);
        let size = max - min;
        let (x, y, z) = (size * Vec3::X, size * Vec3::Y, size * Vec3::Z);
        let mut add = |part: Solid, uv: Vec2, material: u32| b.add(part.uv_scaled(uv), Affine3A::IDENTITY, material);
        add(quad(min + z, x, -z), floor_uv, self.floor);
        add(quad(min + y, x, z), Vec2::ONE, self.ceiling);
        add(quad(min, x, y), wall_uv, self.walls[0]);
        add(quad(min + x + z, -x, y), wall_uv, self.walls[1]);
        add(quad(min + x, z, y), wall_uv, self.walls[2]);
        match self.window {
            None => add(quad(min + z, -z, y), wall_uv, self.walls[3]),
            // A 3 × 3 grid without its middle, so that no edge ends within another.
            Some(Opening { low, high, .. }) => {
                let (zs, ys) = ([min.z, low.x, high.x, max.z], [min.y, low.y, high.y, max.y]);
                for (i, j) in (0..9).map(|k| (k / 3, k % 3)).filter(|cell| *cell != (1, 1)) {
                    let part = quad(
                        vec3(min.x, ys[j], zs[i + 1]),
                        Vec3::NEG_Z * (zs[i + 1] - zs[i]),
                        Vec3::Y * (ys[j + 1] - ys[j]),
                    );
                    add(part, wall_uv, self.walls[3]);
                }
            }
        }
        add(self.around(-0.005, 0.085, 0.014), Vec2::ONE, self.trim);
        add(self.around(max.y - 0.08, max.y + 0.005, 0.05), Vec2::ONE, self.trim);
    }

    /// Adds a band along all four walls from `y0` to `y1`, `t` thick.
    fn around(&self, y0: f32, y1: f32, t: f32) -> Solid {
        let (min, max, sink) = (self.min, self.max, 0.005);
        [
            block(vec3(min.x - sink, y0, min.z - sink), vec3(max.x + sink, y1, min.z + t)),
            block(vec3(min.x - sink, y0, max.z - t), vec3(max.x + sink, y1, max.z + sink)),
            block(vec3(min.x - sink, y0, min.z + t), vec3(min.x + t, y1, max.z - t)),
            block(vec3(max.x - t, y0, min.z + t), vec3(max.x + sink, y1, max.z - t)),
        ]
        .into_iter()
        .fold(Solid::default(), Solid::and)
    }
}

impl Opening {
    /// Adds the opening's four sides in the wall x = `wall`, and outside it `bands` of light from the bottom
    /// up. Each band has the height at which it ends, as a share, and its material.
    pub fn reveal(&self, b: &mut Builder, wall: f32, paint: u32, bands: &[(f32, u32)]) {
        let (w, h) = (Vec3::Z * (self.high.x - self.low.x), Vec3::Y * (self.high.y - self.low.y));
        let inward = Vec3::X * self.depth;
        let corner = vec3(wall - self.depth, self.low.y, self.low.x);
        let sides = [
            quad(corner + w, inward, -w),          // bottom, facing up
            quad(corner + h, inward, w),           // top, facing down
            quad(corner, inward, h),               // z low, facing +z
            quad(corner + w + inward, -inward, h), // z high
        ];
        for side in sides {
            b.add(side, Affine3A::IDENTITY, paint);
        }
        let mut from = 0.0;
        for &(share, light) in bands {
            b.add(quad(corner + w + h * from, -w, h * (share - from)), Affine3A::IDENTITY, light);
            from = share;
        }
    }
}
