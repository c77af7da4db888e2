//! One process per sensor, from the world or from a log directory.

mod emulator;
pub mod process;
pub mod scenario_source;
pub mod simulate;
pub mod source;
