//! `chart`: speed against accuracy. Each method and each setting is a *point*: what a frame costs, and how far its picture is
//! from both truths after so many frames.
//!
//! [`sweep`] says which points there are, [`run`] measures them, [`csv`] and [`markdown`] show them.

pub mod csv;
pub mod markdown;
mod measure;
pub mod pictures;
pub mod point;
pub mod run;
pub mod sweep;

pub use point::{Chart, ChartPoint, ChartScene, Cost, Outcome, Round, Spread};
pub use run::{Case, ChartOptions, run};
pub use sweep::{Spec, Sweep};
