//! `iprt view`: the window. See it, move in it, compare in it.
//!
//! Three threads. The first handles events and lays panels out, and waits for nothing. [`engine`]'s renders what is wanted now.
//! [`presenter`]'s copies finished pictures to the window and draws the panels over them. Between the first two go a
//! [`state::Wanted`], of which the newest counts, and a [`state::Shown`].

pub mod app;
pub mod camera;
pub mod controls;
pub mod edit;
pub mod engine;
pub mod legend;
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
pub use report::Report;
