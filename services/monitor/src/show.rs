//! A finished run in the page, or as a file to be sent on.

use std::path::{Path, PathBuf};

use ilns_runtime::Shutdown;

use crate::error::MonitorError;
use crate::finished::Run;
use crate::web::{WebAddress, WebArgs, listen, one_file, serve_finished};

/// Serves the page with `run` in it until `shutdown` is requested.
///
/// # Errors
/// It cannot be served there.
pub fn show(run: Run, args: &WebArgs, shutdown: &Shutdown) -> Result<(), MonitorError> {
    let (listener, token) = listen(args.web.unwrap_or(WebAddress::Auto), args.web_token.as_deref())?;
    eprintln!("ilns view: page at http://{} (Ctrl-C ends it)", listener.local_addr()?);
    Ok(serve_finished(listener, token, run.json, run.end, || shutdown.requested())?)
}

/// Writes the page with `run` in it as one file that needs nothing else, whole or not at all.
///
/// # Errors
/// It cannot be written.
pub fn export(run: &Run, file: &Path) -> Result<(), MonitorError> {
    let failed = |source| MonitorError::Export { file: file.to_owned(), source };
    let mut partial = PathBuf::from(file).into_os_string();
    partial.push(".partial");
    std::fs::write(&partial, one_file(&run.json)).map_err(failed)?;
    std::fs::rename(&partial, file).map_err(failed)
}
