//! Where a scenario comes from: the built-in ones by name, any other from a file.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use sim_world::{BUILTIN_SCENARIOS, Scenario, ScenarioError};

/// A scenario that cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum ScenarioSourceError {
    /// No such name, or a text that is no scenario.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// The file cannot be read.
    #[error("{}: cannot read the scenario", file.display())]
    Read {
        /// Which file.
        file: PathBuf,
        /// Why.
        source: io::Error,
    },
}

/// The built-in scenario of that name, else the one in that file. What has no path separator and does not end in `.toml`
/// is taken for a name.
///
/// # Errors
/// [`ScenarioSourceError`], naming the built-in scenarios or the file and line.
pub fn load_scenario(name_or_file: &str) -> Result<Scenario, ScenarioSourceError> {
    let file = Path::new(name_or_file);
    let is_builtin = BUILTIN_SCENARIOS.iter().any(|(name, _)| *name == name_or_file);
    let is_file = file.components().count() > 1 || file.extension().is_some_and(|extension| extension == "toml");
    if is_builtin || !is_file {
        return Ok(Scenario::builtin(name_or_file)?);
    }
    let text =
        fs::read_to_string(file).map_err(|source| ScenarioSourceError::Read { file: file.to_owned(), source })?;
    Ok(Scenario::parse(&text, file)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_a_built_in_scenario_and_a_path_is_a_file() {
        assert_eq!(load_scenario("stable").expect("built in"), Scenario::builtin("stable").expect("built in"));
        let error = load_scenario("stabel").expect_err("misspelt").to_string();
        assert!(error.contains("stabel") && error.contains("mission, stable, outage"), "{error}");
        let error = load_scenario("no/such.toml").expect_err("there is none").to_string();
        assert_eq!(error, "no/such.toml: cannot read the scenario");
    }

    #[test]
    fn a_file_is_read_and_its_errors_name_it() {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let file = dir.path().join("own.toml");
        fs::write(&file, BUILTIN_SCENARIOS[1].1).expect("it is writable");
        let path = file.to_str().expect("it is UTF-8");
        assert_eq!(load_scenario(path).expect("it is valid").segments.len(), 3);
        fs::write(&file, "origin = 3\n").expect("it is writable");
        let error = load_scenario(path).expect_err("no origin").to_string();
        assert!(error.starts_with(&format!("{path}:1:")), "{error}");
    }
}
