//! What was understood of a video file that is looked at without a scene.

use crate::{
    Result,
    image_file::FileImage,
    media::{Decoder, VideoInfo},
    panorama::packing::packed_codes,
};
use serde::Serialize;
use std::{path::Path, sync::Arc};

/// The facts of a video file.
#[derive(Clone, Debug, Serialize)]
pub struct VideoReport {
    pub file: String,
    pub codec: String,
    pub pixels: String,
    pub size: [u32; 2],
    pub rotation: i32,
    pub frames: usize,
    pub rate: [u32; 2],
    pub varies: bool,
    pub seconds: f64,
    pub matrix: String,
    pub range: &'static str,
    pub primaries: String,
    pub transfer: String,
    /// Tags that the stream lacks, and what is taken for them.
    pub assumed: Vec<String>,
    pub audio: Option<String>,
    /// How colour and depth seem to share its pictures.
    pub packing: &'static str,
    pub warnings: Vec<String>,
    #[serde(skip)]
    lines: Vec<String>,
}

impl VideoReport {
    /// Looks at a file, and decodes all of it.
    ///
    /// # Errors
    /// Fails if it is no video that can be decoded to its end.
    pub fn of(path: &Path) -> Result<Self> {
        let info = Arc::new(VideoInfo::of(path)?);
        let first = Decoder::new(Arc::clone(&info)).read(0)?;
        let image = info.planes(&first).image();
        let warnings = info.verify()?.into_iter().collect();
        let (packing, words) = packing(image, info.size);
        let mut lines = info.lines();
        lines.push(format!("layout     {words}"));
        Ok(Self {
            file: path.display().to_string(),
            codec: info.codec.clone(),
            pixels: info.stored.clone(),
            size: info.size,
            rotation: info.rotation,
            frames: info.frame_count(),
            rate: info.rate,
            varies: info.varies,
            seconds: info.duration(),
            matrix: info.tags.matrix.to_string(),
            range: if info.tags.full_range { "full" } else { "limited" },
            primaries: info.tags.primaries.clone(),
            transfer: info.tags.transfer.clone(),
            assumed: info.assumed.clone(),
            audio: info.audio.clone(),
            packing,
            warnings,
            lines,
        })
    }

    /// Returns the facts as text.
    pub fn text(&self) -> String {
        self.lines.join("\n")
    }
}

/// Guesses the packing: grey is depth.
fn packing(image: FileImage, [width, height]: [u32; 2]) -> (&'static str, String) {
    let grey = |beside: bool| packed_codes(image.clone(), beside, "video").is_ok();
    match (width, height) {
        (w, h) if w == h && grey(false) => {
            ("top-bottom", "colour above, grey depth below: packing = \"top-bottom\"".into())
        }
        (w, h) if w == 4 * h && grey(true) => {
            ("left-right", "colour left, grey depth right: packing = \"left-right\"".into())
        }
        (w, h) if w == 2 * h && image.into_codes("video").is_ok() => {
            ("separate", "grey: a panorama's depth, it seems".into())
        }
        (w, h) if w == 2 * h => ("separate", "a panorama; its depth must come from elsewhere".into()),
        _ => ("unknown", "not the shape of a panorama, which is twice as wide as high".into()),
    }
}
