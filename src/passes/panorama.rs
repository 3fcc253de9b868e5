//! The panorama on the device, and what is derived from it once per video frame.

use super::{
    free_lamps,
    ingest::Codes,
    resources::{Resource, Resources},
    view::ViewData,
};
use crate::{
    Error, Result,
    gpu::{Buffer, Format, Frame, Gpu, Image},
    panorama::{codes::Coding, depth::Quality, lamps, source::PanoramaFrame, texels},
    plan::{Part, Plan},
};

/// The pyramid of boxes (`pyramid.glsl`). A leaf is 2×2 quads, and a node of level 0 has 2×2 leaves.
#[derive(Clone, Debug, PartialEq)]
pub struct PyramidShape {
    /// Width and height of each level in nodes. The last level has a single node.
    pub levels: Vec<[u32; 2]>,
    /// Room for nodes, shared by all levels: a third more than the finest level has.
    pub area: u32,
    /// The number of nodes of all levels, including gaps.
    pub nodes: u32,
}

impl PyramidShape {
    /// The pyramid of a depth image: W columns and H + 1 rows of quads, with the fans to the poles.
    pub fn new(depth_size: [u32; 2]) -> Self {
        let mut levels = vec![[depth_size[0].div_ceil(4), (depth_size[1] + 1).div_ceil(4)]];
        while levels[levels.len() - 1] != [1, 1] {
            levels.push(levels[levels.len() - 1].map(|n| n.div_ceil(2)));
        }
        let area = (levels[0][0] * levels[0][1]).div_ceil(3) * 4 + 4;
        let mut shape = Self { levels, area, nodes: 0 };
        let top = shape.levels.len() as u32 - 1;
        shape.nodes = shape.node(top, 0, 0) + 1;
        shape
    }

    /// The number of a node, as shaders compute it. Each level begins at a place that follows from its
    /// number, so rays need no table. A level has room for ¾·area·4^−level nodes, which its w·h nodes would
    /// fill if they halved exactly, and for the rounding up of w and h.
    pub fn node(&self, level: u32, x: u32, y: u32) -> u32 {
        let [width, height] = self.levels[0];
        self.area - (self.area >> (2 * level)) + level * (width + height + 4) + y * self.levels[level as usize][0] + x
    }
}

/// Texels of a node, and nodes in a row of the pyramid's image, as in `pyramid.glsl`.
const NODE_TEXELS: u32 = 3;
const PYRAMID_ROW: u32 = 1024;

/// The device resources of a panorama of fixed sizes. A clone has the same images.
#[derive(Clone)]
pub struct Panorama {
    /// Width and height of the radiance, texels.
    pub color_size: [u32; 2],
    /// Width and height of the depth, texels.
    pub depth_size: [u32; 2],
    /// Rotation about +Y, degrees.
    pub yaw_degrees: f32,
    /// The shape of the pyramid.
    pub shape: PyramidShape,
    /// Whether the far sides of skirts have boxes of their own.
    pub far_sides: bool,
    /// Whether noisy depth is smoothed.
    pub smooth_depth: bool,
    /// How well the depth that was uploaded knows its surfaces.
    quality: Quality,
    /// What shaders read, by name.
    pub resources: Resources,
    gpu: Gpu,
    radiance: Image,
    /// What `ingest` makes radiance of. `None` if that comes as such.
    codes: Option<Codes>,
    /// The lamps that hang free. `None` if none are looked for.
    lamps: Option<Buffer>,
    /// Depth as captured. Dropped once a panorama that never changes is prepared.
    raw_depth: Option<Image>,
}

/// What a panorama holds. An `Err` names the part without which something is left out.
#[derive(Clone, Copy, Debug)]
pub struct Needs {
    /// The number of mip levels of radiance.
    pub color_levels: u32,
    /// How frames are coded, if radiance is made of codes.
    pub codes: Option<Coding>,
    /// Depth and normals.
    pub geometry: std::result::Result<(), Part>,
    /// The pyramid that rays walk.
    pub boxes: std::result::Result<(), Part>,
    /// The light table.
    pub lights: std::result::Result<(), Part>,
    /// Lamps that hang free, found in each frame.
    pub free_lamps: bool,
    /// Noisy depth is smoothed.
    pub smooth_depth: bool,
}

impl Needs {
    /// What a plan needs.
    pub fn of(plan: &Plan) -> Self {
        let need = |needed: bool, part| if needed { Ok(()) } else { Err(part) };
        Self {
            color_levels: plan.color_levels(),
            codes: plan.codes(),
            geometry: need(plan.geometry(), Part::Objects),
            boxes: need(plan.boxes(), if plan.on(Part::Objects) { Part::RealTracer } else { Part::Objects }),
            lights: need(plan.on(Part::LightTable), Part::LightTable),
            free_lamps: plan.on(Part::FreeLamps),
            smooth_depth: plan.settings.smooth_depth,
        }
    }
}

/// How the radiance of a panorama is kept: as [`texels`] keeps it.
pub fn radiance_format(color_size: [u32; 2]) -> Format {
    if texels::is_half(color_size) { Format::Rgba16f } else { Format::Rgba32f }
}

/// Bytes of a plan's panorama once it is prepared.
pub fn bytes(plan: &Plan) -> u64 {
    let texels = |[width, height]: [u32; 2]| u64::from(width) * u64::from(height);
    let facts = &plan.facts;
    let radiance: u64 = (0..plan.color_levels()).map(|l| texels(facts.color_size.map(|n| (n >> l).max(1)))).sum();
    let radiance = radiance * radiance_format(facts.color_size).bytes();
    let depth = texels(facts.depth_size);
    // depth and normals, then the images that they are made from
    let geometry = depth * (4 + 8) + if plan.on(Part::Video) { depth * (4 + 16) } else { 0 };
    radiance
        + plan.codes().map_or(0, |coding| super::ingest::bytes(coding, facts.color_size))
        + if plan.geometry() { geometry } else { 0 }
        + if plan.boxes() { u64::from(PyramidShape::new(facts.depth_size).nodes * NODE_TEXELS) * 16 } else { 0 }
        + if plan.on(Part::LightTable) { super::light_table::BYTES } else { 0 }
        + if plan.on(Part::FreeLamps) { free_lamps::BYTES } else { 0 }
}

/// How many texels of a large panorama go up at a time, about.
const STRIP: usize = 1 << 21;

/// The first width that the pyramid's node codes cannot address.
const LARGEST: u32 = 32768;

impl Panorama {
    /// Allocates images for frames of these sizes.
    pub fn new(gpu: &Gpu, color_size: [u32; 2], depth_size: [u32; 2], yaw_degrees: f32, needs: Needs) -> Result<Self> {
        for size in [color_size, depth_size] {
            if size.contains(&0) || size.iter().any(|&n| n >= LARGEST) {
                let problem = format!("{}×{} texels", size[0], size[1]);
                let remedy = format!("sizes from 1 to {} can be used; --panorama-size reduces it", LARGEST - 1);
                return Err(Error::input("panorama", problem, remedy));
            }
        }
        let shape = PyramidShape::new(depth_size);
        let with_poles = [depth_size[0], depth_size[1] + 2];
        let radiance = gpu.image("panorama radiance", color_size, 1, needs.color_levels, radiance_format(color_size));
        let radiance = radiance.map_err(|error| match error {
            Error::Input { subject, problem, .. } => {
                Error::Input { subject, problem, remedy: "give --panorama-size 4096, or use another device".into() }
            }
            other => other,
        })?;
        let angles_size = [with_poles[0].max(with_poles[1]), 2];
        let angles_image = gpu.image("panorama angles", angles_size, 1, 1, Format::Rg32f)?;
        gpu.write_image(&angles_image, 0, 0, &angles(depth_size, yaw_degrees, angles_size[0]))?;
        let mut resources = Resources::default();
        let whole = match radiance.format() {
            Format::Rgba32f => radiance.clone(),
            _ => gpu.image("no panorama radiance", [1, 1], 1, 1, Format::Rgba32f)?,
        };
        resources.add("panorama_radiance", Resource::Image(whole));
        resources.add("panorama_levels", Resource::Image(radiance.clone()));
        resources.add("angles", Resource::Image(angles_image));
        let mut raw_depth = None;
        for (name, size, format) in [
            ("depth", with_poles, Format::R32f),
            ("panorama_normal", depth_size, Format::Rgba16f),
            ("plane", depth_size, Format::Rgba32f),
        ] {
            match needs.geometry {
                Ok(()) => {
                    resources.add(name, Resource::Image(gpu.image(&format!("panorama {name}"), size, 1, 1, format)?))
                }
                Err(part) => resources.leave_out(gpu, name, format, part)?,
            }
        }
        if needs.geometry.is_ok() {
            raw_depth = Some(gpu.image("panorama raw depth", with_poles, 1, 1, Format::R32f)?);
        }
        match needs.boxes {
            Ok(()) => resources.add("pyramid", Resource::Image(pyramid(gpu, shape.nodes)?)),
            Err(part) => resources.leave_out(gpu, "pyramid", Format::Rgba32u, part)?,
        }
        let lights = if needs.lights.is_ok() { super::light_table::BYTES } else { 0 };
        resources.add("lights", Resource::Buffer(gpu.buffer("light table", lights)?));
        let lamps = gpu.buffer("free lamps", if needs.free_lamps { free_lamps::BYTES } else { 0 })?;
        resources.add("lamps", Resource::Buffer(lamps.clone()));
        let lamps = needs.free_lamps.then_some(lamps);
        Ok(Self {
            color_size,
            depth_size,
            yaw_degrees,
            shape,
            far_sides: false,
            smooth_depth: needs.smooth_depth,
            quality: Quality::default(),
            resources,
            gpu: gpu.clone(),
            radiance,
            codes: needs.codes.map(|coding| Codes::new(gpu, coding, color_size)).transpose()?,
            lamps,
            raw_depth,
        })
    }

    /// Adds room for the far sides of skirts, which `panorama_unknown` needs.
    pub fn with_far_sides(mut self, gpu: &Gpu) -> Result<Self> {
        let both = Resource::Image(pyramid(gpu, 2 * self.shape.nodes)?);
        self.resources.0.retain(|(name, _)| *name != "pyramid");
        self.resources.add("pyramid", both);
        self.far_sides = true;
        Ok(self)
    }

    pub fn radiance(&self) -> &Image {
        &self.radiance
    }

    /// What `ingest` reads.
    ///
    /// # Errors
    /// Fails with [`Error::Internal`] if radiance is not made of codes.
    pub fn codes(&self) -> Result<&Codes> {
        self.codes.as_ref().ok_or_else(|| Error::Internal("the panorama has no codes".into()))
    }

    /// Depth as captured, before `normals` moves it off the steps of its codes.
    ///
    /// # Errors
    /// Fails with [`Error::Internal`] if the depth is not kept.
    pub fn raw_depth(&self) -> Result<&Image> {
        self.raw_depth.as_ref().ok_or_else(|| Error::Internal("the panorama's depth is not kept".into()))
    }

    /// Depth as rays meet it.
    ///
    /// # Errors
    /// Fails with [`Error::Internal`] if there is none.
    pub fn depth(&self) -> Result<&Image> {
        self.resources.image("depth").ok_or_else(|| Error::Internal("the panorama has no depth".into()))
    }

    /// Frees what only the passes of a new video frame read, as there will be no new one.
    pub fn settle(&mut self) {
        self.raw_depth = None;
        self.codes = None;
        self.resources.0.retain(|(name, _)| *name != "plane");
    }

    /// Bytes of the pyramid.
    pub fn pyramid_bytes(&self) -> u64 {
        self.resources.image("pyramid").map_or(0, |image| {
            let [width, height] = image.size().map(u64::from);
            width * height * image.format().bytes()
        })
    }

    /// Tells shaders the panorama's sizes and shape.
    pub fn describe(&self, data: &mut ViewData) {
        data.color_size = self.color_size;
        data.color_levels = self.radiance.levels();
        data.depth_size = self.depth_size;
        data.yaw = self.yaw_degrees.to_radians();
        data.pyramid_levels = self.shape.levels.len() as u32;
        data.pyramid_size = self.shape.levels[0];
        data.pyramid_area = self.shape.area;
        data.pyramid_nodes = self.shape.nodes;
    }

    /// How well the depth that was uploaded knows its surfaces, as far as that matters here.
    pub fn quality(&self) -> Quality {
        self.quality
    }

    /// Records the upload of a video frame. The passes of a new video frame must run after it.
    pub fn upload(&mut self, frame: &mut Frame, content: &PanoramaFrame) -> Result<()> {
        match (&self.codes, content.radiance.codes()) {
            (Some(images), Some(codes)) => images.upload(frame, codes)?,
            _ => self.upload_radiance(frame, content)?,
        }
        let mut depth = &content.depth;
        let found;
        if let Some(buffer) = &self.lamps {
            found = lamps::find(content);
            frame.write_buffer(buffer, 0, &free_lamps::packed(&found.lamps, self.yaw_degrees))?;
            if !found.lamps.is_empty() {
                depth = &found.depth;
            }
        }
        if self.raw_depth.is_none() {
            return Ok(());
        }
        let quality = content.quality();
        self.quality = if self.smooth_depth { quality } else { Quality { noise: 0.0, ..quality } };
        // `normals` smooths noisy depth first, and puts the result where depth comes without noise.
        let given = if self.quality.noise > 0.0 { self.depth()? } else { self.raw_depth()? };
        frame.write_image(given, 0, 0, &with_poles(depth, content.depth_size))
    }

    fn upload_radiance(&self, frame: &mut Frame, content: &PanoramaFrame) -> Result<()> {
        let texels = content.radiance.bytes();
        if !texels::is_half(self.color_size) {
            return frame.write_image(&self.radiance, 0, 0, texels);
        }
        // A large panorama goes up by itself, in strips, so that it is not in memory as a whole once more.
        let width = self.color_size[0] as usize;
        let rows = (STRIP / width).max(1);
        let strip = rows * width * self.radiance.format().bytes() as usize;
        for (number, strip) in texels.chunks(strip).enumerate() {
            let mut upload = self.gpu.frame()?;
            upload.write_rows(&self.radiance, (number * rows) as u32, strip)?;
            upload.run()?;
        }
        Ok(())
    }
}

/// Makes an image for this many nodes.
fn pyramid(gpu: &Gpu, nodes: u32) -> Result<Image> {
    let size = [PYRAMID_ROW * NODE_TEXELS, nodes.div_ceil(PYRAMID_ROW)];
    gpu.image("depth pyramid", size, 1, 1, Format::Rgba32u)
}

/// (sin φ, cos φ) of each column in the world. From `stride` on, (sin θ, cos θ) of each row and both poles.
pub(super) fn angles([width, height]: [u32; 2], yaw_degrees: f32, stride: u32) -> Vec<[f32; 2]> {
    use std::f64::consts::{PI, TAU};
    let yaw = f64::from(yaw_degrees).to_radians();
    let pair = |angle: f64| [angle.sin() as f32, angle.cos() as f32];
    let columns = (0..width).map(|i| pair(TAU * ((f64::from(i) + 0.5) / f64::from(width) - 0.5) - yaw));
    let rows = (0..height).map(|j| pair(PI * (f64::from(j) + 0.5) / f64::from(height)));
    let mut all: Vec<_> = columns.collect();
    all.resize(stride as usize, [0.0; 2]);
    all.push([0.0, 1.0]);
    all.extend(rows);
    all.push([0.0, -1.0]);
    all.resize(2 * stride as usize, [0.0; 2]);
    all
}

/// Adds a row of the pole's distance at each end of the depth: the harmonic mean of the nearest row.
fn with_poles(depth: &[f32], [width, _]: [u32; 2]) -> Vec<f32> {
    let pole = |row: &[f32]| {
        let valid: Vec<f64> = row.iter().filter(|d| **d > 0.0).map(|d| 1.0 / f64::from(*d)).collect();
        if valid.is_empty() { 0.0 } else { (valid.len() as f64 / valid.iter().sum::<f64>()) as f32 }
    };
    let width = width as usize;
    let [north, south] = [&depth[..width], &depth[depth.len() - width..]].map(|row| vec![pole(row); width]);
    [&north, depth, &south].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pyramid_ends_in_one_node_for_any_size() {
        for size in [[1, 1], [2, 1], [3, 2], [7, 5], [64, 32], [1023, 513], [8192, 4096]] {
            let shape = PyramidShape::new(size);
            assert_eq!(*shape.levels.last().unwrap(), [1, 1]);
            assert!(shape.levels.len() <= 15);
        }
    }

    #[test]
    fn a_pole_is_the_harmonic_mean_of_its_valid_texels() {
        assert_eq!(with_poles(&[1.0, 3.0, 0.0, 0.0], [2, 2]), [1.5, 1.5, 1.0, 3.0, 0.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn levels_of_the_pyramid_lie_apart() {
        for width in (1..200u32).chain([511, 513, 1023, 4095, 8192, 32767]) {
            for height in [1, 2, 3, width.div_ceil(2), width, 32767] {
                let shape = PyramidShape::new([width, height]);
                let mut free = 0;
                for (level, [w, h]) in (0..).zip(shape.levels.iter().copied()) {
                    assert!(shape.node(level, 0, 0) >= free, "{width}×{height}, level {level}");
                    free = shape.node(level, w - 1, h - 1) + 1;
                    let halved = shape.levels[0].map(|n| ((n - 1) >> level) + 1);
                    assert_eq!([w, h], halved, "as shaders reckon it");
                }
                assert_eq!(free, shape.nodes);
            }
        }
    }
}
