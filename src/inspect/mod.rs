//! What a scene measures: picture, depth, floor, light, objects and how they stand. `iprt check` prints it, as
//! text, JSON or a sheet of pictures, with a warning for what can hardly be right and the line to write.

pub mod object;
pub mod sheet;
pub mod video;

use crate::{
    options::RenderOptions,
    panorama::{
        clipped::ClippedLamp,
        cloud::Cloud,
        depth::length_words as metres,
        room::{self, Level},
        source::{DepthSource, PanoramaFrame},
    },
    plan::Plan,
    scene::{Scene, load::Examined},
    terminal::plain,
};
use glam::Vec3;
use object::{ObjectFacts, Room};
use serde::Serialize;
use std::{fmt::Write as _, path::Path};

/// What a scene measures at its start.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    pub scene: String,
    pub frames: usize,
    pub color: ColorFacts,
    pub depth: DepthFacts,
    pub floor: Option<Level>,
    pub ceiling: Option<Level>,
    pub objects: Vec<ObjectFacts>,
    /// What can hardly be right.
    pub warnings: Vec<String>,
}

/// What the panorama's picture holds.
#[derive(Clone, Debug, Serialize)]
pub struct ColorFacts {
    pub size: [u32; 2],
    /// The layer or channels that were taken, of a file that has several.
    pub taken: Option<String>,
    /// Radiance: the least, the median and the largest luminance.
    pub radiance: [f32; 3],
    /// The share of texels with a channel at the largest value, where the camera was saturated.
    pub clipped: f32,
    /// The lamps that an LDR capture clips, with the factors that the light they cast asks for. `None` if they
    /// are not estimated.
    pub lamps: Option<Vec<ClippedLamp>>,
}

/// What the panorama's depth holds.
#[derive(Clone, Debug, Serialize)]
pub struct DepthFacts {
    pub size: [u32; 2],
    pub taken: Option<String>,
    pub encoding: String,
    /// Metres at 1, 50 and 99 % of what is known; `None` if all is holes.
    pub metres: Option<[f32; 3]>,
    /// The share of the sphere without depth.
    pub holes: f32,
    /// The standard deviation from texel to texel, as a share of the distance; 0 if it is too little to matter.
    pub noise: f32,
}

/// Reads all that a scene file names, and finds every problem that rendering would have before it asks the
/// device.
pub fn examine(path: &Path) -> Examined {
    let mut examined = Scene::examine(path);
    if let Some(scene) = examined.scene.as_ref().filter(|_| examined.problems.is_empty()) {
        let planned = RenderOptions::of(scene).and_then(|options| Plan::of(scene, &options, None));
        examined.problems.extend(planned.err());
    }
    examined
}

impl Report {
    /// Measures a scene by its first panorama frame.
    pub fn of(scene: &Scene, frame: &PanoramaFrame, cloud: &Cloud) -> Self {
        let panorama = &scene.panorama;
        let spec = panorama.spec();
        let (floor, ceiling) = (room::level(cloud, true), room::level(cloud, false));
        let subject = match spec.map(|spec| &spec.depth) {
            Some(DepthSource::Files(path)) => path.display().to_string(),
            _ => scene.name.clone(),
        };
        let measured = matches!(spec.map(|spec| &spec.depth), Some(DepthSource::Files(_) | DepthSource::Packed));
        let rule = spec.filter(|_| measured).map(|spec| &spec.rule);
        let mut warnings = room::depth_warnings(cloud, rule, floor, &subject);
        warnings.extend(frame.warnings.iter().filter(|warning| warning.contains("it seems to be in")).cloned());
        // Where distances mean something else, the room says nothing about its objects.
        let sound = warnings.is_empty();
        if measured {
            warnings.extend(room::edge_warning(room::edges(frame, cloud), &subject));
        }
        if let Some(spec) = spec.filter(|_| measured && sound) {
            warnings.extend(room::tilt_warning([floor, ceiling], spec, &subject));
        }
        let objects: Vec<(usize, ObjectFacts)> = (0..scene.object_count())
            .filter_map(|index| Some((index, ObjectFacts::of(scene, index, cloud, floor, panorama.position)?)))
            .collect();
        if sound {
            let has_surfaces = !matches!(spec.map(|spec| &spec.depth), Some(DepthSource::Sphere(_)));
            let room = Room::of(cloud, [floor, ceiling], panorama.position, has_surfaces);
            warnings.extend(objects.iter().flat_map(|(index, facts)| facts.warnings(scene, *index, &room)));
        }
        let percentiles = [0.01, 0.5, 0.99].map(|share| cloud.percentile(share));
        Self {
            scene: scene.name.clone(),
            frames: panorama.frame_count(),
            color: ColorFacts {
                lamps: panorama.clipped_lamps().map(|found| found.lamps.clone()),
                ..color_facts(frame)
            },
            depth: DepthFacts {
                size: frame.depth_size,
                taken: frame.taken[1].clone(),
                encoding: spec.map_or("made in memory".into(), encoding),
                metres: percentiles.into_iter().collect::<Option<Vec<_>>>().and_then(|all| all.try_into().ok()),
                holes: cloud.holes(),
                noise: frame.quality().noise,
            },
            floor,
            ceiling,
            objects: objects.into_iter().map(|(_, facts)| facts).collect(),
            warnings,
        }
    }

    /// Returns what was measured as text.
    pub fn text(&self) -> String {
        let mut out = String::new();
        let (color, depth) = (&self.color, &self.depth);
        let taken = |taken: &Option<String>| taken.as_ref().map_or(String::new(), |taken| format!("; {taken}"));
        let [w, h] = color.size;
        let _ = writeln!(out, "colour   {w}x{h}, {} frames{}", self.frames, taken(&color.taken));
        let [least, median, most] = color.radiance;
        let clipped = 100.0 * color.clipped;
        let _ = writeln!(
            out,
            "light    radiance {least:.3} to {most:.3}, median {median:.3}; {clipped:.1} % at the largest value"
        );
        if let Some(lamps) = color.lamps.as_ref().filter(|lamps| !lamps.is_empty()) {
            let _ = writeln!(out, "lamps    {}", lamp_words(lamps));
        }
        let [w, h] = depth.size;
        let holes = 100.0 * depth.holes;
        let range = match depth.metres {
            Some([near, middle, far]) => format!("{} to {}, median {}", metres(near), metres(far), metres(middle)),
            None => "nothing but holes".to_owned(),
        };
        let noise = match 100.0 * depth.noise {
            0.0 => String::new(),
            noise => format!(", {noise:.1} % noise, which is smoothed"),
        };
        let encoding = &depth.encoding;
        let _ =
            writeln!(out, "depth    {w}x{h}, {encoding}: {range}; {holes:.1} % holes{noise}{}", taken(&depth.taken));
        for (name, level, side) in [("floor  ", self.floor, "under"), ("ceiling", self.ceiling, "over")] {
            let found = level.map_or("none found".to_owned(), |level| {
                format!("{} {side} the camera, tilted by {:.1}°", metres(level.distance), level.tilt)
            });
            let _ = writeln!(out, "{name}  {found}");
        }
        for object in &self.objects {
            let size = object.size.map(metres).join(" × ");
            let stands = match (object.gap, object.beyond) {
                (_, Some(beyond)) if beyond > 0.0 => format!("{} behind the real surface", metres(beyond)),
                (Some(gap), _) if gap < 0.0 => format!("{} below the surface under it", metres(-gap)),
                (Some(gap), _) => format!("{} over the surface below it", metres(gap)),
                (None, _) => "over nothing that was seen".to_owned(),
            };
            let _ = writeln!(out, "object   {}: {size}, {stands}", plain(&object.name));
        }
        out
    }
}

/// Says how bright clipped lamps are. Of most, nothing tells that they are brighter than white.
fn lamp_words(lamps: &[ClippedLamp]) -> String {
    let brighter: Vec<_> = lamps.iter().filter(|lamp| lamp.factor > 1.05).collect();
    let share = |lamp: &&ClippedLamp| format!("{:.1} ({:.2} % of the sphere)", lamp.factor, lamp.solid_angle / 0.1257);
    let named: Vec<_> = brighter.iter().map(share).collect();
    let many = if lamps.len() == 1 { "1 is clipped".to_owned() } else { format!("{} are clipped", lamps.len()) };
    match named.as_slice() {
        [] => format!("{many}; their light tells of none that it is brighter than white"),
        named => format!("{many}; by the light that they cast brighter by {}", named.join(", ")),
    }
}

fn encoding(spec: &crate::panorama::source::PanoramaSpec) -> String {
    match &spec.depth {
        DepthSource::Sphere(radius) => format!("a sphere of {}", metres(*radius)),
        DepthSource::Box { .. } => "a box".to_owned(),
        DepthSource::Files(_) | DepthSource::Packed => {
            let rule = &spec.rule;
            let offset = if rule.offset == 0.0 { String::new() } else { format!(", offset {}", rule.offset) };
            format!("{} (scale {}{offset})", format!("{:?}", rule.encoding).to_lowercase(), rule.scale)
        }
    }
}

fn color_facts(frame: &PanoramaFrame) -> ColorFacts {
    let luminance = |texel: [f32; 4]| Vec3::new(texel[0], texel[1], texel[2]).dot(Vec3::new(0.2126, 0.7152, 0.0722));
    // A hundred thousand texels tell the median.
    let step = (frame.radiance.len() / 100_000).max(1);
    let mut some: Vec<f32> = frame.radiance.iter().step_by(step).map(luminance).collect();
    some.sort_by(f32::total_cmp);
    let largest = frame.radiance.iter().fold(0.0_f32, |most, [r, g, b, _]| most.max(r).max(g).max(b));
    let at_largest = frame.radiance.iter().filter(|texel| texel[..3].iter().any(|v| *v >= 0.999 * largest)).count();
    let brightest = frame.radiance.iter().map(luminance).fold(0.0, f32::max);
    ColorFacts {
        size: frame.color_size,
        taken: frame.taken[0].clone(),
        radiance: [some[0], some[some.len() / 2], brightest],
        clipped: at_largest as f32 / frame.radiance.len() as f32,
        lamps: None,
    }
}
