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
//! | `rows.rs` | what do all measurements of a keyframe say, robustly weighted? |
//! | `innovation.rs`, `robust.rs` | how probable is it, how much does it count? |
//! | `batch.rs`, `smoother.rs` | where was the vehicle, given the whole log? |
//! | `recovery.rs` | is it the state that is wrong, not the sensors? |
//! | `columns.rs`, `time_offsets.rs` | are a sensor's stamps right? |
//! | `chain.rs`, `kernels.rs` | the block-tridiagonal solve |

mod batch;
pub mod chain;
mod columns;
mod estimator;
mod factor;
mod innovation;
mod interval;
pub mod kernels;
mod node;
mod recovery;
mod robust;
mod rows;
mod smoother;
mod ties;
mod time_offsets;
mod window;

pub use batch::BatchReport;
pub use estimator::FgoEstimator;
pub use smoother::{Smoothed, SmoothedKeyframe};
