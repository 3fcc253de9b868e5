//! `iprt`: virtual objects in 360° RGBD video, lit by the video itself.
//!
//! A panorama with depth is a scene of diffuse emitters at known places. Rays are traced against it and
//! against the virtual objects, and give light, shadows and reflections to both. The method follows
//! *Interactive Panoramic Ray Tracing for Mixed 360° RGBD Videos* (Wu, Wang, Ke; VRW 2023).
//! `docs/pipeline.md` says what each pass computes, with its images, units and settings. `docs/limits.md`
//! says where it fails.
//!
//! # The house
//!
//! The list goes from the ground up. A module uses only those above it.
//!
//! * [`error`]: an [`Error`] says what failed, on which file or object, and the remedy.
//! * [`budget`]: how much memory a file may take, and what the device holds, asked before anything is allocated.
//! * [`temporary`]: files that are written beside their target, and are gone whatever ends the process.
//! * [`shaders`]: the SPIR-V of `shaders/glsl/*.comp`. A debug build loads changed shaders from disk.
//! * [`gpu`] knows Vulkan and nothing else. A [`gpu::Gpu`] makes buffers, images and passes. A [`gpu::Frame`]
//!   records dispatches and barriers, and refuses to run if a barrier is missing. Submitting it gives a
//!   [`gpu::Ticket`], and waiting for the ticket gives the time of each dispatch.
//! * [`image_file`] reads PNG, JPEG, WebP, TIFF, HDR and EXR, and hears what they say of layers, crops and
//!   colours. It writes PNG and EXR, and never leaves half a file.
//! * [`media`] reads and writes videos by `ffmpeg`, whose frames cross pipes.
//! * [`settings`]: every approximation is a named value. A [`settings::Method`] is a preset of them.
//! * [`panorama`] loads the video's frames as codes, or as linear radiance, and metres, maps directions to
//!   texels, and finds the floor.
//! * [`scene`] reads scene files and glTF objects, and has built-in [`scene::rooms`]. A [`scene::Scene`]
//!   gives the state of camera and objects at any time.
//! * [`options`]: what to render, and how.
//! * [`plan`] decides from a table which parts of the model a scene needs. Other parts are not dispatched,
//!   compiled in or allocated.
//! * [`passes`]: one file for each pass, and the table [`passes::PASSES`]. A pass runs on a
//!   [`passes::view::View`], which holds the images and the history of one picture.
//! * [`renderer`] records the frame, with the parts that the plan has.
//! * [`output`] writes a renderer's picture as a file.
//! * [`mod@reference`] path-traces the truth of a scene and keeps it in a cache. It also makes the rooms'
//!   panoramas.
//! * [`measure`]: pass times, errors against the truth, the [`measure::chart`] of speed against accuracy, and
//!   the [`measure::choice`] of settings for a target. [`measure::clock`] takes all times.
//! * [`inspect`] measures a scene, and tells what can hardly be right. [`warnings`] reach whoever acts, once.
//!   All that is printed goes through [`terminal`].
//! * [`stability`]: cases in which such methods fail, each with its truth.
//! * `viewer`: the window. It needs the feature `viewer`, which is on by default.
//! * [`cli`]: one file for each subcommand. `main.rs` only parses and prints.
//!
//! The feature `faults` adds deliberate faults to shaders and passes (`passes::fault`), which tests must
//! notice.
//!
//! # The frame
//!
//! [`renderer::Renderer::begin`] records it, from top to bottom:
//!
//! 1. For a new video frame, from the panorama alone: [`passes::ingest`], [`passes::radiance_pyramid`],
//!    [`passes::normals`], [`passes::depth_pyramid`], [`passes::light_table`].
//! 2. *relight* runs the passes of 3 on a coarse panoramic view, so that rays see real surfaces with the
//!    light that objects leave them.
//! 3. [`passes::gbuffer`], [`passes::sampling_mask`], [`passes::irradiance`], [`passes::interpolate`],
//!    [`passes::temporal`], [`passes::atrous`].
//! 4. [`passes::composite`].
//!
//! If objects change their shape, [`passes::deform`] comes before all of these, and behind it
//! [`passes::acceleration`], if rays meet objects by ray queries.
//!
//! Any image of it can be read back by name: [`renderer::Renderer::aov`].
//!
//! ```no_run
//! use iprt::{gpu::{Gpu, GpuOptions}, options::RenderOptions, renderer::Renderer, scene::{Scene, viewpoint::Projection}};
//! use iprt::settings::{Method, Settings};
//!
//! # fn main() -> iprt::Result<()> {
//! let gpu = Gpu::new(&GpuOptions::default())?;
//! let scene = Scene::load("my_room.toml".as_ref())?;
//! let options = RenderOptions {
//!     size: [1280, 720],
//!     method: Method::Iprt,
//!     settings: Settings::of(Method::Iprt),
//!     projection: Projection::Perspective,
//!     seed: 0,
//!     without_objects: false,
//!     eye: 0.0,
//! };
//! let mut renderer = Renderer::new(&gpu, &scene, options)?;
//! for _ in 0..16 {
//!     renderer.render(&scene, 0.0)?;
//! }
//! let radiance = renderer.picture()?; // linear, RGBA, row 0 on top
//! # Ok(())
//! # }
//! ```
//!
//! # Adding a pass
//!
//! 1. Write `shaders/glsl/NAME.comp`, which becomes `shaders::NAME`. Its head says inputs, outputs, units and
//!    the equation. Bindings that passes share are in `bind/*.glsl`.
//! 2. Write `src/passes/NAME.rs`: a [`passes::resources::Kernel`] and a `record` of a few lines. Bindings and
//!    constants are found by their GLSL names. Push constants are a `gpu_struct!`.
//! 3. Declare new images: those of a picture in `DECLARED` of [`passes::view`], those of a video frame in
//!    [`passes::panorama::Panorama::new`].
//! 4. Add a row to [`passes::PASSES`]. If a scene can do without the pass, add a row to [`plan::part`] and a
//!    criterion to `Plan::needed`.
//! 5. Add a field to [`renderer::Renderer`], make it in `src/renderer/construction.rs`, and add a line to the
//!    frame, with a [`gpu::Frame::barrier`] that says what it separates.
//! 6. Add its settings to [`settings`] and a section to `docs/pipeline.md`. `make docs` writes the tables.
//!
//! `tests/headless/adding.rs` makes a pass by steps 1 to 3.

pub mod budget;
pub mod cli;
pub mod error;
#[macro_use]
pub mod gpu;
pub mod image_file;
pub mod inspect;
pub mod measure;
pub mod media;
pub mod options;
pub mod output;
pub mod panorama;
pub mod passes;
pub mod plan;
pub mod reference;
pub mod renderer;
pub mod scene;
pub mod settings;
pub mod shaders;
pub mod stability;
pub mod temporary;
pub mod terminal;
#[cfg(feature = "viewer")]
pub mod viewer;
pub mod warnings;
pub use error::{Error, Result};
