//! The process that solves the window at each keyframe: `nav/measurements` -> `nav/solution`, `nav/diagnostics`.
//!
//! The estimating is `nav-fgo`'s; here a clock looks at it, and the queue says how hard it may work.

mod beginning;
mod error;
mod keeper;
mod ports;
mod recent;
mod run;

pub use error::SolverError;
pub use run::{Args, run, run_until};
