//! The truths that results are compared with: path-traced scenes, and panoramas of synthetic rooms made with
//! the same tracer.

pub mod cache;
pub mod capture;
pub mod denoise;
pub mod path_trace;
pub mod stored;
pub mod truth;
