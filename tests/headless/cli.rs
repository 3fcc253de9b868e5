//! The program as users run it: exit codes, one clear line on stderr, files that are what was asked for, no panic.

use crate::folder::{Folder, SCENE};
use std::path::Path;

/// What there is in a folder beside the scene's own files.
fn others(folder: &Folder) -> Vec<String> {
    let files = folder.root().read_dir().expect("readable");
    let names = files.map(|f| f.expect("readable").file_name().to_string_lossy().into_owned());
    names.filter(|name| name != "scene.toml" && name != "room.png").collect()
}

#[test]
fn what_the_user_got_wrong_is_told_in_one_line() {
    let folder = Folder::with_scene();
    for (arguments, words) in [
        ("render nowhere.toml -o a.png", &["nowhere.toml"][..]),
        ("render scene.toml -o a.png --set sampling_msk=true", &["sampling_msk", "did you mean \"sampling_mask\""]),
        ("render scene.toml -o a.png --set history=-3", &["history", "-3", "1 to inf"]),
        ("render scene.toml -o a.png --set history=many", &["history", "many"]),
        ("render scene.toml -o a.png --set history=NaN", &["history", "NaN"]),
        ("render scene.toml -o a.png --set history", &["--set", "key=value"]),
        ("render scene.toml -o a.png --size 12by9", &["--size", "12by9"]),
        ("render scene.toml -o a.png --size 0x0", &["size", "0"]),
        ("render scene.toml -o a.png --size 99999x4", &["size", "16384"]),
        ("render scene.toml -o a.png --method magic", &["--method", "magic", "iprt"]),
        ("render scene.toml -o a.png --projection fisheye", &["--projection", "fisheye"]),
        ("render scene.toml -o a.png --exposure 0", &["--exposure"]),
        ("render scene.toml -o missing/a.png", &["missing/a.png", "folder"]),
        ("render scene.toml -o a.png --frames 0..1", &["a.png", "pattern"]),
        ("render scene.toml -o a_%02d.png --frames 3..1", &["--frames", "3..1"]),
        ("render scene.toml -o a.exr --aov depth", &["--aov", "depth", "position_real"]),
        ("render scene.toml -o a.png --aov all", &["--aov", "exr"]),
        ("render scene.toml -o a.jpg", &["a.jpg", ".png", ".exr"]),
        ("bench scene.toml --json missing/b.json", &["missing/b.json"]),
        ("bench scene.toml --frames x", &["--frames"]),
        ("check nowhere.toml", &["nowhere.toml"]),
        ("plan nowhere.toml", &["nowhere.toml"]),
        ("plan scene.toml --json missing/p.json", &["missing/p.json"]),
        ("plan scene.toml --set specular=maybe", &["specular", "maybe", "auto, on, off"]),
        ("render scene.toml -o a.exr --aov emission", &["emission is off: nothing shines", "--set emission=on"]),
        ("masks nowhere.toml -o m", &["nowhere.toml"]),
        ("masks scene.toml -o m --without-objects", &["--without-objects"]),
        ("masks scene.toml -o m --frame 0..2", &["--frame", "0..2"]),
        ("masks scene.toml -o room.png", &["room.png"]),
        ("scene export attic -o m", &["attic", "apartment, bedroom, gallery"]),
        ("scene export bedroom -o .", &["empty"]),
    ] {
        folder.fails_by(arguments, 2, words);
    }
    for arguments in
        ["render scene.toml -o a.png --sise 4x4", "rander", "render scene.toml", "render -o a.png --seed x"]
    {
        let output = folder.run(arguments);
        assert_eq!(output.status.code(), Some(2), "iprt {arguments}");
        assert!(!output.stderr.is_empty() && output.stdout.is_empty(), "iprt {arguments}");
    }
    assert!(others(&folder).is_empty(), "nothing is left behind: {:?}", others(&folder));
}

#[test]
fn a_device_that_is_not_there_is_another_kind_of_error() {
    let folder = Folder::with_scene();
    folder.fails_by("render scene.toml -o a.png --device nonexistent", 3, &["nonexistent"]);
    folder.fails_by("bench scene.toml --device 99", 3, &["99"]);
    assert!(others(&folder).is_empty());
}

#[test]
fn pictures_have_the_size_and_layers_asked_for() {
    let folder = Folder::with_scene();
    let printed = folder.succeeds("render scene.toml -o a.png --warmup 1 --validation");
    assert_eq!(printed.trim(), "a.png");
    let picture = image::open(folder.path("a.png")).expect("a PNG");
    assert_eq!((picture.width(), picture.height()), (40, 30), "the scene's own size");

    folder.succeeds("render scene.toml -o a.exr --size 24x17 --warmup 1 --aov all --projection equirect -q");
    let mut names = vec![];
    let file = exr::prelude::read_all_flat_layers_from_file(folder.path("a.exr"));
    for layer in file.expect("an EXR").layer_data {
        assert_eq!((layer.size.0, layer.size.1), (24, 17));
        let name = layer.attributes.layer_name.map(|name| name.to_string()).unwrap_or_default();
        for channel in &layer.channel_data.list {
            names.push(format!("{name}.{}", channel.name));
            let finite = channel.sample_data.values_as_f32().all(f32::is_finite);
            assert!(finite, "{name}.{} is finite", channel.name);
        }
    }
    for wanted in
        ["irradiance_real", "irradiance_mixed", "camera_radiance", "real_coverage", "motion_virtual", "object_id"]
    {
        assert!(names.iter().any(|name| name.contains(wanted)), "{wanted} is among {names:?}");
    }

    folder.succeeds("render scene.toml -o b_%03d.png --frames 2..3 --warmup 0 --size 9x7 -q --without-objects");
    for name in ["b_002.png", "b_003.png"] {
        let picture = image::open(folder.path(name)).expect("a PNG");
        assert_eq!((picture.width(), picture.height()), (9, 7));
    }
    // a picture that is there is replaced whole
    folder.succeeds("render scene.toml -o a.png --size 1x1 --warmup 0 -q");
    assert_eq!(image::open(folder.path("a.png")).expect("a PNG").width(), 1);
    let mut left = others(&folder);
    left.sort();
    assert_eq!(left, ["a.exr", "a.png", "b_002.png", "b_003.png"]);
}

#[test]
fn light_beyond_white_is_mapped_as_asked() {
    use iprt::image_file::{read, tonemap::Tonemap, write::display_code};
    let folder = Folder::with_scene();
    folder.succeeds("render -q scene.toml -o linear.exr --warmup 0 --without-objects");
    let linear = read::read(&folder.path("linear.exr")).expect("readable").into_color("linear.exr").expect("a picture");
    let mut seen = Vec::new();
    for (flags, map) in [("", Tonemap::Clip), (" --tonemap neutral", Tonemap::Neutral)] {
        folder.succeeds(&format!("render -q scene.toml -o shown.png --warmup 0 --without-objects --exposure 3{flags}"));
        let shown = image::open(folder.path("shown.png")).expect("readable").to_rgb8().into_raw();
        let right = linear
            .texels
            .iter()
            .flat_map(|texel| map.map(3.0 * glam::Vec3::from_slice(&texel[..3])).to_array().map(display_code));
        assert!(shown.iter().zip(right).all(|(a, b)| a.abs_diff(b) <= 1), "{map:?}");
        let stream = folder.run(&format!(
            "render -q scene.toml -o - --pix-fmt rgb24 --frames 0..0 --warmup 0 --without-objects --exposure 3{flags}"
        ));
        assert!(shown.iter().zip(&stream.stdout).all(|(a, b)| a.abs_diff(*b) <= 1), "{map:?} as a stream");
        seen.push(shown);
    }
    let white = |codes: &[u8]| codes.iter().filter(|code| **code == 255).count();
    assert!(white(&seen[0]) > 50 && white(&seen[1]) == 0, "{} and {}", white(&seen[0]), white(&seen[1]));
    // The scene file can say it, and a command goes before it.
    folder.write("neutral.toml", &format!("{}\n[render]\ntonemap = \"neutral\"\n", crate::folder::SCENE));
    folder.succeeds("render -q neutral.toml -o said.png --warmup 0 --without-objects --exposure 3");
    assert_eq!(image::open(folder.path("said.png")).expect("readable").to_rgb8().into_raw(), seen[1]);
}

#[test]
fn a_panorama_is_reduced_when_asked() {
    let folder = Folder::with_scene();
    let size = |flags: &str| {
        let report = folder.succeeds(&format!("check scene.toml --json -q {flags}"));
        let report: serde_json::Value = serde_json::from_str(&report).expect("JSON");
        report["color"]["size"].clone()
    };
    assert_eq!(size(""), serde_json::json!([64, 32]));
    assert_eq!(size("--panorama-size 16"), serde_json::json!([16, 8]));
    assert_eq!(size("--panorama-size 4096"), serde_json::json!([64, 32]), "none is made larger");
    // A pixel is one of the file's picture, however large the panorama is.
    let ball = "[[object]]\nshape = \"sphere\"\nsize = 0.2\nplace = { pixel = [50, 20] }\n";
    folder.write("placed.toml", &format!("[panorama]\ncolor = \"room.png\"\ndepth = {{ box = [4, 3, 5] }}\n{ball}"));
    let place = |flags: &str| {
        let report = folder.succeeds(&format!("check placed.toml --json -q {flags}"));
        let report: serde_json::Value = serde_json::from_str(&report).expect("JSON");
        report["objects"][0]["center"]
            .as_array()
            .expect("three")
            .iter()
            .map(|x| x.as_f64().expect("a number"))
            .collect::<Vec<_>>()
    };
    let apart = place("").iter().zip(place("--panorama-size 32")).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(apart < 0.3, "{apart} m");
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(path).expect("written")).expect("JSON")
}

#[test]
fn bench_writes_its_schema() {
    let folder = Folder::with_scene();
    let files = "--json b.json --csv b.csv --trace b.trace";
    let table = folder.succeeds(&format!("bench scene.toml --size 160x120 --frames 0..4 --warmup 2 -q {files}"));
    let report = json(&folder.path("b.json"));
    let object = report.as_object().expect("an object");
    for key in ["device", "driver", "scene", "method"] {
        assert!(object[key].as_str().is_some_and(|text| !text.is_empty()), "{key}");
    }
    assert_eq!(
        (&report["size"], &report["frames"], &report["warmup"]),
        (&serde_json::json!([160, 120]), &5.into(), &2.into())
    );
    assert!(report["settings"].get("rays_per_pixel").is_some());
    assert!(report["memory"]["device_bytes"].as_u64().expect("a number") > 1 << 20);
    let passes = report["passes"].as_array().expect("an array");
    let names: Vec<_> = passes.iter().map(|pass| pass["name"].as_str().expect("a name")).collect();
    assert_eq!(
        names,
        [
            "deform",
            "acceleration",
            "ingest",
            "radiance_pyramid",
            "normals",
            "depth_pyramid",
            "light_table",
            "relight",
            "gbuffer",
            "sampling_mask",
            "irradiance",
            "interpolate",
            "temporal",
            "atrous",
            "composite",
        ]
    );
    for pass in passes {
        let time = |key: &str| pass[key].as_f64().expect("a number");
        assert!(table.contains(pass["name"].as_str().expect("a name")));
        match pass["off"].as_str() {
            Some(reason) => assert!(!reason.is_empty() && time("median_ms") == 0.0 && time("max_ms") == 0.0, "{pass}"),
            None => {
                assert!(pass["off"].is_null(), "{pass}");
                assert!(0.0 < time("min_ms") && time("min_ms") <= time("median_ms"), "{pass}");
                assert!(time("median_ms") <= time("p95_ms") && time("p95_ms") <= time("max_ms"), "{pass}");
            }
        }
        // everything stands still, and the panorama is nowhere finer than the picture; what is not traced has a
        // history
        let idle = [
            "deform",
            "acceleration",
            "ingest",
            "radiance_pyramid",
            "normals",
            "depth_pyramid",
            "light_table",
            "gbuffer",
            "interpolate",
        ];
        let once = idle.contains(&pass["name"].as_str().expect("a name"));
        assert_eq!(pass["off"].is_string(), once, "{pass}");
    }
    let frame = &report["frame"];
    for key in ["gpu_median_ms", "gpu_p95_ms", "wall_median_ms", "wall_p95_ms"] {
        assert!(frame[key].as_f64().expect("a number") > 0.0, "{key}");
    }
    let coverage = frame["coverage"].as_f64().expect("a number");
    // 0.95 and more on a machine of its own. Tests run beside each other, and then the driver's threads wait between passes.
    assert!((0.5..=1.0001).contains(&coverage), "{coverage}");

    let csv = std::fs::read_to_string(folder.path("b.csv")).expect("written");
    let first: Vec<_> = csv.lines().map(|line| line.split(',').next().expect("a column")).collect();
    assert_eq!(first[0], "pass");
    assert_eq!(first[1..=names.len()], names[..]);
    let events = json(&folder.path("b.trace"))["traceEvents"].as_array().expect("events").clone();
    assert!(events.len() > 5 * 8, "{} events", events.len());
    for event in &events {
        assert!(
            event["name"].is_string() && event["ph"] == "X" && event["dur"].as_f64().expect("a number") >= 0.0,
            "{event}"
        );
    }

    // settings that switch passes off are the reason given
    let off = "--set sampling_mask=false --set atrous_levels=0 --set relight_levels=0";
    folder.succeeds(&format!("bench scene.toml --size 32x24 --frames 0..1 --warmup 1 -q --json off.json {off}"));
    let report = json(&folder.path("off.json"));
    for (pass, reason) in [("relight", "relight_levels"), ("interpolate", "sampling_mask"), ("atrous", "atrous_levels")]
    {
        let entry =
            report["passes"].as_array().expect("an array").iter().find(|entry| entry["name"] == pass).expect("listed");
        assert!(entry["off"].as_str().is_some_and(|text| text.contains(reason)), "{entry}");
    }
}

#[test]
fn a_plan_says_what_is_left_out_and_why() {
    let folder = Folder::with_scene();
    let table = folder.succeeds("plan scene.toml --json plan.json -q");
    let report = json(&folder.path("plan.json"));
    let parts = report["parts"].as_array().expect("an array");
    assert_eq!(parts.len(), iprt::plan::Part::ALL.len());
    for part in parts {
        let [name, why] = ["name", "why"].map(|key| part[key].as_str().expect("text"));
        let line = table.lines().find(|line| line.starts_with(&format!("{name} "))).expect("a line of the table");
        assert!(!why.is_empty() && line.ends_with(why), "{line}");
        assert!(line.contains(if part["on"].as_bool().expect("a flag") { " on " } else { " off " }), "{line}");
        // what needs a part that the scene leaves out follows it
        assert!(part["by"] == "scene" || (part["by"] == "need" && why.ends_with(" is off")), "{part}");
    }
    let cost = |report: &serde_json::Value| ["bytes", "dispatches"].map(|key| report[key].as_u64().expect("a number"));
    let [bytes, dispatches] = cost(&report);
    let sum: u64 = report["passes"].as_array().expect("an array").iter().filter_map(|p| p["dispatches"].as_u64()).sum();
    assert_eq!(sum, dispatches);

    folder.succeeds("plan scene.toml --json plan.json -q --without-objects");
    let [least, fewest] = cost(&json(&folder.path("plan.json")));
    assert!(10 * least < bytes && fewest == 2, "{least} bytes of {bytes}, {fewest} dispatches");
    let table = folder.succeeds("plan scene.toml --set atrous_levels=0 --set emission=on --json plan.json -q");
    assert!(table.contains("atrous_levels = 0 was set") && table.contains("emission = on was set"), "{table}");

    // the others say it in a line
    let output = folder.run("render scene.toml -o a.png --warmup 0 --size 8x6");
    let stderr = String::from_utf8_lossy(&output.stderr);
    let lines: Vec<_> = stderr.lines().filter(|line| !line.starts_with("rendering: ")).collect();
    assert!(matches!(lines[..], [line] if line.starts_with("plan: ")), "{stderr}");
    assert!(stderr.contains("without off_centre, video"), "{stderr}");
    assert!(folder.run("render scene.toml -o a.png --warmup 0 --size 8x6 -q").stderr.is_empty());
    let table =
        folder.succeeds("bench scene.toml --size 8x6 --frames 0..0 --warmup 0 -q --without-objects --json b.json");
    // pixels this large need the radiance pyramid
    assert!(table.contains("plan: 1 of"), "{table}");
    let passes = json(&folder.path("b.json"))["passes"].clone();
    let irradiance =
        passes.as_array().expect("an array").iter().find(|pass| pass["name"] == "irradiance").expect("listed");
    assert!(irradiance["off"].as_str().is_some_and(|why| why.contains("objects is off")), "{irradiance}");
}

#[test]
fn check_reports_every_problem() {
    let folder = Folder::with_scene();
    assert!(folder.succeeds("check scene.toml").contains("no problems"));
    // first what the text says, then what the files hold
    let misspelt = SCENE.replace("shape = \"sphere\"", "shape = \"spere\"").replace("[camera]", "[camera]\nfov = 3");
    let lacking = SCENE.replace("room.png", "gone.png").replace("shape = \"sphere\"", "gltf = \"lost.glb\"");
    let lacking = lacking.replace("size = [0.6, 0.6, 0.6]", "");
    for (text, words) in [(misspelt, ["sphere", "fov_y"]), (lacking, ["gone.png", "lost.glb"])] {
        folder.write("bad.toml", &text);
        let output = folder.run("check bad.toml");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        assert!(words.iter().all(|word| stderr.contains(word)), "{stderr}");
        assert_eq!(stderr.lines().count(), 2, "one line a problem: {stderr}");
    }
    folder.write("broken.toml", "[panorama\ncolor = 3");
    folder.fails_by("check broken.toml", 2, &["broken.toml"]);
    folder.fails_by("render bad.toml -o a.png", 2, &["lost.glb"]);
}

#[test]
fn masks_tell_objects_and_their_influence_apart() {
    let folder = Folder::with_scene();
    let printed = folder.succeeds("masks scene.toml -o out/masks --spp 16 --size 64x48");
    assert!(printed.contains("virtual.png") && printed.contains("influenced.png"), "{printed}");
    let mask = |name: &str| {
        let picture = image::open(folder.path("out/masks").join(name)).expect("a PNG").to_luma8();
        assert_eq!((picture.width(), picture.height()), (64, 48));
        assert!(picture.pixels().all(|p| p.0[0] == 0 || p.0[0] == 255));
        picture
    };
    let (hidden, influenced) = (mask("virtual.png"), mask("influenced.png"));
    let inside = |picture: &image::GrayImage| picture.pixels().filter(|p| p.0[0] == 255).count() as f64;
    // A ball 0.6 m across, 1.513 m away: a disc whose angle's tangent is 0.2023, fov_y 60° over 48 pixels; it lies 7.5° down.
    let disc = std::f64::consts::PI * (0.2023 * 24.0 / 30.0_f64.to_radians().tan()).powi(2);
    assert!((inside(&hidden) / disc - 1.0).abs() < 0.08, "{} pixels, not {disc}", inside(&hidden));
    assert!(hidden.get_pixel(32, 29).0[0] == 255 && hidden.get_pixel(2, 2).0[0] == 0);
    let both = hidden.pixels().zip(influenced.pixels()).filter(|(a, b)| a.0[0] == 255 && b.0[0] == 255).count();
    assert_eq!(both, 0);
    assert!(inside(&influenced) > 20.0, "at least the ring about the ball: {}", inside(&influenced));
    // The ball is behind the camera: no pixel is virtual.
    let scene = std::fs::read_to_string(folder.path("scene.toml")).expect("there");
    folder.write("away.toml", &scene.replace("[camera]", "[camera]\nyaw = 180"));
    folder.succeeds("masks away.toml -o out/masks --spp 4 --size 64x48");
    assert_eq!(inside(&mask("virtual.png")), 0.0);
}

#[test]
fn the_stability_suite_reports_every_method() {
    let folder = Folder::empty();
    folder.succeeds("stability empty_scene determinism -o report --quick -q");
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.path("report/stability.json")).expect("a report")).expect("JSON");
    let cases = report["cases"].as_array().expect("a list");
    let names: Vec<_> = cases.iter().map(|case| case["name"].as_str().expect("a name")).collect();
    assert!(names.len() == 2 && names.contains(&"empty_scene") && names.contains(&"determinism"), "{names:?}");
    let page = std::fs::read_to_string(folder.path("report/stability.html")).expect("a page");
    for case in cases {
        let (name, limit) = (case["name"].as_str().expect("a name"), case["limit"].as_f64().expect("a limit"));
        assert!(case["metric"].is_string() && page.contains(name), "{case}");
        for method in ["ibl", "paper", "iprt"] {
            let result = &case["results"][method];
            let value = result["value"].as_f64().expect("a value");
            assert_eq!(result["pass"].as_bool(), Some(value <= limit), "{name}, {method}: {result}");
            assert!(folder.path(&format!("report/{name}_{method}.png")).is_file(), "{name}, {method}");
        }
    }
    folder.succeeds("stability empty_scene -o one --quick -q --method reference --set relight_levels=0");
    let one: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.path("one/stability.json")).expect("a report")).expect("JSON");
    assert_eq!(one["set"], serde_json::json!(["relight_levels=0"]));
    let methods: Vec<_> = one["cases"][0]["results"].as_object().expect("results").keys().collect();
    assert_eq!(methods, ["reference"]);
    folder.fails("stability empty_scene -o one --quick --set relight_level=0", &["relight_level", "relight_levels"]);
    folder.fails("stability contact_shado -o report --quick", &["contact_shado", "contact_shadow"]);
}
