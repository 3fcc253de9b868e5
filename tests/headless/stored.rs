//! The stored scene truths: they are of the scenes that they are listed for, they are clean, ours agrees with them, and `chart` takes
//! them.

use crate::{
    common::validated,
    folder::Folder,
    mitsuba::{Means, data_file, ours_at},
};
use iprt::{
    gpu::Gpu,
    image_file::{ExrLayer, write::write_exr},
    measure::metrics::{Picture, compare},
    reference::stored::{StoredTruth, StoredTruths},
    scene::{
        CompleteScene,
        animation::{Placement, Transform},
        rooms,
    },
};
use std::path::Path;

fn stored() -> StoredTruths {
    StoredTruths::open(&Path::new(env!("CARGO_MANIFEST_DIR")).join("truth")).expect("a list")
}

fn scene(stored: &StoredTruth) -> CompleteScene {
    match rooms::by_name(&stored.scene) {
        Some(room) => {
            let objects = if stored.objects { room.objects } else { Vec::new() };
            CompleteScene::assemble(room.name, room.model, room.camera, objects).expect("fits")
        }
        None => CompleteScene::load(&data_file(&stored.scene), !stored.objects).expect("a good scene"),
    }
}

/// `IPRT_BLESS=1` writes contents and noise.
#[test]
fn the_list_is_what_the_folder_holds() {
    let mut stored = stored();
    let mut right = stored.clone();
    for entry in &mut right.list {
        let (scene, truth) = (scene(entry), stored.read(entry).expect("a picture"));
        entry.content = scene.content.clone();
        let [a, b] = truth.halves.each_ref().map(|texels| Picture { subject: "a half", size: truth.size, texels });
        entry.noise = (1e4 * compare(a, b, None, scene.exposure).expect("alike").flip).round() / 1e4;
        assert_ne!(truth.halves[0], truth.halves[1], "{}", entry.file);
    }
    assert_eq!(right.list.len(), 14);
    if std::env::var_os("IPRT_BLESS").is_some() {
        stored = right.clone();
        stored.save().expect("writes");
    }
    assert_eq!(stored.list, right.list, "render them anew, or bless them if only the list changed");
    for entry in &stored.list {
        assert!(entry.noise <= LARGEST_NOISE, "{}: {}", entry.file, entry.noise);
    }
}

/// FLIP between the halves of any picture.
const LARGEST_NOISE: f64 = 0.04;

/// Blocks of 20×20 pixels, or of 32×32. Ours has 16 samples a pixel, and its standard errors come from as many pictures, so that some
/// are too small.
#[test]
fn ours_agrees_in_the_means_of_blocks() {
    validated(|gpu| {
        let stored = stored();
        for entry in stored.list.iter().filter(|entry| entry.objects && (entry.time == 0.0 || entry.scene == "gallery"))
        {
            agrees(gpu, &stored, entry);
        }
    });
}

fn agrees(gpu: &Gpu, stored: &StoredTruths, entry: &StoredTruth) {
    let truth = stored.read(entry).expect("a picture");
    let [a, b] = &truth.halves;
    let both = |i: usize, f: fn(f64, f64) -> f64| std::array::from_fn(|c| f(a[i][c].into(), b[i][c].into()));
    let pixels = 0..a.len();
    let theirs = Means {
        size: entry.size.map(|side| side as usize),
        mean: pixels.clone().map(|i| both(i, |a, b| 0.5 * (a + b))).collect(),
        standard_error: pixels.map(|i| both(i, |a, b| 0.5 * (a - b).abs())).collect(),
    };
    let by = if entry.size == [320, 180] { 20 } else { 32 };
    let theirs = theirs.patches(by);
    let ours = ours_at(gpu, &scene(entry), entry.time, entry.size, [16, 16]).patches(by);
    let (mut sums, mut apart) = ([[0.0; 2]; 3], 0);
    for i in 0..theirs.mean.len() {
        for (c, sums) in sums.iter_mut().enumerate() {
            let [own, other] = [&ours, &theirs].map(|means| means.mean[i][c]);
            // Rounding and the tables of albedos may take an eighth of a percent.
            let noise = ours.standard_error[i][c].hypot(theirs.standard_error[i][c]).hypot(0.00125 * other);
            apart += usize::from((own - other).abs() > 3.0 * noise);
            *sums = [sums[0] + own, sums[1] + other];
        }
    }
    let ratios = sums.map(|[own, other]| own / other);
    let apart = apart as f64 / (3 * theirs.mean.len()) as f64;
    println!("{}: ratios {ratios:.4?}, {:.1} % of the blocks apart", entry.file, 100.0 * apart);
    assert!(ratios.iter().all(|ratio| (ratio - 1.0).abs() < 0.008), "{}: {ratios:?}", entry.file);
    assert!(apart < 0.06, "{}: {apart} of the blocks differ by three standard errors", entry.file);
}

#[test]
fn a_changed_scene_has_no_truth() {
    let stored = stored();
    let size = [320, 180];
    let room = || rooms::by_name("apartment").expect("built in");
    let complete =
        |room: rooms::Room| CompleteScene::assemble(room.name, room.model, room.camera, room.objects).expect("fits");
    let same = complete(room());
    let found = |scene: &CompleteScene, size, time| stored.find(scene, size, time).expect("reads").is_some();
    assert!(found(&same, size, 0.0) && found(&same, size, 1.0));
    assert!(!found(&same, [160, 90], 0.0) && !found(&same, size, 0.5), "another size and another moment");

    let mut moved = room();
    let at = moved.objects[0].placement.at(0.0);
    let aside = Transform { translation: at.translation + glam::Vec3::X * 1e-3, ..at };
    moved.objects[0].placement = Placement::fixed(aside);
    assert!(!found(&complete(moved), size, 0.0), "an object stands elsewhere");
    let mut fewer = room();
    fewer.objects.pop();
    assert!(!found(&complete(fewer), size, 0.0));
    let mut painted = room();
    let mut model = (*painted.model).clone();
    model.materials[0].base_color.x *= 0.99;
    painted.model = model.into();
    assert!(!found(&complete(painted), size, 0.0), "a wall has another colour");
    let mut turned = room();
    turned.camera.fov_y_degrees = iprt::scene::animation::Track::constant(60.0);
    assert!(!found(&complete(turned), size, 0.0), "another camera");

    // Without objects nothing moves in this room, so one picture serves all moments.
    let empty = complete(rooms::Room { objects: Vec::new(), ..room() });
    assert!(found(&empty, size, 0.5));
}

#[test]
fn a_truth_of_two_halves_is_compared_without_its_noise() {
    let folder = Folder::empty();
    let grey = |name: &str, value: f32| ExrLayer::rgb(name, [16, 16], &[[value, value, value, 1.0]; 256]);
    write_exr(&folder.path("truth.exr"), &[grey("a", 0.4), grey("b", 0.6)]).expect("writes");
    write_exr(&folder.path("test.exr"), &[grey("", 0.7)]).expect("writes");
    let json: serde_json::Value =
        serde_json::from_str(&folder.succeeds("compare test.exr truth.exr --json")).expect("JSON");
    let number = |value: &serde_json::Value| value.as_f64().expect("a number");
    assert!((number(&json["rmse"]) - 0.2).abs() < 1e-3, "{json}");
    assert!((number(&json["noise_free"]["rmse"]) - 0.03f64.sqrt()).abs() < 1e-3, "{json}");
    assert!(folder.succeeds("compare test.exr truth.exr").contains("without the truth's noise: RMSE 0.173"));
}
