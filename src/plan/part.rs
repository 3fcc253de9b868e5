//! The table of the model's parts, with one row for each.

use crate::{
    gpu::Constant,
    scene::packed::{self, PackedMaterial},
    settings::{Method, Settings},
};
use glam::Vec3;
use std::fmt::Write;

/// One row of the table.
#[derive(Clone, Copy, Debug)]
pub struct PartRow {
    pub name: &'static str,
    /// The key of `--set` that forces it on or off.
    pub setting: &'static str,
    /// The value of that setting that turns it off.
    pub off: &'static str,
    /// The part that it depends on.
    pub needs: Option<Part>,
    /// The specialization constant that compiles it in, if there is one.
    pub constant: Option<&'static str>,
    /// What the part is.
    pub what: &'static str,
    /// When a scene cannot show it, as `Plan::needed` decides.
    pub off_where: &'static str,
    /// What is left out if it is off.
    pub leaves_out: &'static str,
}

macro_rules! parts {
    ($( $part:ident: $what:literal { $( $field:ident: $value:expr, )* } )*) => {
        /// A part of the model, in the order of the frame. A part comes after the one that it needs.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Part { $( #[doc = $what] $part, )* }

        impl Part {
            /// All parts.
            pub const ALL: [Self; TABLE.len()] = [ $( Self::$part, )* ];
        }

        const TABLE: &[PartRow] = &[ $( PartRow { what: $what, $( $field: $value, )* }, )* ];
    };
}

parts! {
    Objects: "Virtual objects, and with them all lighting." {
        name: "objects", setting: "objects", off: "off", needs: None, constant: Some("LIT"),
        off_where: "nothing is inserted, or `--without-objects`",
        leaves_out: "everything but `gbuffer` and `composite`, which then make the plain panorama view",
    }
    VirtualSurfaces: "Virtual surfaces in the picture itself." {
        name: "virtual_surfaces", setting: "virtual_surfaces", off: "off", needs: Some(Part::Objects), constant: Some("VIRTUAL_SURFACES"),
        off_where: "camera and objects stand still and no object's box meets the view",
        leaves_out: "the virtual layer of all images, k_V, emission, hit and M, sub-pixel rays, one of the two `irradiance` dispatches",
    }
    OffCentre: "Primary rays traced through the panorama." {
        name: "off_centre", setting: "off_centre", off: "off", needs: None, constant: Some("OFF_CENTRE"),
        off_where: "all key frames of the camera are at the capture point, or the panorama has no depth",
        leaves_out: "the pipelines that trace primary rays through the panorama; without objects also `normals` and `depth_pyramid`",
    }
    Video: "A panorama that changes." {
        name: "video", setting: "video", off: "off", needs: None, constant: None,
        off_where: "the panorama has one frame",
        leaves_out: "after the first frame: raw depth, plane fits, the pipelines of a new video frame",
    }
    Ingest: "A video's codes as they are, of which the device makes radiance." {
        name: "ingest", setting: "ingest", off: "off", needs: None, constant: None,
        off_where: "the panorama's colours are no video, or are changed before they are used: masked, levelled, made smaller, of a cubemap",
        leaves_out: "the pass; the processor makes radiance of the codes, and that is uploaded",
    }
    RadiancePyramid: "Mip levels of the panorama." {
        name: "radiance_pyramid", setting: "radiance_pyramid", off: "off", needs: None, constant: Some("MINIFIED"),
        off_where: "no pixel spans more than a texel, at the widest angle of the camera",
        leaves_out: "mip levels and their pass",
    }
    RealTracer: "Rays that meet real surfaces where they stand." {
        name: "real_tracer", setting: "real_tracer", off: "direction", needs: Some(Part::Objects), constant: Some("REAL_TRACER"),
        off_where: "the panorama's only frame has no depth at all",
        leaves_out: "`depth_pyramid`, the walk in `irradiance`",
    }
    FreeLamps: "Small lamps that hang free, as ellipsoids." {
        name: "free_lamps", setting: "free_lamps", off: "off", needs: None, constant: Some("FREE_LAMPS"),
        off_where: "no small lamp of the only frame stands clear of what lies behind it, or rays and camera meet no real surfaces",
        leaves_out: "the search for them in each video frame, the code",
    }
    LightTable: "The panorama's lamps as something to draw directions from." {
        name: "light_table", setting: "directions", off: "brdf", needs: Some(Part::Objects), constant: Some("DIRECTIONS"),
        off_where: "less than 5 % of the only frame's light is above its mean: no lamp would be drawn",
        leaves_out: "the table, its pass, light sampling in `irradiance`",
    }
    Relight: "Relit real surfaces, seen by rays." {
        name: "relight", setting: "relight_levels", off: "0", needs: Some(Part::Objects), constant: None,
        off_where: "the panorama has no depth, so no real surface",
        leaves_out: "the maps and their passes",
    }
    Specular: "The GGX lobe." {
        name: "specular", setting: "specular", off: "off", needs: Some(Part::Objects), constant: Some("SPECULAR"),
        off_where: "all materials have `specularFactor` 0 and metallic 0, and no other lobe but Lambert's",
        leaves_out: "the GGX lobe and all parts of materials that need it; the virtual layer's second light in `irradiance`, `accumulated`, `filtered` and `scratch`",
    }
    Emission: "Virtual surfaces that shine." {
        name: "emission", setting: "emission", off: "off", needs: Some(Part::Objects), constant: Some("EMISSION"),
        off_where: "no material shines",
        leaves_out: "the image, the code",
    }
    Emitters: "The triangles that shine as something to draw directions from." {
        name: "emitters", setting: "emitters", off: "off", needs: Some(Part::Emission), constant: Some("EMITTERS"),
        off_where: "nothing shines",
        leaves_out: "the aiming at them in `irradiance`",
    }
    Punctual: "Lights without a surface, which objects bring." {
        name: "punctual", setting: "punctual", off: "off", needs: Some(Part::Objects), constant: Some("PUNCTUAL"),
        off_where: "no glTF file of an object has a light of KHR_lights_punctual",
        leaves_out: "the code that draws one at each surface, and its two rays; with it every ray of `irradiance` is traced (`least_share` 1)",
    }
    Textures: "Textures of virtual surfaces." {
        name: "textures", setting: "textures", off: "off", needs: Some(Part::Objects), constant: Some("TEXTURES"),
        off_where: "no material has any",
        leaves_out: "the code",
    }
    Alpha: "Virtual surfaces with holes, or half transparent." {
        name: "alpha", setting: "alpha", off: "off", needs: Some(Part::Objects), constant: Some("ALPHA"),
        off_where: "all materials have alpha mode OPAQUE",
        leaves_out: "the code that looks whether a hit is there and, if not, traces on",
    }
    Transmission: "Virtual surfaces that let light through." {
        name: "transmission", setting: "transmission", off: "off", needs: Some(Part::Specular), constant: Some("TRANSMISSION"),
        off_where: "no material has a `transmissionFactor`",
        leaves_out: "the code",
    }
    Clearcoat: "Clear coats." {
        name: "clearcoat", setting: "clearcoat", off: "off", needs: Some(Part::Specular), constant: Some("CLEARCOAT"),
        off_where: "no material has a `clearcoatFactor`",
        leaves_out: "the code",
    }
    Sheen: "Fibres over surfaces." {
        name: "sheen", setting: "sheen", off: "off", needs: Some(Part::Specular), constant: Some("SHEEN"),
        off_where: "no material has a `sheenColorFactor`",
        leaves_out: "the code",
    }
    Anisotropy: "Surfaces that are rougher along one direction." {
        name: "anisotropy", setting: "anisotropy", off: "off", needs: Some(Part::Specular), constant: Some("ANISOTROPY"),
        off_where: "no material has an `anisotropyStrength`",
        leaves_out: "the code",
    }
    Iridescence: "Thin films." {
        name: "iridescence", setting: "iridescence", off: "off", needs: Some(Part::Specular), constant: Some("IRIDESCENCE"),
        off_where: "no material has an `iridescenceFactor`",
        leaves_out: "the code",
    }
    Bounces: "Paths from one virtual surface to another." {
        name: "bounces", setting: "bounces", off: "1", needs: Some(Part::Objects), constant: Some("INTERREFLECTION"),
        off_where: "one convex, closed object that does not move, a one-frame panorama whose surface keeps clear of the object's box, and a camera that does",
        leaves_out: "the second tracing of objects in `irradiance`",
    }
    Temporal: "Accumulation over frames." {
        name: "temporal", setting: "temporal", off: "false", needs: Some(Part::Objects), constant: None,
        off_where: "one frame is rendered in all, the relit maps' warm-up included",
        leaves_out: "the pass, four images, and the previous frame's values of three and of the guide",
    }
    Motion: "Object motion vectors, and histories that change shortens." {
        name: "motion", setting: "motion", off: "off", needs: Some(Part::Temporal), constant: Some("OBJECT_MOTION"),
        off_where: "nothing but the camera moves and the video has one frame",
        leaves_out: "objects' motion vectors, the search for what changes, the clamping pipeline",
    }
    Reflections: "Reflections that move over the surfaces that show them." {
        name: "reflections", setting: "reflections", off: "off", needs: Some(Part::Temporal), constant: Some("REFLECTIONS"),
        off_where: "no material is smoother than a roughness of 0.3, or neither camera nor objects move",
        leaves_out: "the image, the search for where a reflection was a frame ago; its history follows the surface",
    }
    Deformation: "Objects that change their shape." {
        name: "deformation", setting: "deformation", off: "off", needs: Some(Part::Motion), constant: Some("DEFORMATION"),
        off_where: "no object plays a clip that moves joints of a skin or weights of morph targets",
        leaves_out: "the pass `deform`; such objects stand in their rest pose",
    }
    SamplingMask: "Tracing a share of the pixels." {
        name: "sampling_mask", setting: "sampling_mask", off: "false", needs: Some(Part::Objects), constant: None,
        off_where: "every pixel is traced anyhow: no history, or never one as long as `short_history`; or `rays_per_pixel` 1",
        leaves_out: "`interpolate`",
    }
    Interpolate: "Filling the pixels that are not traced." {
        name: "interpolate", setting: "interpolate", off: "false", needs: Some(Part::SamplingMask), constant: None,
        off_where: "`sampling_mask` is off; or `short_history` > 0 and `temporal` comes first: what is not traced has a history that passes its tests, to which an interpolated value adds nothing",
        leaves_out: "the pass",
    }
    Atrous: "The edge-avoiding filter." {
        name: "atrous", setting: "atrous_levels", off: "0", needs: Some(Part::Objects), constant: None,
        off_where: "(by the method alone)",
        leaves_out: "the pass, four images",
    }
}

impl Part {
    /// Its row of the table.
    pub const fn row(self) -> &'static PartRow {
        &TABLE[self as usize]
    }

    pub const fn name(self) -> &'static str {
        self.row().name
    }

    /// Whether its setting only forces it on or off.
    pub fn is_switch(self) -> bool {
        self.row().off == "off"
    }

    /// The value of its setting that turns it on: the method's, or that of `iprt` if the method's is off.
    pub fn value_on(self, method: Method) -> String {
        let PartRow { setting, off, .. } = *self.row();
        let of = |method| Settings::of(method).value(setting).unwrap_or_default();
        match self.is_switch() {
            true => "on".to_owned(),
            false => Some(of(method)).filter(|value| value != off).unwrap_or_else(|| of(Method::Iprt)),
        }
    }

    /// The settings that force it on or off, whatever the scene holds.
    pub fn forced(self, on: bool, method: Method) -> Vec<(&'static str, String)> {
        let PartRow { setting, off, needs, .. } = *self.row();
        if !on {
            return vec![(setting, off.to_owned())];
        }
        let mut set = needs.map_or(Vec::new(), |other| other.forced(true, method));
        set.push((setting, self.value_on(method)));
        set
    }

    /// Its specialization constant with a value. Making a pass fails if the part has none.
    pub fn constant(self, value: u32) -> Constant {
        (self.row().constant.unwrap_or(self.name()), value)
    }

    /// The parts that materials alone decide on. Passes that read materials compile them in.
    pub const MATERIAL: [Self; 8] = [
        Self::Specular,
        Self::Textures,
        Self::Alpha,
        Self::Transmission,
        Self::Clearcoat,
        Self::Sheen,
        Self::Anisotropy,
        Self::Iridescence,
    ];

    /// Whether a material needs it. Only for parts of [`Part::MATERIAL`].
    pub fn is_in(self, m: &PackedMaterial) -> bool {
        let lobes = m.transmission > 0.0 || m.clearcoat > 0.0 || m.sheen_color != Vec3::ZERO;
        match self {
            Self::Specular => m.specular != 0.0 || m.metallic != 0.0 || lobes || m.flags & packed::BLENDED != 0,
            Self::Textures => m.textures.iter().any(|texture| *texture != packed::NONE),
            Self::Alpha => m.flags & (packed::MASKED | packed::BLENDED) != 0,
            Self::Transmission => m.transmission > 0.0,
            Self::Clearcoat => m.clearcoat > 0.0,
            Self::Sheen => m.sheen_color != Vec3::ZERO,
            Self::Anisotropy => m.anisotropy > 0.0,
            Self::Iridescence => m.iridescence > 0.0,
            _ => true,
        }
    }

    /// The table as Markdown.
    pub fn markdown() -> String {
        let mut out = "| part | needs | is off where | forced by | what goes with it | compiled in by |\n".to_owned();
        out += "|---|---|---|---|---|---|\n";
        let code = |name: Option<&str>| name.map_or(String::new(), |name| format!("`{name}`"));
        for part in Self::ALL {
            let PartRow { name, setting, off, needs, constant, off_where, leaves_out, .. } = part.row();
            let (needs, constant) = (code(needs.map(Self::name)), code(*constant));
            let on = part.value_on(Method::Iprt);
            let _ = writeln!(
                out,
                "| `{name}` | {needs} | {off_where} | `{setting}={on}\\|{off}` | {leaves_out} | {constant} |"
            );
        }
        out
    }

    /// The table as text: each part, what it is, and the settings that force it.
    pub fn help() -> String {
        let mut out = "Parts, and the settings that force them on or off:".to_owned();
        for part in Self::ALL {
            let PartRow { name, setting, off, what, .. } = part.row();
            let set = format!("--set {setting}={}|{off}", part.value_on(Method::Iprt));
            let _ = write!(out, "\n  {name:<18}{set:<36}{what}");
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_fits_the_settings_and_comes_after_what_it_needs() {
        for (at, part) in Part::ALL.into_iter().enumerate() {
            let row = part.row();
            assert!(row.needs.is_none_or(|other| (other as usize) < at), "{}", row.name);
            let setting = Settings::TABLE.iter().find(|setting| setting.name == row.setting).expect(row.setting);
            assert_eq!(part.is_switch(), setting.pass == "plan", "{}", row.name);
            for value in [row.off.to_owned(), part.value_on(Method::Paper)] {
                Settings::of(Method::Iprt).set(row.setting, &value, "a test").expect(row.setting);
            }
            assert_ne!(row.off, part.value_on(Method::Ibl), "{}", row.name);
        }
    }
}
