//! `chart`: speed against accuracy. Each method and each setting is a *point*: what a frame costs, and how far its picture is
//! from both truths after so many frames.
//!
//! [`sweep`] says which points there are, [`mod@run`] measures them; [`csv`], [`figure`], [`html`] and [`markdown`] show them.

mod choices;
pub mod csv;
pub mod draw;
pub mod figure;
pub mod html;
pub mod markdown;
pub(in crate::measure) mod measure;
pub mod pareto;
pub mod pictures;
pub mod point;
pub mod run;
pub mod scatter;
pub mod sentences;
pub mod sweep;

pub use choices::keep_sheets;
pub use point::{Chart, ChartChoice, ChartPoint, ChartScene, Cost, Outcome, Round, Spread, Truth};
pub use run::{Case, ChartOptions, run};
pub use sweep::{Spec, Sweep};
