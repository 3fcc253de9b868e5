//! The real surfaces of a panorama as a coarse grid of points, with the plane that each lies in.

use super::{
    mapping::{coordinates, panorama_to_world, texel_direction, world_to_panorama},
    source::PanoramaFrame,
};
use glam::{Quat, Vec3};

/// The most columns of the grid.
const COLUMNS: u32 = 256;

/// A grid of directions with what is known in each. Points are relative to the capture point, metres, in the
/// world's axes.
pub struct Cloud {
    /// Columns and rows.
    pub size: [usize; 2],
    pub directions: Vec<Vec3>,
    /// Radial metres; 0 is a hole.
    pub depth: Vec<f32>,
    /// Solid angles, steradians.
    pub weights: Vec<f32>,
    /// How far the panorama is turned, degrees.
    yaw_degrees: f64,
    /// Normals of fitted planes, towards the capture point; zero where there is none.
    pub normals: Vec<Vec3>,
}

impl Cloud {
    /// Samples a frame whose panorama is turned by `yaw_degrees`.
    pub fn of(frame: &PanoramaFrame, yaw_degrees: f32) -> Self {
        Self::of_depth(&frame.depth, frame.depth_size, yaw_degrees)
    }

    /// Samples radial metres, of which 0 is a hole.
    pub fn of_depth(radial: &[f32], radial_size: [u32; 2], yaw_degrees: f32) -> Self {
        let columns = radial_size[0].clamp(1, COLUMNS);
        let size = [columns, (columns / 2).clamp(1, radial_size[1])];
        let cells = || (0..size[1]).flat_map(|row| (0..size[0]).map(move |column| (column, row)));
        let solid = std::f32::consts::TAU * std::f32::consts::PI / (size[0] * size[1]) as f32;
        let place = |cell: u32, axis: usize| {
            (u64::from(2 * cell + 1) * u64::from(radial_size[axis]) / u64::from(2 * size[axis])) as usize
        };
        let depth: Vec<f32> =
            cells().map(|(x, y)| radial[place(y, 1) * radial_size[0] as usize + place(x, 0)]).collect();
        let polar = |row: u32| (std::f32::consts::PI * (row as f32 + 0.5) / size[1] as f32).sin();
        let mut cloud = Self {
            size: size.map(|side| side as usize),
            directions: cells()
                .map(|(x, y)| panorama_to_world(texel_direction(x, y, size), f64::from(yaw_degrees)).as_vec3())
                .collect(),
            depth,
            weights: cells().map(|(_, y)| solid * polar(y)).collect(),
            yaw_degrees: f64::from(yaw_degrees),
            normals: Vec::new(),
        };
        cloud.normals = (0..cloud.depth.len()).map(|index| cloud.normal(index)).collect();
        cloud
    }

    /// Returns the same surfaces, turned. Cells are no longer where the directions are.
    pub fn turned(mut self, rotation: Quat) -> Self {
        for vector in self.directions.iter_mut().chain(&mut self.normals) {
            *vector = rotation * *vector;
        }
        self
    }

    /// Returns the cell that a direction from the capture point meets.
    pub fn cell(&self, direction: Vec3) -> usize {
        let uv = coordinates(world_to_panorama(direction.as_dvec3(), self.yaw_degrees));
        let [column, row] = [0, 1].map(|axis| (uv[axis] * self.size[axis] as f64) as usize);
        row.min(self.size[1] - 1) * self.size[0] + column % self.size[0]
    }

    /// Returns a point; `None` in a hole.
    pub fn point(&self, index: usize) -> Option<Vec3> {
        (self.depth[index] > 0.0).then(|| self.directions[index] * self.depth[index])
    }

    /// Returns the cells of a window of (2·radius + 1)² around a cell. Columns wrap; rows end.
    pub fn window(&self, index: usize, radius: usize) -> impl Iterator<Item = usize> + use<> {
        let [width, height] = self.size;
        let (row, column) = (index / width, index % width);
        let rows = row.saturating_sub(radius)..(row + radius + 1).min(height);
        rows.flat_map(move |y| {
            (0..=2 * radius).map(move |k| y * width + (column + width + k - radius.min(width)) % width)
        })
    }

    /// A plane n·p = c is n/c · d = 1/r in each direction d, which is linear.
    fn normal(&self, index: usize) -> Vec3 {
        if self.depth[index] <= 0.0 {
            return Vec3::ZERO;
        }
        let cells = || self.window(index, 2).filter(|cell| self.depth[*cell] > 0.0);
        let near = cells().filter(|cell| {
            let ratio = self.depth[*cell] / self.depth[index];
            (0.7..1.43).contains(&ratio)
        });
        let near: Vec<usize> = near.collect();
        if near.len() < 12 {
            return Vec3::ZERO;
        }
        let inverse = |cell: &usize| 1.0 / self.depth[*cell];
        plane(near.iter().map(|cell| (self.directions[*cell], inverse(cell), 1.0)))
            .map_or(Vec3::ZERO, |m| -m.normalize())
    }

    /// Returns the depth below which a share of the known solid angle lies; `None` if all are holes.
    pub fn percentile(&self, share: f32) -> Option<f32> {
        let mut known: Vec<(f32, f32)> =
            self.depth.iter().zip(&self.weights).filter(|(d, _)| **d > 0.0).map(|(d, w)| (*d, *w)).collect();
        known.sort_by(|a, b| a.0.total_cmp(&b.0));
        let total: f32 = known.iter().map(|(_, weight)| weight).sum();
        let mut sum = 0.0;
        let reached = |(_, weight): &&(f32, f32)| {
            sum += weight;
            sum >= share * total
        };
        known.iter().find(reached).or(known.last()).map(|(depth, _)| *depth)
    }

    /// Returns the share of the sphere that is holes.
    pub fn holes(&self) -> f32 {
        let total: f32 = self.weights.iter().sum();
        let holes: f32 = self.depth.iter().zip(&self.weights).filter(|(d, _)| **d <= 0.0).map(|(_, w)| w).sum();
        (holes / total).abs() // A sum of nothing is −0.
    }
}

/// Fits m with m·d = value over (d, value, weight). The plane's normal is along m, and its distance 1/|m| if
/// the values are 1/metres.
pub fn plane(samples: impl Iterator<Item = (Vec3, f32, f32)>) -> Option<Vec3> {
    let (mut matrix, mut right) = (glam::DMat3::ZERO, glam::DVec3::ZERO);
    for (direction, value, weight) in samples {
        let (d, weight) = (direction.as_dvec3(), f64::from(weight));
        matrix += glam::DMat3::from_cols(d * d.x, d * d.y, d * d.z) * weight;
        right += d * f64::from(value) * weight;
    }
    // A narrow window of directions hardly tells tilt: the least bit of it keeps the inverse finite.
    let trace = matrix.x_axis.x + matrix.y_axis.y + matrix.z_axis.z;
    matrix += glam::DMat3::from_diagonal(glam::DVec3::splat(1e-9 * trace));
    let fitted = (matrix.inverse() * right).as_vec3();
    (fitted.is_finite() && fitted.length() > 1e-9).then_some(fitted)
}
