//! Decides which parts of the model a scene needs, before the first frame, from the scene and the settings.
//!
//! A part that is off is not dispatched, compiled in or allocated. Whoever builds something asks
//! [`Plan::on`]. A part is left out only if that cannot change the picture, whatever the random numbers.
//! [`Facts`] and `Plan::needed` hold the criterion of each. A value that the user sets wins.

pub mod convex;
pub mod facts;
pub mod part;

pub use facts::{CameraPlace, Facts};
pub use part::{Part, PartRow};

use crate::{
    Result,
    gpu::Constant,
    options::RenderOptions,
    panorama::{codes::Coding, texels},
    scene::Scene,
    settings::{Directions, FilterOrder, MaskBy, Method, RealTracer, Settings, VirtualTracer},
};

/// Who decided on a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum By {
    /// The scene needs it, or cannot show it.
    Scene,
    /// The settings of the method leave it out.
    Method,
    /// Another part that it needs is off.
    Need(Part),
    /// The user set it.
    Set,
}

/// The decision on a part.
#[derive(Clone, Debug, PartialEq)]
pub struct Decision {
    pub part: Part,
    /// Whether it is on.
    pub on: bool,
    pub by: By,
    /// Why, in a few words.
    pub why: String,
}

/// A plan: which parts of the model are on, and why.
#[derive(Clone, Debug)]
pub struct Plan {
    /// A decision on each part, in the order of [`Part::ALL`].
    pub parts: Vec<Decision>,
    /// The settings of the frame. Each part that is left out has its setting's off value here.
    pub settings: Settings,
    /// What is known about the scene.
    pub facts: Facts,
    /// Width and height of the picture, pixels.
    pub size: [u32; 2],
    /// The preset from which the settings started.
    pub method: Method,
    asked: Settings,
}

/// Two plans are equal if one renderer serves both. The reasons do not matter.
impl PartialEq for Plan {
    fn eq(&self, other: &Self) -> bool {
        let key = |plan: &Self| {
            let on: Vec<bool> = plan.parts.iter().map(|part| part.on).collect();
            let Facts { projection, of_eye, color_size, depth_size, codes, .. } = plan.facts;
            let slots = plan.constant(Part::Textures);
            (
                on,
                plan.wants_history(),
                plan.size,
                projection,
                of_eye,
                plan.looks_up(),
                plan.color_levels(),
                color_size,
                depth_size,
                codes,
                slots,
            )
        };
        // switches of parts have no effect besides the parts themselves
        let switches = |name: &str| Part::ALL.iter().any(|part| part.is_switch() && part.row().setting == name);
        let values = |plan: &Self| -> Vec<_> {
            plan.settings.values().into_iter().filter(|(name, _)| !switches(name)).collect()
        };
        let places = |plan: &Self| [plan.facts.instances, plan.facts.lights];
        key(self) == key(other) && values(self) == values(other) && places(self) == places(other)
    }
}

impl Plan {
    /// Examines a scene from its first video frame. `frames` is how many share one history, if that is known.
    ///
    /// # Errors
    /// Fails if the panorama cannot be read.
    pub fn of(scene: &Scene, options: &RenderOptions, frames: Option<u32>) -> Result<Self> {
        Ok(Self::decide(Facts::of(scene, options, frames)?, options.size, options.method, &options.settings))
    }

    /// Examines a scene for a window, where the user moves the camera and the objects by hand. Pictures may
    /// be up to `shrink` times smaller each way than the size in `options`. Loads the panorama's first frame.
    ///
    /// # Errors
    /// Fails if the panorama cannot be read.
    pub fn interactive(scene: &Scene, options: &RenderOptions, shrink: f32) -> Result<Self> {
        let facts = Facts::of(scene, options, None)?.interactive(shrink);
        Ok(Self::decide(facts, options.size, options.method, &options.settings))
    }

    /// The plan of the same scene with other settings.
    pub fn with(&self, settings: &Settings) -> Self {
        Self::decide(self.facts.clone(), self.size, self.method, settings)
    }

    fn decide(facts: Facts, size: [u32; 2], method: Method, settings: &Settings) -> Self {
        let (asked, settings) = (settings.clone(), settings.clone());
        let mut plan = Self { parts: Vec::with_capacity(Part::ALL.len()), settings, facts, size, method, asked };
        for part in Part::ALL {
            let decision = plan.decision(part);
            plan.apply(&decision);
            plan.parts.push(decision);
        }
        plan
    }

    fn decision(&self, part: Part) -> Decision {
        let settings = &self.asked;
        let decided = |on, by, why: String| Decision { part, on, by, why };
        let PartRow { setting, off, needs, .. } = *part.row();
        if let Some(other) = needs.filter(|other| !self.on(*other)) {
            return decided(false, By::Need(other), format!("{} is off", other.name()));
        }
        let value = settings.value(setting).unwrap_or_default();
        let is_off = value == off;
        if settings.given.contains(&setting) && value != AUTO {
            return decided(!is_off, By::Set, format!("{setting} = {value} was set"));
        }
        if is_off {
            return decided(false, By::Method, format!("{setting} = {value} with method {}", self.method.name()));
        }
        let (on, why) = self.needed(part);
        decided(on, By::Scene, why)
    }

    /// Whether the scene needs a part, and the reason. The parts before it must have been decided.
    fn needed(&self, part: Part) -> (bool, String) {
        let (facts, settings) = (&self.facts, &self.settings);
        let found =
            |what: &Option<String>, none: &str| (what.is_some(), what.clone().unwrap_or_else(|| none.to_owned()));
        let of_materials = |none: &str| {
            let at = Part::MATERIAL.iter().position(|other| *other == part);
            found(&at.and_then(|at| facts.materials[at].clone()), none)
        };
        let warmup = if self.on(Part::Relight) { settings.relight_warmup } else { 0 };
        let frames = facts.frames.map(|frames| frames.saturating_add(warmup));
        let screen = settings.virtual_tracer == VirtualTracer::Screen;
        let because = |on, yes: &str, no: &str| (on, if on { yes } else { no }.to_owned());
        match part {
            Part::Objects => {
                let on = facts.instances + facts.lights > 0;
                let what = match facts.instances {
                    0 if on => count(facts.lights, "light is", "lights are"),
                    meshes => count(meshes, "mesh is", "meshes are"),
                };
                (on, format!("{what} inserted"))
            }
            Part::VirtualSurfaces if screen => (true, "rays walk the picture (virtual_tracer = screen)".to_owned()),
            Part::VirtualSurfaces => because(facts.in_view, "objects may be in view", "no object is ever in view"),
            Part::OffCentre if !facts.has_depth => (false, "the panorama is infinitely far".to_owned()),
            Part::OffCentre => match facts.camera {
                CameraPlace::Centre => (false, "the camera stays at the capture point".to_owned()),
                CameraPlace::Away(most) => (true, format!("the camera is up to {most:.2} m from the capture point")),
                CameraPlace::Anywhere => (true, "the camera can be moved by hand".to_owned()),
                CameraPlace::Both(most) => (true, format!("the camera comes up to {most:.2} m from the capture point")),
            },
            Part::Video => {
                (facts.video_frames > 1, format!("the panorama has {}", count(facts.video_frames, "frame", "frames")))
            }
            Part::Ingest => match facts.codes {
                Some(coding) => (true, format!("frames are {} codes", coding.format.name())),
                None => (false, "frames are not kept as codes".to_owned()),
            },
            Part::RadiancePyramid => {
                let on = facts.footprint > 1.0;
                (on, format!("a pixel spans {:.2} texels of the panorama", facts.footprint))
            }
            Part::RealTracer => because(
                facts.has_depth,
                "the panorama has depth",
                "the panorama is infinitely far: its depth is all holes",
            ),
            // Whether objects are inserted changes nothing else in the picture.
            Part::FreeLamps if self.asked.real_tracer == RealTracer::Direction => {
                (false, "rays meet no real surfaces".to_owned())
            }
            Part::FreeLamps if !self.geometry() => (false, "nothing needs real surfaces".to_owned()),
            Part::FreeLamps => match facts.free_lamps {
                Some(count) => {
                    (count > 0, format!("the panorama has {}", crate::plan::count(count, "such lamp", "such lamps")))
                }
                None => (true, "the panorama changes".to_owned()),
            },
            Part::LightTable if settings.directions == Directions::Light => (true, "all rays draw from it".to_owned()),
            Part::LightTable => match facts.light_share {
                Some(share) => {
                    (share >= facts::EVEN, format!("{:.1} % of the panorama's light is above its mean", 100.0 * share))
                }
                None => (true, "the panorama changes".to_owned()),
            },
            Part::Relight => {
                because(facts.has_depth, "real surfaces see each other", "no real surface, as there is no depth")
            }
            Part::Specular => of_materials("all materials are pure Lambert"),
            Part::Punctual => {
                (facts.lights > 0, format!("objects bring {}", count(facts.lights, "such light", "such lights")))
            }
            Part::Emitters if screen => (false, "what rays meet is a guess (virtual_tracer = screen)".to_owned()),
            Part::Emitters => found(&facts.emissive, "nothing shines"),
            Part::Emission => found(&facts.emissive, "nothing shines"),
            Part::Textures => of_materials("no material has a texture"),
            Part::Alpha => of_materials("all materials are opaque"),
            Part::Transmission => of_materials("no material lets light through"),
            Part::Clearcoat => of_materials("no material has a clear coat"),
            Part::Sheen => of_materials("no material has sheen"),
            Part::Anisotropy => of_materials("no material is anisotropic"),
            Part::Iridescence => of_materials("no material has a thin film"),
            Part::Bounces if screen => (true, "what rays meet is a guess (virtual_tracer = screen)".to_owned()),
            Part::Bounces => (
                facts.alone.is_err(),
                match &facts.alone {
                    Ok(()) => "one convex object, free of everything: what leaves it meets it nowhere".to_owned(),
                    Err(why) => why.clone(),
                },
            ),
            Part::Temporal => (
                frames != Some(1),
                frames.map_or("frames follow each other".to_owned(), |n| count(n as usize, "frame", "frames")),
            ),
            Part::Motion if facts.video_frames > 1 && self.on(Part::Video) => (true, "the video changes".to_owned()),
            Part::Deformation => found(&facts.deforming, "nothing changes its shape"),
            Part::Motion => found(&facts.moving, "nothing but the camera moves"),
            Part::Reflections if !self.on(Part::Specular) || !self.on(Part::VirtualSurfaces) => {
                (false, "no such surface is seen".to_owned())
            }
            Part::Reflections if !facts.camera_moves && !self.on(Part::Motion) => (false, "nothing moves".to_owned()),
            Part::Reflections => found(&facts.smooth, "no material is smooth"),
            // without a history, all pixels are newly seen
            Part::SamplingMask if !settings.temporal && settings.short_history > 0 => {
                (false, "there is no history, so every pixel is newly seen and traced".to_owned())
            }
            Part::SamplingMask if frames.is_some_and(|frames| frames <= settings.short_history) => {
                (false, "no history will be long, so every pixel is newly seen and traced".to_owned())
            }
            Part::SamplingMask if settings.mask_by == MaskBy::History && settings.rays_per_pixel >= 1.0 => {
                (false, format!("rays_per_pixel = {}", settings.rays_per_pixel))
            }
            Part::SamplingMask => (true, "a share of the pixels is traced each frame".to_owned()),
            // sampling_mask traces what has no history, and interpolated values add nothing to a history
            Part::Interpolate
                if self.on(Part::Temporal)
                    && settings.short_history > 0
                    && settings.filter_order == FilterOrder::TemporalFirst =>
            {
                (false, "what is not traced has a history".to_owned())
            }
            Part::Interpolate => (true, "pixels are left untraced".to_owned()),
            Part::Atrous => (true, count(settings.atrous_levels as usize, "level", "levels")),
        }
    }

    /// Sets the setting of a part that is off to its off value. Mere switches stay, as nothing reads them.
    fn apply(&mut self, decision: &Decision) {
        let row = decision.part.row();
        if !decision.on && !decision.part.is_switch() {
            self.settings.leave_out(row.setting, row.off);
        }
    }

    /// Whether a part is on.
    pub fn on(&self, part: Part) -> bool {
        self.parts.iter().any(|decision| decision.part == part && decision.on)
    }

    /// Whether light is accumulated, or would be if more frames than one were asked for.
    pub const fn wants_history(&self) -> bool {
        self.asked.temporal
    }

    /// The decision on a part for people to read: `specular is off: all materials are pure Lambert`.
    pub fn reason(&self, part: Part) -> String {
        let decision = self.parts.iter().find(|decision| decision.part == part);
        decision.map_or(String::new(), |d| {
            let root = match d.by {
                By::Need(other) => return self.reason(other),
                _ => {
                    if d.on {
                        "on"
                    } else {
                        "off"
                    }
                }
            };
            format!("{} is {root}: {}", part.name(), d.why)
        })
    }

    /// The plan with this one part forced the other way.
    pub fn flipped(&self, decision: &Decision) -> Result<Self> {
        let mut settings = self.asked.clone();
        for (name, value) in decision.part.forced(!decision.on, self.method) {
            settings.set(name, &value, "plan")?;
        }
        Ok(self.with(&settings))
    }

    /// The specialization constants of the parts that materials decide on.
    pub fn materials(&self) -> [Constant; Part::MATERIAL.len()] {
        Part::MATERIAL.map(|part| self.constant(part))
    }

    /// A part's specialization constant. It says whether the part is on, or which of several ways is set.
    pub fn constant(&self, part: Part) -> Constant {
        part.constant(match part {
            Part::RealTracer => self.settings.real_tracer as u32,
            Part::LightTable => self.settings.directions as u32,
            Part::Textures if self.on(part) => match self.facts.texture_slots {
                0 => u32::MAX, // on without need
                slots => slots,
            },
            _ => u32::from(self.on(part)),
        })
    }

    /// Parts whose code is compiled into passes that other parts need as well.
    pub fn code(&self) -> impl Iterator<Item = Part> {
        Part::ALL.into_iter().filter(|part| part.row().constant.is_some() && self.on(*part))
    }

    /// Whether primary rays ever look the panorama up by direction, with the camera at the capture point.
    pub fn looks_up(&self) -> bool {
        !(self.on(Part::OffCentre) && matches!(self.facts.camera, CameraPlace::Away(_)))
    }

    /// The number of mip levels of the panorama's radiance.
    pub fn color_levels(&self) -> u32 {
        let [width, height] = self.facts.color_size;
        let deepest = 32 - width.max(height).leading_zeros();
        let levels = 1 + self.facts.footprint.log2().ceil().max(0.0) as u32;
        if self.on(Part::RadiancePyramid) { levels.max(2).min(deepest) } else { 1 }
    }

    /// The constant that says whether the panorama is of 16-bit floats.
    pub fn halves(&self) -> Constant {
        ("HALVES", u32::from(texels::is_half(self.facts.color_size)))
    }

    /// The coding of frames of which the device makes radiance.
    pub fn codes(&self) -> Option<Coding> {
        self.facts.codes.filter(|_| self.on(Part::Ingest))
    }

    /// Whether anything needs the normals of real surfaces, and depth without its codes' steps.
    pub fn geometry(&self) -> bool {
        self.on(Part::Objects) || self.on(Part::OffCentre)
    }

    /// Whether light is accumulated in brief (`light_code.glsl`): over a short history, and where a filter follows.
    pub fn history_in_brief(&self) -> bool {
        const LONGEST: u32 = 256;
        let Settings { filter_order, atrous_levels, history, .. } = self.settings;
        self.on(Part::Temporal) && filter_order == FilterOrder::TemporalFirst && atrous_levels > 0 && history <= LONGEST
    }

    /// Whether the image of this frame's light serves the filter as well, once the light is accumulated. Nothing may then
    /// ask for the light of a neighbour, whose tile may rest and hold what the filter left there.
    pub fn lends_irradiance(&self) -> bool {
        self.history_in_brief() && self.settings.clamp == 0.0 && !self.on(Part::Interpolate)
    }

    /// The constant that says whether the result of the filters is in brief.
    pub fn result_in_brief(&self) -> Constant {
        let Settings { filter_order, atrous_levels, .. } = self.settings;
        let accumulated_last = self.on(Part::Temporal) && filter_order == FilterOrder::SpatialFirst;
        ("RESULT_BRIEF", u32::from(atrous_levels > 0 && !accumulated_last))
    }

    /// Whether not all rays from real surfaces that meet no object are traced.
    pub fn roulette(&self) -> bool {
        self.on(Part::Temporal)
            && !(self.on(Part::Punctual) && self.facts.lights > 0)
            && self.settings.least_share < 1.0
            && self.settings.virtual_tracer != VirtualTracer::Screen
            && self.settings.real_tracer != RealTracer::Direction
    }

    /// Whether smooth surfaces see real ones lit as the last picture has them, where it shows them.
    pub fn sees_picture(&self) -> bool {
        let parts = [Part::Temporal, Part::Relight, Part::VirtualSurfaces, Part::Specular];
        parts.into_iter().all(|part| self.on(part))
    }

    /// Whether `irradiance` looks at the light of the last frame.
    pub fn knows_last_light(&self) -> bool {
        self.roulette() || self.sees_picture() || self.limits_paths()
    }

    /// Whether no path may bring much more light by chance than the last picture shows, which is filtered.
    pub fn limits_paths(&self) -> bool {
        self.on(Part::Temporal) && self.on(Part::Atrous) && self.settings.path_limit < f32::INFINITY
    }

    /// Whether rays meet virtual objects by the device's ray queries.
    pub fn ray_queries(&self) -> bool {
        self.on(Part::Objects) && self.settings.virtual_tracer == VirtualTracer::RayQuery
    }

    /// Whether what an object does to the light of real surfaces in the picture is followed when it moves. That needs an
    /// image of the filters', to keep it in, and what they tell of each tile.
    pub fn follows(&self) -> bool {
        let Settings { atrous_levels, clamp, history_change, rest_noise, .. } = self.settings;
        let moves = self.on(Part::Motion) && clamp == 0.0 && history_change.is_finite();
        moves && self.history_in_brief() && atrous_levels > 1 && rest_noise > 0.0
    }

    /// Whether rays walk the pyramid of boxes.
    pub fn boxes(&self) -> bool {
        self.on(Part::OffCentre) || (self.on(Part::Objects) && self.settings.real_tracer == RealTracer::Surface)
    }
}

/// The value of a setting that leaves the decision to the plan.
const AUTO: &str = "auto";

fn count(n: usize, one: &str, many: &str) -> String {
    format!("{n} {}", if n == 1 { one } else { many })
}
