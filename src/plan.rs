//! Which processes make a set, in the order in which they are started, and what each is told.

use std::ffi::OsString;
use std::fs;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use ilns_bus::Prefix;
use ilns_runtime::{LogFormat, ProcessFile, StartClock};
use shared_types::{Config, Process};
use sim_emulators::process::{EMULATORS, is_fitted};
use sim_emulators::source::{Source, SourceArgs};

use crate::child::ChildPlan;
use crate::legacy;
use crate::processes::can_run;

/// Those who listen are there before those who speak; the set is stopped in the reverse order.
const LISTENERS: [Process; 5] =
    [Process::Recorder, Process::Monitor, Process::Propagator, Process::Solver, Process::Preprocessor];

/// A run as it was asked for.
#[derive(Debug)]
pub struct Wishes<'a> {
    /// What is emulated.
    pub source: &'a SourceArgs,
    /// Seconds of data time.
    pub duration: Option<f64>,
    /// Where a recording goes, if one is wanted.
    pub out: Option<PathBuf>,
    /// What outlives a restart of the machine.
    pub keep: Option<PathBuf>,
    /// Nothing is shown.
    pub headless: bool,
    /// What something else starts is none of this run's.
    pub processes: &'a ProcessFile,
    /// Where the monitor serves its page.
    pub web: Option<SocketAddr>,
    /// File with the token that the page asks for.
    pub web_token: Option<PathBuf>,
    /// Where the monitor serves Foxglove.
    pub foxglove: Option<SocketAddr>,
}

/// The processes of a run, in the order of their start.
pub fn children(wishes: &Wishes, source: &Source) -> Vec<ChildPlan> {
    let emulators = EMULATORS.into_iter().filter(|&emulator| is_fitted(source, emulator));
    LISTENERS
        .into_iter()
        .filter(|&process| match process {
            Process::Recorder => wishes.out.is_some(),
            Process::Monitor => !wishes.headless,
            _ => true,
        })
        .chain(emulators)
        .filter(|&process| can_run(process) && !wishes.processes.is_external(process))
        .map(|process| ChildPlan {
            process,
            arguments: arguments(process, wishes),
            owns_terminal: process == Process::Monitor,
        })
        .collect()
}

/// What one process is told beyond what all are told.
fn arguments(process: Process, wishes: &Wishes) -> Vec<OsString> {
    let mut arguments: Vec<OsString> = Vec::new();
    let mut push = |key: &str, value: OsString| arguments.extend([OsString::from(key), value]);
    if process == Process::Recorder
        && let Some(out) = &wishes.out
    {
        push("--out", out.into());
    }
    if matches!(process, Process::Solver | Process::Preprocessor)
        && let Some(keep) = &wishes.keep
    {
        push("--keep", keep.into());
    }
    if process == Process::Monitor
        && let Some(address) = wishes.web
    {
        push("--web", address.to_string().into());
        if let Some(token) = &wishes.web_token {
            push("--web-token", token.into());
        }
    }
    if process == Process::Monitor
        && let Some(address) = wishes.foxglove
    {
        push("--foxglove", address.to_string().into());
    }
    if EMULATORS.contains(&process) {
        match &wishes.source.log {
            Some(log) => push("--log", log.into()),
            None => {
                push("--scenario", wishes.source.scenario.clone().into());
                push("--seed", wishes.source.seed.to_string().into());
                push("--preset", wishes.source.preset_name().into());
            }
        }
        wishes.source.faults.iter().for_each(|fault| push("--fault", fault.to_string().into()));
        if let Some(seed) = wishes.source.fault_seed {
            push("--fault-seed", seed.to_string().into());
        }
        if let Some(duration) = wishes.duration {
            push("--duration", duration.to_string().into());
        }
    }
    arguments
}

/// What every process of the run is told: the set, the whole effective configuration as a file in the directory of the run,
/// the process file, and the start.
pub fn common_arguments(
    prefix: &Prefix,
    config: &Config,
    processes: Option<&Path>,
    clock: &StartClock,
    (log_level, log_format): (&str, LogFormat),
) -> std::io::Result<Vec<OsString>> {
    let directory = prefix.run_directory();
    fs::create_dir_all(&directory)?;
    let file = directory.join("effective.toml");
    fs::write(&file, config.to_toml())?;
    legacy::leave(&directory, clock)?;
    let mut arguments: Vec<OsString> = vec![
        "--prefix".into(),
        prefix.name().into(),
        "--config".into(),
        file.into(),
        "--start".into(),
        clock.to_string().into(),
        "--supervisor".into(),
        std::process::id().to_string().into(),
        "--log-level".into(),
        log_level.into(),
        "--log-format".into(),
        log_format.name().into(),
    ];
    if let Some(file) = processes {
        arguments.extend(["--processes".into(), file.into()]);
    }
    Ok(arguments)
}
