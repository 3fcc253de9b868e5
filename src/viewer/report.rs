//! The report of a session, for scripts.

use super::{session::Session, state::Compare};
use serde::Serialize;
use serde_json::{Value, json};

/// What is written as JSON when a scripted session ends.
#[derive(Clone, Debug, Default, Serialize)]
pub struct SessionReport {
    /// The device that it ran on.
    pub device: String,
    /// Frames of the window that were shown.
    pub frames: u64,
    /// Frames of the window that were not shown, because the window was hidden or had just changed.
    pub skipped: u64,
    /// Number of rendered pictures.
    pub pictures: u64,
    /// Number of video frames that playing skipped.
    pub dropped: u64,
    /// How often the window's images were made anew.
    pub swapchains: u64,
    /// Milliseconds from the start to the first frame with a picture in it.
    pub first_picture_ms: Option<f64>,
    /// The longest time that events had to wait, milliseconds.
    pub longest_event_ms: f64,
    /// Screenshots with file, size in pixels, and number of accumulated frames.
    pub screenshots: Vec<Value>,
    /// What the `note` lines of the script noted.
    pub notes: Vec<Value>,
    /// The errors that were shown in the window.
    pub errors: Vec<String>,
    /// The messages of the validation layer.
    pub messages: Vec<String>,
}

/// The state of a session, for `note`.
pub fn note(word: &str, session: &Session, window: [u32; 2]) -> Value {
    let objects = session.editor.as_ref().map_or_else(Vec::new, |editor| {
        let names = editor.names().into_iter().enumerate();
        let object = |(index, name): (usize, String)| {
            let at = editor.transform(index, session.time);
            json!({
                "name": name,
                "translation": at.translation.to_array(),
                "rotation": at.rotation.to_array(),
                "scale": at.scale.to_array(),
            })
        };
        names.map(object).collect()
    });
    let camera = session.camera().map(|camera| {
        json!({
            "position": camera.position.to_array(),
            "rotation": camera.rotation.to_array(),
            "fov_y": camera.fov_y_degrees,
        })
    });
    let shown = session.shown.pictures.iter().flatten();
    let shown = shown.map(|p| json!({ "size": p.size, "full": p.full, "frames": p.frames, "frame_ms": p.frame_ms }));
    let compare = match session.compare {
        Compare::Single => "single",
        Compare::Split => "split",
        Compare::Difference => "difference",
    };
    json!({
        "note": word,
        "window": window,
        "picture": session.picture_size(),
        "selected": session.editor.as_ref().and_then(|editor| editor.selected()),
        "objects": objects,
        "steps": session.editor.as_ref().map(|editor| editor.steps().0).unwrap_or_default(),
        "changed": session.editor.as_ref().is_some_and(super::edit::Editor::changed),
        "closing": session.closing,
        "camera": camera,
        "frame": session.frame(),
        "playing": session.playing,
        "methods": session.sides.each_ref().map(|side| side.method.name()),
        "compare": compare,
        "divider": session.divider,
        "difference_shown": session.shown.difference.is_some(),
        "aov": session.aov,
        "under": session.under,
        "command": session.command().unwrap_or_default(),
        "shown": shown.collect::<Vec<_>>(),
        "present": session.mode.name(),
        "text": session.messages.iter().map(|message| message.text.clone()).collect::<Vec<_>>(),
    })
}
