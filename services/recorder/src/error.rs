//! Why this process cannot begin or go on.

use ilns_bus::BusError;
use ilns_recording::LogError;
use ilns_runtime::RuntimeError;

/// A recorder that cannot begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum RecorderError {
    /// Arguments, configuration, signals.
    #[error(transparent)]
    Runtime(#[from] RuntimeError),
    /// The bus.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// The folder, or the disk below it.
    #[error(transparent)]
    Log(#[from] LogError),
}
