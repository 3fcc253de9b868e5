//! What results are measured against: scene truth by path tracing, and the panoramas of synthetic rooms made with it.

pub mod cache;
pub mod capture;
pub mod denoise;
pub mod lights;
pub mod path_trace;
pub mod truth;
