//! Measuring: what a frame costs, and how far a picture is from another.

pub mod bench;
pub mod metrics;
pub mod motion;
pub mod rays;
pub mod regions;
pub mod temporal;
