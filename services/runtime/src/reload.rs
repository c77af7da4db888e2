//! Another configuration for processes that run: `ilns reload` leaves it in the folder of the run, whole or not at all, with the time from
//! which on it is in force; whoever navigates has a thread that looks there twice a second, and takes it up when that time has come, all
//! at the same.
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
use std::thread;
use std::time::Duration;

use crossbeam::channel::{Receiver, RecvTimeoutError, Sender, bounded};
use shared_types::{Config, ConfigText, Process};
use tracing::{error, info, warn};

use crate::clock::monotonic_now;
use crate::configuration::load_config;

/// Between two looks.
const LOOK: Duration = Duration::from_millis(500);

/// From its being left to its being in force, ns: by then everybody has looked.
pub const NOTICE: i64 = 2 * LOOK.as_nanos() as i64;

const HEAD: &str = "# in force from ";

/// A configuration and when it begins to be in force, monotonic ns.
#[derive(Clone, Debug, PartialEq)]
struct Due {
    config: Config,
    mono: i64,
}

/// What a running process knows of the configuration in force. Files are looked at in a thread of its own: asking costs nothing.
#[derive(Debug)]
pub struct Reloads {
    found: Receiver<Due>,
    taken: Sender<Config>,
    due: Option<Due>,
    in_force: Config,
}

/// What lies in the folder of the run, and what this process says there of itself.
#[derive(Debug)]
struct Lookout {
    process: Process,
    folder: PathBuf,
    file: PathBuf,
    /// As it was last looked at.
    seen: Option<String>,
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
        let mut lookout = Lookout::new(process, folder);
        if let Some(newer) = lookout.look(config) {
            // For a process that begins there is nothing to be taken up together: the others have it or get it.
            info!("the configuration is the one that was reloaded");
            *config = newer.config;
        }
        let (to_process, found) = bounded(1);
        let (taken, of_process) = bounded(1);
        let in_force = config.clone();
        thread::spawn(move || lookout.look_on(in_force, &to_process, &of_process));
        Reloads { found, taken, due: None, in_force: config.clone() }
    }

    /// A configuration that is to take the place of the one in force at the monotonic time `mono`, ns. To be asked in each turn of a loop.
    pub fn take(&mut self, mono: i64) -> Option<Config> {
        if let Ok(due) = self.found.try_recv() {
            self.due = Some(due);
        }
        let next = self.due.take_if(|due| mono >= due.mono)?.config;
        if next == self.in_force {
            return None;
        }
        self.in_force = next.clone();
        // There is room: the one before was read before this one was found.
        let _ = self.taken.try_send(next.clone());
        Some(next)
    }
}

impl Lookout {
    fn new(process: Process, folder: &Path) -> Lookout {
        Lookout { process, folder: folder.to_owned(), file: reloaded(folder), seen: None }
    }

    /// Until the process is no longer interested.
    fn look_on(mut self, mut config: Config, found: &Sender<Due>, taken: &Receiver<Config>) {
        self.tell(&config);
        loop {
            match taken.recv_timeout(LOOK) {
                Ok(newer) => {
                    self.tell(&newer);
                    config = newer;
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
            // A process that takes nothing for longer than it takes to leave another one gets it later.
            if !found.is_full()
                && let Some(due) = self.look(&config)
            {
                let _ = found.try_send(due);
            }
        }
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
            Ok(due) => Some(due),
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

    /// What is taken within `limit`; `None` if that is nothing.
    fn taken_within(reloads: &mut Reloads, limit: Duration) -> Option<Config> {
        let end = monotonic_now() + limit.as_nanos() as i64;
        while monotonic_now() < end {
            let taken = reloads.take(monotonic_now());
            if taken.is_some() {
                return taken;
            }
            thread::sleep(Duration::from_millis(5));
        }
        None
    }

    #[test]
    fn a_configuration_is_taken_up_when_its_time_has_come_and_once() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let (mut reloads, config) = begun(folder.path());
        let newer = with(&["dvl.sigma=0.05"]);
        let left = monotonic_now();
        leave_config(folder.path(), &newer).expect("writable");
        let limit = Duration::from_secs(60);
        assert_eq!(taken_within(&mut reloads, limit), Some(newer.clone()));
        assert!(monotonic_now() >= left + NOTICE, "before its time");
        while config_in_force(folder.path(), Process::Solver).as_ref() != Some(&newer) {
            assert!(monotonic_now() < left + limit.as_nanos() as i64, "it never said so");
            thread::sleep(Duration::from_millis(5));
        }
        assert_eq!(taken_within(&mut reloads, 3 * LOOK), None, "a second time");
        // Whoever begins later begins with it.
        assert_eq!(begun(folder.path()).1, newer);
        // And back again.
        leave_config(folder.path(), &config).expect("writable");
        assert_eq!(taken_within(&mut reloads, limit), Some(config));
    }

    #[test]
    fn one_that_was_thought_better_of_before_its_time_is_never_in_force() {
        let (to_process, found) = bounded(1);
        let (taken, of_process) = bounded(1);
        let [first, second] = [with(&[]), with(&["dvl.sigma=0.05"])];
        let mut reloads = Reloads { found, taken, due: None, in_force: first.clone() };
        to_process.send(Due { config: second.clone(), mono: 1000 }).expect("room");
        assert_eq!(reloads.take(900), None);
        to_process.send(Due { config: first, mono: 1900 }).expect("room");
        assert_eq!((reloads.take(1500), reloads.take(2500)), (None, None));
        to_process.send(Due { config: second.clone(), mono: 3000 }).expect("room");
        assert_eq!((reloads.take(2999), reloads.take(3000)), (None, Some(second.clone())));
        assert_eq!(of_process.try_iter().collect::<Vec<_>>(), [second], "only what is in force is told of");
    }

    #[test]
    fn what_is_wrong_or_may_not_change_changes_nothing() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let config = with(&[]);
        let mut lookout = Lookout::new(Process::Solver, folder.path());
        assert_eq!(lookout.look(&config), None, "nobody has left one");
        for wrong in ["", "[dvl]\nsigma = 0.5\n", "# in force from soon\n", "# in force from 0\n[dvl]\nsigma = -1\n"] {
            fs::write(reloaded(folder.path()), wrong).expect("writable");
            assert_eq!(lookout.look(&config), None, "{wrong:?}");
        }
        leave_config(folder.path(), &with(&["fgo.window=30"])).expect("writable");
        assert_eq!(lookout.look(&config), None);
        assert_eq!(begun(folder.path()).1, config);
        leave_config(folder.path(), &with(&["dvl.sigma=0.5"])).expect("writable");
        assert!(lookout.look(&config).is_some());
        assert_eq!(lookout.look(&config), None, "a second time");
    }
}
