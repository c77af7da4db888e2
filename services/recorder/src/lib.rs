//! The process that writes everything down: `sensor/*`, `sim/truth` -> a log directory that a replay reads;
//! `nav/estimate` -> `estimate.csv`, `estimate.tum`; the rest -> `summary.json`; and all of it -> `recording.mcap`.
//!
//! It listens only. Whatever becomes of the disk, navigation does not wait for it, nor does this process end: what a full queue or
//! a full disk does not take is counted and said.

mod directory_log;
mod drops_told;
mod error;
mod estimate_log;
mod live_score;
mod mcap_log;
mod ports;
mod run;
mod tally;

pub use error::RecorderError;
pub use mcap_log::McapArgs;
pub use run::{Args, run, run_until};
