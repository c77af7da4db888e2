//! Which reading counts, and at which keyframe: raw readings in, checked, anchored measurements out.
//!
//! A reading is judged by itself and by its own sensor's past only; gates that need an estimate stand in the estimators.
//! Everything here is a pure function of the readings: data time is the only time.
//!
//! | file | its question |
//! |---|---|
//! | `preprocessor.rs` | the whole walk, reading by reading |
//! | `imu_gate.rs` | does this IMU sample count? |
//! | `leaps.rs` | can an IMU's numbers change as fast as that? |
//! | `axes.rs` | have an IMU's axes changed places? |
//! | `repetition.rs` | has an instrument frozen? |
//! | `event_time.rs` | in which order are readings of several channels taken up? |
//! | `duplicates.rs` | did exactly this reading come before? |
//! | `frozen_sensors.rs` | has a DVL, MCP or PS frozen? |
//! | `gates.rs` | is the content possible, and what is it in SI units? |
//! | `origin.rs` | where is the frame? |
//! | `buoy_tracks.rs` | where was the buoy at that instant? |
//! | `lbl_epochs.rs` | which ranges belong together? |
//! | `keyframe_times.rs` | when is the next keyframe, and which were the last? |
//! | `time_offset.rs` | to which keyframe is a reading tied, and with which offset? |

mod axes;
mod buoy_tracks;
mod duplicates;
mod event_time;
mod frozen_sensors;
mod gates;
mod imu_gate;
mod keyframe_times;
mod lbl_epochs;
mod leaps;
mod origin;
mod preprocessor;
mod repetition;
#[cfg(test)]
#[expect(dead_code, reason = "the tests in `tests/` use the rest")]
#[path = "../tests/readings/mod.rs"]
mod testing;
mod time_offset;

pub use imu_gate::{ImuGate, ImuVerdict};
pub use origin::OriginError;
pub use preprocessor::Preprocessor;
