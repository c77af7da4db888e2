//! Why this process cannot begin or go on.

use ilns_bus::BusError;
use ilns_runtime::RuntimeError;

/// A monitor that cannot begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum MonitorError {
    /// Arguments, signals.
    #[error(transparent)]
    Runtime(#[from] RuntimeError),
    /// The bus.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// What was asked for could not be printed.
    #[error("cannot write to standard output")]
    Output(#[from] std::io::Error),
}
