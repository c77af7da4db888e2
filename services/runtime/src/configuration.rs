//! Files and `--set` to the checked configuration.

use std::fs;
use std::path::Path;

use shared_types::{Config, ConfigText};

use crate::error::RuntimeError;

/// Reads a configuration file.
///
/// # Errors
/// [`RuntimeError::ConfigFile`], naming it.
pub fn read_config_text(path: &Path) -> Result<ConfigText, RuntimeError> {
    match fs::read_to_string(path) {
        Ok(text) => Ok(ConfigText::new(path, text)),
        Err(source) => Err(RuntimeError::ConfigFile { path: path.to_owned(), source }),
    }
}

/// The defaults, then `first` (what comes with a scenario or log), then `file`, then `sets`, later ones winning.
///
/// # Errors
/// [`RuntimeError::ConfigFile`] or [`RuntimeError::Config`].
pub fn load_config(first: &[ConfigText], file: Option<&Path>, sets: &[String]) -> Result<Config, RuntimeError> {
    let mut texts = first.to_vec();
    if let Some(path) = file {
        texts.push(read_config_text(path)?);
    }
    Ok(Config::load(&texts, sets)?)
}
