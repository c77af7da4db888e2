//! What can go wrong before a process has begun its own work.

use std::path::PathBuf;

use shared_types::ConfigError;

use crate::process_file::ProcessFileError;

/// A process that cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum RuntimeError {
    /// A configuration file that cannot be read.
    #[error("cannot read the configuration {} (--config FILE names it)", path.display())]
    ConfigFile {
        /// Which file.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
    /// A configuration that cannot be used.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A process file that cannot be used.
    #[error(transparent)]
    Processes(#[from] ProcessFileError),
    /// A start triple that is none.
    #[error("--start {text}: expected DATA_NS,MONO_NS,RATE, two whole numbers and a positive number")]
    Start {
        /// As given.
        text: String,
    },
    /// A log level that is none.
    #[error("--log-level {text}: expected error, warn, info, debug or trace, or target=level pairs with commas")]
    LogLevel {
        /// As given.
        text: String,
    },
    /// Signals cannot be caught.
    #[error("cannot catch SIGTERM and SIGINT")]
    Signals(#[source] std::io::Error),
    /// The supervisor died while it started this process.
    #[error("the supervisor (process {supervisor}) is gone")]
    Orphaned {
        /// Its process number.
        supervisor: u32,
    },
}
