//! Estimates written by a thread of their own: text is a fifth of a replay's work, and the navigator need not wait for it.

use std::path::Path;
use std::thread::{self, JoinHandle};

use crossbeam::channel::{Receiver, Sender, bounded};
use ilns_recording::{EstimateWriter, LogError};
use shared_types::NavEstimate;

/// Estimates handed over at once.
const BATCH: usize = 256;
/// Batches under way; the navigator waits for the disk when all are full.
const BATCHES: usize = 4;

type Batch = Vec<NavEstimate>;

/// Both estimate files, under construction in the background.
#[derive(Debug)]
pub struct BackgroundWriter {
    batch: Batch,
    full: Option<Sender<Batch>>,
    empty: Receiver<Batch>,
    thread: Option<JoinHandle<Result<EstimateWriter, LogError>>>,
}

impl BackgroundWriter {
    /// Begins the files in `out`, as [`EstimateWriter::create`] does.
    ///
    /// # Errors
    /// Those of [`EstimateWriter::create`].
    pub fn create(out: &Path) -> Result<BackgroundWriter, LogError> {
        let mut writer = EstimateWriter::create(out)?;
        let (full, to_write) = bounded::<Batch>(BATCHES);
        let (written, empty) = bounded::<Batch>(BATCHES);
        for _ in 0..BATCHES {
            written.send(Batch::with_capacity(BATCH)).expect("there is room for every batch, and a receiver");
        }
        let thread = thread::spawn(move || {
            for mut batch in to_write {
                batch.iter().try_for_each(|estimate| writer.write(estimate))?;
                batch.clear();
                // Nobody waits for empty batches after the last full one.
                let _ = written.send(batch);
            }
            Ok(writer)
        });
        Ok(BackgroundWriter { batch: Batch::with_capacity(BATCH), full: Some(full), empty, thread: Some(thread) })
    }

    /// Appends an estimate.
    ///
    /// # Errors
    /// Those of [`EstimateWriter::write`], of this estimate or one before it.
    pub fn write(&mut self, estimate: &NavEstimate) -> Result<(), LogError> {
        self.batch.push(*estimate);
        if self.batch.len() < BATCH { Ok(()) } else { self.hand_over() }
    }

    fn hand_over(&mut self) -> Result<(), LogError> {
        if let Ok(empty) = self.empty.recv() {
            let full = core::mem::replace(&mut self.batch, empty);
            if self.full.as_ref().is_some_and(|to_write| to_write.send(full).is_ok()) {
                return Ok(());
            }
        }
        // The thread has ended early, and knows why.
        self.join().map(drop)
    }

    /// The writer, when its thread has ended; `None` if it was taken before.
    fn join(&mut self) -> Result<Option<EstimateWriter>, LogError> {
        self.full = None;
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(written)) => written.map(Some),
            Some(Err(panic)) => std::panic::resume_unwind(panic),
            None => Ok(None),
        }
    }

    /// Writes what is left and completes both files.
    ///
    /// # Errors
    /// Those of [`EstimateWriter::write`], for any estimate so far, and of [`EstimateWriter::finish`].
    pub fn finish(mut self) -> Result<(), LogError> {
        self.hand_over()?;
        self.join()?.map_or(Ok(()), EstimateWriter::finish)
    }
}
