//! Pass 1, `gbuffer`: primary visibility of panorama and objects, then the fraction M at silhouettes.

use super::{
    resources::{Kernel, Resources},
    scene::SceneBuffers,
    view::View,
};
use crate::{
    Result,
    gpu::{Access, Frame, Gpu, StructLayout, Threads, struct_layout},
    scene::packed,
    shaders,
};

/// Layouts of the scene's structs, as shaders that trace it declare them.
pub const SCENE_STRUCTS: &[StructLayout] = &[
    struct_layout::<packed::TriangleGeometry>("TriangleGeometry"),
    struct_layout::<packed::TriangleShading>("TriangleShading"),
    struct_layout::<packed::Vertex>("Vertex"),
    struct_layout::<packed::BvhNode>("BvhNode"),
    struct_layout::<packed::Instance>("Instance"),
    struct_layout::<packed::Material>("Material"),
    struct_layout::<packed::Texture>("Texture"),
    struct_layout::<super::view::ViewData>("View"),
];

/// See the module.
pub struct Gbuffer {
    centre: Kernel,
    coverage: Kernel,
}

impl Gbuffer {
    /// Builds the pipelines; `off_centre` cameras trace their primary rays through the panorama; `minified`:
    /// the panorama is finer than the picture and has mip levels.
    pub fn new(gpu: &Gpu, off_centre: bool, minified: bool) -> Result<Self> {
        use Access::{Read, Write};
        const CENTRE: &[(&str, Access)] = &[
            ("in_view", Read),
            ("in_panorama_radiance", Read),
            ("panorama_levels", Read),
            ("in_depth", Read),
            ("in_angles", Read),
            ("in_pyramid", Read),
            ("in_panorama_normal", Read),
            ("in_triangles", Read),
            ("in_shading", Read),
            ("in_vertices", Read),
            ("in_nodes", Read),
            ("in_instances", Read),
            ("in_top_nodes", Read),
            ("in_materials", Read),
            ("in_textures", Read),
            ("in_texels", Read),
            ("in_energy", Read),
            ("out_position", Write),
            ("out_normal", Write),
            ("out_motion", Write),
            ("out_camera_radiance", Write),
            ("out_albedo_virtual", Write),
            ("out_emission", Write),
            ("out_hit", Write),
        ];
        const COVERAGE: &[(&str, Access)] = &[
            ("in_view", Read),
            ("in_depth", Read),
            ("in_angles", Read),
            ("in_pyramid", Read),
            ("in_triangles", Read),
            ("in_shading", Read),
            ("in_vertices", Read),
            ("in_nodes", Read),
            ("in_instances", Read),
            ("in_top_nodes", Read),
            ("in_materials", Read),
            ("in_textures", Read),
            ("in_texels", Read),
            ("in_energy", Read),
            ("in_camera_radiance", Read),
            ("out_real_coverage", Write),
            ("out_position", Write),
            ("out_normal", Write),
            ("out_motion", Write),
            ("out_albedo_virtual", Write),
            ("out_emission", Write),
            ("out_hit", Write),
        ];
        let constants = [(0, u32::from(off_centre)), (3, u32::from(minified))];
        Ok(Self {
            centre: Kernel::new::<()>(gpu, "gbuffer", shaders::GBUFFER, CENTRE, SCENE_STRUCTS, &constants)?,
            coverage: Kernel::new::<()>(gpu, "gbuffer", shaders::COVERAGE, COVERAGE, SCENE_STRUCTS, &constants[..1])?,
        })
    }

    /// Records both dispatches.
    pub fn record(&self, frame: &mut Frame, view: &View, panorama: &Resources, scene: &SceneBuffers) -> Result<()> {
        let threads = || Threads::Size([view.size[0], view.size[1], 1]);
        let pools = [&view.resources, panorama, &scene.resources];
        self.centre.dispatch(frame, &[], &pools, &(), threads())?;
        frame.barrier("coverage reads its neighbours' visibility");
        self.coverage.dispatch(frame, &[], &pools, &(), threads())
    }
}
