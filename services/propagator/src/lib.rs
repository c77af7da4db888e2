//! The process that publishes an estimate for every IMU sample: `sensor/imu`, `nav/solution` -> `nav/estimate`.
//!
//! One hop from the driver to the pose: neither the preprocessor nor the solver can hold it up, crash it or silence it.

mod error;
mod fast_path;
mod rhythm;
mod run;
mod silence;

pub use error::PropagatorError;
pub use fast_path::FastPath;
pub use run::{Args, run, run_until};
