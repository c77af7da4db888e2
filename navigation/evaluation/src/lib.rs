//! How good was it: estimates held against the truth.
//!
//! ```text
//! EstimatePoint, Truth --> Scorer --> Score
//! Pose, Pose --> associate --> absolute_error, relative_error      any trajectory against any other
//! ```
//!
//! Pure sums over pairs of estimate and truth: constant memory, so that a log of a day is scored like one of a minute.

mod alignment;
mod association;
mod axis;
mod pose;
mod rigid_motion;
mod score;
mod scorer;
mod trajectory_error;

pub use association::{EstimatePoint, MAX_SPACING};
pub use pose::{Pose, PosePair, associate};
pub use rigid_motion::{Motion, RigidMotion};
pub use score::{Score, Window};
pub use scorer::{Pair, Scorer};
pub use trajectory_error::{Distances, absolute_error, relative_error};
