//! Keeps the newest solution on disk, off the solving thread, for the solver that comes after one that died.

use std::path::{Path, PathBuf};
use std::thread;

use crossbeam::channel::{Receiver, Sender, bounded};
use ilns_recording::{LogError, read_checkpoint, write_checkpoint};
use shared_types::Solution;
use tracing::warn;

/// Hands solutions to the thread that writes.
pub(crate) struct Keeper {
    to_writer: Sender<Solution>,
}

/// The file in a run's folder.
pub(crate) fn file_in(folder: &Path) -> PathBuf {
    folder.join("solution")
}

/// What the solver before this one left.
pub(crate) fn last_solution(folder: &Path) -> Result<Option<Solution>, LogError> {
    read_checkpoint(&file_in(folder))
}

impl Keeper {
    /// Starts the thread; it ends with this value.
    pub(crate) fn start(folder: &Path) -> Keeper {
        // One waits while one is written: an older one is worth nothing, and the solver never waits for a disk.
        let (to_writer, solutions) = bounded(1);
        let file = file_in(folder);
        thread::spawn(move || write_all(&file, &solutions));
        Keeper { to_writer }
    }

    /// Keeps this solution, unless the writer is still busy with two others.
    pub(crate) fn keep(&self, solution: &Solution) {
        let _busy = self.to_writer.try_send(*solution);
    }
}

fn write_all(file: &Path, solutions: &Receiver<Solution>) {
    let mut failed = false;
    for solution in solutions {
        match write_checkpoint(file, &solution) {
            Ok(()) => failed = false,
            Err(error) if !failed => {
                warn!(%error, "the last solution cannot be kept: a restarted solver would initialise anew");
                failed = true;
            }
            Err(_) => {}
        }
    }
}
