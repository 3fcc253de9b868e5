//! A pass of its own, `tests/glsl/edges.comp`, is made by steps 1, 2 and 3 of the list in `src/lib.rs`, and by nothing else: its
//! bindings, accesses and constants come from the shader. The frame around it is recorded by hand.

use crate::{common::*, shaders};
use glam::{Quat, Vec3};
use iprt::{
    Result,
    gpu::{Format, Frame, Gpu, Threads},
    gpu_struct,
    passes::{
        composite::Composite,
        gbuffer::{Gbuffer, Look},
        panorama::{Needs, Panorama},
        resources::{Kernel, Resource},
        scene::SceneBuffers,
        view::{Role, View, ViewData},
    },
    plan::Plan,
    scene::{packed::PackedScene, viewpoint::Viewpoint},
    settings::Method,
};

gpu_struct! {
    struct EdgesPush { pub least: f32 }
}

struct Edges(Kernel);

impl Edges {
    fn new(gpu: &Gpu, stride: u32) -> Result<Self> {
        Ok(Self(Kernel::new::<EdgesPush>(gpu, "edges", shaders::EDGES, &[("STRIDE", stride)])?))
    }

    fn record(&self, frame: &mut Frame, view: &View) -> Result<()> {
        let threads = Threads::Size([view.size[0], view.size[1], 1]);
        self.0.dispatch(frame, &[], &[&view.resources], &EdgesPush { least: 0.1 }, threads)
    }
}

#[test]
fn a_pass_is_added_by_the_steps_of_the_checklist() {
    validated(|gpu| {
        let captured = surroundings([128, 64], |_| 2.0, |d| if d.x > 0.1 { Vec3::ONE } else { Vec3::splat(0.25) });
        let scene = scene(captured, camera(Vec3::ZERO, Vec3::NEG_Z, 60.0), vec![]);
        let options = options(Method::Iprt, &[]);
        let plan = Plan::of(&scene, &options, None).expect("a plan");
        let content = scene.panorama.load(0).expect("a panorama");
        let mut panorama =
            Panorama::new(gpu, content.color_size, content.depth_size, 0.0, Needs::of(&plan)).expect("fits");
        let objects = SceneBuffers::new(gpu, &PackedScene::default(), 0, 0).expect("fits");
        let mut view = View::new(gpu, "picture", options.size, &plan, Role::Picture).expect("fits");
        let look = Look { role: Role::Picture, off_centre: false };
        let (gbuffer, composite) = (Gbuffer::new(gpu, &plan, look), Composite::new(gpu, &plan));
        let (gbuffer, composite) = (gbuffer.expect("a pass"), composite.expect("a pass"));
        let edges = Edges::new(gpu, 1).expect("a pass");

        let eye = Viewpoint::perspective(Vec3::ZERO, Quat::IDENTITY, 60.0, options.size);
        let mut data = ViewData { size: view.size, ..Default::default() };
        panorama.describe(&mut data);
        data.look(&eye, &eye);
        let mut upload = gpu.frame().expect("a frame");
        panorama.upload(&mut upload, &content).expect("fits");
        upload.write_buffer(&view.data, 0, &[data]).expect("fits");
        upload.run().expect("runs");

        // what the shader asks for and nobody has is named
        let unknown = edges.record(&mut gpu.frame().expect("a frame"), &view).expect_err("no such image").to_string();
        assert!(unknown.contains("edges: nothing is called out_edges"), "{unknown}");
        let image = gpu.image("picture edges", view.size, 1, 1, Format::R32f).expect("fits");
        view.resources.add("edges", Resource::Image(image));

        let record = |barrier: bool| {
            let mut frame = gpu.frame()?;
            gbuffer.record(&mut frame, &view, &panorama.resources, &objects, false)?;
            if barrier {
                frame.barrier("edges reads L_cam");
            }
            edges.record(&mut frame, &view)?;
            frame.barrier("composite reads L_cam");
            composite.record(&mut frame, &view, None, false)?;
            frame.run()
        };
        // its accesses are the shader's, so that what is missing between it and others is found
        let missing = record(false).expect_err("refused").to_string();
        assert!(missing.contains("no barrier between gbuffer and edges"), "{missing}");
        let timings = record(true).expect("runs");
        let mut names: Vec<_> = timings.entries.iter().map(iprt::gpu::Entry::pass).collect();
        names.dedup();
        assert_eq!(names, ["gbuffer", "edges", "composite"]);

        let read = |name: &str| gpu.read_image(view.image(name).expect("its name"), 0).expect("reads");
        let (found, radiance, picture) = (read("edges"), read("camera_radiance"), read("radiance"));
        assert_eq!(radiance, picture, "the passes around it do what they did");
        let [width, height] = view.size.map(|n| n as usize);
        let mut count = 0;
        for (i, texel) in found.iter().enumerate() {
            let next = if i % width + 1 < width { radiance[i + 1] } else { radiance[i] };
            let edge = (next[0] - radiance[i][0]).abs() > 0.1;
            assert_eq!(texel[0] == 1.0, edge, "pixel {}, {}", i % width, i / width);
            count += usize::from(edge);
        }
        assert!((height..6 * height).contains(&count), "an edge runs from top to bottom: {count} pixels");
        assert!(Edges::new(gpu, 2).is_ok(), "another pipeline by another constant");
    });
}
