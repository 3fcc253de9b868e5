//! Parses the scene file (`docs/scene.md`) to plain values, and reports everything that is wrong at once.

use super::{
    animation::{Placement, Track, Turn},
    camera::{Aim, CameraTrack},
    fields::{FieldTable, Problems},
    file_panorama::read_panorama,
    material::Material,
    material_override::{MaterialOverride, Value},
    placing::{Place, read_place},
    shapes::Shape,
};
use crate::{
    Error,
    image_file::{read, tonemap::Tonemap},
    panorama::source::PanoramaSpec,
    settings::{Method, Settings},
};
use glam::{Quat, Vec3};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};
use toml::Table;

/// The content of a scene file.
#[derive(Clone, Debug)]
pub struct SceneFile {
    /// The file's stem.
    pub name: String,
    pub panorama: PanoramaSpec,
    pub camera: CameraTrack,
    pub objects: Vec<ObjectSpec>,
    /// The glTF file of the true room, for `--model scene`.
    pub room: Option<PathBuf>,
    pub render: RenderSettings,
    /// What is understood but not done.
    pub warnings: Vec<String>,
}

/// The table `[render]`.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderSettings {
    /// The value of `--method`.
    pub method: String,
    /// A factor on radiance for display.
    pub exposure: f32,
    /// How light beyond white is shown.
    pub tonemap: Tonemap,
    /// The values of `--set`, by key.
    pub set: BTreeMap<String, toml::Value>,
}

impl RenderSettings {
    /// Returns `set` as `--set` takes it.
    pub fn set_text(&self) -> Vec<(String, String)> {
        let text = |value: &toml::Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        self.set.iter().map(|(name, value)| (name.clone(), text(value))).collect()
    }
}

impl Default for RenderSettings {
    fn default() -> Self {
        Self { method: "iprt".into(), exposure: 1.0, tonemap: Tonemap::Clip, set: BTreeMap::new() }
    }
}

/// A table `[[object]]`.
#[derive(Clone, Debug)]
pub struct ObjectSpec {
    pub name: String,
    pub source: ObjectSource,
    pub placement: Placement,
    /// Where it stands in the room, in place of a translation.
    pub place: Option<Place>,
    /// The largest side of a glTF model in metres, in place of its own.
    pub side: Option<f32>,
    /// The glTF animation that is played: `None` plays the first one if there is any, `"none"` none.
    /// The name of one of the glTF's material variants.
    pub variant: Option<String>,
    pub clip: Option<String>,
    /// A factor on the clip's time.
    pub speed: f64,
    /// What of the clip has been played at time 0, seconds.
    pub offset: f64,
    /// Whether the clip ends with its last key, and does not repeat.
    pub hold: bool,
    /// A factor on its lights without a surface.
    pub light: f64,
    pub material: Option<MaterialOverride>,
}

/// The geometry of an object.
#[derive(Clone, Debug, PartialEq)]
pub enum ObjectSource {
    Gltf(PathBuf),
    /// A shape and its full extents, metres.
    Shape(Shape, Vec3),
}

/// Reads and parses a scene file. Does not look at the files that it names.
///
/// # Errors
/// Fails with every problem of the file itself.
pub fn read_scene_file(path: &Path) -> Result<SceneFile, Vec<Error>> {
    let subject = path.display().to_string();
    let bytes = read::read_bytes(path).map_err(|error| vec![error])?;
    let text = String::from_utf8(bytes)
        .map_err(|_| vec![Error::input(&subject, "is not a text file", "give a scene file in TOML")])?;
    parse(path, &text)
}

/// Parses a scene file's text. `path` names it and anchors relative paths.
///
/// # Errors
/// Fails with every problem found.
pub fn parse(path: &Path, text: &str) -> Result<SceneFile, Vec<Error>> {
    let table: Table = text.parse().map_err(|error: toml::de::Error| {
        let line = error.span().map_or(0, |span| text[..span.start.min(text.len())].matches('\n').count()) + 1;
        let subject = format!("{}: line {line}", path.display());
        vec![Error::input(subject, read::one_line(&error.message()), "correct the TOML")]
    })?;
    let report = Problems::new(path);
    let mut warnings = Vec::new();
    let root = FieldTable::new(&report, "", &table, &["panorama", "camera", "object", "room", "render"]);
    let panorama = match root.table("panorama", super::file_panorama::KEYS) {
        Some(fields) => read_panorama(&fields, &mut warnings),
        None => {
            if !root.has("panorama") {
                root.complain("panorama", "is missing", "add [panorama] with color and depth");
            }
            None
        }
    };
    let start = panorama.as_ref().map_or(Vec3::ZERO, |panorama| panorama.position);
    let camera = root.table("camera", &CAMERA_KEYS).map(|fields| read_camera(&fields, start));
    let objects: Vec<_> = root.tables("object", OBJECT_KEYS).iter().filter_map(|fields| read_object(fields)).collect();
    let room = root.table("room", &["gltf"]).and_then(|fields| {
        if !fields.has("gltf") {
            fields.complain("gltf", "is missing", "name the glTF file of the true room");
        }
        fields.file_path("gltf")
    });
    let render = root.table("render", &["method", "exposure", "tonemap", "set"]).map(|fields| read_render(&fields));
    let problems = report.into_problems();
    match panorama {
        Some(panorama) if problems.is_empty() => Ok(SceneFile {
            name: path.file_stem().map_or_else(|| "scene".into(), |stem| stem.to_string_lossy().into_owned()),
            panorama,
            camera: camera.unwrap_or_else(|| CameraTrack::at_point(start)),
            objects,
            room,
            render: render.unwrap_or_default(),
            warnings,
        }),
        _ => Err(problems),
    }
}

pub(super) fn vec3(values: [f64; 3]) -> Vec3 {
    Vec3::from_array(values.map(|value| value as f32))
}

const AIM_KEYS: [&str; 5] = ["position", "look_at", "yaw", "pitch", "fov_y"];
const CAMERA_KEYS: [&str; 7] = ["position", "look_at", "yaw", "pitch", "fov_y", "size", "key"];
const CAMERA_KEY_KEYS: [&str; 7] = ["time", "position", "look_at", "yaw", "pitch", "fov_y", "size"];

fn read_fov(fields: &FieldTable) -> Option<f32> {
    fields.number_in("fov_y", "between 0 and 180 degrees", |f| f > 0.0 && f < 180.0).map(|f| f as f32)
}

fn read_camera(fields: &FieldTable, start: Vec3) -> CameraTrack {
    let default = CameraTrack::at_point(start);
    let keys = fields.tables("key", &CAMERA_KEY_KEYS);
    let mut tracks: [Vec<(f64, [f64; 3])>; 5] = Default::default();
    for key in &keys {
        let Some(time) = key_time(key) else { continue };
        if !AIM_KEYS.iter().any(|name| key.has(name)) {
            key.complain("time", "a key frame that sets nothing", "add position, look_at, yaw, pitch or fov_y");
        }
        if key.has("size") {
            key.complain("size", "the image size cannot change over time", "set it in [camera]");
        }
        both_aims(key);
        let values = [
            key.vector("position"),
            key.vector("look_at"),
            key.number("yaw").map(|yaw| [yaw; 3]),
            key.number("pitch").map(|pitch| [pitch; 3]),
            read_fov(key).map(|fov| [f64::from(fov); 3]),
        ];
        for (track, value) in tracks.iter_mut().zip(values) {
            track.extend(value.map(|value| (time, value)));
        }
    }
    both_aims(fields);
    if keys.iter().any(|key| key.has("look_at")) && keys.iter().any(|key| key.has("yaw") || key.has("pitch")) {
        fields.complain("key", "some key frames use look_at, others yaw or pitch", "use one of the two in all");
    }
    let [position, look_at, yaw, pitch, fov_y] = tracks;
    let vectors = |keys: Vec<(f64, [f64; 3])>| keys.into_iter().map(|(time, value)| (time, vec3(value))).collect();
    let numbers = |keys: Vec<(f64, [f64; 3])>| keys.into_iter().map(|(time, value)| (time, value[0] as f32)).collect();
    let angle = |key: &str| fields.number(key).unwrap_or(0.0) as f32;

    let position = Track::from_keys(vectors(position), fields.vector("position").map_or(start, vec3));
    let target = fields.vector("look_at").map(vec3);
    let aim = if !look_at.is_empty() || (yaw.is_empty() && pitch.is_empty() && target.is_some()) {
        Aim::LookAt(Track::from_keys(vectors(look_at), target.unwrap_or_default()))
    } else {
        Aim::Angles {
            yaw: Track::from_keys(numbers(yaw), angle("yaw")),
            pitch: Track::from_keys(numbers(pitch), angle("pitch")),
        }
    };
    if let Aim::LookAt(target) = &aim
        && target.is_constant()
        && position.is_constant()
        && target.at(0.0) == position.at(0.0)
    {
        fields.complain("look_at", "is where the camera stands", "give a point in front of it");
    }
    let fov_y_degrees = Track::from_keys(numbers(fov_y), read_fov(fields).unwrap_or(60.0));
    CameraTrack { position, aim, fov_y_degrees, size: read_size(fields).unwrap_or(default.size) }
}

fn read_size(fields: &FieldTable) -> Option<[u32; 2]> {
    let size = fields.integers("size")?;
    match <[u32; 2]>::try_from(size) {
        Ok(size) if size.iter().all(|side| (1..=16384).contains(side)) => Some(size),
        _ => {
            fields.complain("size", "is no image size", "write size = [width, height], each 1 to 16384");
            None
        }
    }
}

fn both_aims(fields: &FieldTable) {
    if fields.has("look_at") && (fields.has("yaw") || fields.has("pitch")) {
        fields.complain("look_at", "stands beside yaw or pitch", "give look_at, or yaw and pitch");
    }
}

fn key_time(key: &FieldTable) -> Option<f64> {
    if !key.has("time") {
        key.complain("time", "is missing", "give the key frame's time in seconds");
    }
    key.number("time")
}

const OBJECT_KEYS: &[&str] = &[
    "name",
    "gltf",
    "variant",
    "shape",
    "size",
    "place",
    "translation",
    "rotation",
    "scale",
    "clip",
    "speed",
    "offset",
    "repeat",
    "light",
    "material",
    "key",
];

fn read_object(fields: &FieldTable) -> Option<ObjectSpec> {
    let shape = fields.word("shape", &Shape::NAMES).map(|index| Shape::ALL[index]);
    let gltf = fields.file_path("gltf");
    if fields.has("gltf") == fields.has("shape") {
        let problem = if fields.has("gltf") { "stands beside shape" } else { "and shape are both missing" };
        fields.complain("gltf", problem, "give one of gltf and shape");
    }
    let (size, side) = match (fields.value("size"), fields.has("gltf")) {
        (None, _) => (None, None),
        (Some(toml::Value::Array(_)), true) => {
            fields.complain("size", "only shapes have three sides", "write size = 0.3, the largest side in metres");
            (None, None)
        }
        (Some(toml::Value::Array(_)), false) => (fields.vector("size").map(vec3), None),
        (Some(_), is_gltf) => {
            let side = fields.number_in("size", "above 0 (metres)", |side| side > 0.0 && side < 1e6);
            let side = side.map(|side| side as f32);
            if is_gltf { (None, side) } else { (side.map(Vec3::splat), None) }
        }
    };
    if side.is_some()
        && fields.tables("key", &["time", "translation", "rotation", "scale"]).iter().any(|k| k.has("scale"))
    {
        fields.complain("size", "stands beside key frames of scale", "give one of the two");
    }
    if let (Some(size), Some(shape)) = (size, shape) {
        let used = if shape == Shape::Plane { Vec3::new(size.x, 1.0, size.z) } else { size };
        if used.min_element() <= 0.0 {
            fields.complain("size", "is not positive", "give full extents in metres");
        }
    }
    if fields.has("shape") {
        for key in ["clip", "speed", "offset", "repeat"].into_iter().filter(|key| fields.has(key)) {
            fields.complain(key, "a shape has no animation clips", "use key frames: key = [ … ]");
        }
        if fields.has("light") {
            fields.complain("light", "a shape has no lights", "use material.emissive");
        }
        if fields.has("variant") {
            fields.complain("variant", "a shape has no variants", "leave variant out");
        }
    }
    let material = fields.table("material", MaterialOverride::KEYS).map(|material| read_material(&material));
    let (placement, place) = (read_placement(fields), read_place(fields));
    let clip = fields.string("clip").map(str::to_owned);
    let variant = fields.string("variant").map(str::to_owned);
    let speed = fields.number("speed").unwrap_or(1.0);
    let offset = fields.number("offset").unwrap_or(0.0);
    let hold = fields.word("repeat", &["loop", "hold"]) == Some(1);
    let light = fields.number_in("light", "from 0 to 1e6", |v| (0.0..=1e6).contains(&v)).unwrap_or(1.0);
    let name = fields.string("name").map(str::to_owned);
    let source = match (gltf, shape) {
        (Some(path), None) => ObjectSource::Gltf(path),
        (None, Some(shape)) => ObjectSource::Shape(shape, size.unwrap_or(Vec3::ONE)),
        _ => return None,
    };
    let default_name = || match &source {
        // As it is written: values of $NAME are nobody's business.
        ObjectSource::Gltf(_) => {
            let stem = fields.string("gltf").and_then(|text| Path::new(text).file_stem());
            stem.map_or("object".into(), |stem| stem.to_string_lossy().into_owned())
        }
        ObjectSource::Shape(shape, _) => Shape::NAMES[*shape as usize].to_owned(),
    };
    let name = name.unwrap_or_else(default_name);
    Some(ObjectSpec { name, source, placement, place, side, variant, clip, speed, offset, hold, light, material })
}

fn read_material(fields: &FieldTable) -> MaterialOverride {
    let mut by = MaterialOverride::default();
    for entry in MaterialOverride::ENTRIES {
        let [least, most] = entry.range;
        let range = if most < 1e9 { format!("from {least} to {most}") } else { format!("from {least}") };
        let fits = |value: f64| (f64::from(least)..=f64::from(most)).contains(&value);
        let value = match (entry.of)(&Material::default()) {
            Value::Number(_) => fields.number_in(entry.key, &range, fits).map(|number| Value::Number(number as f32)),
            Value::Color(_) => fields.vector(entry.key).map(|color| {
                if !color.into_iter().all(fits) {
                    fields.complain(entry.key, "is out of range", format!("give three numbers {range}"));
                }
                Value::Color(vec3(color))
            }),
        };
        (entry.set)(&mut by, value);
    }
    by
}

fn read_rotation(fields: &FieldTable) -> Option<Turn> {
    let values = fields.numbers("rotation")?;
    let values: Vec<f32> = values.iter().map(|v| *v as f32).collect();
    match values[..] {
        [x, y, z] => Some(Turn::of_degrees(Vec3::new(x, y, z))),
        [x, y, z, w] if Quat::from_xyzw(x, y, z, w).length() > 1e-6 => {
            Some(Quat::from_xyzw(x, y, z, w).normalize().into())
        }
        _ => {
            let remedy = "give [x, y, z] in degrees or a quaternion [x, y, z, w]";
            fields.complain("rotation", "is no rotation", remedy);
            None
        }
    }
}

fn read_scale(fields: &FieldTable) -> Option<Vec3> {
    let scale = match fields.value("scale")? {
        toml::Value::Array(_) => fields.vector("scale").map(vec3),
        _ => fields.number("scale").map(|scale| Vec3::splat(scale as f32)),
    };
    if scale.is_some_and(|scale| scale.abs().min_element() < 1e-9) {
        fields.complain("scale", "flattens the object", "give numbers that are not 0");
    }
    scale
}

fn read_placement(fields: &FieldTable) -> Placement {
    let translation = fields.vector("translation").map_or(Vec3::ZERO, vec3);
    let rotation = read_rotation(fields).unwrap_or(Quat::IDENTITY.into());
    let scale = read_scale(fields).unwrap_or(Vec3::ONE);
    let (mut translations, mut rotations, mut scales) = (Vec::new(), Vec::new(), Vec::new());
    for key in fields.tables("key", &["time", "translation", "rotation", "scale"]) {
        let Some(time) = key_time(&key) else { continue };
        let (translation, rotation, scale) =
            (key.vector("translation").map(vec3), read_rotation(&key), read_scale(&key));
        if !["translation", "rotation", "scale"].iter().any(|name| key.has(name)) {
            key.complain("time", "a key frame that sets nothing", "add translation, rotation or scale");
        }
        translations.extend(translation.map(|value| (time, value)));
        rotations.extend(rotation.map(|value| (time, value)));
        scales.extend(scale.map(|value| (time, value)));
    }
    Placement {
        translation: Track::from_keys(translations, translation),
        rotation: Track::from_keys(rotations, rotation),
        scale: Track::from_keys(scales, scale),
    }
}

fn read_render(fields: &FieldTable) -> RenderSettings {
    let default = RenderSettings::default();
    let set = match fields.value("set") {
        Some(toml::Value::Table(table)) => table.clone().into_iter().collect(),
        None => BTreeMap::new(),
        Some(_) => {
            fields.complain("set", "is no table", "write set = { key = value }");
            BTreeMap::new()
        }
    };
    let render = RenderSettings {
        method: fields.string("method").map_or(default.method, str::to_owned),
        exposure: fields.number_in("exposure", "above 0", |v| v > 0.0).unwrap_or(1.0) as f32,
        tonemap: fields.word("tonemap", &Tonemap::NAMES).map_or(Tonemap::Clip, |index| Tonemap::ALL[index]),
        set,
    };
    match Method::parse(&render.method, &fields.subject("method")) {
        Ok(method) => {
            let mut settings = Settings::of(method);
            for (key, text) in render.set_text() {
                let _ = settings.set(&key, &text, &fields.subject("set")).map_err(|problem| fields.report(problem));
            }
        }
        Err(problem) => fields.report(problem),
    }
    render
}
