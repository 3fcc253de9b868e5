//! Skins and morph targets on the device: what the pass `deform` poses is what the CPU poses.

use crate::common::*;
use glam::{Vec3, Vec4, vec3};
use iprt::{
    error::Error,
    gpu::{FrameOptions, Gpu, Image, Timings},
    passes::{resources::Resource, scene::SceneBuffers},
    renderer::Renderer,
    scene::{
        Object, Scene,
        bounds::Bounds,
        bvh,
        clip::{Clip, Join, Weights},
        deform::{Deform, Pose, Target, patched},
        gltf,
        model::{Mesh, Model},
        packed::{BvhNode, PackedInstances, PackedScene, TriangleGeometry, Vertex},
    },
    settings::Method,
};
use std::sync::Arc;

/// Models with skins and with morph targets, with normals and without.
const FILES: [(&str, &str); 4] = [
    ("Fox/Fox.glb", "Run"),
    ("RiggedFigure/RiggedFigure.glb", ""),
    ("AnimatedMorphCube/AnimatedMorphCube.glb", ""),
    ("SimpleMorph/SimpleMorph.gltf", ""),
];

/// A file's object, with the clip of this name or the first, of this height and standing at a point.
fn file((below, clip): (&str, &str), height: f32, at: Vec3) -> Object {
    let data = std::path::PathBuf::from(std::env::var("IPRT_DATA").expect("the folder of data"));
    let (model, _) = gltf::load(&data.join("gltf").join(below)).expect("loads");
    let clip = model.rig.clips.iter().position(|known| known.name == clip).unwrap_or(0);
    let mut object = Object { model: Arc::new(model), clip: Some(clip), ..growing(at) };
    let bounds = scene(floor(), camera(Vec3::ZERO, Vec3::NEG_Z, 60.0), vec![object.clone()]).object_bounds(0, 0.0);
    let size = (bounds.max - bounds.min).max_element();
    let now = object.placement.at(0.0);
    object.placement =
        object.placement.moved(0.0, iprt::scene::animation::Transform { scale: now.scale * (height / size), ..now });
    object
}

fn of(objects: Vec<Object>) -> Scene {
    scene(
        room([64, 32], vec3(4.0, 3.0, 4.0), Vec3::ZERO, |_| Vec3::ONE),
        camera(Vec3::ZERO, Vec3::NEG_Z, 60.0),
        objects,
    )
}

/// The tables on the device, and the pass that poses them.
struct Tables<'a> {
    gpu: &'a Gpu,
    scene: Scene,
    buffers: SceneBuffers,
}

impl<'a> Tables<'a> {
    fn new(gpu: &'a Gpu, scene: Scene) -> Self {
        let mut buffers =
            SceneBuffers::new(gpu, &scene.packed, scene.instance_count(), scene.light_count()).expect("fits");
        buffers.add_deform(gpu, &scene.packed, false).expect("fits");
        Self { gpu, scene, buffers }
    }

    fn state(&self, time: f64, previous: f64) -> PackedInstances {
        self.scene.at(time, previous).instances
    }

    /// Poses the meshes for a frame.
    fn follow(&mut self, time: f64, previous: f64, options: FrameOptions) -> Result<Timings, Error> {
        let state = self.state(time, previous);
        let mut frame = self.gpu.frame_with(options)?;
        self.buffers.follow(&mut frame, &state)?;
        let timings = frame.run()?;
        self.buffers.submitted();
        Ok(timings)
    }

    fn image(&self, name: &str) -> Vec<[u32; 4]> {
        let image: &Image = self.buffers.resources.image(name).expect("is there");
        let texels = self.gpu.read_pairs(image, 0).expect("reads");
        texels.into_iter().map(|t| [0, 2, 4, 6].map(|i| u32::from(t[i]) | u32::from(t[i + 1]) << 16)).collect()
    }

    fn triangles(&self, name: &str) -> Vec<TriangleGeometry> {
        let vectors: Vec<_> =
            self.image(name).iter().map(|t| Vec3::from([t[0], t[1], t[2]].map(f32::from_bits))).collect();
        vectors.as_chunks().0.iter().map(|[v0, e1, e2]| TriangleGeometry { v0: *v0, e1: *e1, e2: *e2 }).collect()
    }

    fn vertices(&self) -> Vec<Vertex> {
        let found = self.buffers.resources.0.iter().find(|(name, _)| *name == "vertices");
        let Some((_, Resource::Buffer(buffer))) = found else { panic!("no vertices") };
        self.gpu.read_buffer(buffer).expect("reads")
    }

    /// The scene as the device has it.
    fn packed(&self) -> PackedScene {
        let mut packed = PackedScene::clone(&self.scene.packed);
        let nodes: Vec<BvhNode> = bytemuck::cast_slice(&self.image("nodes")).to_vec();
        let triangles = self.triangles("triangles");
        let [count, of_nodes] = [packed.triangles.len(), packed.nodes.len()];
        packed.triangles = triangles[..count].to_vec();
        packed.nodes = nodes[..of_nodes].to_vec();
        packed.vertices = self.vertices();
        packed
    }

    /// Demands that the device has what the CPU poses for a frame, and for the one before.
    fn check(&self, time: f64, previous: f64, what: &str) {
        let (now, before) = (self.state(time, previous), self.state(previous, previous));
        let [truth, earlier] = [&now, &before].map(|state| patched(&self.scene.packed, &state.poses));
        let packed = self.packed();
        let first = packed.first_deformed as usize;
        let size = now.poses.iter().map(|pose| pose.bounds.min.abs().max(pose.bounds.max.abs()).max_element());
        let most = 1e-5 * size.fold(1e-3, f32::max);
        let near = |ours: &TriangleGeometry, truth: &TriangleGeometry| {
            [(ours.v0, truth.v0), (ours.e1, truth.e1), (ours.e2, truth.e2)].iter().all(|(a, b)| a.distance(*b) <= most)
        };
        let all = |ours: &[TriangleGeometry], truth: &[TriangleGeometry]| {
            ours.iter().zip(truth).position(|(ours, truth)| !near(ours, truth))
        };
        assert_eq!(all(&packed.triangles, &truth.triangles), None, "{what}: a triangle at {time} s");
        let past = self.triangles("previous_triangles");
        assert_eq!(all(&past, &earlier.triangles[first..]), None, "{what}: a triangle before {time} s");
        for (ours, truth) in packed.vertices.iter().zip(&truth.vertices) {
            let apart = ours.normal.distance(truth.normal);
            let tangent = |v: &Vertex| Vec4::from_array(v.tangent);
            // Facets without area have no normal.
            assert!(apart < 2e-3 || !ours.normal.is_normalized(), "{what}: a normal is off by {apart} at {time} s");
            assert!(tangent(ours).distance(tangent(truth)) < 2e-3, "{what}: a tangent at {time} s");
            assert_eq!((ours.uv, ours.color, ours.uv2), (truth.uv, truth.color, truth.uv2));
        }
        bvh::check(&packed).unwrap_or_else(|error| panic!("{what} at {time} s: {error}"));
    }
}

/// Times of frames and of the frames before them: consecutive ones, a leap, a stop, and backwards.
const TIMES: [(f64, f64); 7] = [(0.3, 0.3), (0.34, 0.3), (0.38, 0.34), (0.7, 0.66), (0.7, 0.7), (0.7, 0.7), (0.1, 0.7)];

#[test]
fn the_device_poses_what_the_cpu_poses() {
    validated(|gpu| {
        for which in FILES {
            let mut tables = Tables::new(gpu, of(vec![file(which, 0.6, Vec3::NEG_Z)]));
            for (time, previous) in TIMES {
                tables.follow(time, previous, FrameOptions::default()).expect("runs");
                tables.check(time, previous, which.0);
            }
        }
        // Several at once, each at a time of its own, behind what keeps its shape.
        let mut objects: Vec<_> = FILES.map(|which| file(which, 0.6, Vec3::NEG_Z)).to_vec();
        objects.push(Object { speed: 0.7, ..objects[0].clone() });
        objects.insert(0, ball(0.2, lambert(0.5), Vec3::ZERO));
        objects.push(growing(Vec3::X));
        let mut tables = Tables::new(gpu, of(objects));
        for (time, previous) in TIMES {
            tables.follow(time, previous, FrameOptions::default()).expect("runs");
            tables.check(time, previous, "all");
        }
    });
}

#[test]
fn nothing_is_posed_where_nothing_has_moved() {
    validated(|gpu| {
        let growing = of(vec![growing(vec3(0.0, -0.2, -1.4))]);
        let mut renderer = Renderer::new(gpu, &growing, options(Method::Iprt, &[])).expect("fits");
        let ran = [0.1, 0.1, 0.2, 0.2, 0.2]
            .map(|time| renderer.render(&growing, time).expect("renders").pass("deform").is_some());
        // One frame after the last move, the frame before is another.
        assert_eq!(ran, [true, false, true, true, false]);

        let still = of(vec![ball(0.3, lambert(0.5), vec3(0.0, -0.2, -1.4))]);
        let mut renderer = Renderer::new(gpu, &still, options(Method::Iprt, &[])).expect("fits");
        assert!(renderer.render(&still, 0.0).expect("renders").pass("deform").is_none());
        let passes = renderer.plan().passes();
        let pass = passes.iter().find(|pass| pass.name == "deform").expect("is among them");
        assert!(pass.dispatches == 0 && pass.off.as_deref().is_some_and(|why| why.contains("nothing")), "{pass:?}");
    });
}

#[test]
fn every_barrier_of_the_pass_is_needed() {
    validated(|gpu| {
        let mut tables = Tables::new(gpu, of(vec![file(FILES[0], 0.6, Vec3::NEG_Z)]));
        let barriers = tables.follow(0.3, 0.2, FrameOptions::default()).expect("runs").barriers;
        assert!(barriers > 10, "{barriers}");
        for n in 0..barriers {
            let skip = FrameOptions { skip_barrier: Some(n), ..Default::default() };
            let mut tables = Tables::new(gpu, tables.scene.clone());
            match tables.follow(0.3, 0.2, skip) {
                Err(Error::Internal(text)) => assert!(text.contains("no barrier between"), "{text}"),
                other => panic!("barrier {n}: {:?}", other.map(|timings| timings.barriers)),
            }
        }
    });
}

/// Without the pass a mesh stands in its rest pose, and its box does, too.
#[test]
fn boxes_are_those_of_the_rest_pose_where_nothing_is_posed() {
    let scene = of(vec![ball(0.2, lambert(0.5), Vec3::ZERO), growing(vec3(0.5, 0.0, -1.0))]);
    let [mut later, start] = [1.0, 0.0].map(|time| scene.at(time, time).instances);
    let heights = [&later, &start].map(|state| state.nodes[0].max.y);
    assert!(heights[0] > heights[1] + 0.3, "{heights:?}");
    later.rest(&scene.packed);
    assert!(later.poses.is_empty());
    assert!((later.nodes[0].max.y - heights[1]).abs() < 1e-4, "{} and {heights:?}", later.nodes[0].max.y);
    bvh::check_top(&scene.packed, &later).expect("a valid top level");
}

/// The bounds of instances, and the ways of their vertices, hold what is posed, and are not much larger.
#[test]
fn bounds_hold_what_is_posed() {
    let posed = |pose: &Pose| pose.placed.deform.pose(&pose.now).positions;
    for which in FILES {
        let scene = of(vec![file(which, 0.6, Vec3::NEG_Z)]);
        let (mut loosest, mut longest) = (1.0_f32, 0.0_f32);
        for frame in 0..60 {
            let (time, previous) = (f64::from(frame) * 0.0217, f64::from(frame - 1) * 0.0217);
            let [now, before] = [(time, previous), (previous, previous)].map(|(t, p)| scene.at(t, p).instances.poses);
            for (now, before) in now.iter().zip(&before) {
                let [here, there] = [now, before].map(posed);
                let exact = Bounds::of(here.iter().copied());
                assert!(now.bounds.contains(&exact), "{which:?} at {time} s: {:?} holds not {exact:?}", now.bounds);
                let way = here.iter().zip(&there).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
                assert!(now.step >= 0.9999 * way, "{which:?} at {time} s: {} is less than {way}", now.step);
                loosest = loosest.max((now.bounds.max - now.bounds.min).length() / (exact.max - exact.min).length());
                longest = longest.max(if way > 0.0 { now.step / way } else { 1.0 });
            }
        }
        println!("{which:?}: boxes at most {loosest:.3} times as large, ways at most {longest:.3} times as long");
        assert!(loosest < 1.8 && longest < 2.0, "{which:?}: {loosest}, {longest}");
    }
}

/// Groups of tiles in a row, which change places: groups that were side by side come to lie far apart.
fn shuffled() -> Object {
    let still = growing(Vec3::NEG_Z);
    let mut mesh = Mesh::default();
    let mut moves = Vec::new();
    for tile in 0..512_u32 {
        let (group, within) = (tile / 8, tile % 8);
        let at = |group: u32| vec3(group as f32 * 0.4 + within as f32 * 0.01, 0.0, 0.0);
        let corners = [Vec3::ZERO, vec3(0.008, 0.0, 0.0), vec3(0.0, 0.008, 0.0)];
        mesh.triangles.push([3 * tile, 3 * tile + 1, 3 * tile + 2]);
        mesh.positions.extend(corners.map(|corner| corner + at(group)));
        // to the place whose number has the six bits of its own in reverse
        moves.extend([at(group.reverse_bits() >> 26) - at(group); 3]);
    }
    (mesh.normals, mesh.materials) = (vec![Vec3::Z; mesh.positions.len()], vec![0; mesh.triangles.len()]);
    let (positions, normals) = (mesh.positions.clone(), mesh.normals.clone());
    let targets = vec![Target { positions: moves, normals: vec![] }];
    mesh.deform = Some(Arc::new(Deform { positions, normals, targets, ..Deform::default() }));
    let weights = Weights { node: 0, join: Join::Linear, times: vec![0.0, 1.0], values: vec![0.0, 1.0] };
    let mut model = Model { meshes: vec![Arc::new(mesh)], ..Model::clone(&still.model) };
    model.rig.clips = vec![Clip { weights: [weights].into(), hold: true, ..Clip::default() }];
    Object { model: Arc::new(model), ..still }
}

#[test]
fn a_tree_that_has_become_costly_is_built_anew() {
    validated(|gpu| {
        let mut tables = Tables::new(gpu, of(vec![shuffled()]));
        let mut rebuilds = Vec::new();
        let mut previous = 0.0;
        for time in [0.0, 0.01, 1.0, 1.0, 0.99] {
            tables.follow(time, previous, FrameOptions::default()).expect("runs");
            tables.check(time, previous, "tiles");
            rebuilds.push(tables.buffers.deform().expect("deforms").rebuilds());
            previous = time;
        }
        println!("rebuilds: {rebuilds:?}");
        assert_eq!(rebuilds, [0, 0, 1, 1, 1]);
        // It is as cheap as one that was made for this shape.
        let cost = |packed: &PackedScene| {
            let area = |node: &BvhNode| Bounds { min: node.min, max: node.max }.half_area();
            let root = packed.deforming[0].root as usize;
            let nodes = &packed.nodes[root..][..packed.deforming[0].nodes.len()];
            nodes.iter().map(area).sum::<f32>() / area(&nodes[0])
        };
        tables.follow(1.0, 1.0, FrameOptions::default()).expect("runs");
        let renewed = cost(&tables.packed());
        let kept = cost(&patched(&tables.scene.packed, &tables.state(1.0, 1.0).poses));
        println!("cost {renewed:.1}, fitted {kept:.1}");
        assert!(renewed < 0.5 * kept, "{renewed} of {kept}");
    });
}

/// The model as it stands at a time, without anything that moves it.
fn frozen(scene: &Scene, object: &Object, time: f64) -> Object {
    let mut model = Model::clone(&object.model);
    for pose in &scene.at(time, time).instances.poses {
        let mesh = Arc::make_mut(&mut model.meshes[pose.placed.mesh]);
        let patch = pose.patch();
        mesh.positions = pose.placed.deform.pose(&pose.now).positions;
        mesh.normals = patch.vertices.iter().map(|vertex| vertex.normal).collect();
        mesh.tangents = patch.vertices.iter().map(|vertex| vertex.tangent).collect();
    }
    model.meshes.iter_mut().for_each(|mesh| Arc::make_mut(mesh).deform = None);
    Object { model: Arc::new(model), ..object.clone() }
}

#[test]
fn pictures_show_what_is_posed() {
    validated(|gpu| {
        let object = file(FILES[1], 1.2, vec3(0.0, -0.6, -1.4));
        let moving = of(vec![object.clone()]);
        let copy = of(vec![frozen(&moving, &object, 0.6)]);
        let picture = |scene: &Scene, renderer: &mut Renderer| {
            for time in [0.2, 0.6, 0.6] {
                renderer.render(scene, time).expect("renders");
            }
            aov(renderer, "position")
        };
        let set = options(Method::Iprt, &[]);
        let of = |scene: &Scene| picture(scene, &mut Renderer::new(gpu, scene, set.clone()).expect("fits"));
        let apart = |a: &[f32; 4], b: &[f32; 4]| (0..3).any(|axis| (a[axis] - b[axis]).abs() > 2e-3);
        let differs = |a: &Texels, b: &Texels| a.iter().zip(b).filter(|(a, b)| apart(a, b)).count();
        let truth = of(&copy);
        let apart = differs(&of(&moving), &truth);
        assert!(apart <= 2, "{apart} of {} pixels", truth.len());
        #[cfg(feature = "faults")]
        {
            let fault = iprt::passes::fault::Fault::OneJoint;
            let mut faulty = Renderer::with_fault(gpu, &moving, set.clone(), fault).expect("fits");
            let apart = differs(&picture(&moving, &mut faulty), &truth);
            println!("{apart} pixels with {fault:?}");
            assert!(apart > 40, "{apart} pixels with {fault:?}");
        }
    });
}
