//! Mutated inputs of every reader: none may panic, hang or fill the memory, and every refusal is one line that names the
//! file. The corpus is `tests/corpus`. A short run with fixed seeds is part of the tests; `IPRT_FUZZ_SECONDS` makes it
//! longer, with other seeds (`make fuzz`). An input that fails is kept and named.

use crate::memory;
use glam::Vec3;
use iprt::{
    Error, Result,
    image_file::read,
    panorama::{pattern::Pattern, source::PanoramaSource},
    scene::{Scene, file::read_scene_file, gltf},
};
use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

type Reader = dyn Fn(&[u8], &Path) -> Result<()>;

/// Something that reads bytes, and the files that it begins with.
struct Target {
    name: &'static str,
    /// The extensions of its part of the corpus.
    seeds: &'static [&'static str],
    /// How many inputs a short run has.
    count: u64,
    read: fn(&[u8], &Path) -> Result<()>,
}

/// What a file may take while it is read, and how much more of it than it asked for a reader may have at a time.
const ALLOWED: u64 = 256 << 20;
const SLACK: u64 = 64 << 20;

/// Reads the first frame of a panorama, a row after the other where it can be, and by `ffmpeg` what it alone can read.
fn first_frame(bytes: &[u8], folder: &Path) -> Result<()> {
    std::fs::write(folder.join("input"), bytes).expect("writes");
    std::fs::write(folder.join("scene.toml"), "[panorama]\ncolor = \"input\"\ndepth = 3\n").expect("writes");
    let file = read_scene_file(&folder.join("scene.toml")).map_err(|mut problems| problems.remove(0))?;
    let frame = PanoramaSource::open(file.panorama)?.load(0)?;
    assert_eq!(frame.radiance.len() as u64, u64::from(frame.color_size[0]) * u64::from(frame.color_size[1]));
    assert!(frame.radiance.to_vec().iter().flatten().all(|value| value.is_finite()));
    Ok(())
}

const TARGETS: [Target; 7] = [
    Target { name: "panorama", seeds: &["png", "jpg", "webp", "tiff", "hdr", "exr"], count: 300, read: first_frame },
    Target { name: "video", seeds: &["mkv", "avif"], count: 40, read: first_frame },
    Target {
        name: "image",
        seeds: &["png", "jpg", "webp", "tiff", "hdr", "exr", "pfm", "npy"],
        count: 600,
        read: |bytes, _| {
            let image = read::decode(bytes, "input")?;
            let color = image.into_color("input")?;
            assert_eq!(color.texels.len() as u64, u64::from(color.size[0]) * u64::from(color.size[1]));
            assert!(color.texels.iter().all(|texel| texel[3] == 0.0 || !texel[..3].iter().any(|v| v.is_nan())));
            Ok(())
        },
    },
    Target {
        name: "depth",
        seeds: &["png", "tiff", "exr", "pfm", "npy", "npz", "dpt"],
        count: 600,
        read: |bytes, _| {
            let codes = read::decode(bytes, "input")?.into_codes("input")?;
            assert_eq!(codes.codes.len() as u64, u64::from(codes.size[0]) * u64::from(codes.size[1]));
            let rule = iprt::panorama::guess::rule(&codes, 1.6).rule;
            let metres = rule.metres(codes.codes.clone(), codes.size);
            assert!(metres.iter().all(|metres| metres.is_finite() && *metres >= 0.0), "a hole is 0");
            Ok(())
        },
    },
    Target {
        name: "gltf",
        seeds: &["glb", "gltf"],
        count: 600,
        read: |bytes, folder| {
            let path = folder.join("input.gltf");
            std::fs::write(&path, bytes).expect("writes");
            let (model, _) = gltf::load(&path)?;
            for mesh in &model.meshes {
                let vertices = mesh.positions.len();
                assert!(mesh.triangles.iter().flatten().all(|index| (*index as usize) < vertices));
                assert!(mesh.positions.iter().all(|position| position.is_finite()));
            }
            let _ = model.rig.node_matrices(None);
            Ok(())
        },
    },
    Target {
        name: "scene",
        seeds: &["toml"],
        count: 600,
        read: |bytes, folder| {
            let path = folder.join("input.toml");
            std::fs::write(&path, bytes).expect("writes");
            let file = read_scene_file(&path).map_err(|mut problems| {
                assert!(!problems.is_empty());
                assert!(problems.iter().all(|problem| !problem.to_string().contains('\n')), "{problems:?}");
                problems.remove(0)
            })?;
            let at = file.camera.at(0.5);
            assert!(at.position.is_finite() && at.rotation.is_finite() && at.fov_y_degrees > 0.0);
            assert!(file.panorama.yaw_degrees.is_finite() && file.panorama.exposure > 0.0);
            Scene::load(&path).map(drop)
        },
    },
    Target {
        name: "pattern",
        seeds: &["names"],
        count: 600,
        read: |bytes, _| {
            let name = String::from_utf8_lossy(bytes).into_owned();
            let pattern = Pattern::parse(Path::new(&name))?;
            assert_eq!(pattern.file(7) == pattern.file(8), !pattern.is_sequence(), "{name}");
            Ok(())
        },
    },
];

fn corpus(target: &Target) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus");
    let mut files: Vec<PathBuf> =
        folder.read_dir().expect("a corpus").map(|entry| entry.expect("readable").path()).collect();
    files.sort();
    let of = |path: &PathBuf| path.extension().is_some_and(|e| target.seeds.contains(&e.to_str().unwrap_or_default()));
    let mut seeds: Vec<_> = files.into_iter().filter(of).map(|path| std::fs::read(path).expect("readable")).collect();
    if target.seeds == ["names"] {
        let names = ["a/%04d_rgb.jpg", "100% done/f%d.png", "f.####.exr", "a%%b#1.png", "%s", "st_%99999d.png"];
        seeds = names.map(|name| name.as_bytes().to_vec()).to_vec();
    }
    assert!(!seeds.is_empty(), "{} has no corpus", target.name);
    seeds
}

/// Numbers at which readers go wrong.
const ODD: [u32; 10] = [0, 1, 2, 0x7f, 0xff, 0xffff, 0x7fff_ffff, 0x8000_0000, 0xffff_fffe, u32::MAX];
const WORDS: [&str; 14] =
    ["-1", "0", "1e300", "1e39", "nan", "inf", "null", "[]", "{}", "\"\"", "9999999999", "0.5", "true", "1e-300"];

/// Changes an input in one to four places.
fn mutate(random: &mut fastrand::Rng, seeds: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = seeds[random.usize(..seeds.len())].clone();
    let textual = bytes.is_ascii();
    for _ in 0..random.usize(1..=4) {
        if bytes.is_empty() {
            break;
        }
        let at = random.usize(..bytes.len());
        match random.u32(..if textual { 9 } else { 7 }) {
            0 => bytes[at] ^= 1 << random.u32(..8),
            1 => bytes[at] = random.u8(..),
            2 => bytes.truncate(at),
            3 => {
                let (odd, big) = (ODD[random.usize(..ODD.len())], random.bool());
                let odd = if big { odd.to_be_bytes() } else { odd.to_le_bytes() };
                let width = [2, 4][random.usize(..2)].min(bytes.len() - at);
                bytes[at..at + width].copy_from_slice(&odd[..width]);
            }
            4 => {
                let other = &seeds[random.usize(..seeds.len())];
                let from = random.usize(..other.len());
                let length = random.usize(..32).min(other.len() - from);
                let part = other[from..from + length].to_vec();
                bytes.splice(at..at, part);
            }
            5 => {
                let end = (at + random.usize(..16)).min(bytes.len());
                bytes.drain(at..end);
            }
            6 => {
                let end = (at + random.usize(..64)).min(bytes.len());
                let part = bytes[at..end].to_vec();
                bytes.splice(at..at, part);
            }
            // Of text, a whole number or word is another.
            _ => {
                let is_word = |b: &u8| b.is_ascii_alphanumeric() || b"+-._".contains(b);
                let Some(start) = (at..bytes.len()).find(|i| is_word(&bytes[*i])) else { continue };
                let length = bytes[start..].iter().take_while(|b| is_word(b)).count();
                bytes.splice(start..start + length, WORDS[random.usize(..WORDS.len())].bytes());
            }
        }
    }
    bytes
}

/// An input that is not read as it should be.
struct Found {
    seed: u64,
    bytes: Vec<u8>,
    why: String,
}

/// Feeds mutated inputs to `read` until `enough` says so. Returns the first that it panics at, and how many were read.
fn feed(target: &Target, first_seed: u64, read: &Reader, enough: &dyn Fn(u64) -> bool) -> (Option<Found>, u64) {
    let (seeds, folder) = (corpus(target), tempfile::tempdir().expect("a folder"));
    let mut accepted = 0;
    for count in 0.. {
        if enough(count) {
            break;
        }
        let seed = first_seed + count;
        // The corpus itself goes first.
        let bytes = match seeds.get(count as usize) {
            Some(bytes) => bytes.clone(),
            None => mutate(&mut fastrand::Rng::with_seed(seed), &seeds),
        };
        let start = Instant::now();
        let held = memory::held();
        let answer = catch_unwind(AssertUnwindSafe(|| read(&bytes, folder.path())));
        let taken = memory::most_since(held);
        let why = match answer {
            _ if taken > ALLOWED + SLACK => format!("takes {} MiB", taken >> 20),
            Ok(answer) if start.elapsed() > Duration::from_secs(60) => format!("takes a minute: {answer:?}"),
            Ok(Ok(())) => {
                accepted += 1;
                continue;
            }
            // What stands in front is the name, which the terminal shows in one line.
            Ok(Err(Error::Input { problem, remedy, .. }))
                if ![&problem, &remedy].iter().any(|text| text.contains(['\n', '\r'])) =>
            {
                continue;
            }
            Ok(Err(error)) => format!("is refused by {error:?}"),
            Err(_) => "panics".to_owned(),
        };
        return (Some(Found { seed, bytes, why }), accepted);
    }
    (None, accepted)
}

fn fuzz(name: &str) {
    iprt::budget::set(ALLOWED);
    let target = TARGETS.iter().find(|target| target.name == name).expect("a target");
    let seconds: Option<u64> = std::env::var("IPRT_FUZZ_SECONDS").ok().map(|text| text.parse().expect("seconds"));
    let start = Instant::now();
    let first = seconds.map_or(1, |_| fastrand::u64(..u64::MAX / 2));
    let enough = |count: u64| match seconds {
        Some(seconds) => start.elapsed() > Duration::from_secs(seconds),
        None => count >= target.count,
    };
    let (found, accepted) = feed(target, first, &target.read, &enough);
    if let Some(Found { seed, bytes, why }) = found {
        let kept = std::env::temp_dir().join(format!("iprt-fuzz-{name}-{seed}"));
        std::fs::write(&kept, &bytes).expect("writes");
        panic!("{name}: seed {seed} {why}; it is kept as {}", kept.display());
    }
    assert!(accepted >= corpus(target).len() as u64 / 2, "{name}: {accepted} inputs were read");
}

#[test]
fn panorama_is_survived() {
    fuzz("panorama");
}

#[test]
fn video_is_survived() {
    fuzz("video");
}

#[test]
fn image_is_survived() {
    fuzz("image");
}

#[test]
fn depth_is_survived() {
    fuzz("depth");
}

#[test]
fn gltf_is_survived() {
    fuzz("gltf");
}

#[test]
fn scene_is_survived() {
    fuzz("scene");
}

#[test]
fn pattern_is_survived() {
    fuzz("pattern");
}

/// Each target finds the bug that is planted in a reader of its kind: what such readers get wrong.
#[test]
fn each_target_finds_its_planted_bug() {
    let word = |bytes: &[u8], at: usize| bytes.get(at..at + 4).map(|b| u32::from_be_bytes([b[0], b[1], b[2], b[3]]));
    let bugs: [(&str, Box<Reader>); 7] = [
        // What a header says is allocated, whatever is behind it.
        (
            "panorama",
            Box::new(move |bytes, _| {
                if let (Some(b"\x89PNG"), Some(width), Some(height)) =
                    (bytes.get(..4), word(bytes, 16), word(bytes, 20))
                {
                    let size = u64::from(width) * u64::from(height) * 4;
                    std::hint::black_box(Vec::<u8>::with_capacity(size.min(1 << 32) as usize));
                }
                Ok(())
            }),
        ),
        // A container's box is as long as it says.
        (
            "video",
            Box::new(move |bytes, _| {
                if bytes.get(4..8) == Some(b"ftyp") {
                    assert!(word(bytes, 0).is_some_and(|length| (length as usize) < bytes.len()), "planted");
                }
                Ok(())
            }),
        ),
        // The size of an image is multiplied as it is stored.
        (
            "image",
            Box::new(move |bytes, _| {
                if let (Some(b"\x89PNG"), Some(width), Some(height)) =
                    (bytes.get(..4), word(bytes, 16), word(bytes, 20))
                {
                    assert!(width.checked_mul(height).is_some(), "planted");
                }
                Ok(())
            }),
        ),
        // A depth of infinity or NaN is believed.
        (
            "depth",
            Box::new(|bytes, _| {
                let floats = bytes.strip_prefix(b"PIEH").and_then(|rest| rest.get(8..)).unwrap_or_default();
                let finite = |b: &[u8; 4]| f32::from_le_bytes(*b).is_finite();
                assert!(floats.as_chunks::<4>().0.iter().all(finite), "planted");
                Ok(())
            }),
        ),
        // An index into accessors is not checked.
        (
            "gltf",
            Box::new(|bytes, _| {
                if let Ok(root) = serde_json::from_slice::<serde_json::Value>(bytes) {
                    let count = root["accessors"].as_array().map_or(0, Vec::len) as u64;
                    let index = root["meshes"][0]["primitives"][0]["attributes"]["POSITION"].as_u64();
                    assert!(index.is_none_or(|index| index < count), "planted");
                }
                Ok(())
            }),
        ),
        // A number is taken for single precision without a look.
        (
            "scene",
            Box::new(|bytes, _| {
                let table: Option<toml::Table> = std::str::from_utf8(bytes).ok().and_then(|text| text.parse().ok());
                let yaw = table.as_ref().and_then(|table| table.get("panorama")?.get("yaw")?.as_float());
                assert!(yaw.is_none_or(|yaw| Vec3::splat(yaw as f32).is_finite()), "planted");
                Ok(())
            }),
        ),
        // A width is used as it is given.
        (
            "pattern",
            Box::new(|bytes, _| {
                let text = String::from_utf8_lossy(bytes);
                let digits: String =
                    text.split('%').nth(1).unwrap_or("").chars().take_while(char::is_ascii_digit).collect();
                assert!(digits.parse::<u32>().is_ok_and(|width| width < 1000) || digits.is_empty(), "planted");
                Ok(())
            }),
        ),
    ];
    let quiet = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let missed: Vec<_> = bugs
        .iter()
        .filter(|(name, bug)| {
            let target = TARGETS.iter().find(|target| target.name == *name).expect("a target");
            feed(target, 1, bug, &|count| count >= 20_000).0.is_none()
        })
        .map(|(name, _)| name)
        .collect();
    std::panic::set_hook(quiet);
    assert!(missed.is_empty(), "not found: {missed:?}");
}
