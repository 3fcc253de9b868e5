//! The passes, one file each. Shaders, timings and documents use the file's name. [`PASSES`] is their table.
//!
//! Each runs on a [`view::View`], which is the picture or the relit panorama's map. [`trace_rays`] runs
//! outside of frames, and so do [`geometry`], which serves whoever reads images, and [`display`] and [`unknown`],
//! which serve the window.

pub mod acceleration;
pub mod atrous;
pub mod bsdf;
pub mod composite;
pub mod deform;
pub mod depth_pyramid;
pub mod display;
pub mod fault;
pub mod free_lamps;
pub mod gbuffer;
pub mod geometry;
pub mod ingest;
pub mod interpolate;
pub mod irradiance;
pub mod light_table;
pub mod normals;
pub mod panorama;
pub mod radiance_pyramid;
pub mod resources;
pub mod sampling_mask;
pub mod scene;
pub mod temporal;
pub mod trace_rays;
pub mod unknown;
pub mod view;

use crate::{
    plan::{Part, Plan},
    shaders,
};

/// How often a pass runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Every {
    /// Once for each new frame of the panorama's video.
    VideoFrame,
    /// Once in each frame.
    Frame,
}

/// One pass of the table.
#[derive(Clone, Copy, Debug)]
pub struct PassRow {
    /// Its name in timings, labels and documents.
    pub name: &'static str,
    /// What it makes.
    pub what: &'static str,
    /// How often it runs.
    pub every: Every,
    /// The stem and the SPIR-V of each shader that it dispatches.
    pub shaders: &'static [(&'static str, &'static [u32])],
    /// Dispatches in a frame that shows a new video frame. A build of instances counts as one, and
    /// so do the dispatches that fit boxes, one for each height of a tree.
    pub dispatches: fn(&Plan) -> u32,
    /// The pass is off if all of these parts are off. Empty if it always runs.
    pub without: &'static [Part],
    /// Its colour in charts and in the window.
    pub color: &'static str,
}

/// The passes in the order of the frame. `relight` stands for the passes after it, on the relit maps.
pub const PASSES: &[PassRow] = &[
    PassRow {
        name: "deform",
        what: "the vertices, triangles and boxes of objects that change their shape",
        every: Every::Frame,
        shaders: &[
            ("deform", shaders::DEFORM),
            ("deform_triangles", shaders::DEFORM_TRIANGLES),
            ("deform_boxes", shaders::DEFORM_BOXES),
            ("deform_corners", shaders::DEFORM_CORNERS),
        ],
        dispatches: |plan| 3 * u32::from(plan.on(Part::Deformation)),
        without: &[Part::Deformation],
        color: "#bcbd22",
    },
    PassRow {
        name: "acceleration",
        what: "what ray queries search, where objects have moved",
        every: Every::Frame,
        shaders: &[],
        dispatches: |plan| u32::from(plan.ray_queries()),
        without: &[Part::Objects],
        color: "#17becf",
    },
    PassRow {
        name: "ingest",
        what: "radiance of a video frame's codes",
        every: Every::VideoFrame,
        shaders: &[("ingest", shaders::INGEST)],
        dispatches: |plan| u32::from(plan.codes().is_some()),
        without: &[Part::Ingest],
        color: "#e377c2",
    },
    PassRow {
        name: "radiance_pyramid",
        what: "mip levels of the panorama's radiance, where the picture is coarser than it",
        every: Every::VideoFrame,
        shaders: &[("radiance_pyramid", shaders::RADIANCE_PYRAMID)],
        dispatches: |plan| plan.color_levels() - 1,
        without: &[Part::RadiancePyramid],
        color: "#8c8c8c",
    },
    PassRow {
        name: "normals",
        what: "plane fits through the depth, which moves off its codes' steps",
        every: Every::VideoFrame,
        shaders: &[("plane_fit", shaders::PLANE_FIT), ("normals", shaders::NORMALS)],
        dispatches: |plan| 2 * u32::from(plan.geometry()),
        without: &[Part::Objects, Part::OffCentre],
        color: "#a6761d",
    },
    PassRow {
        name: "depth_pyramid",
        what: "the boxes that rays through the panorama walk",
        every: Every::VideoFrame,
        shaders: &[("depth_pyramid", shaders::DEPTH_PYRAMID)],
        dispatches: |plan| {
            panorama::PyramidShape::new(plan.facts.depth_size).levels.len() as u32 * u32::from(plan.boxes())
        },
        without: &[Part::RealTracer, Part::OffCentre],
        color: "#666a1f",
    },
    PassRow {
        name: "light_table",
        what: "the panorama's lamps and windows as something to draw directions from",
        every: Every::VideoFrame,
        shaders: &[("light_cells", shaders::LIGHT_CELLS), ("light_table", shaders::LIGHT_TABLE)],
        dispatches: |plan| 2 * u32::from(plan.on(Part::LightTable)),
        without: &[Part::LightTable],
        color: "#e6ab02",
    },
    PassRow {
        name: "relight",
        what: "the passes below on the relit panorama's maps, once a level",
        every: Every::Frame,
        shaders: &[],
        dispatches: |plan| {
            let filters = u32::from(plan.on(Part::Interpolate)) + u32::from(plan.on(Part::Temporal)) + levels(plan);
            plan.settings.relight_levels * u32::from(plan.on(Part::Relight)) * (3 + filters)
        },
        without: &[Part::Relight],
        color: "#d95f02",
    },
    PassRow {
        name: "gbuffer",
        what: "primary visibility of panorama and objects, then the fraction M at silhouettes",
        every: Every::Frame,
        shaders: &[
            ("gbuffer", shaders::GBUFFER),
            ("coverage", shaders::COVERAGE),
            ("silhouette", shaders::SILHOUETTE),
            ("surface", shaders::SURFACE),
        ],
        dispatches: |plan| 1 + 3 * u32::from(plan.on(Part::VirtualSurfaces)),
        without: &[],
        color: "#7570b3",
    },
    PassRow {
        name: "sampling_mask",
        what: "which pixels trace this frame, compacted",
        every: Every::Frame,
        shaders: &[("sampling_mask", shaders::SAMPLING_MASK)],
        dispatches: |plan| u32::from(plan.on(Part::Objects)),
        without: &[Part::Objects],
        color: "#1b9e77",
    },
    PassRow {
        name: "irradiance",
        what: "one path for each traced surface: first the real ones, then the virtual ones, which see them relit",
        every: Every::Frame,
        shaders: &[("irradiance", shaders::IRRADIANCE)],
        dispatches: |plan| layers(plan) * u32::from(plan.on(Part::Objects)),
        without: &[Part::Objects],
        color: "#e7298a",
    },
    PassRow {
        name: "interpolate",
        what: "pixels that were not traced, from traced neighbours",
        every: Every::Frame,
        shaders: &[("interpolate", shaders::INTERPOLATE)],
        dispatches: |plan| layers(plan) * u32::from(plan.on(Part::Interpolate)),
        without: &[Part::Interpolate],
        color: "#66a61e",
    },
    PassRow {
        name: "temporal",
        what: "accumulation along motion vectors",
        every: Every::Frame,
        shaders: &[("follow", shaders::FOLLOW), ("temporal", shaders::TEMPORAL)],
        dispatches: |plan| layers(plan) * u32::from(plan.on(Part::Temporal)) + u32::from(plan.follows()),
        without: &[Part::Temporal],
        color: "#1f78b4",
    },
    PassRow {
        name: "atrous",
        what: "the edge-avoiding filter, level by level",
        every: Every::Frame,
        shaders: &[("atrous", shaders::ATROUS)],
        dispatches: |plan| layers(plan) * levels(plan),
        without: &[Part::Atrous],
        color: "#b2182b",
    },
    PassRow {
        name: "composite",
        what: "the picture: real surfaces relit, and virtual ones over them",
        every: Every::Frame,
        shaders: &[("composite", shaders::COMPOSITE)],
        dispatches: |_| 1,
        without: &[],
        color: "#525252",
    },
];

/// The table as text: each pass and what it makes.
pub fn help() -> String {
    let rows = PASSES.iter().map(|row| format!("\n  {:<18}{}", row.name, row.what));
    format!("Passes, in the order of the frame:{}", rows.collect::<String>())
}

/// The number of surfaces that a pixel may hold, each of which is dispatched alone.
fn layers(plan: &Plan) -> u32 {
    1 + u32::from(plan.on(Part::VirtualSurfaces))
}

/// The number of atrous levels.
fn levels(plan: &Plan) -> u32 {
    plan.settings.atrous_levels * u32::from(plan.on(Part::Atrous))
}
