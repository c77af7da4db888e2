//! The process that turns raw readings into anchored measurements: `sensor/*` -> `nav/measurements`, `nav/frame_origin`.
//!
//! What a reading is worth is decided in `nav-preprocessing`; here it is only carried.

mod error;
mod kept_origin;
mod ports;
mod run;

pub use error::PreprocessorError;
pub use run::{Args, run, run_until};
