//! Why this process cannot begin or go on.

use std::path::PathBuf;

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
    /// The page.
    #[error(transparent)]
    Web(#[from] crate::web::WebError),
    /// Foxglove.
    #[error(transparent)]
    Foxglove(#[from] crate::foxglove::FoxgloveError),
    /// A page of one file that cannot be written.
    #[error("{}: cannot write the page", file.display())]
    Export {
        /// Which file.
        file: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// What was asked for could not be printed.
    #[error("cannot write to standard output")]
    Output(#[from] std::io::Error),
}
