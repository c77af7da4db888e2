//! The table of processes: what each is for, what it is told, and who runs it.
//!
//! A process is added here with one row, and is then a subcommand and, if [`crate::plan`] names it, a part of the set.

use clap::error::ErrorKind;
use clap::{ArgMatches, Args, Command, Error, FromArgMatches, Subcommand};
use shared_types::Process;
use sim_emulators::process::EmulatorArgs;

use crate::Outcome;

/// A process that this executable can be.
pub struct Row {
    /// Which.
    pub process: Process,
    about: &'static str,
    arguments: fn(Command) -> Command,
    run: fn(Process, &ArgMatches) -> Outcome,
}

/// A process whose crate has `Args` and `run`.
macro_rules! service {
    ($process:expr, $about:literal, $service:ident) => {
        Row {
            process: $process,
            about: $about,
            arguments: $service::Args::augment_args,
            run: |_, matches| Ok($service::run(&$service::Args::from_arg_matches(matches)?)?),
        }
    };
}

/// Every process that this executable can be.
pub static PROCESSES: &[Row] = &[
    emulator(Process::EmulatorImu, "Send inertial samples, from a simulated mission or a recorded log."),
    emulator(Process::EmulatorLbl, "Send acoustic ranges, from a simulated mission or a recorded log."),
    emulator(Process::EmulatorGnss, "Send satellite fixes, from a simulated mission or a recorded log."),
    emulator(Process::EmulatorDvl, "Send Doppler velocities, from a simulated mission or a recorded log."),
    emulator(Process::EmulatorMcp, "Send compass headings, from a simulated mission or a recorded log."),
    emulator(Process::EmulatorPs, "Send depths, from a simulated mission or a recorded log."),
    emulator(Process::EmulatorBuoys, "Send buoy positions, from a simulated mission or a recorded log."),
    emulator(Process::EmulatorTruth, "Send where the vehicle really is, for scoring only."),
    service!(Process::Preprocessor, "Gate raw readings and anchor them to keyframes.", ilns_preprocessor),
    service!(Process::Solver, "Solve the sliding window at every keyframe.", ilns_solver),
    service!(Process::Propagator, "Publish an estimate for every inertial sample.", ilns_propagator),
    service!(Process::Recorder, "Write readings and estimates into a folder.", ilns_recorder),
    service!(Process::Monitor, "Show where the vehicle is and how the machine keeps up.", ilns_monitor),
];

const fn emulator(process: Process, about: &'static str) -> Row {
    Row {
        process,
        about,
        arguments: EmulatorArgs::augment_args,
        run: |process, matches| Ok(sim_emulators::process::run(process, &EmulatorArgs::from_arg_matches(matches)?)?),
    }
}

/// Whether this executable can be that process.
pub fn can_run(process: Process) -> bool {
    PROCESSES.iter().any(|row| row.process == process)
}

/// One process of the set, as the supervisor starts it.
pub struct ProcessCommand {
    row: &'static Row,
    matches: ArgMatches,
}

/// `emulator imu` is `emulator-imu`.
const EMULATOR: &str = "emulator";

impl ProcessCommand {
    /// Its name.
    pub fn name(&self) -> &'static str {
        self.row.process.name()
    }

    /// Is that process until it is told to stop.
    pub fn run(&self) -> Outcome {
        (self.row.run)(self.row.process, &self.matches)
    }

    fn find(name: &str) -> Option<&'static Row> {
        PROCESSES.iter().find(|row| row.process.name() == name)
    }
}

impl FromArgMatches for ProcessCommand {
    fn from_arg_matches(matches: &ArgMatches) -> Result<ProcessCommand, Error> {
        let named = match matches.subcommand() {
            Some((EMULATOR, inner)) => {
                inner.subcommand().map(|(sensor, matches)| (format!("{EMULATOR}-{sensor}"), matches))
            }
            other => other.map(|(name, matches)| (name.to_owned(), matches)),
        };
        named
            .and_then(|(name, matches)| Some((ProcessCommand::find(&name)?, matches)))
            .map(|(row, matches)| ProcessCommand { row, matches: matches.clone() })
            .ok_or_else(|| Error::new(ErrorKind::InvalidSubcommand))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        *self = ProcessCommand::from_arg_matches(matches)?;
        Ok(())
    }
}

impl Subcommand for ProcessCommand {
    fn augment_subcommands(command: Command) -> Command {
        // The arguments' own type has a description, too, which is not for users: the row's comes last.
        let subcommand =
            |name: &'static str, row: &Row| (row.arguments)(Command::new(name)).about(row.about).long_about(None);
        let mut emulators = Command::new(EMULATOR)
            .about("Be the driver of one sensor: `emulator imu` is `emulator-imu`.")
            .subcommand_required(true)
            .hide(true);
        let mut command = command;
        for row in PROCESSES {
            let name = row.process.name();
            if let Some(sensor) = name.strip_prefix("emulator-") {
                emulators = emulators.subcommand(subcommand(sensor, row));
            }
            command = command.subcommand(subcommand(name, row));
        }
        command.subcommand(emulators)
    }

    fn augment_subcommands_for_update(command: Command) -> Command {
        ProcessCommand::augment_subcommands(command)
    }

    fn has_subcommand(name: &str) -> bool {
        name == EMULATOR || ProcessCommand::find(name).is_some()
    }
}
