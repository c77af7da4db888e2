//! Keeps the newest solution on disk, off the solving thread, for the solver that comes after one that died.

use std::path::{Path, PathBuf};
use std::thread;

use crossbeam::channel::{Receiver, Sender, bounded};
use ilns_recording::{CheckpointTerms, LogError, configuration_hash, read_checkpoint, write_checkpoint};
use ilns_runtime::monotonic_now;
use shared_types::{Config, Solution};
use tracing::warn;

/// Oldest solution that is taken up, ns: the history of `nav/measurements` holds what came since for about so long.
const MAX_AGE: i64 = 10_000_000_000;

/// Hands solutions to the thread that writes.
pub(crate) struct Keeper {
    to_writer: Sender<Solution>,
}

/// The file in a run's folder.
pub(crate) fn file_in(folder: &Path) -> PathBuf {
    folder.join("solution")
}

/// What the solver before this one left, if it is whole, of this configuration, and young enough.
pub(crate) fn last_solution(folder: &Path, config: &Config) -> Result<Option<Solution>, LogError> {
    let configuration = configuration_hash(&config.to_toml());
    read_checkpoint(&file_in(folder), &CheckpointTerms { configuration, mono: monotonic_now(), max_age: MAX_AGE })
}

impl Keeper {
    /// Starts the thread; it ends with this value.
    pub(crate) fn start(folder: &Path, config: &Config) -> Keeper {
        // One waits while one is written: an older one is worth nothing, and the solver never waits for a disk.
        let (to_writer, solutions) = bounded(1);
        let file = file_in(folder);
        let configuration = configuration_hash(&config.to_toml());
        thread::spawn(move || write_all(&file, &solutions, configuration));
        Keeper { to_writer }
    }

    /// Keeps this solution, unless the writer is still busy with two others.
    pub(crate) fn keep(&self, solution: &Solution) {
        let mut kept = *solution;
        kept.header.t_published = monotonic_now();
        let _busy = self.to_writer.try_send(kept);
    }
}

fn write_all(file: &Path, solutions: &Receiver<Solution>, configuration: u64) {
    let mut failed = false;
    // Where no `ilns run` has made it; if it cannot be made, the first write says so.
    let _ = file.parent().map(std::fs::create_dir_all);
    for solution in solutions {
        match write_checkpoint(file, &solution, configuration) {
            Ok(()) => failed = false,
            Err(error) if !failed => {
                warn!(%error, "the last solution cannot be kept: a restarted solver would initialise anew");
                failed = true;
            }
            Err(_) => {}
        }
    }
}
