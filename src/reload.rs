//! `ilns reload`: another configuration for a set that runs, whole or not at all.

use std::thread;
use std::time::Duration;

use ilns_bus::{Bus, Prefix};
use ilns_runtime::{DEFAULT_PREFIX, NOTICE, NavigatorArgs, answer, config_in_force, leave_config, monotonic_now};
use shared_types::{Config, ConfigText, Process};

use crate::Outcome;

/// What `reload` is told.
#[derive(Debug, clap::Args)]
pub struct ReloadArgs {
    /// Name of the set.
    #[arg(long, value_name = "NAME", default_value = DEFAULT_PREFIX)]
    prefix: String,
    #[command(flatten)]
    navigator: NavigatorArgs,
}

/// Those who go by what may change.
const READERS: [Process; 2] = [Process::Preprocessor, Process::Solver];

/// From the notice on, ns: a process that begins anew meanwhile is there by then.
const PATIENCE: i64 = NOTICE + 5_000_000_000;

/// A set that cannot be told.
#[derive(Debug, thiserror::Error)]
enum ReloadError {
    #[error(
        "the solver of {prefix} has not said which configuration is in force (`ilns status --prefix {prefix}` shows whether it runs)"
    )]
    Unknown { prefix: String },
    #[error("{} has not taken the configuration up; it will when it begins anew (`ilns status --prefix {prefix}` shows whether it runs)", process.name())]
    NotTaken { prefix: String, process: Process },
    #[error("the configuration cannot be left in the folder of the run")]
    NotLeft(#[from] std::io::Error),
}

/// Checks the new configuration as at the start, and against what may change under way; leaves it for the processes, and waits until
/// they have taken it up. Where anything is wrong, nothing has changed.
pub fn run(args: &ReloadArgs) -> Outcome {
    let prefix = Prefix::new(&args.prefix)?;
    // Says so where nobody runs under this name.
    drop(Bus::join(&prefix, Process::Supervisor, 0)?);
    let folder = prefix.run_directory();
    let unknown = || ReloadError::Unknown { prefix: args.prefix.clone() };
    let in_force = config_in_force(&folder, Process::Solver).ok_or_else(unknown)?;
    let next = next_config(&args.navigator, &in_force)?;
    if args.navigator.print_config {
        answer(&next.to_toml())?;
        return Ok(());
    }
    in_force.may_become(&next)?;
    leave_config(&folder, &next).map_err(ReloadError::NotLeft)?;
    let limit = monotonic_now() + PATIENCE;
    for process in READERS {
        while config_in_force(&folder, process).as_ref() != Some(&next) {
            if monotonic_now() > limit {
                return Err(ReloadError::NotTaken { prefix: args.prefix.clone(), process }.into());
            }
            thread::sleep(Duration::from_millis(20));
        }
    }
    Ok(())
}

/// A file is a whole configuration, as at the start; without one, what is given changes the one in force.
fn next_config(navigator: &NavigatorArgs, in_force: &Config) -> Result<Config, ilns_runtime::RuntimeError> {
    let base = ConfigText::new("the configuration in force", in_force.to_toml());
    let first = if navigator.config.is_some() { Vec::new() } else { vec![base] };
    navigator.load_config(&first)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_set_changes_what_is_in_force_and_a_file_is_whole() {
        let in_force = Config::load(&[], &["dvl.sigma=0.05".to_owned()]).expect("valid");
        let mut navigator = NavigatorArgs { sets: vec!["mcp.sigma=0.2".to_owned()], ..NavigatorArgs::default() };
        let next = next_config(&navigator, &in_force).expect("valid");
        assert_eq!((next.vehicle.dvl.sigma, in_force.may_become(&next)), (0.05, Ok(())));
        let file = tempfile::NamedTempFile::new().expect("a temporary file");
        std::fs::write(file.path(), "[ps]\nsigma = 0.3\n").expect("writable");
        navigator.config = Some(file.path().to_owned());
        let next = next_config(&navigator, &in_force).expect("valid");
        assert_eq!((next.vehicle.ps.sigma, next.vehicle.dvl.sigma), (0.3, Config::default().vehicle.dvl.sigma));
    }
}
