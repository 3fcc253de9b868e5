//! `chart`: what it measures is measured once, truths are kept and checked, and what it writes can be read.

use crate::common::{ball, camera, lambert, options, room, scene, validated};
use glam::{Vec3, vec3};
use iprt::{
    Error,
    gpu::Gpu,
    image_file::{ExrLayer, read::read, write::write_exr},
    measure::{
        chart::{Chart, ChartInput, ChartOptions, point::FILE, run, sweep::Sweep},
        choice::store::Store,
    },
    options::RenderOptions,
    reference::cache::{Keep, Truth, truth_of_model, truth_of_scene},
    scene::{CompleteScene, material::Material, shapes::Shape, viewpoint::Projection},
    settings::Method,
};
use std::{
    cell::Cell,
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::Command,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

const SIZE: [u32; 2] = [48, 36];
const EXTENT: Vec3 = vec3(4.0, 3.0, 4.0);

/// The relit panorama would take most of the time.
const COARSE: [(&str, i64); 2] = [("relight_width", 16), ("relight_warmup", 2)];

/// A grey ball in a room whose walls shine, more from above: what methods render, and all of it as geometry.
fn case() -> ChartInput {
    let shines = |d: Vec3| Vec3::splat(if d.y > 0.6 { 2.0 } else { 0.4 });
    let eye = camera(Vec3::ZERO, vec3(0.0, -0.6, -1.5), 60.0);
    let grey = ball(0.4, lambert(0.5), vec3(0.0, -1.0, -1.5));
    let panorama = room([128, 64], EXTENT, Vec3::ZERO, shines);
    let mut walls = Material { emissive: Vec3::splat(0.4), ..lambert(0.3) };
    walls.name = "walls".into();
    let walls = Arc::new(iprt::scene::model::Model::from_mesh(Shape::Box.mesh(EXTENT), walls));
    let complete = |objects| CompleteScene::assemble("test", walls.clone(), eye.clone(), objects).expect("fits");
    let mut scene = scene(panorama, eye.clone(), vec![grey.clone()]);
    for (setting, value) in COARSE {
        scene.render.set.insert(setting.to_owned(), toml::Value::Integer(value));
    }
    ChartInput { name: "test room".to_owned(), scene, complete: Some([complete(vec![grey]), complete(Vec::new())]) }
}

fn chart_options() -> ChartOptions {
    let wanted = ["iprt", "rays_per_pixel = 1", "scale = 0.5", "reference, 4 paths"];
    ChartOptions {
        size: SIZE,
        projection: Projection::Perspective,
        seed: 1,
        frame: 0,
        frames: vec![1, 7],
        moving_frames: 2,
        rounds: 2,
        model_spp: 8,
        scene_spp: 8,
        truths: None,
        points: Sweep::Full.points().into_iter().filter(|spec| wanted.contains(&spec.name.as_str())).collect(),
    }
}

static GO_ON: AtomicBool = AtomicBool::new(false);

fn keep(folder: &Path) -> Keep<'_> {
    Keep { folder: Some(folder), stop: &GO_ON }
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() { found.extend(files(&path)) } else { found.push(path) }
    }
    found.sort();
    found
}

#[test]
fn points_are_measured_once_however_often_it_is_interrupted() {
    validated(|gpu| {
        let folder = tempfile::tempdir().expect("a folder");
        let (cache, out) = (folder.path().join("cache"), folder.path().join("out"));
        let (case, options) = (case(), chart_options());
        let stop = AtomicBool::new(false);
        let keep = Keep { folder: Some(&cache), stop: &stop };
        // It is stopped in each round, and goes on; what was there stays as it was.
        let mut seen: BTreeMap<String, serde_json::Value> = BTreeMap::new();
        let mut chosen: BTreeMap<String, serde_json::Value> = BTreeMap::new();
        let mut interruptions = 0;
        let chart = loop {
            stop.store(false, Ordering::Relaxed);
            let begun = Cell::new(0);
            let result = run::run(gpu, std::slice::from_ref(&case), &options, &out, keep, &mut |work, what| {
                if work > 0 && !what.contains("truth") {
                    begun.set(begun.get() + 1);
                    stop.store(begun.get() > 4 * interruptions, Ordering::Relaxed);
                }
            });
            let written = fs::read_to_string(out.join(FILE)).expect("there is a chart");
            let points: serde_json::Value = serde_json::from_str(&written).expect("JSON");
            for point in points["points"].as_array().expect("points") {
                let Some(before) = seen.insert(point["key"].as_str().expect("a key").to_owned(), point.clone()) else {
                    continue;
                };
                assert_eq!(before["outcomes"], point["outcomes"], "its pictures were made again");
                let rounds = |point: &serde_json::Value| point["rounds"].as_array().expect("rounds").clone();
                assert!(rounds(point).starts_with(&rounds(&before)), "it was measured again");
            }
            for choice in points["choices"].as_array().expect("choices") {
                let (key, measured) = (choice["key"].as_str().expect("a key").to_owned(), choice["measured"].clone());
                let before = chosen.entry(key).or_insert_with(|| measured.clone());
                assert_eq!(*before, measured, "a choice was measured again");
            }
            match result {
                Ok(chart) => break chart,
                Err(Error::Interrupted { .. }) => interruptions += 1,
                Err(error) => panic!("{error}"),
            }
        };
        assert!(interruptions >= 2, "{interruptions}");
        assert_eq!((chart.points.len(), seen.len()), (4, 4));
        assert!(Chart::load(&out).expect("a chart") == Some(chart.clone()), "it is read as it was written");
        check_points(&chart, &out);
        check_choices(&chart);
        check_documents(&chart, &out);
        check_kept(gpu, &case, &options, &chart, &cache);

        // Of another size it is another chart; of another seed of the truth, too.
        let other = ChartOptions { size: [32, 24], ..options.clone() };
        let error =
            run::run(gpu, std::slice::from_ref(&case), &other, &out, keep, &mut |_, _| {}).expect_err("another");
        assert!(error.to_string().contains("32×24") && error.exit_code() == 2, "{error}");
    });
}

fn check_points(chart: &Chart, out: &Path) {
    for point in &chart.points {
        assert_eq!(point.rounds.len(), 2);
        // a later round looks at all pictures of a method, and at one of any other point
        let looks = |round: usize| point.rounds[round].scores.len();
        let again = if point.group == "method" { point.outcomes.len() } else { 1 };
        assert_eq!((looks(0), looks(1)), (point.outcomes.len(), again), "{}", point.name);
        assert!(point.ms.median > 0.0);
        for outcome in &point.outcomes {
            assert!(out.join(&outcome.picture).is_file() && out.join(&outcome.difference).is_file());
            assert!(outcome.scores.scene.is_some(), "the true room is known");
        }
    }
    let frames = |name: &str| -> Vec<u32> {
        chart.point("test room", name).expect("a point").outcomes.iter().map(|outcome| outcome.frames).collect()
    };
    assert_eq!(frames("iprt"), [1, 7]);
    assert_eq!(frames("reference, 4 paths"), [4]);
    let flickers = |name: &str| -> Vec<&str> {
        chart.point("test room", name).expect("a point").flicker.keys().map(String::as_str).collect()
    };
    assert_eq!(flickers("iprt"), ["influenced", "virtual", "whole"]);
    assert!(flickers("reference, 4 paths").is_empty(), "its picture is one, and no frames");
    let flicker = &chart.point("test room", "iprt").expect("a point").flicker;
    assert!(flicker["virtual"] > 1e-5 && flicker["virtual"] < 0.1, "{flicker:?}");
    assert!(flicker["whole"] < flicker["influenced"], "what nothing influences stands still: {flicker:?}");
    assert_eq!(chart.point("test room", "scale = 0.5").expect("a point").rendered, [24, 18]);
    let csv = chart.csv();
    // commas within quotes are no separators
    let columns = |line: &str| line.split('"').step_by(2).map(|part| part.matches(',').count()).sum::<usize>();
    assert!(csv.lines().all(|line| columns(line) == 25), "{csv}");
}

/// Each target's choice is one of the points that a user can have, predicted from it and measured anew.
fn check_choices(chart: &Chart) {
    let choices: Vec<_> = chart.choices_of("test room").collect();
    assert!(choices.len() >= 2 && choices.len() == chart.choices.len(), "{choices:?}");
    for choice in &choices {
        assert!(["iprt", "rays_per_pixel = 1"].contains(&choice.point.as_str()), "{choice:?}");
        let point = chart.point("test room", &choice.point).expect("a point");
        assert_eq!((&choice.key, choice.larger_size), (&point.key, [96, 72]));
        let main = point.still(7).expect("a picture");
        let flip = |region| point.flip(main, iprt::measure::score::TruthKind::Scene, region).expect("measured");
        let worst = [flip("virtual"), flip("influenced")].map(|flip| flip.high).into_iter().fold(0.0, f64::max);
        assert!(choice.predicted.flip <= worst + 1e-9 && choice.predicted.flip > 0.0, "{choice:?}");
        assert!(choice.measured.flip > 0.0 && choice.measured.flip != choice.predicted.flip, "another seed");
        assert!(choice.measured.ms > 0.0 && choice.larger_ms.iter().all(|ms| *ms > 0.0), "{choice:?}");
        assert!(choice.target.flip.is_none_or(|flip| choice.predicted.flip <= flip), "{choice:?}");
        assert!(choice.target.ms.is_none_or(|ms| choice.predicted.ms <= ms), "{choice:?}");
    }
    let (sheet, points) = chart.sheet(&chart.scenes[0], &case().settings().expect("good settings"));
    assert_eq!((sheet.candidates.len(), points.len()), (2, 2), "no scaled picture, and none that costs all its frames");
    assert!(sheet.candidates[0].set.is_empty(), "what the scene sets is no part of a choice: {sheet:?}");
    assert_eq!(sheet.candidates[1].flags(), "--method iprt --set rays_per_pixel=1");
    assert!(!sheet.complete, "too few to choose from");
    let fixed = |pass: &str| sheet.fixed.get(pass).copied();
    assert!(fixed("composite").is_some_and(|share| (0.0..=1.0).contains(&share)), "{:?}", sheet.fixed);
}

/// A chart of enough points leaves them where `--target-flip` looks for them.
fn check_kept(gpu: &Gpu, case: &ChartInput, options: &ChartOptions, chart: &Chart, cache: &Path) {
    let asked = |set: &[(&str, &str)]| {
        let coarse = COARSE.map(|(name, value)| (name, value.to_string()));
        let set: Vec<_> = coarse.iter().map(|(k, v)| (*k, v.as_str())).chain(set.iter().copied()).collect();
        let options = RenderOptions { size: [480, 360], ..crate::common::options(Method::Paper, &set) };
        Store::of(gpu, &case.scene, &options, case.scene.render.exposure, Some(cache)).expect("a key").load()
    };
    let keep =
        |chart: &Chart| iprt::measure::chart::keep_sheets(gpu, std::slice::from_ref(case), options, chart, Some(cache));
    keep(chart).expect("keeps");
    assert_eq!(asked(&[]), [], "too few points");
    let mut large = chart.clone();
    large.of.main_frames = 16;
    large.points = [&chart.points[..], &chart.points, &chart.points].concat();
    let scores = large.points.iter_mut().flat_map(|point| &mut point.rounds).flat_map(|round| &mut round.scores);
    scores.filter(|scores| scores.frames == 7).for_each(|scores| scores.frames = 16);
    keep(&large).expect("keeps");
    let kept = asked(&[]);
    assert_eq!((kept.len(), kept[0].candidates.len()), (1, 6));
    assert!(kept[0].serves(SIZE) && kept[0].truth == "scene truth");
    assert_eq!(asked(&[("bounces", "2")]), [], "other settings, other points");
}

/// What people open: it holds every point, and needs nothing that is not in it.
fn check_documents(chart: &Chart, out: &Path) {
    chart.write_figure(out).expect("writes");
    chart.write_page(out).expect("writes");
    let page = fs::read_to_string(out.join("chart.html")).expect("a page");
    let drawing = fs::read_to_string(out.join("chart.svg")).expect("a drawing");
    for elsewhere in ["http:", "https:", "src=\"pictures", "<link", "@import", "url("] {
        assert!(!page.contains(elsewhere), "{elsewhere}");
    }
    let linked: Vec<&str> = page.split("href=\"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
    assert!(
        linked.iter().all(|link| page.contains(&format!("id=\"{}\"", &link[1..]))),
        "links lead to rows of the page"
    );
    for point in &chart.points {
        assert!(page.contains(&format!(">{}</b>", point.name)), "{} has no row", point.name);
        assert!(drawing.contains(&format!("<title>{}&#10;", point.name)), "{} is not drawn", point.name);
        if let Some(flicker) = point.flicker.get("whole") {
            let text = format!("flicker whole {flicker:.4}, ");
            assert!(drawing.contains(&text) && page.contains(&text.replace("flicker ", "flicker: ")), "{text}");
        }
        for (name, value) in &point.settings {
            assert!(page.contains(&format!("{name} = {value}")), "{name} of {}", point.name);
        }
    }
    // rooms of the truth and its regions, and a picture and a difference of each point
    assert_eq!(page.matches("data:image/png;base64,").count(), 4 + 2 * chart.points.len());
    let findings = chart.findings(&chart.scenes[0]);
    let settings: Vec<&str> = findings.iter().map(|finding| finding.setting.as_str()).collect();
    assert_eq!(settings, ["rays_per_pixel", "scale"]);
    assert!(findings[0].sentences[0].starts_with("1 instead of 0.25 "), "{findings:?}");
    let png = read(&out.join("chart.png")).expect("an image").into_color("chart.png").expect("RGB");
    let dark = png.texels.iter().filter(|texel| texel[0] + texel[1] + texel[2] < 1.0).count();
    assert!(png.size[0] > 1000 && dark > 500, "{:?}, {dark} dark pixels", png.size);
    let document = out.join("table.md");
    fs::write(&document, "<!-- chart full: here -->\n<!-- end of chart full -->\n").expect("writes");
    chart.write_markdown(out, &document, "full").expect("writes");
    let table = fs::read_to_string(&document).expect("reads");
    assert!(
        table.contains("](images/full-test_room.png)") && out.join("images/full-test_room.png").is_file(),
        "{table}"
    );
    for (target, chosen) in chart.choices.iter().map(|choice| (choice.target_text(), &choice.point)) {
        assert!(table.contains(&format!("| {target} | {chosen} |")), "{target} → {chosen}: {table}");
        assert!(page.contains(&format!("<td>{target}</td><td>{chosen}</td>")), "{target} → {chosen}");
    }
    for point in &chart.points {
        assert!(table.contains(&format!("| `{}` |", point.name)), "{table}");
    }
}

#[test]
fn truths_are_kept_checked_and_made_anew_for_other_settings() {
    validated(|gpu| {
        let cache = tempfile::tempdir().expect("a folder");
        let case = case();
        let options = options(Method::Reference, &[]);
        let samples = Cell::new(0);
        let model = |set: &[(&str, &str)], spp| -> Truth {
            let coarse = COARSE.map(|(k, v)| (k.to_owned(), v.to_string()));
            let set: Vec<_> =
                coarse.into_iter().chain(set.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned()))).collect();
            let mut tick = || samples.set(samples.get() + 1);
            truth_of_model(gpu, &case.scene, &options, &set, 0.0, spp, keep(cache.path()), &mut tick).expect("a truth")
        };
        let first = model(&[], 8);
        assert_eq!((first.spp, samples.take()), (8, 8));
        let kept = files(cache.path());
        assert_eq!(kept.len(), 8, "a file a batch");
        let times = || -> Vec<_> {
            kept.iter().map(|file| file.metadata().and_then(|m| m.modified()).expect("a time")).collect()
        };
        let written = times();
        assert!(model(&[], 8) == first && times() == written, "read, not computed");

        // A damaged batch is computed again, to the same bits but for the relit panorama's age.
        let mut bytes = fs::read(&kept[3]).expect("reads");
        let last = bytes.len() - 1;
        bytes[last] ^= 1;
        fs::write(&kept[3], &bytes).expect("writes");
        let mended = model(&[], 8);
        assert_ne!(fs::read(&kept[3]).expect("reads"), bytes, "written anew");
        assert_eq!(mended.halves[0], first.halves[0], "batch 3 is of the second half");
        fs::write(&kept[3], "short").expect("writes");

        // Other settings have their own files, and more samples are added to those that are there.
        model(&[("bounces", "1")], 8);
        assert_eq!(files(cache.path()).len(), 16);
        let more = model(&[], 10);
        assert_eq!((more.spp, files(cache.path()).len()), (10, 18));
        assert!(fs::read(&kept[3]).expect("reads").len() > 100, "a short file, too, is written anew");

        // So for scene truth; halves are independent of each other.
        let [with, _] = case.complete.as_ref().expect("known");
        let scene = |keep| truth_of_scene(gpu, with, &options, 0.0, 8, keep, &mut || ()).expect("a truth");
        let truth = scene(keep(cache.path()));
        assert_eq!(files(cache.path()).len(), 26);
        assert_ne!(truth.halves[0], truth.halves[1]);
        assert_eq!(scene(Keep { folder: None, stop: &GO_ON }), truth);
    });
}

#[test]
fn stored_scene_truth_is_taken_where_it_fits() {
    validated(|gpu| {
        let folder = tempfile::tempdir().expect("a folder");
        let truths = folder.path().join("truths");
        fs::create_dir(&truths).expect("a folder");
        let case = case();
        let grey = |name: &str, value: f32| ExrLayer::rgb(name, SIZE, &[[value, value, value, 1.0]; 48 * 36]);
        let entry = |file: &str, complete: &CompleteScene| {
            write_exr(&truths.join(file), &[grey("a", 0.4), grey("b", 0.6)]).expect("writes");
            serde_json::json!({ "file": file, "scene": "test room", "objects": true, "time": 0.0, "size": SIZE,
                "made_by": "somebody", "samples": 77, "content": complete.content })
        };
        let [with, without] = case.complete.as_ref().expect("known");
        let list = |entries: &[serde_json::Value]| {
            fs::write(truths.join("index.json"), serde_json::to_string(entries).expect("JSON")).expect("writes");
            let options = ChartOptions { truths: Some(truths.clone()), points: Vec::new(), ..chart_options() };
            let out = folder.path().join("out");
            let mut said = String::new();
            let mut tell = |_, what: &str| said += what;
            let chart = run::run(gpu, std::slice::from_ref(&case), &options, &out, keep(folder.path()), &mut tell);
            (chart.expect("a chart").scenes[0].clone(), said)
        };
        let both = [entry("with.exr", with), entry("without.exr", without)];
        let (scene, said) = list(&both);
        assert_eq!((scene.stored.as_deref(), scene.scene_spp), (Some("somebody"), 77));
        assert!(scene.about_scene_truth().contains("stored, 77 samples a pixel by somebody"));
        assert!(said.contains("test room, scene truth, stored, by somebody"), "{said}");
        let rmse = scene.noise.scene.expect("known").region("virtual").expect("a ball").rmse;
        assert!((rmse - 0.2).abs() < 1e-3, "the halves are those of the files: {rmse}");
        // One alone is not enough, and a damaged one is an error.
        let (scene, said) = list(&both[..1]);
        assert!(scene.stored.is_none() && scene.scene_spp == 8 && !said.contains("stored"), "{said}");
        fs::write(truths.join("with.exr"), "damaged").expect("writes");
        let options = ChartOptions { truths: Some(truths.clone()), ..chart_options() };
        let out = folder.path().join("other");
        let error = run::run(gpu, std::slice::from_ref(&case), &options, &out, keep(folder.path()), &mut |_, _| {});
        assert!(error.expect_err("damaged").to_string().contains("with.exr"));
    });
}

fn fails(arguments: &[&str], words: &[&str]) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_iprt"));
    let output = command.args(arguments).env_remove("IPRT_VALIDATION").output().expect("runs");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "iprt {arguments:?}: {stderr}");
    assert_eq!(stderr.trim_end().lines().count(), 1, "iprt {arguments:?}: {stderr}");
    for word in words {
        assert!(stderr.contains(word), "iprt {arguments:?}: no \"{word}\" in {stderr}");
    }
}

#[test]
fn what_cannot_be_charted_is_one_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name).display().to_string();
    fs::write(folder.path().join("file"), "").expect("writes");
    fs::write(folder.path().join("plain.md"), "no marks").expect("writes");
    let (out, file, plain) = (path("out"), path("file"), path("plain.md"));
    fails(&["chart", "-o", &out, "--sweep", "everything"], &["--sweep", "everything", "methods, small, full"]);
    fails(&["chart", "-o", &out, "--size", "12"], &["--size", "12"]);
    fails(&["chart", "nowhere.toml", "-o", &out], &["nowhere.toml"]);
    fails(&["chart", "-o", &out, "--markdown", &plain], &["plain.md", "<!-- chart full:"]);
    fails(&["chart", "-o", &format!("{file}/x"), "--size", "16x16"], &["file/x", "folder"]);
}
