//! The whole navigator in one thread: raw reading in, estimate out.
//!
//! The same three pure values that the processes carry between them (preprocessor, estimator, propagator), called in line:
//! same readings in, same bits out. The one place where an estimator is chosen by name.

mod chosen;
mod navigator;
mod rebase;

pub use chosen::ChosenEstimator;
pub use nav_fgo::{BatchReport, Smoothed, SmoothedKeyframe};
pub use nav_models::estimator::{Effort, Estimator, EstimatorError};
pub use nav_models::initialisation::LastKnown;
pub use navigator::{Navigator, Output, SolveClock, Unmeasured};
pub use rebase::Rebase;
