//! A log directory through the whole navigator, without processes; scores and pictures.
//!
//! ```text
//! ilns replay  log directory -> estimate.csv, estimate.tum, summary.json
//! ilns smooth  log directory -> the same, each estimate with what came after it
//! ilns score   estimate.csv, truth.csv -> error statistics
//! ilns plot    estimate.csv, truth.csv -> picture.svg
//! ```

mod args;
mod background;
mod chart;
mod error;
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

pub use args::ReplayArgs;
pub use error::ReplayError;
pub use navigate::{Watcher, navigate};
pub use output::{ReplayOutput, RunFacts};
pub use plot::PlotArgs;
pub use progress::Progress;
pub use score::ScoreArgs;
pub use smooth::SmoothArgs;
