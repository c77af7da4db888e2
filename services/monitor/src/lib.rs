//! The process that shows where the vehicle is and how the machine keeps up.
//!
//! ```text
//! nav/*, sensor/buoys, sim/truth, health --> Model --> Snapshot --> terminal, lines, JSON
//! ```
//!
//! The model folds messages into what is known and draws nothing; the views draw a snapshot and know no message. It listens
//! on a timer, is rung by nobody and speaks on `health` only: navigation does not notice whether it is there.

mod compact;
mod detail;
mod error;
mod finished;
mod foxglove;
mod history;
mod keys;
mod lines;
mod model;
mod numbers;
mod ports;
mod run;
mod screen;
mod show;
mod snapshot;
mod terminal;
#[cfg(test)]
mod testing;
mod web;

pub use crate::foxglove::{FoxgloveArgs, FoxgloveError};
pub use detail::{Factor, Fate, Fix, Histogram, Hop, KeyframeDetail, News, Ring};
pub use error::MonitorError;
pub use finished::{Finished, Run};
pub use history::{History, Kind, Limits, Sample};
pub use model::Model;
pub use run::{Args, View, run, run_until};
pub use show::{export, show};
pub use snapshot::{
    Buoy, Distribution, Estimates, Event, EventKind, Keyframe, Pose, ProcessRow, SensorRow, Snapshot, Solver,
    TruthError,
};
pub use web::{WebAddress, WebArgs, WebError, listen};
