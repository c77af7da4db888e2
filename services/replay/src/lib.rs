//! A log directory through the whole navigator, without processes; scores and pictures.
//!
//! ```text
//! ilns replay  log directory -> estimate.csv, estimate.tum, summary.json
//! ilns smooth  log directory -> the same, each estimate with what came after it
//! ilns score   estimate.csv, truth.csv -> error statistics; any trajectory in TUM format -> ATE, RPE
//! ilns convert a public data set -> log directory
//! ilns plot    estimate.csv, truth.csv -> picture.svg
//! ```

mod args;
mod background;
mod chart;
pub mod convert;
mod error;
pub mod figure;
mod navigate;
mod origin;
mod output;
pub mod plot;
mod progress;
pub mod replay;
pub mod score;
pub mod smooth;
mod svg;
mod thinned;
mod trajectory;

pub use args::ReplayArgs;
pub use convert::ConvertArgs;
pub use error::ReplayError;
pub use navigate::{Watcher, navigate};
pub use output::{ReplayOutput, RunFacts};
pub use plot::PlotArgs;
pub use progress::Progress;
pub use score::ScoreArgs;
pub use smooth::SmoothArgs;
pub use trajectory::{Alignment, TrajectoryArgs, TrajectoryScore, score_trajectory};
