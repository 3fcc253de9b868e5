//! `iprt view` opens the window, to see a scene, move in it and compare in it.
//!
//! There are three threads. The first one handles events, lays out the panels, and never waits. The thread of
//! [`engine`] renders what is wanted now. The thread of [`presenter`] copies finished pictures to the window
//! and draws the panels over them. The first thread sends a [`state::Wanted`] to the second one, of which the
//! newest counts, and receives a [`state::EngineOutput`].

pub mod app;
pub mod behind;
mod blits;
pub mod camera;
pub mod controls;
pub mod edit;
pub mod engine;
pub mod gizmo;
pub mod legend;
pub mod loupe;
mod notches;
pub mod objects_panel;
pub mod painter;
pub mod panels;
pub mod pick;
pub mod presenter;
pub mod report;
pub mod save;
pub mod script;
pub mod session;
pub mod settings_panel;
pub mod state;
pub mod timings_panel;

pub use app::{Open, Opened, Options, run};
pub use report::SessionReport;
