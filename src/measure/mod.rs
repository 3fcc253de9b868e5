//! Measures what a frame costs, and how far a picture is from another.

pub mod bench;
pub mod chart;
pub mod choice;
pub mod clock;
pub mod growth;
pub mod metrics;
pub mod motion;
pub mod rays;
pub mod regions;
pub mod score;
pub mod sequence;
