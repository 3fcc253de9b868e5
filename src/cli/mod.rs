//! The command line, one file per subcommand.
pub mod bench;
pub mod check;
pub mod common;
pub mod reference;
pub mod render;
