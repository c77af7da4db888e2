//! Why this process cannot begin.

use ilns_bus::BusError;
use ilns_runtime::RuntimeError;

/// A propagator that cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum PropagatorError {
    /// Arguments, configuration, signals.
    #[error(transparent)]
    Runtime(#[from] RuntimeError),
    /// The bus.
    #[error(transparent)]
    Bus(#[from] BusError),
}
