//! `chart` charts speed against accuracy. Each method and each changed setting is a *point*. For each point
//! it measures what a frame costs, and how far the picture is from both truths after a number of frames.
//!
//! [`sweep`] lists the points, and [`mod@run`] measures them. [`csv`], [`figure`], [`html`] and [`markdown`]
//! show them.

mod choices;
pub mod csv;
pub mod draw;
pub mod figure;
pub mod html;
pub mod markdown;
pub mod options;
pub mod pareto;
pub mod pictures;
pub mod point;
mod prepare;
mod rounds;
pub mod run;
pub mod scatter;
pub mod sentences;
pub mod sweep;

pub use choices::keep_sheets;
pub use options::{ChartInput, ChartOptions};
pub use point::{Chart, ChartChoice, ChartPoint, ChartScene, CostUnit, ScoredPicture};
pub use run::run;
pub use sweep::{PointSpec, Sweep};
