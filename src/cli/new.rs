//! `iprt new` writes a scene file for a panorama, its depth and models, and says what it assumed.

use crate::{
    Error, Result,
    image_file::{
        CodeImage, FileImage,
        write::{folder_of, write_bytes},
    },
    inspect::Report,
    panorama::{
        cloud::Cloud,
        cube,
        depth::box_depth,
        guess::{self, Guess},
        level::rotation,
        packing::packed_codes,
        preset::{PRESETS, Preset},
        room::{Level, level, levelling},
        source::PanoramaFrame,
        stream::first_picture,
    },
    scene::{
        Object, Scene,
        animation::{Placement, Transform},
        bounds::Bounds,
        gltf,
        placing::model_bounds,
    },
    warnings,
};
use glam::{Affine3A, Vec3};
use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
    sync::Arc,
};

/// Arguments of `iprt new`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The panorama: an image, a video, a %04d pattern, or one face of a cubemap in six files
    pub panorama: PathBuf,
    /// Its depth, if the panorama does not hold it, and glTF models to put into it
    pub files: Vec<PathBuf>,
    /// The scene file to write
    #[arg(short, long, value_name = "FILE", default_value = "scene.toml")]
    pub output: PathBuf,
    /// The camera's height over the floor in metres, which gives relative depth its scale
    #[arg(long, value_name = "METRES", default_value_t = 1.6)]
    pub height: f64,
    /// What wrote the depth, if it is known: the scene file's depth_preset
    #[arg(long, value_name = "NAME", value_parser = PRESETS.iter().map(|preset| preset.name).collect::<Vec<_>>())]
    pub depth_preset: Option<String>,
    /// Replace a scene file that is there
    #[arg(long)]
    pub force: bool,
}

/// Where the depth comes from.
enum Depth {
    File(PathBuf, Guess, CodeImage),
    Packed(&'static str, Guess, CodeImage),
    Box,
}

/// Looks at the files, and writes the scene.
pub fn run(args: &Args) -> Result<()> {
    if !(0.001..=10_000.0).contains(&args.height) {
        return Err(Error::input("--height", args.height, "give metres, from 0.001 to 10000"));
    }
    if args.output.exists() && !args.force {
        return Err(Error::input(args.output.display(), "is there already", "give another name with -o, or --force"));
    }
    super::render::require_folder(&args.output)?;
    let is_model = |path: &&PathBuf| {
        path.extension().is_some_and(|e| ["glb", "gltf"].contains(&e.to_string_lossy().to_lowercase().as_str()))
    };
    let models: Vec<&PathBuf> = args.files.iter().filter(is_model).collect();
    let depths: Vec<&PathBuf> = args.files.iter().filter(|path| !is_model(path)).collect();
    let panorama = Picture::look(&args.panorama)?;
    let depth = match depths.as_slice() {
        [] => own_depth(args, &panorama)?,
        [depth] => {
            let path = cube::siblings(depth).unwrap_or_else(|| (*depth).clone());
            let subject = path.display().to_string();
            let mut codes = first_picture(&path)?.into_codes(&subject)?;
            if panorama.is_cube || cube::has_faces(&path) {
                codes = cube::codes(codes, &subject)?;
            }
            Depth::File(path, args.guess(&codes), codes)
        }
        [_, other, ..] => {
            return Err(Error::input(
                other.display(),
                "is a second image of depth",
                "give one, and models as .glb or .gltf",
            ));
        }
    };
    let text = scene_text(args, &panorama, &depth, &models)?;
    write_bytes(&args.output, text.as_bytes())?;

    let mut examined = Scene::examine(&args.output);
    let mut found = std::mem::take(&mut examined.warnings);
    if let (Some(scene), Some(frame)) = (&examined.scene, &examined.first) {
        let report = Report::of(scene, frame, &Cloud::of(frame, scene.panorama.yaw_degrees));
        found.extend(report.warnings.iter().filter(|warning| !found.contains(warning)).cloned().collect::<Vec<_>>());
        super::print_lines(report.text().trim_end());
    }
    warnings::tell(&found);
    if let Some(problem) = examined.problems.pop() {
        return Err(problem);
    }
    let name = args.output.display();
    super::print(&format!("{name}: written; what was assumed stands in it. Next: iprt render {name} -o picture.png"));
    Ok(())
}

/// The panorama's picture.
struct Picture {
    path: PathBuf,
    image: FileImage,
    /// Whether one image holds the six faces of a cube.
    is_cube: bool,
}

impl Picture {
    fn look(path: &Path) -> Result<Self> {
        let path = cube::siblings(path).unwrap_or_else(|| path.to_owned());
        let image = first_picture(&path)?;
        let color = image.clone().into_color(&path.display().to_string())?;
        Ok(Self { is_cube: !cube::has_faces(&path) && cube::seems_one(&color), path, image })
    }
}

impl Args {
    fn guess(&self, codes: &CodeImage) -> Guess {
        match self.depth_preset.as_deref().and_then(Preset::named) {
            Some(preset) => guess::by_preset(preset, codes, self.height),
            None => guess::rule(codes, self.height),
        }
    }
}

/// Depth that the panorama's own file holds: as a channel, or as its second half.
fn own_depth(args: &Args, panorama: &Picture) -> Result<Depth> {
    let subject = panorama.path.display().to_string();
    let (image, in_six) = (&panorama.image, cube::has_faces(&panorama.path));
    let [width, height] = match image {
        FileImage::Raster(raster) => raster.size,
        FileImage::Exr(exr) => {
            let other = exr.layers.iter().map(|layer| layer.channels.len()).sum::<usize>() > 4;
            if let (true, Ok(mut codes)) = (other, image.clone().into_codes(&subject)) {
                if panorama.is_cube || in_six {
                    codes = cube::codes(codes, &subject)?;
                }
                return Ok(Depth::File(panorama.path.clone(), args.guess(&codes), codes));
            }
            image.clone().into_color(&subject)?.size
        }
    };
    let packing = match [width, height] {
        _ if panorama.is_cube || in_six => return Ok(Depth::Box),
        [w, h] if w == h => "top-bottom",
        [w, h] if w == 4 * h => "left-right",
        _ => return Ok(Depth::Box),
    };
    let codes = packed_codes(image.clone(), packing == "left-right", &subject)?;
    Ok(Depth::Packed(packing, args.guess(&codes), codes))
}

fn scene_text(args: &Args, panorama: &Picture, depth: &Depth, models: &[&PathBuf]) -> Result<String> {
    let folder = folder_of(&args.output);
    let absolute = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let quoted = |path: &Path| {
        let near = pathdiff::diff_paths(absolute(path), absolute(folder)).unwrap_or_else(|| absolute(path));
        toml::Value::from(near.to_string_lossy().replace('$', "$$")).to_string()
    };
    let (depth_size, metres) = match depth {
        Depth::File(_, guess, codes) | Depth::Packed(_, guess, codes) => {
            (codes.size, guess.rule.metres(codes.codes.clone(), codes.size))
        }
        Depth::Box => {
            let (depth_size, center) = ([256, 128], Vec3::new(0.0, 1.35 - args.height as f32, 0.0));
            (depth_size, box_depth(depth_size, Vec3::new(6.0, 2.7, 6.0), center, 0.0))
        }
    };
    let mut cloud = Cloud::of(&PanoramaFrame { depth_size, depth: metres, ..Default::default() }, 0.0);
    let levelling = levelling(&cloud);
    if let Some([pitch, roll]) = levelling {
        cloud = cloud.turned(rotation(pitch, roll));
    }
    let floor = level(&cloud, true);
    let height = floor.map_or(args.height as f32, |floor| floor.distance);
    let spot = free_spot(&cloud, floor, height);

    let mut out = String::from("# Written by iprt new. Every key is in docs/scene.md.\n\n[panorama]\n");
    let _ = writeln!(out, "color = {}", quoted(&panorama.path));
    if panorama.is_cube {
        let _ = writeln!(out, "layout = \"cube\"  # assumed by the picture's shape: six faces of a cube");
    }
    match depth {
        Depth::File(path, ..) => {
            let _ = writeln!(out, "depth = {}", quoted(path));
        }
        Depth::Packed(packing, ..) => {
            let _ =
                writeln!(out, "packing = \"{packing}\"  # assumed by the picture's shape: colour first, depth second");
        }
        Depth::Box => {
            let _ = writeln!(
                out,
                "# No depth was given: the room is taken for a box. Correct its size, or name a depth map."
            );
            let _ = writeln!(out, "depth = {{ box = [6, 2.7, 6], center = [0, 1.35, 0] }}");
        }
    }
    if let Depth::File(_, guess, _) | Depth::Packed(_, guess, _) = depth {
        let _ = writeln!(out, "# Assumed: {}.", guess.because);
        let meaning = match &args.depth_preset {
            Some(name) => format!("depth_preset = \"{name}\""),
            None => format!("encoding = \"{}\"", guess.rule.encoding.word()),
        };
        let _ = writeln!(out, "{meaning}\nscale = {}", guess.rule.scale);
        if guess.rule.offset != 0.0 {
            let _ = writeln!(out, "offset = {}  # walls are flattest so", guess.rule.offset);
        }
    }
    if let Some([pitch, roll]) = levelling {
        let _ = writeln!(out, "# The camera was tilted: this makes the floor level.\npitch = {pitch}\nroll = {roll}");
    }
    let found = if floor.is_some() { "the floor that was found is" } else { "no floor was found; it is taken for" };
    let _ = writeln!(out, "position = [0, {height:.3}, 0]  # {found} y = 0");
    let [x, _, z] = spot.to_array();
    let right = Vec3::new(-spot.z, 0.0, spot.x).normalize_or_zero();
    let standing = models.iter().enumerate().map(|(index, path)| {
        Standing::load(path, spot + right * 0.7 * (index as f32 - 0.5 * (models.len() - 1) as f32))
    });
    let standing: Vec<Standing> = standing.collect::<Result<_>>()?;
    let [look, fov] = framing(&standing, height, spot.length());
    let _ = writeln!(out, "\n[camera]  # at the capture point\nlook_at = [{x:.2}, {look}, {z:.2}]\nfov_y = {fov}");
    if models.is_empty() {
        let _ = writeln!(out, "\n# Something to begin with.\n[[object]]\nshape = \"sphere\"\nsize = 0.3");
        let _ = writeln!(out, "place = {{ floor = [{x:.2}, {z:.2}] }}");
    }
    for model in &standing {
        let at = model.at;
        let _ = writeln!(out, "\n[[object]]\ngltf = {}", quoted(model.path));
        if floor.is_some() {
            let _ = writeln!(out, "place = {{ floor = [{:.2}, {:.2}], facing = \"camera\" }}", at.x, at.z);
        } else {
            let down = if model.bounds.is_empty() { 0.0 } else { -model.bounds.min.y };
            let _ = writeln!(out, "translation = [{:.2}, {down:.3}, {:.2}]", at.x, at.z);
        }
        if model.is_odd() {
            let largest = model.largest();
            let _ =
                writeln!(out, "size = 0.4  # metres, its largest side. Its own {largest:.3} m can hardly be meant.");
        }
    }
    Ok(out)
}

/// A model that is put into the room.
struct Standing<'a> {
    path: &'a Path,
    /// Its own box, metres.
    bounds: Bounds,
    /// Where it stands, from the capture point.
    at: Vec3,
}

impl<'a> Standing<'a> {
    fn load(path: &'a Path, at: Vec3) -> Result<Self> {
        let (model, _) = gltf::load(path)?;
        let clip = (!model.rig.clips.is_empty()).then_some(0);
        let placement = Placement::fixed(Transform::IDENTITY);
        let object = Object { name: String::new(), model: Arc::new(model), placement, clip, speed: 1.0 };
        Ok(Self { path, bounds: model_bounds(&object, &Affine3A::IDENTITY), at })
    }

    fn largest(&self) -> f32 {
        (self.bounds.max - self.bounds.min).max_element()
    }

    /// Whether its own size can hardly be meant.
    fn is_odd(&self) -> bool {
        !(0.03..3.0).contains(&self.largest())
    }

    /// Its extents in the scene, metres.
    fn size(&self) -> Vec3 {
        if self.bounds.is_empty() {
            return Vec3::ZERO;
        }
        (self.bounds.max - self.bounds.min) * if self.is_odd() { 0.4 / self.largest() } else { 1.0 }
    }
}

/// The height over the floor that the camera looks at, `distance` ahead, and its vertical field of view in degrees, so
/// that all models are in the picture. The camera is `height` over the floor.
fn framing(standing: &[Standing<'_>], height: f32, distance: f32) -> [f32; 2] {
    const USUAL: [f32; 2] = [0.2, 50.0];
    /// Around what is shown, degrees.
    const MARGIN: f32 = 4.0;
    let elevation = |over: f32, away: f32| (over - height).atan2(away).to_degrees();
    let middle = elevation(USUAL[0], distance);
    let (mut low, mut high, mut across) = (f32::MAX, f32::MIN, 0.0_f32);
    for model in standing {
        // It may be turned in any way.
        let (size, away) = (model.size(), model.at.length());
        let radius = 0.5 * size.x.hypot(size.z);
        let near = (away - radius).max(0.3 * away);
        low = low.min(elevation(0.0, near));
        high = high.max(elevation(size.y, near)).max(elevation(size.y, away + radius));
        let aside = model.at.angle_between(standing[0].at.lerp(standing[standing.len() - 1].at, 0.5));
        across = across.max(aside + (radius / away).atan());
    }
    let fits = low > middle - 0.5 * USUAL[1] && high < middle + 0.5 * USUAL[1] && across < 38_f32.to_radians();
    if standing.is_empty() || fits {
        return USUAL;
    }
    // Pictures are 16:9 by default.
    let wide = 2.0 * (across.min(1.2).tan() * 9.0 / 16.0).atan().to_degrees();
    let fov = (high - low).max(wide) + 2.0 * MARGIN;
    let look = height + distance * (0.5 * (low + high)).to_radians().tan();
    [(100.0 * look).round() / 100.0, fov.round().clamp(USUAL[1], 100.0)]
}

/// A place on the floor where nothing stands: as straight ahead as can be, within a few steps.
fn free_spot(cloud: &Cloud, floor: Option<Level>, height: f32) -> Vec3 {
    let points: Vec<Vec3> = (0..cloud.depth.len()).filter_map(|index| cloud.point(index)).collect();
    let over = |p: &Vec3| p.y - floor.and_then(|floor| floor.height(p.x, p.z)).unwrap_or(-height);
    // Points of the floor around a place, and of things on it.
    let around = |at: Vec3| {
        let near = || points.iter().filter(|p| (p.x - at.x).hypot(p.z - at.z) < 0.4);
        let floor = near().filter(|p| over(p).abs() < 0.1).count();
        let things = near().filter(|p| over(p) > 0.12 && p.y < 0.0).count();
        (floor, things)
    };
    let turns = (0..=9).flat_map(|k| [20.0 * k as f32, -20.0 * k as f32]);
    let spots = turns.flat_map(|degrees| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        [1.6, 1.3, 2.0, 1.0, 2.6].map(|distance| Vec3::new(sin, 0.0, -cos) * distance)
    });
    let seen: Vec<(Vec3, (usize, usize))> = spots.map(|at| (at, around(at))).collect();
    let free = seen.iter().find(|(_, (floor, things))| *floor >= 6 && things * 20 <= *floor);
    // Where none is free, that which shows most of the floor beside what stands on it.
    let share = |(_, (floor, things)): &&(Vec3, (usize, usize))| *floor as f64 / (*floor + 4 * things + 6) as f64;
    let barest = || seen.iter().max_by(|a, b| share(a).total_cmp(&share(b)));
    let has_floor = |(_, (floor, _)): &&(Vec3, (usize, usize))| *floor > 0;
    free.or_else(barest).filter(has_floor).map_or(Vec3::new(0.0, 0.0, -1.6), |(at, _)| *at)
}
