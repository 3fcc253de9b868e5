//! Writes the scene as it is now, so that `render` shows what the window shows. A scene file keeps its
//! comments and all that was not changed. A built-in room becomes a folder, as `iprt scene export` makes it.

use super::edit::{Editor, Made, Origin, Painted};
use crate::{
    Error, Result,
    image_file::{
        tonemap::Tonemap,
        write::{folder_of, make_folder, write_bytes},
    },
    scene::{
        Scene,
        animation::Placement,
        camera::CameraTrack,
        export::{Export, camera_table, placement_table},
        file::{RenderSettings, read_scene_file},
        material_override::{MaterialOverride, Value},
        shapes::Shape,
    },
    settings::{Method, Settings},
};
use std::path::{Path, PathBuf};
use toml_edit::{ArrayOfTables, DocumentMut, Item, Table};

/// What goes into the file besides objects.
pub struct SavedView {
    /// The camera, if it was moved by hand.
    pub camera: Option<CameraTrack>,
    /// Method, exposure, and the settings that differ from the method's own.
    pub render: RenderSettings,
}

/// A method and its settings as a scene file gives them.
pub fn render_settings(method: Method, settings: &Settings, exposure: f32, tonemap: Tonemap) -> RenderSettings {
    let preset = Settings::of(method).values();
    let differing = settings.values().into_iter().zip(preset).filter(|(now, preset)| now != preset);
    let set = differing.map(|((name, value), _)| (name.to_owned(), toml::Value::String(value))).collect();
    RenderSettings { method: method.name(), exposure, tonemap, set }
}

/// Where a scene is saved by default: its own file, or a folder with the room's name.
pub fn usual_place(origin: &Origin) -> PathBuf {
    match origin {
        Origin::File(path) => path.clone(),
        Origin::Room(room) => PathBuf::from(format!("{}-scene", room.name)),
    }
}

/// Saves the scene and returns the scene file. `again` says that the window itself has written there before.
///
/// # Errors
/// Fails if something cannot be written, or if the scene file goes to another folder than the one that its
/// paths are relative to.
pub fn save(editor: &Editor, view: &SavedView, to: &Path, again: bool) -> Result<PathBuf> {
    match &editor.origin {
        Origin::File(from) => save_file(editor, view, from, to),
        Origin::Room(room) => {
            let mut room = (**room).clone();
            room.objects = editor.scene().objects().cloned().collect();
            if let Some(camera) = &view.camera {
                room.camera = camera.clone();
            }
            let mut export = Export::of(&room);
            if again {
                make_folder(to)?;
            } else {
                export.prepare(to)?;
            }
            let mut text: DocumentMut = parse(to, &export.scene)?;
            write_render(&mut text, view);
            export.scene = text.to_string();
            let panorama = &editor.scene().panorama;
            let frames = (0..panorama.frame_count()).map(|index| panorama.load(index)).collect::<Result<Vec<_>>>()?;
            export.write(to, &frames)
        }
    }
}

fn parse(path: &Path, text: &str) -> Result<DocumentMut> {
    text.parse().map_err(|error: toml_edit::TomlError| {
        Error::input(path.display(), error.message().replace('\n', " "), "correct the TOML, then save again")
    })
}

fn save_file(editor: &Editor, view: &SavedView, from: &Path, to: &Path) -> Result<PathBuf> {
    let folder = |path: &Path| {
        let folder = folder_of(path);
        std::fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned())
    };
    if folder(from) != folder(to) {
        let remedy = format!("save it in {}, to which its paths are relative", folder(from).display());
        return Err(Error::input(to.display(), "is in another folder than the scene", remedy));
    }
    let text = std::fs::read_to_string(from)
        .map_err(|error| Error::input(from.display(), error.kind().to_string(), "save it under another name"))?;
    let mut document = parse(from, &text)?;
    let first = |mut problems: Vec<Error>| problems.remove(0);
    let specs = read_scene_file(from).map_err(first)?.objects;
    let names: Vec<String> = specs.iter().map(|spec| spec.name.clone()).collect();
    // What the room places stands where it did when the scene was opened.
    let known: Vec<Placement> = if specs.iter().any(|spec| spec.place.is_some() || spec.side.is_some()) {
        Scene::load(from)?.objects().map(|object| object.placement.clone()).collect()
    } else {
        specs.into_iter().map(|spec| spec.placement).collect()
    };
    let old = document.remove("object").and_then(|item| item.into_array_of_tables().ok()).unwrap_or_default();
    let mut objects = ArrayOfTables::new();
    for (index, (object, made)) in editor.scene().objects().zip(editor.made()).enumerate() {
        let kept = match made {
            Made::Kept(index) => old.get(*index).cloned(),
            _ => None,
        };
        let unmoved = matches!(made, Made::Kept(index) if known.get(*index) == Some(&object.placement));
        let mut table = kept.unwrap_or_default();
        table.set_position(None); // in the order of the objects, not of the former file
        match made {
            // A copy has another name.
            Made::Kept(index) if names.get(*index).is_some_and(|name| *name != object.name) => {
                table["name"] = toml_edit::value(&object.name);
            }
            Made::Kept(_) => {}
            Made::Gltf(path) => {
                table["name"] = toml_edit::value(&object.name);
                let near = pathdiff::diff_paths(path, folder(to)).unwrap_or_else(|| path.clone());
                table["gltf"] = toml_edit::value(near.to_string_lossy().into_owned());
            }
            Made::Shape(shape, size) => {
                table["name"] = toml_edit::value(&object.name);
                table["shape"] = toml_edit::value(Shape::NAMES[*shape as usize]);
                let size: toml_edit::Array = size.to_array().iter().map(|side| shortest(*side)).collect();
                table["size"] = toml_edit::value(size);
            }
        }
        if let Some(painted) = editor.painted(index).filter(|painted| painted.is_touched()) {
            write_material(&mut table, painted);
        }
        if !unmoved {
            let mut placed = placement_table(&object.placement);
            for (key, none) in [("rotation", vec![0.0, 0.0, 0.0, 1.0]), ("scale", vec![1.0; 3])] {
                let is_none = placed.get(key).is_some_and(|value| *value == none.clone().into());
                if is_none && !table.contains_key(key) {
                    placed.remove(key);
                }
            }
            replace(&mut table, &["translation", "rotation", "scale", "key", "place"], placed)?;
            // The scale holds it now.
            if table.contains_key("gltf") {
                table.remove("size");
            }
        }
        objects.push(table);
    }
    if !objects.is_empty() {
        document.insert("object", Item::ArrayOfTables(objects));
    }
    if let Some(camera) = &view.camera {
        let table = document.entry("camera").or_insert(Item::Table(Table::new()));
        let Some(table) = table.as_table_mut() else {
            return Err(Error::input(from.display(), "its camera is no [camera] table", "write it as one"));
        };
        let mut new = camera_table(camera);
        new.remove("size");
        replace(table, &["position", "look_at", "yaw", "pitch", "fov_y", "key"], new)?;
    }
    write_render(&mut document, view);
    write_bytes(to, document.to_string().as_bytes())?;
    Ok(to.to_owned())
}

/// Writes what was set of a material by hand, beside what the file had set of it.
fn write_material(table: &mut Table, painted: &Painted) {
    let material = table.entry("material").or_insert(toml_edit::value(toml_edit::InlineTable::new()));
    let Some(material) = material.as_table_like_mut() else { return };
    for entry in MaterialOverride::ENTRIES {
        match (entry.get)(&painted.by).or((entry.get)(&painted.of_file)) {
            Some(Value::Number(number)) => {
                material.insert(entry.key, toml_edit::value(shortest(number)));
            }
            Some(Value::Color(color)) => {
                let color: toml_edit::Array = color.to_array().into_iter().map(shortest).collect();
                material.insert(entry.key, toml_edit::value(color));
            }
            None => {
                material.remove(entry.key);
            }
        }
    }
    if material.is_empty() {
        table.remove("material");
    }
}

/// The shortest decimal that reads back as the same single-precision number.
fn shortest(value: f32) -> f64 {
    value.to_string().parse().unwrap_or_else(|_| f64::from(value))
}

/// Replaces some entries by those of another table.
fn replace(table: &mut Table, keys: &[&str], by: toml::Table) -> Result<()> {
    for key in keys {
        table.remove(key);
    }
    // The two crates share the text, but not the types.
    let by: DocumentMut =
        by.to_string().parse().map_err(|error: toml_edit::TomlError| Error::Internal(error.to_string()))?;
    for (key, item) in by.iter() {
        let item = match item.as_array_of_tables() {
            // The table is written inline, since a table of its own would end the object's.
            Some(tables) => {
                toml_edit::value(tables.iter().map(|t| t.clone().into_inline_table()).collect::<toml_edit::Array>())
            }
            None => item.clone(),
        };
        table.insert(key, item);
    }
    Ok(())
}

/// Writes method, settings and exposure where they differ from the defaults, or were in the file before. That the
/// window fills what was never seen was set by nobody, and is written only with a camera that may see it.
fn write_render(document: &mut DocumentMut, SavedView { camera, render }: &SavedView) {
    let default = RenderSettings::default();
    let mut new = Table::new();
    let old = document.entry("render").or_insert(Item::Table(Table::new()));
    let Some(old) = old.as_table_like_mut() else { return };
    let mut write = |key: &str, value: Item, is_default: bool| {
        if old.contains_key(key) || !is_default {
            new.insert(key, value);
        }
    };
    write("method", toml_edit::value(&render.method), render.method == default.method);
    write("exposure", toml_edit::value(shortest(render.exposure)), render.exposure == default.exposure);
    write("tonemap", toml_edit::value(render.tonemap.name()), render.tonemap == default.tonemap);
    let had = |key: &str| old.get("set").and_then(Item::as_table_like).is_some_and(|set| set.contains_key(key));
    let mut set = toml_edit::InlineTable::new();
    for (key, value) in &render.set {
        let value = value.as_str().unwrap_or_default();
        if (key.as_str(), value) != ("fill_unseen", "true") || had(key) || camera.is_some() {
            set.insert(key, value.into());
        }
    }
    old.remove("set");
    if !set.is_empty() {
        new.insert("set", toml_edit::value(set));
    }
    for (key, item) in new {
        old.insert(&key, item);
    }
    if old.is_empty() {
        document.remove("render");
    }
}
