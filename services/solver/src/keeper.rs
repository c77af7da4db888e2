//! Keeps the newest solution on disk, off the solving thread: in the folder of the run for the solver that comes after one that
//! died, and, where asked for, in a folder that outlives the machine's restart.

use std::path::{Path, PathBuf};
use std::thread;

use crossbeam::channel::{Receiver, Sender, bounded};
use ilns_bus::Prefix;
use ilns_recording::{
    Checkpoint, CheckpointTerms, Durability, Kept, LogError, configuration_hash, kept_file, write_checkpoint,
};
use ilns_runtime::{clocks_now, monotonic_now};
use shared_types::{Config, Solution};
use tracing::warn;

/// Oldest solution of this start of the machine that is taken up, ns: the history of `nav/measurements` holds what came since for about
/// so long.
const MAX_AGE: i64 = 10_000_000_000;

/// Between two solutions that are to outlive a loss of power, ns: a disk that is made to write keyframe by keyframe wears out, and a
/// second is little beside the time that a machine takes to start.
const BETWEEN_KEPT: i64 = 1_000_000_000;

/// Where solutions go.
#[derive(Clone, Debug)]
pub(crate) struct Places {
    of_run: PathBuf,
    /// That outlives the machine's restart.
    of_machine: Option<PathBuf>,
}

impl Places {
    /// In the folder of the run, and in `keep` for what is to outlive it.
    pub(crate) fn new(prefix: &Prefix, keep: Option<&Path>) -> Places {
        Places {
            of_run: prefix.run_directory().join("solution"),
            of_machine: keep.map(|folder| kept_file(folder, prefix.name())),
        }
    }

    /// What the solver before this one left, if it is whole, of this configuration, and young enough.
    pub(crate) fn last_solution(&self, config: &Config) -> Result<Option<Solution>, LogError> {
        let configuration = configuration_hash(&config.to_toml());
        CheckpointTerms { configuration, now: clocks_now(), max_age: MAX_AGE }.last_of_this_boot(&self.of_run)
    }

    /// What was kept before the machine was started anew, on the same terms but for its age.
    pub(crate) fn kept_solution(&self, config: &Config) -> Result<Option<Kept>, LogError> {
        let Some(file) = &self.of_machine else { return Ok(None) };
        CheckpointTerms::after_a_restart(configuration_hash(&config.to_toml()), clocks_now()).last_of_another_boot(file)
    }
}

/// Hands solutions to the threads that write.
pub(crate) struct Keeper {
    configuration: u64,
    of_run: Sender<Checkpoint>,
    of_machine: Option<Sender<Checkpoint>>,
    next_of_machine: i64,
}

impl Keeper {
    /// Starts the threads; they end with this value.
    pub(crate) fn start(places: &Places, config: &Config) -> Keeper {
        Keeper {
            configuration: configuration_hash(&config.to_toml()),
            of_run: start_writer(&places.of_run, Durability::Process),
            // A thread of its own: a disk that takes its time holds up none but itself.
            of_machine: places.of_machine.as_deref().map(|file| start_writer(file, Durability::Power)),
            next_of_machine: i64::MIN,
        }
    }

    /// What follows was found with another configuration.
    pub(crate) fn go_on_under(&mut self, config: &Config) {
        self.configuration = configuration_hash(&config.to_toml());
    }

    /// Keeps this solution, unless a writer is still busy with two others.
    pub(crate) fn keep(&mut self, solution: &Solution) {
        let checkpoint = Checkpoint { configuration: self.configuration, written: clocks_now(), solution: *solution };
        let _busy = self.of_run.try_send(checkpoint);
        if let Some(to_writer) = &self.of_machine
            && monotonic_now() >= self.next_of_machine
            // A machine that does not tell its starts apart could not tell this one from the next.
            && checkpoint.written.boot != 0
            && to_writer.try_send(checkpoint).is_ok()
        {
            self.next_of_machine = monotonic_now() + BETWEEN_KEPT;
        }
    }
}

fn start_writer(file: &Path, durability: Durability) -> Sender<Checkpoint> {
    // One waits while one is written: an older one is worth nothing, and the solver never waits for a disk.
    let (to_writer, checkpoints) = bounded(1);
    let file = file.to_owned();
    thread::spawn(move || write_all(&file, &checkpoints, durability));
    to_writer
}

fn write_all(file: &Path, checkpoints: &Receiver<Checkpoint>, durability: Durability) {
    let after = match durability {
        Durability::Process => "a restarted solver",
        Durability::Power => "a restarted machine",
    };
    let mut failed = false;
    // Where nobody has made it; if it cannot be made, the first write says so.
    let _ = file.parent().map(std::fs::create_dir_all);
    for checkpoint in checkpoints {
        match write_checkpoint(file, &checkpoint, durability) {
            Ok(()) => failed = false,
            Err(error) if !failed => {
                warn!(%error, "the last solution cannot be kept: {after} would initialise anew");
                failed = true;
            }
            Err(_) => {}
        }
    }
}
