//! Why this process cannot begin.

use std::path::PathBuf;

use ilns_bus::BusError;
use ilns_runtime::RuntimeError;
use nav_preprocessing::OriginError;

/// A preprocessor that cannot begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum PreprocessorError {
    /// Arguments, configuration, signals.
    #[error(transparent)]
    Runtime(#[from] RuntimeError),
    /// The bus.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// The origin that an earlier start of this run had fixed is lost: going on without would move the frame.
    #[error("{} should hold the origin of the frame and does not; restart the whole set", path.display())]
    OriginLost {
        /// Which file.
        path: PathBuf,
    },
    /// The origin that was kept is no place on Earth.
    #[error("{} is wrong; restart the whole set", path.display())]
    OriginWrong {
        /// Which file.
        path: PathBuf,
        /// What it says.
        source: OriginError,
    },
    /// The run's folder.
    #[error("cannot {what} {}", path.display())]
    Io {
        /// What was tried.
        what: &'static str,
        /// With which file.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
}
