//! Another configuration for processes that run: `ilns reload` leaves it in the folder of the run, whole or not at all, with the time from
//! which on it is in force; whoever navigates looks there twice a second and takes it up when that time has come, all at the same.
//!
//! ```text
//! reloaded.toml            "# in force from MONOTONIC_NS", then the whole effective configuration
//! in-force-PROCESS.toml    what a process has taken up, for those who want to know
//! ```
//!
//! It holds for those who come after, too, until the folder of the run goes. Whether it may take the place of the one in force is asked
//! once more by each process: one that finds it wrong says so and stays with what it has.

use std::fs;
use std::path::{Path, PathBuf};

use shared_types::{Config, ConfigText, Process};
use tracing::{error, info, warn};

use crate::clock::monotonic_now;
use crate::configuration::load_config;

/// Between two looks, ns.
const LOOK: i64 = 500_000_000;

/// From its being left to its being in force, ns: by then everybody has looked.
pub const NOTICE: i64 = 2 * LOOK;

const HEAD: &str = "# in force from ";

/// A configuration and when it begins to be in force, monotonic ns.
#[derive(Clone, Debug, PartialEq)]
struct Due {
    config: Config,
    mono: i64,
}

/// What a running process knows of the configuration in force.
#[derive(Debug)]
pub struct Reloads {
    process: Process,
    folder: PathBuf,
    /// Made once: looking for it allocates nothing.
    file: PathBuf,
    /// As it was last looked at.
    seen: Option<String>,
    due: Option<Due>,
    next_look: i64,
}

fn reloaded(folder: &Path) -> PathBuf {
    folder.join("reloaded.toml")
}

fn in_force(folder: &Path, process: Process) -> PathBuf {
    folder.join(format!("in-force-{}.toml", process.name()))
}

/// What a process of the run in `folder` has taken up; `None` where it has not said so.
pub fn config_in_force(folder: &Path, process: Process) -> Option<Config> {
    load_config(&[], Some(&in_force(folder, process)), &[]).ok()
}

/// Leaves a configuration for the processes of the run in `folder`, whole or not at all.
///
/// # Errors
/// When it cannot be written.
pub fn leave_config(folder: &Path, config: &Config) -> std::io::Result<()> {
    let mono = monotonic_now() + NOTICE;
    write_whole(&reloaded(folder), &format!("{HEAD}{mono}\n{}", config.to_toml()))
}

fn write_whole(file: &Path, text: &str) -> std::io::Result<()> {
    let partial = file.with_extension("partial");
    fs::write(&partial, text)?;
    fs::rename(partial, file)
}

impl Reloads {
    /// Begins to look; `config` is what the process was started with, and becomes what was reloaded before it was started.
    pub fn begin(process: Process, folder: &Path, config: &mut Config) -> Reloads {
        let mut reloads = Reloads {
            process,
            folder: folder.to_owned(),
            file: reloaded(folder),
            seen: None,
            due: None,
            next_look: i64::MIN,
        };
        if let Some(newer) = reloads.look(config) {
            // For a process that begins there is nothing to be taken up together: the others have it or get it.
            info!("the configuration is the one that was reloaded");
            *config = newer.config;
        }
        reloads.next_look = monotonic_now() + LOOK;
        reloads.tell(config);
        reloads
    }

    /// A configuration that is to take the place of `config` now. To be asked in each turn of a loop: it looks at the folder only twice a
    /// second.
    pub fn take(&mut self, config: &Config, mono: i64) -> Option<Config> {
        if mono >= self.next_look {
            self.next_look = mono + LOOK;
            self.due = self.look(config).or(self.due.take());
        }
        let due = self.due.take_if(|due| mono >= due.mono)?;
        self.tell(&due.config);
        Some(due.config)
    }

    /// What lies in the folder, if it was not there at the last look and may take the place of `config`.
    fn look(&mut self, config: &Config) -> Option<Due> {
        let text = fs::read_to_string(&self.file).ok()?;
        if self.seen.as_ref() == Some(&text) {
            return None;
        }
        let read = parse(&self.file, &text).and_then(|due| match config.may_become(&due.config) {
            Ok(()) => Ok(due),
            Err(error) => Err(error.to_string()),
        });
        self.seen = Some(text);
        match read {
            Ok(due) => Some(due).filter(|due| due.config != *config),
            Err(error) => {
                error!(error, "{} is not taken up", self.file.display());
                None
            }
        }
    }

    /// For those who want to know; that nobody can know it is no reason to end.
    fn tell(&self, config: &Config) {
        let file = in_force(&self.folder, self.process);
        let written = fs::create_dir_all(&self.folder).and_then(|()| write_whole(&file, &config.to_toml()));
        if let Err(error) = written {
            warn!(%error, "{}: it cannot be written, and `ilns reload` cannot know what is in force", file.display());
        }
    }
}

fn parse(file: &Path, text: &str) -> Result<Due, String> {
    let first = text.lines().next().unwrap_or_default();
    let mono = first.strip_prefix(HEAD).and_then(|mono| mono.parse().ok());
    let mono = mono.ok_or_else(|| "its first line does not say from when on it is in force".to_owned())?;
    let config = Config::load(&[ConfigText::new(file, text)], &[]).map_err(|error| error.to_string())?;
    Ok(Due { config, mono })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(sets: &[&str]) -> Config {
        Config::load(&[], &sets.iter().map(|set| (*set).to_owned()).collect::<Vec<_>>()).expect("valid")
    }

    fn begun(folder: &Path) -> (Reloads, Config) {
        let mut config = with(&[]);
        (Reloads::begin(Process::Solver, folder, &mut config), config)
    }

    #[test]
    fn a_configuration_is_taken_up_when_its_time_has_come_and_once() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let (mut reloads, config) = begun(folder.path());
        let now = monotonic_now();
        assert_eq!(reloads.take(&config, now + LOOK), None, "nobody has left one");
        let newer = with(&["dvl.sigma=0.05"]);
        leave_config(folder.path(), &newer).expect("writable");
        // Seen, and not yet due.
        assert_eq!(reloads.take(&config, now + 2 * LOOK - 1), None);
        assert_eq!(config_in_force(folder.path(), Process::Solver), Some(config.clone()));
        assert_eq!(reloads.take(&config, monotonic_now() + NOTICE), Some(newer.clone()));
        assert_eq!(config_in_force(folder.path(), Process::Solver), Some(newer.clone()));
        assert_eq!(reloads.take(&newer, monotonic_now() + 9 * NOTICE), None);
        // Whoever begins later begins with it.
        assert_eq!(begun(folder.path()).1, newer);
    }

    #[test]
    fn what_is_wrong_or_may_not_change_changes_nothing() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let (mut reloads, config) = begun(folder.path());
        let mut later = monotonic_now();
        for wrong in ["", "[dvl]\nsigma = 0.5\n", "# in force from soon\n", "# in force from 0\n[dvl]\nsigma = -1\n"] {
            fs::write(reloaded(folder.path()), wrong).expect("writable");
            later += NOTICE;
            assert_eq!(reloads.take(&config, later), None, "{wrong:?}");
        }
        leave_config(folder.path(), &with(&["fgo.window=30"])).expect("writable");
        assert_eq!(reloads.take(&config, later + NOTICE), None);
        assert_eq!(begun(folder.path()).1, config);
    }
}
