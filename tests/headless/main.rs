//! The tests of what the program promises, one file per thing promised, linked into one binary. All of them run without
//! a screen; those of the window start an X server without one. `cargo test` runs them as threads of one process, so no
//! test may change the process: its environment, its working folder.
//!
//! The tests of one file: `cargo nextest run renderer::` or `cargo test --test headless renderer::`.

mod adding;
mod agreement;
mod alpha;
mod bounces;
mod bvh;
mod caches;
mod cases;
mod chart;
mod cli;
mod clipped;
mod common;
mod compare;
mod converged;
mod cubes;
mod deform;
mod devices;
mod docs;
mod drift;
mod fault_cases;
#[cfg(feature = "faults")]
mod faults;
mod folder;
mod free_lamps;
mod fuzz;
mod gltf;
mod gltf_lenient;
mod golden;
mod gpu;
mod identities;
mod ingest;
mod inspect;
mod large;
mod layers;
mod lighting;
mod memory;
mod methods;
mod mitsuba;
mod oracle;
mod panorama_io;
mod path_trace;
mod plan;
mod profiles;
mod punctual;
mod ray_query;
mod relighting;
#[cfg(debug_assertions)]
mod reload;
mod renderer;
mod rooms;
mod samplers;
mod samples;
mod scene;
mod shapes;
mod shared;
mod sides;
mod stability;
mod stereo;
mod stored;
mod target;
mod terminal;
mod textures;
mod tracer;
mod truth;
mod truth_cli;
mod unseen;
mod video_docs;
mod video_in;
mod video_out;
mod view;
mod vulkan_faults;
mod window_edits;
mod window_looks;

/// SPIR-V of `tests/glsl/*.comp`.
mod shaders {
    include!(concat!(env!("OUT_DIR"), "/test_shaders.rs"));
}
