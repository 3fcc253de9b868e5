//! Pass 1, `gbuffer`: primary visibility of panorama and objects, then the fraction M at silhouettes.

use super::{
    resources::{Kernel, Resources},
    scene::SceneBuffers,
    view::{Role, View},
};
use crate::{
    Result,
    gpu::{Access, Frame, Gpu, StructLayout, Threads, struct_layout},
    plan::{Part, Plan},
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
    struct_layout::<packed::PackedMaterial>("Material"),
    struct_layout::<packed::PackedTexture>("Texture"),
    struct_layout::<super::view::ViewData>("View"),
];

/// What a view's primary rays are for, and from where.
#[derive(Clone, Copy, Debug)]
pub struct Look {
    /// The view.
    pub role: Role,
    /// The camera is not at the panorama's centre: rays are traced through the panorama.
    pub off_centre: bool,
}

/// See the module.
pub struct Gbuffer {
    centre: Kernel,
    /// Where objects are in view.
    coverage: Option<Kernel>,
}

impl Gbuffer {
    /// Builds the pipelines.
    pub fn new(gpu: &Gpu, plan: &Plan, look: Look) -> Result<Self> {
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
        const SHOWN: u32 = 23;
        let shown = look.role == Role::Picture;
        let (id, in_view) = plan.constant(Part::VirtualSurfaces);
        let in_view = if shown { in_view } else { 0 };
        let material = [
            (0, u32::from(look.off_centre)),
            plan.constant(Part::Specular),
            plan.constant(Part::Emission),
            plan.constant(Part::Textures),
            plan.constant(Part::Motion),
            plan.constant(Part::Objects),
        ];
        let minified = (3, u32::from(plan.color_levels() > 1));
        let fill = (9, u32::from(plan.settings.fill_unseen)); // coverage asks where a surface is, not what it looks like
        let centre = [&material[..], &[fill, minified, (id, in_view), (SHOWN, u32::from(shown))]].concat();
        let coverage = || Kernel::new::<()>(gpu, "gbuffer", shaders::COVERAGE, COVERAGE, SCENE_STRUCTS, &material);
        Ok(Self {
            centre: Kernel::new::<()>(gpu, "gbuffer", shaders::GBUFFER, CENTRE, SCENE_STRUCTS, &centre)?,
            coverage: (in_view == 1).then(coverage).transpose()?,
        })
    }

    /// Records one or both dispatches.
    pub fn record(&self, frame: &mut Frame, view: &View, panorama: &Resources, scene: &SceneBuffers) -> Result<()> {
        let threads = || Threads::Size([view.size[0], view.size[1], 1]);
        let pools = [&view.resources, panorama, &scene.resources];
        self.centre.dispatch(frame, &[], &pools, &(), threads())?;
        let Some(coverage) = &self.coverage else { return Ok(()) };
        frame.barrier("coverage reads its neighbours' visibility");
        coverage.dispatch(frame, &[], &pools, &(), threads())
    }
}
