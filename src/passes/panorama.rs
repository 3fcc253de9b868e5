//! The panorama on the device: radiance with mip levels, depth, and what is derived from them once per video frame.

use super::{
    resources::{Resource, Resources},
    view::ViewData,
};
use crate::{
    Error, Result,
    gpu::{Buffer, Format, Gpu, Image},
    panorama::source::PanoramaFrame,
};

/// Sizes of the min–max pyramid: level 0 has one node per 2×2 quads, the last a single one.
#[derive(Clone, Debug, PartialEq)]
pub struct PyramidShape {
    /// Width and height of each level, nodes.
    pub levels: Vec<[u32; 2]>,
    /// Index of each level's first node. Levels are padded to even sizes, so that four siblings always exist.
    pub offsets: Vec<u32>,
    /// Nodes of all levels, padding included.
    pub nodes: u32,
}

impl PyramidShape {
    /// For a depth image of this size: W columns of quads, H + 1 rows with the fans to the poles.
    pub fn new(depth_size: [u32; 2]) -> Self {
        let mut size = [depth_size[0].div_ceil(2), (depth_size[1] + 1).div_ceil(2)];
        let mut shape = Self { levels: Vec::new(), offsets: Vec::new(), nodes: 0 };
        loop {
            shape.levels.push(size);
            shape.offsets.push(shape.nodes);
            shape.nodes += size[0].next_multiple_of(2) * size[1].next_multiple_of(2);
            if size == [1, 1] {
                return shape;
            }
            size = size.map(|n| n.div_ceil(2));
        }
    }
}

/// Device resources of a panorama of fixed sizes.
pub struct Panorama {
    /// Width and height of the radiance, texels.
    pub color_size: [u32; 2],
    /// Width and height of the depth, texels.
    pub depth_size: [u32; 2],
    /// Rotation about +Y, degrees.
    pub yaw_degrees: f32,
    /// The shape of the pyramid.
    pub shape: PyramidShape,
    /// What shaders read.
    pub resources: Resources,
    radiance: Image,
    raw_depth: Buffer,
}

/// The widest panorama that the pyramid's node codes can address.
const LARGEST: u32 = 32768;

impl Panorama {
    /// Allocates for frames of these sizes; `color_levels` mip levels of radiance.
    pub fn new(
        gpu: &Gpu,
        color_size: [u32; 2],
        depth_size: [u32; 2],
        yaw_degrees: f32,
        color_levels: u32,
    ) -> Result<Self> {
        for size in [color_size, depth_size] {
            if size.contains(&0) || size.iter().any(|&n| n >= LARGEST) {
                let problem = format!("{}×{} texels", size[0], size[1]);
                return Err(Error::input("panorama", problem, format!("sizes from 1 to {} can be used", LARGEST - 1)));
            }
        }
        let shape = PyramidShape::new(depth_size);
        let texels = u64::from(depth_size[0]) * u64::from(depth_size[1]);
        let radiance = gpu.image("panorama radiance", color_size, 1, color_levels, Format::Rgba32f)?;
        let raw_depth = gpu.buffer("panorama raw depth", (texels + 2) * 4)?;
        let mut resources = Resources::default();
        resources.add("panorama_radiance", Resource::Image(radiance.clone()));
        resources.add("panorama_levels", Resource::Image(radiance.clone()));
        resources.add("depth", Resource::Buffer(gpu.buffer("panorama depth", (texels + 2) * 4)?));
        resources
            .add("angles", Resource::Buffer(gpu.buffer_with("panorama angles", &angles(depth_size, yaw_degrees))?));
        resources
            .add("panorama_normal", Resource::Image(gpu.image("panorama normal", depth_size, 1, 1, Format::Rgba16f)?));
        resources.add("plane", Resource::Image(gpu.image("panorama plane", depth_size, 1, 1, Format::Rgba32f)?));
        resources.add("pyramid", Resource::Buffer(gpu.buffer("depth pyramid", u64::from(shape.nodes) * 24)?));
        resources.add("lights", Resource::Buffer(gpu.buffer("light table", super::light_table::BYTES)?));
        Ok(Self { color_size, depth_size, yaw_degrees, shape, resources, radiance, raw_depth })
    }

    /// The radiance image.
    pub fn radiance(&self) -> &Image {
        &self.radiance
    }

    /// Depth as captured, before normals moves it off its steps.
    pub fn raw_depth(&self) -> &Buffer {
        &self.raw_depth
    }

    /// Bytes of the pyramid.
    pub fn pyramid_bytes(&self) -> u64 {
        u64::from(self.shape.nodes) * 24
    }

    /// What shaders must know of its shape.
    pub fn describe(&self, data: &mut ViewData) {
        data.color_size = self.color_size;
        data.color_levels = self.radiance.levels();
        data.depth_size = self.depth_size;
        data.yaw = self.yaw_degrees.to_radians();
        data.pyramid_levels = self.shape.levels.len() as u32;
        for (level, (size, offset)) in self.shape.levels.iter().zip(&self.shape.offsets).enumerate() {
            data.level_width[level] = size[0];
            data.level_offset[level] = *offset;
        }
    }

    /// Uploads a frame; the per-video-frame passes must run after it.
    pub fn upload(&self, gpu: &Gpu, frame: &PanoramaFrame) -> Result<()> {
        gpu.write_image(&self.radiance, 0, 0, &frame.radiance)?;
        gpu.write_buffer(&self.raw_depth, 0, &with_poles(&frame.depth, frame.depth_size))
    }
}

/// (sin φ, cos φ) of each column in the world, then (sin θ, cos θ) of each row.
fn angles([width, height]: [u32; 2], yaw_degrees: f32) -> Vec<[f32; 2]> {
    use std::f64::consts::{PI, TAU};
    let yaw = f64::from(yaw_degrees).to_radians();
    let pair = |angle: f64| [angle.sin() as f32, angle.cos() as f32];
    let columns = (0..width).map(|i| pair(TAU * ((f64::from(i) + 0.5) / f64::from(width) - 0.5) - yaw));
    let rows = (0..height).map(|j| pair(PI * (f64::from(j) + 0.5) / f64::from(height)));
    columns.chain(rows).collect()
}

/// Depth and the distances of the two pole vertices: the harmonic means of the first and the last row.
fn with_poles(depth: &[f32], [width, _]: [u32; 2]) -> Vec<f32> {
    let pole = |row: &[f32]| {
        let valid: Vec<f64> = row.iter().filter(|d| **d > 0.0).map(|d| 1.0 / f64::from(*d)).collect();
        if valid.is_empty() { 0.0 } else { (valid.len() as f64 / valid.iter().sum::<f64>()) as f32 }
    };
    let width = width as usize;
    let poles = [pole(&depth[..width]), pole(&depth[depth.len() - width..])];
    depth.iter().copied().chain(poles).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pyramid_ends_in_one_node_for_any_size() {
        for size in [[1, 1], [2, 1], [3, 2], [7, 5], [64, 32], [1023, 513], [8192, 4096]] {
            let shape = PyramidShape::new(size);
            assert_eq!(*shape.levels.last().unwrap(), [1, 1]);
            assert!(shape.levels.len() <= 16);
        }
    }

    #[test]
    fn a_pole_is_the_harmonic_mean_of_its_valid_texels() {
        assert_eq!(with_poles(&[1.0, 3.0, 0.0, 0.0], [2, 2])[4..], [1.5, 0.0]);
    }
}
