//! Measuring: what a frame costs.

pub mod bench;
