//! The plan: what it leaves out cannot be seen and would cost something; what it keeps is seen where it is missing. For each of its
//! parts, in the built-in rooms and in scenes made for it.

use crate::common::*;
use glam::{Vec3, vec3};
use iprt::{
    gpu::{Gpu, Timings},
    image_file::write::display_code,
    measure::{
        metrics::{Picture, flip_map},
        regions::regions,
    },
    options::RenderOptions,
    panorama::source::{PanoramaFrame, PanoramaSource},
    plan::{By, Part, Plan},
    reference::capture::{CaptureSettings, room_frames},
    renderer::Renderer,
    scene::{
        Scene,
        animation::Track,
        file::RenderSettings,
        rooms::{NAMES, Video, by_name},
    },
    settings::Method,
};

/// FLIP of a region, and 99th percentile of its pixels' largest channel difference in 8-bit steps, at which a change is seen.
const SEEN: (f64, u8) = (0.002, 2);
/// FLIP of two pictures that differ in their random numbers.
const NOISE: f64 = 0.08;

struct Case {
    name: &'static str,
    scene: Scene,
    options: RenderOptions,
    times: Vec<f64>,
    /// Whether the plan is told that there are no more frames than these.
    told: bool,
    /// The parts to prove, where not all.
    only: Option<Vec<Part>>,
}

/// A renderer after all frames of a case, with what its first frame dispatched.
struct Rendered {
    renderer: Renderer,
    picture: Texels,
    first: Timings,
    bytes: u64,
}

impl Case {
    fn new(name: &'static str, scene: Scene, times: &[f64]) -> Self {
        let set = [("relight_width", "64")];
        Self { name, scene, options: options(Method::Iprt, &set), times: times.to_vec(), told: false, only: None }
    }

    fn plan(&self) -> Plan {
        let frames = self.told.then_some(self.times.len() as u32);
        Plan::of(&self.scene, &self.options, frames).expect("a plan")
    }

    fn render(&self, gpu: &Gpu, plan: Plan) -> Rendered {
        let before = gpu.device_bytes();
        let mut renderer = Renderer::with_plan(gpu, &self.scene, self.options.clone(), plan).expect("fits");
        let timings: Vec<_> =
            self.times.iter().map(|time| renderer.render(&self.scene, *time).expect("renders")).collect();
        let picture = aov(&renderer, "radiance");
        Rendered { renderer, picture, first: timings[0].clone(), bytes: gpu.device_bytes() - before }
    }
}

/// The regions of the metrics that hold any pixel: whole, virtual, influenced.
fn regions_of(case: &Case, base: &Rendered, empty: &Rendered) -> Vec<Vec<bool>> {
    let whole = vec![true; base.picture.len()];
    let coverage = match base.renderer.plan().on(Part::VirtualSurfaces) {
        true => aov(&base.renderer, "real_coverage").iter().map(|m| m[0]).collect(),
        false => vec![1.0; base.picture.len()],
    };
    let found = regions(case.options.size, &base.picture, &empty.picture, &coverage);
    [whole, found.virtual_, found.influenced].into_iter().filter(|mask| mask.contains(&true)).collect()
}

/// The largest FLIP over the regions, and their largest 99th percentile of pixels' differences, in 8-bit steps.
fn change(size: [u32; 2], a: &Texels, b: &Texels, regions: &[Vec<bool>]) -> (f64, u8) {
    let picture = |texels| Picture { subject: "test", size, texels };
    let flip = flip_map(picture(a), picture(b), 1.0).expect("comparable");
    let code = |texel: &[f32; 4]| [0, 1, 2].map(|c| display_code(texel[c]));
    let (mut largest, mut steps) = (0.0f64, 0);
    for mask in regions {
        let inside: Vec<usize> = (0..mask.len()).filter(|i| mask[*i]).collect();
        largest = largest.max(inside.iter().map(|i| f64::from(flip[*i])).sum::<f64>() / inside.len() as f64);
        let difference = |i: &usize| (0..3).map(|c| code(&a[*i])[c].abs_diff(code(&b[*i])[c])).max().unwrap_or(0);
        let mut differences: Vec<u8> = inside.iter().map(difference).collect();
        differences.sort_unstable();
        steps = steps.max(differences[(differences.len() - 1) * 99 / 100]);
    }
    (largest, steps)
}

/// What cases before have shown.
#[derive(Default)]
struct Shown {
    /// Kept, so that pipelines are shared.
    renderers: Vec<Renderer>,
    /// Parts that were on and seen missing, and parts that were off and not seen. Forcing a part costs seconds of
    /// compiling, so cases that try all parts try only those that are not here.
    parts: [Vec<Part>; 2],
}

/// Forces each part that the scene decides on the other way, and compares. Returns the parts found on and off.
fn prove(gpu: &Gpu, case: &Case, shown: &mut Shown) -> [Vec<Part>; 2] {
    let base = case.render(gpu, case.plan());
    let plan = base.renderer.plan().clone();
    println!("{}\n{}", case.name, plan.table().expect("a table"));
    let mut off = plan.with(&plan.settings);
    let objects = &plan.parts[0];
    if objects.on {
        off = plan.flipped(objects).expect("a setting");
    }
    let regions = regions_of(case, &base, &case.render(gpu, off));
    let mut found = [vec![], vec![]];
    let wanted = |part| case.only.as_ref().is_none_or(|only| only.contains(&part));
    for decision in plan.parts.iter().filter(|decision| decision.by == By::Scene && wanted(decision.part)) {
        let (name, part) = (decision.part.name(), decision.part);
        let at = usize::from(!decision.on);
        if (case.only.is_none() || !decision.on) && shown.parts[at].contains(&part) {
            found[at].push(part);
            continue;
        }
        let other = case.render(gpu, plan.flipped(decision).expect("a setting"));
        let (flip, steps) = change(case.options.size, &base.picture, &other.picture, &regions);
        let dispatched = |r: &Rendered| r.first.entries.iter().filter(|entry| entry.pass() != "upload").count();
        let code = |r: &Rendered| r.renderer.plan().code().count();
        println!(
            "  {name} forced {}: FLIP {flip:.4}, {steps}/255, dispatches {} to {}, bytes {} to {}",
            if decision.on { "off" } else { "on" },
            dispatched(&base),
            dispatched(&other),
            base.bytes,
            other.bytes
        );
        // In a video, lamps may hang free in any frame. What moves in a room need not be seen in a mirror.
        let unseen = part == Part::Reflections && case.only.is_none();
        let may_come = unseen || part == Part::FreeLamps && case.scene.panorama.frame_count() > 1;
        let case = case.name;
        if decision.on {
            assert!(flip > SEEN.0 || may_come, "{case}: {name} is on, but nobody sees it missing: FLIP {flip}");
            found[0].push(part);
            shown.parts[0].push(part);
        } else {
            // a single code is rounding, as of light that is kept in brief
            // Lobes and emitters that are compiled in draw other random numbers.
            let drawing = [
                Part::Emitters,
                Part::Alpha,
                Part::Transmission,
                Part::Clearcoat,
                Part::Sheen,
                Part::Anisotropy,
                Part::Iridescence,
            ];
            let noise = drawing.contains(&part) && flip <= NOISE;
            let same = noise || steps <= 1 || (flip <= SEEN.0 && steps <= SEEN.1);
            assert!(same, "{case}: {name} is off, but would be seen: {flip}, {steps}/255");
            assert_eq!(other.renderer.plan().parts.iter().find(|d| d.part == part).map(|d| d.on), Some(true));
            assert!(
                dispatched(&other) >= dispatched(&base) && other.bytes >= base.bytes,
                "{case}: {name} saves something"
            );
            // Frames in memory are no codes, of which something could be made.
            let more = dispatched(&other) > dispatched(&base)
                || other.bytes > base.bytes
                || code(&other) > code(&base)
                || part == Part::Ingest;
            assert!(more, "{case}: {name} is off, but would cost nothing");
            found[1].push(part);
            shown.parts[1].push(part);
        }
        shown.renderers.push(other.renderer);
    }
    shown.renderers.push(base.renderer);
    found
}

#[test]
fn in_the_built_in_rooms_the_plan_is_right() {
    validated(|gpu| {
        let mut shown = Shown::default();
        for name in NAMES {
            let mut room = by_name(name).expect("a built-in room");
            let size = [128, 64];
            room.video = room.video.map(|video| Video { size, ..video });
            let settings = CaptureSettings { size, samples: 2, progress: false, ..Default::default() };
            let frames = room_frames(gpu, &room, &settings, None).expect("captures");
            let fps = room.video.map_or(30.0, |video| video.fps);
            let panorama = PanoramaSource::from_frames(frames, fps, room.capture_position, 0.0).expect("frames");
            let (camera, objects) = (room.camera.clone(), room.objects.clone());
            let scene = Scene::assemble(name, panorama, camera, objects, RenderSettings::default()).expect("packs");
            let mut case = Case::new(name, scene, &[0.0, 0.3, 0.6, 1.0]);
            case.options.size = [96, 54];
            let [on, off] = prove(gpu, &case, &mut shown);
            assert!(on.len() >= 10 && !off.is_empty(), "{name}: {on:?} {off:?}");
        }
    });
}

/// A small room with a bright window, or of nearly even light.
fn lit_room(window: f32) -> PanoramaFrame {
    room([128, 64], vec3(4.0, 3.0, 5.0), Vec3::ZERO, |d| {
        let lamp = d.dot(vec3(-0.5, 0.4, -0.8).normalize()) > 0.97;
        (if lamp { window } else { 0.7 }) * Vec3::ONE + 0.03 * colourful(d)
    })
}

/// A dim room that a bulb lights, 1.1 m from the capture point.
fn room_with_a_bulb() -> PanoramaFrame {
    let towards = vec3(0.3, 0.15, -0.9).normalize();
    let bulb = |d: Vec3| d.dot(towards) > 0.998;
    let dim = |d: Vec3| Vec3::splat(0.05) + 0.02 * colourful(d);
    let mut frame =
        room([128, 64], vec3(4.0, 3.0, 5.0), Vec3::ZERO, |d| if bulb(d) { 40.0 * Vec3::ONE } else { dim(d) });
    for k in 0..128 * 64 {
        if bulb(iprt::panorama::mapping::texel_direction(k % 128, k / 128, [128, 64]).as_vec3()) {
            frame.depth[k as usize] = 1.1;
        }
    }
    frame
}

#[test]
fn in_scenes_made_for_it_the_plan_is_right() {
    validated(|gpu| {
        let look = camera(Vec3::ZERO, vec3(0.1, -0.8, -1.5), 50.0);
        let hovering = vec3(0.1, -1.12, -1.4);
        let still = [0.0; 6]; // longer than short_history
        let mut shown = Shown::default();
        let mut run = |mut case: Case, whole: bool, off: &[Part], on: &[Part]| {
            case.only = (!whole).then(|| [off, on].concat());
            let [is_on, is_off] = prove(gpu, &case, &mut shown);
            for part in off {
                assert!(is_off.contains(part), "{}: {part:?} is not off by the scene", case.name);
            }
            for part in on {
                assert!(is_on.contains(part), "{}: {part:?} is not on by the scene", case.name);
            }
        };

        let diffuse = || scene(lit_room(0.7), look.clone(), vec![ball(0.3, lambert(0.6), hovering)]);
        let none = [
            Part::OffCentre,
            Part::Video,
            Part::RadiancePyramid,
            Part::FreeLamps,
            Part::Emission,
            Part::Textures,
            Part::Alpha,
            Part::Motion,
            Part::Reflections,
            Part::Interpolate,
        ];
        let of_diffuse = [&none[..], &[Part::LightTable, Part::Specular, Part::Bounces]].concat();
        run(Case::new("one diffuse object", diffuse(), &still), true, &of_diffuse, &[Part::Relight, Part::RealTracer]);

        let single = Case { told: true, ..Case::new("one diffuse object, one frame", diffuse(), &[0.0]) };
        run(single, false, &[Part::Temporal, Part::SamplingMask], &[Part::Atrous]);

        let mirror = object(iprt::scene::shapes::Shape::Box.mesh(vec3(0.4, 0.3, 0.02)), metal(0.0), hovering);
        let away = camera(vec3(0.4, 0.1, 0.3), hovering, 40.0);
        let mirror = scene(lit_room(30.0), away, vec![mirror]);
        run(
            Case::new("a small mirror, seen from elsewhere", mirror, &still),
            true,
            &[
                Part::Bounces,
                Part::Emission,
                Part::Transmission,
                Part::Clearcoat,
                Part::Sheen,
                Part::Anisotropy,
                Part::Iridescence,
            ],
            &[Part::OffCentre, Part::Specular, Part::LightTable],
        );

        let mirror = object(iprt::scene::shapes::Shape::Box.mesh(vec3(0.8, 0.6, 0.02)), metal(0.0), hovering);
        let mut passing = camera(Vec3::ZERO, hovering, 40.0);
        passing.position = Track::from_keys(vec![(0.0, vec3(-0.3, 0.1, 0.3)), (1.0, vec3(0.3, 0.1, 0.3))], Vec3::ZERO);
        let mirror = scene(lit_room(30.0), passing, vec![mirror]);
        let times = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0];
        run(Case::new("a mirror that the camera passes", mirror, &times), false, &[Part::Motion], &[Part::Reflections]);

        let bulb = scene(room_with_a_bulb(), look.clone(), vec![ball(0.3, lambert(0.6), hovering)]);
        run(Case::new("a bulb", bulb, &still), false, &[], &[Part::FreeLamps]);

        let fine = room([512, 256], vec3(4.0, 3.0, 5.0), Vec3::ZERO, |d| {
            Vec3::splat(0.5 + 0.4 * (150.0 * d.x).sin() * (140.0 * d.y).sin())
        });
        let nothing = scene(fine, look.clone(), vec![]);
        let plan = Case::new("nothing inserted", nothing.clone(), &still);
        assert_eq!(
            plan.plan().passes().iter().filter(|pass| pass.dispatches > 0).map(|pass| pass.name).collect::<Vec<_>>(),
            ["radiance_pyramid", "gbuffer", "composite"]
        );
        run(plan, true, &[Part::Objects, Part::OffCentre, Part::Video], &[Part::RadiancePyramid]);

        let behind = ball(0.4, lambert(0.2), vec3(0.1, -0.9, 0.6));
        let down = camera(Vec3::ZERO, vec3(0.1, -1.5, -0.7), 40.0);
        let unseen = scene(lit_room(30.0), down, vec![behind]);
        run(Case::new("a caster off screen", unseen, &still), false, &[Part::VirtualSurfaces], &[Part::Objects]);

        // A ball of each material that has a part of its own, besides a half-transparent one.
        use iprt::scene::material::{Alpha, Material};
        let white = || Material::plain("white", Vec3::splat(0.8), 0.3);
        let materials = [
            Material { alpha_mode: Alpha::Blend, alpha: 0.4, ..white() },
            Material { transmission: 1.0, thickness: 1.0, roughness: 0.0, ..white() },
            Material { clearcoat: 1.0, base_color: Vec3::splat(0.02), roughness: 0.9, ..white() },
            Material { sheen_color: Vec3::ONE, sheen_roughness: 0.4, base_color: Vec3::splat(0.02), ..white() },
            Material { anisotropy: 1.0, roughness: 0.2, ..metal(0.2) },
            Material { iridescence: 1.0, base_color: Vec3::splat(0.02), roughness: 0.1, ..white() },
        ];
        let balls = materials.into_iter().enumerate().map(|(k, material)| {
            ball(0.24, material, vec3(0.55 * (k % 3) as f32 - 0.55, 0.25 - 0.5 * (k / 3) as f32, -1.5))
        });
        let varied = scene(lit_room(30.0), camera(Vec3::ZERO, Vec3::NEG_Z, 50.0), balls.collect());
        let parts =
            [Part::Alpha, Part::Transmission, Part::Clearcoat, Part::Sheen, Part::Anisotropy, Part::Iridescence];
        run(Case::new("a ball of each material", varied, &still), false, &[Part::Textures], &parts);

        let lit = scene(lit_room(0.7), look.clone(), vec![light(Vec3::splat(0.5), vec3(0.1, 0.2, -1.4))]);
        run(Case::new("a light alone", lit, &still), false, &[Part::VirtualSurfaces], &[Part::Objects, Part::Punctual]);

        let growing = scene(lit_room(3.0), look.clone(), vec![growing(hovering)]);
        let times = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0];
        run(Case::new("a box that grows", growing, &times), false, &[], &[Part::Deformation, Part::Motion]);

        let far = surroundings([64, 32], |_| 0.0, |d| 0.3 + 0.7 * colourful(d) * d.y.max(0.0));
        let shiny = ball(0.4, metal(0.3), vec3(0.0, -0.3, -1.5));
        run(
            Case::new("an infinitely far panorama", scene(far, look, vec![shiny]), &still),
            false,
            &[Part::RealTracer, Part::Relight],
            &[Part::Specular],
        );
    });
}

#[test]
fn what_is_left_out_is_named_where_it_is_asked_for() {
    validated(|gpu| {
        let things = vec![ball(0.3, lambert(0.6), vec3(0.1, -0.2, -1.4))];
        let case = Case::new("", scene(lit_room(3.0), camera(Vec3::ZERO, Vec3::NEG_Z, 60.0), things), &[0.0]);
        let Rendered { renderer, .. } = case.render(gpu, case.plan());
        for (name, words) in [
            ("radiance_specular", ["specular is off: all materials are pure Lambert", "--set specular=on"]),
            ("a_virtual_", ["there is no image", "a_virtual"]),
            ("emission", ["emission is off: nothing shines", "--set emission=on"]),
            ("accumulated_rest_virtual", ["specular is off", "--set objects=on --set specular=on"]),
        ] {
            let error = renderer.aov(name).expect_err("left out").to_string();
            assert!(words.iter().all(|word| error.contains(word)), "{error}");
            assert!(!renderer.aov_names().contains(&name.to_owned()));
        }
        for name in renderer.aov_names() {
            aov(&renderer, &name);
        }
        let empty = RenderOptions { without_objects: true, ..case.options.clone() };
        let error = rendered(gpu, &case.scene, empty, 1)
            .aov("accumulated_without_objects_real")
            .expect_err("left out")
            .to_string();
        assert!(error.contains("objects is off: 0 meshes are inserted"), "{error}");
    });
}

#[test]
fn settings_given_win_and_plans_compare() {
    let things = || vec![ball(0.3, lambert(0.6), vec3(0.1, -0.2, -1.4))];
    let track = camera(Vec3::ZERO, Vec3::NEG_Z, 60.0);
    let plan = |things, set: &[(&str, &str)]| {
        let scene = scene(lit_room(3.0), track.clone(), things);
        Plan::of(&scene, &options(Method::Iprt, set), None).expect("a plan")
    };
    let base = plan(things(), &[]);
    assert_eq!(base, plan(things(), &[]));
    assert_eq!(base.settings.bounces, 1, "a convex object alone");
    for (set, part) in [("bounces", Part::Bounces), ("specular", Part::Specular), ("relight_levels", Part::Relight)] {
        for on in [false, true] {
            let value = if on { part.value_on(Method::Iprt) } else { part.row().off.to_owned() };
            let forced = plan(things(), &[(set, &value)]);
            assert!(forced.on(part) == on && forced.parts.iter().any(|d| d.part == part && d.by == By::Set), "{set}");
            assert_eq!(forced == base, base.on(part) == on, "{set}={value}");
        }
        let auto = if part == Part::Specular { plan(things(), &[(set, "auto")]) } else { plan(things(), &[]) };
        assert!(auto == base);
    }
    // another object dropped in asks for another renderer, one that is only moved aside does not
    let shining = object(iprt::scene::shapes::Shape::Box.mesh(Vec3::splat(0.2)), metal(0.5), vec3(0.5, 0.0, -1.4));
    assert!(plan([things(), vec![shining]].concat(), &[]) != base);
    assert!(plan(vec![ball(0.3, lambert(0.6), vec3(0.15, -0.2, -1.4))], &[]) == base);
}

#[test]
fn a_plan_for_a_window_allows_for_all_that_a_user_can_move() {
    let placed = |eye: Vec3, ball_at: Vec3| {
        let things = vec![ball(0.3, lambert(0.6), ball_at)];
        scene(lit_room(3.0), camera(eye, vec3(0.1, -0.2, -1.4), 40.0), things)
    };
    // The still camera at the capture point looks away from the one still object, which nothing comes near.
    let (still, moved) = (placed(Vec3::ZERO, vec3(0.1, -0.9, 0.6)), placed(vec3(0.4, 0.1, 0.3), vec3(0.1, -0.2, -1.4)));
    let with = |size, set: &[(&str, &str)]| RenderOptions { size, ..options(Method::Iprt, set) };
    let options = with([256, 144], &[]);
    let offline = Plan::of(&still, &options, None).expect("a plan");
    let window = Plan::interactive(&still, &options, 16.0).expect("a plan");
    for part in [Part::VirtualSurfaces, Part::OffCentre, Part::Motion, Part::Bounces] {
        assert!(!offline.on(part), "{}", offline.reason(part));
        assert!(window.on(part), "{}", window.reason(part));
    }
    assert!(window.looks_up(), "the camera may come back to the capture point");
    assert!(Plan::interactive(&moved, &options, 16.0).expect("a plan") == window, "no other renderer after a move");
    let needed = Plan::of(&still, &with([16, 9], &[]), None).expect("a plan").color_levels();
    assert!(needed > offline.color_levels() && window.color_levels() >= needed, "smaller pictures are coarser");
    let given = Plan::interactive(&still, &with([256, 144], &[("bounces", "1")]), 16.0).expect("a plan");
    assert!(!given.on(Part::Bounces), "what a user sets wins");
}
