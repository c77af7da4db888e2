//! Sliding-window factor graph: the best trajectory given the window (§4 of the method).
//!
//! | file | its question |
//! |---|---|
//! | `estimator.rs` | what does a measurement do to the estimate? |
//! | `ties.rs` | to which keyframe does it belong, does it pass its gate? |
//! | `window.rs` | which keyframes are held, which are linearised and swept anew? |
//! | `node.rs` | what is tied to one keyframe? |
//! | `interval.rs` | which IMU samples lie between two keyframes, and what do they add up to? |
//! | `factor.rs` | what does one measurement say, whitened? |
//! | `joint.rs` | what if it and the samples around it owe their errors to the same noise? |
//! | `rows.rs` | what do all measurements of a keyframe say, robustly weighted? |
//! | `batch.rs`, `smoother.rs` | where was the vehicle, given the whole log? |
//! | `realignment.rs` | what if the heading itself is wrong? |
//! | `elsewhere.rs`, `alternatives.rs` | what if so few buoys were heard from another place? |
//! | `columns.rs`, `systematic.rs` | are a sensor's stamps right, and is it calibrated? |
//! | `moorings.rs` | what if the moored buoys lie elsewhere than they are said to? |
//! | `chain.rs` | the block-tridiagonal solve |
//!
//! How probable a measurement is and how much it counts (`innovation`, `robust`, `judging`), and whether it is the state that
//! is wrong (`recovery`), stands in `nav-models`: the filters ask the same.

mod alternatives;
mod batch;
pub mod chain;
mod columns;
mod elsewhere;
mod estimator;
mod factor;
mod interval;
mod joint;
mod moorings;
mod node;
mod realignment;
mod rows;
mod smoother;
mod systematic;
mod ties;
mod window;

pub use batch::BatchReport;
pub use estimator::{FgoEstimator, KEEPING_ALL};
pub use nav_models::kernels;
pub use smoother::{Smoothed, SmoothedKeyframe};

use nav_models::{recovery, robust};
