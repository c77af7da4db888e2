//! The words every crate and every process of the house speaks.
//!
//! Plain `repr(C)` data and its checks, no algebra: what crosses a border between crates or processes is declared here
//! once, with its frame, unit and layout. `navigation/` turns the arrays into vectors where a model is built from them.

mod calibration;
mod channels;
mod clocks;
mod config;
mod diagnostics;
mod estimate;
mod header;
mod health;
mod layout;
mod measurement;
mod navigator;
mod readings;
mod reject;
mod sensor;
mod solution;
mod time;
mod under_way;
mod vehicle;

pub use calibration::{CALIBRATIONS, Calibration};
pub use channels::{Channel, ChannelSpec, ChannelVisitor, EVERY_CHANNEL, Overflow, visit_channels};
pub mod channel {
    //! The channel table: one constant per channel, the only place that names them.
    pub use crate::channels::table::*;
}
pub use clocks::Clocks;
pub use config::{Config, ConfigError, ConfigText};
pub use diagnostics::{FACTORS_MAX, FactorReport, KeyframeReport};
pub use estimate::{Mode, NavEstimate};
pub use header::{Header, Message, Payload};
pub use health::{Heartbeat, HopLatency, Process, ProcessState, SensorHealth};
pub use measurement::{KeyframeCause, Measurement, MeasurementError, Reading};
pub use navigator::{
    AnchorMethod, EstimatorKind, FgoConfig, ImuGateConfig, KalmanConfig, Kernel, KeyframeConfig, Navigator,
    PropagatorConfig, SensorConfig, TimeOffset,
};
pub use readings::{
    BuoyFix, DvlVelocity, FrameOrigin, GnssFix, ImuSample, LblRange, McpHeading, PsDepth, RawReading, Truth,
};
pub use reject::{REJECT_REASONS, RejectReason};
pub use sensor::{AIDING, SENSORS, Sensor};
pub use solution::{SensorCounts, Solution, SolutionStatus};
pub use time::{Duration, Time, TimeError};
pub use vehicle::{Dvl, Frame, Gnss, ImuNoise, Initial, Lbl, Mcp, Ps, Vehicle};
