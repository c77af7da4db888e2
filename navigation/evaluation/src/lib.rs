//! How good was it: estimates held against the truth.
//!
//! ```text
//! EstimatePoint, Truth --> Scorer --> Score
//! ```
//!
//! Pure sums over pairs of estimate and truth: constant memory, so that a log of a day is scored like one of a minute.

mod alignment;
mod association;
mod axis;
mod score;
mod scorer;

pub use association::{EstimatePoint, MAX_SPACING};
pub use score::{Score, Window};
pub use scorer::{Pair, Scorer};
