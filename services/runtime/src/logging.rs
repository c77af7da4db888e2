//! Log lines: to standard error, for people or as JSON.

use std::io::IsTerminal;

use tracing_subscriber::EnvFilter;

use crate::error::RuntimeError;

/// Starts logging at `level` (`info`, or `warn,ilns_solver=debug`). A second call changes nothing.
///
/// # Errors
/// [`RuntimeError::LogLevel`].
pub fn start_logging(level: &str, json: bool) -> Result<(), RuntimeError> {
    let filter = EnvFilter::try_new(level).map_err(|_| RuntimeError::LogLevel { text: level.to_owned() })?;
    let lines = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal());
    // An error says that this process logs already, which is what was wanted.
    let _ = if json { lines.json().try_init() } else { lines.try_init() };
    Ok(())
}
