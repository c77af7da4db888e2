//! Why this process cannot begin.

use ilns_bus::BusError;
use ilns_runtime::RuntimeError;

/// A solver that cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum SolverError {
    /// Arguments, configuration, signals.
    #[error(transparent)]
    Runtime(#[from] RuntimeError),
    /// The bus.
    #[error(transparent)]
    Bus(#[from] BusError),
}
