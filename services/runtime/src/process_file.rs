//! The process file (`deploy/*.toml`): how the system is to run each process, and which of them something else starts.
//!
//! ```toml
//! [propagator]            # a process by the name that `ilns status` shows
//! core = 1                # bind it to this core
//! priority = 80           # SCHED_FIFO, 1 to 99; absent: ordinary scheduling
//! wake_up = "event"       # sleep until rung (default); "poll": look without end, on a core of its own, without a priority
//! lock_memory = true      # no page of it may be swapped out or is faulted in late
//!
//! [emulator-dvl]
//! external = true         # something else plays this part, such as a real driver: `ilns run` does not start it
//! ```
//!
//! Every key is optional, and a process that is not named runs as `ilns run` runs it without a file.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use shared_types::Process;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// How a process waits for messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum WakeUp {
    /// Asleep until rung: some 20 µs later than a poller, at no cost while nothing comes.
    #[default]
    Event,
    /// Looking without end: under a microsecond, at the price of a core.
    Poll,
}

/// How the system is to run one process.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ProcessSettings {
    /// Something else starts it.
    pub external: bool,
    /// Core that it is bound to.
    pub core: Option<usize>,
    /// SCHED_FIFO priority, 1 to 99.
    pub priority: Option<u8>,
    /// How it waits.
    pub wake_up: WakeUp,
    /// Whether its memory is locked and faulted in before its loop.
    pub lock_memory: bool,
}

/// The settings of every process that a file names.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ProcessFile {
    settings: BTreeMap<Process, ProcessSettings>,
}

/// A process file that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ProcessFileError {
    /// It cannot be read.
    #[error("cannot read the process file {} (--processes FILE names it)", file.display())]
    Read {
        /// Which file.
        file: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
    /// It says something that cannot be done.
    #[error("{}:{line}: {message}", file.display())]
    Content {
        /// Which file.
        file: PathBuf,
        /// From 1.
        line: usize,
        /// What is wrong, and the mend.
        message: String,
    },
}

/// Processes that wait for messages, and may therefore poll for them.
const POLLERS: [Process; 3] = [Process::Preprocessor, Process::Solver, Process::Propagator];

const KEYS: &str = "external, core, priority, wake_up and lock_memory";

impl ProcessFile {
    /// Reads a file for this machine.
    ///
    /// # Errors
    /// [`ProcessFileError`], naming file and line.
    pub fn read(file: &Path) -> Result<ProcessFile, ProcessFileError> {
        let text =
            fs::read_to_string(file).map_err(|source| ProcessFileError::Read { file: file.to_owned(), source })?;
        ProcessFile::parse(&text, file, cores())
    }

    /// Parses a file for a machine that has so many cores.
    ///
    /// # Errors
    /// [`ProcessFileError::Content`].
    pub fn parse(text: &str, file: &Path, cores: usize) -> Result<ProcessFile, ProcessFileError> {
        let fail = |(at, message): Fault| {
            let line = text[..at.min(text.len())].matches('\n').count() + 1;
            ProcessFileError::Content { file: file.to_owned(), line, message }
        };
        parse(text, cores).map_err(fail)
    }

    /// What it says of a process.
    pub fn of(&self, process: Process) -> ProcessSettings {
        self.settings.get(&process).copied().unwrap_or_default()
    }

    /// Whether something else starts it.
    pub fn is_external(&self, process: Process) -> bool {
        self.of(process).external
    }
}

/// Cores of this machine that are there, whether this process may use them or not.
fn cores() -> usize {
    let listed = fs::read_to_string("/sys/devices/system/cpu/possible").ok();
    let last = listed.as_deref().and_then(|list| list.trim().rsplit(['-', ',']).next()?.parse::<usize>().ok());
    last.map_or_else(|| std::thread::available_parallelism().map_or(1, |cores| cores.get()), |last| last + 1)
}

/// Where in the text, and what.
type Fault = (usize, String);

fn parse(text: &str, cores: usize) -> Result<ProcessFile, Fault> {
    let table = DeTable::parse(text).map_err(|error| {
        let at = error.span().map_or(0, |span| span.start);
        (at, error.message().to_owned())
    })?;
    let mut settings = BTreeMap::new();
    let mut places = BTreeMap::new();
    for (key, value) in table.get_ref() {
        let at = key.span().start;
        let process = process_named(key.get_ref()).map_err(|message| (at, message))?;
        let DeValue::Table(section) = value.get_ref() else {
            return Err((at, format!("`{process}` is no table; write `[{process}]`")));
        };
        settings.insert(process, one(process, section, cores)?);
        places.insert(process, at);
    }
    for (&process, own) in &settings {
        let at = places[&process];
        if own.wake_up == WakeUp::Poll {
            polls_alone(process, own, &settings).map_err(|message| (at, message))?;
        }
    }
    Ok(ProcessFile { settings })
}

fn process_named(name: &str) -> Result<Process, String> {
    match Process::from_name(name) {
        Some(Process::Supervisor) => Err("the supervisor takes no settings: it only starts the others".to_owned()),
        Some(process) => Ok(process),
        None => {
            let names: Vec<&str> = Process::ALL.iter().skip(1).map(|process| process.name()).collect();
            Err(format!("`{name}` is no process; there are {}", names.join(", ")))
        }
    }
}

fn one(process: Process, section: &DeTable, cores: usize) -> Result<ProcessSettings, Fault> {
    let mut settings = ProcessSettings::default();
    for (key, value) in section {
        let name = key.get_ref().as_ref();
        let wrong = |found: &Spanned<DeValue>, expected: String| {
            (found.span().start, format!("`{process}.{name}` is {}; it must be {expected}", shown(found.get_ref())))
        };
        match name {
            "external" => settings.external = flag(value).ok_or_else(|| wrong(value, "true or false".to_owned()))?,
            "lock_memory" => {
                settings.lock_memory = flag(value).ok_or_else(|| wrong(value, "true or false".to_owned()))?;
            }
            "core" => {
                let core = number(value).filter(|&core| core < cores);
                let expected = || format!("a core of this machine, 0 to {}", cores.saturating_sub(1));
                settings.core = Some(core.ok_or_else(|| wrong(value, expected()))?);
            }
            "priority" => {
                let priority = number(value).and_then(|number| u8::try_from(number).ok());
                let priority = priority.filter(|priority| (1..=99).contains(priority));
                let expected = "a SCHED_FIFO priority, 1 to 99".to_owned();
                settings.priority = Some(priority.ok_or_else(|| wrong(value, expected))?);
            }
            "wake_up" => {
                settings.wake_up = match value.get_ref().as_str() {
                    Some("event") => WakeUp::Event,
                    Some("poll") if POLLERS.contains(&process) => WakeUp::Poll,
                    Some("poll") => return Err(wrong(value, "\"event\": it works by the clock".to_owned())),
                    _ => return Err(wrong(value, "\"event\" or \"poll\"".to_owned())),
                };
            }
            _ => return Err((key.span().start, format!("`{process}.{name}` is no setting; there are {KEYS}"))),
        }
    }
    Ok(settings)
}

/// Who polls takes every cycle of its core: nobody may be bound to it beside him.
fn polls_alone(
    process: Process,
    own: &ProcessSettings,
    all: &BTreeMap<Process, ProcessSettings>,
) -> Result<(), String> {
    let Some(core) = own.core else {
        return Err(format!("`{process}` polls and therefore needs a core of its own; give it `core`"));
    };
    // The kernel takes a real-time thread that never sleeps off its core for 50 ms in every second.
    if own.priority.is_some() {
        return Err(format!("`{process}` polls, and the kernel throttles a poller with a `priority`; leave that out"));
    }
    match all.iter().find(|(other, settings)| **other != process && settings.core == Some(core)) {
        Some((other, _)) => {
            Err(format!("`{process}` polls core {core}, to which `{other}` is bound too; give it another"))
        }
        None => Ok(()),
    }
}

fn flag(value: &Spanned<DeValue>) -> Option<bool> {
    value.get_ref().as_bool()
}

fn number(value: &Spanned<DeValue>) -> Option<usize> {
    let integer = value.get_ref().as_integer()?;
    usize::from_str_radix(integer.as_str(), integer.radix()).ok()
}

fn shown(value: &DeValue) -> String {
    match value {
        DeValue::String(text) => format!("{text:?}"),
        DeValue::Integer(integer) => integer.as_str().to_owned(),
        DeValue::Float(float) => float.as_str().to_owned(),
        DeValue::Boolean(flag) => flag.to_string(),
        DeValue::Datetime(time) => time.to_string(),
        DeValue::Array(_) => "a list".to_owned(),
        DeValue::Table(_) => "a table".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<ProcessFile, String> {
        ProcessFile::parse(text, Path::new("p.toml"), 4).map_err(|error| error.to_string())
    }

    #[test]
    fn settings_are_read_and_who_is_not_named_has_none() {
        let file = parsed(
            "[propagator]\ncore = 1\nwake_up = \"poll\"\nlock_memory = true\n\
             [emulator-dvl]\nexternal = true\npriority = 80\n",
        )
        .expect("valid");
        let propagator = ProcessSettings {
            external: false,
            core: Some(1),
            priority: None,
            wake_up: WakeUp::Poll,
            lock_memory: true,
        };
        assert_eq!(file.of(Process::Propagator), propagator);
        assert!(file.is_external(Process::EmulatorDvl) && !file.is_external(Process::EmulatorImu));
        assert_eq!(file.of(Process::EmulatorDvl).priority, Some(80));
        assert_eq!(file.of(Process::Solver), ProcessSettings::default());
    }

    #[test]
    fn a_mistake_is_one_line_with_file_line_and_mend() {
        let cases = [
            ("[propagater]\n", "p.toml:1: `propagater` is no process; there are emulator-imu, "),
            ("[solver]\n\ncore = 4\n", "p.toml:3: `solver.core` is 4; it must be a core of this machine, 0 to 3"),
            ("[solver]\ncore = -1\n", "p.toml:2: `solver.core` is -1;"),
            (
                "[solver]\npriority = 100\n",
                "p.toml:2: `solver.priority` is 100; it must be a SCHED_FIFO priority, 1 to 99",
            ),
            ("[solver]\npriority = 0\n", "p.toml:2: `solver.priority` is 0;"),
            ("[solver]\npriority = \"high\"\n", "p.toml:2: `solver.priority` is \"high\";"),
            (
                "[solver]\nwake_up = \"spin\"\n",
                "p.toml:2: `solver.wake_up` is \"spin\"; it must be \"event\" or \"poll\"",
            ),
            ("[recorder]\nwake_up = \"poll\"\n", "p.toml:2: `recorder.wake_up` is \"poll\"; it must be \"event\""),
            ("[solver]\nprio = 3\n", "p.toml:2: `solver.prio` is no setting; there are external, core, "),
            ("[solver]\nlock_memory = 1\n", "p.toml:2: `solver.lock_memory` is 1; it must be true or false"),
            ("solver = 3\n", "p.toml:1: `solver` is no table"),
            ("[supervisor]\ncore = 0\n", "p.toml:1: the supervisor takes no settings"),
            ("[solver]\nwake_up = \"poll\"\n", "p.toml:1: `solver` polls and therefore needs a core of its own"),
            (
                "[monitor]\ncore = 2\n[solver]\nwake_up = \"poll\"\ncore = 2\n",
                "p.toml:3: `solver` polls core 2, to which `monitor` is bound too",
            ),
            (
                "[solver]\nwake_up = \"poll\"\ncore = 2\npriority = 5\n",
                "p.toml:1: `solver` polls, and the kernel throttles a poller with a `priority`",
            ),
            ("[solver\n", "p.toml:1: "),
        ];
        for (text, expected) in cases {
            let error = parsed(text).expect_err(text);
            assert!(error.starts_with(expected) && !error.contains('\n'), "{text:?}: {error}");
        }
    }
}
