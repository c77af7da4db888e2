//! The log directory with its estimates: a thread of its own behind a bounded queue.
//!
//! The loop that empties shared memory never waits for the disk. What the full queue does not take, and what comes while the disk
//! refuses (it is full, over a quota, read-only), is counted and said; once the disk takes again, the same files go on behind
//! their last whole row.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

use ilns_recording::{EstimateWriter, LogError, LogWriter, LogWriterOptions};
use ilns_runtime::{monotonic_now, one_line};
use shared_types::{NavEstimate, RawReading, Truth};
use tracing::{error, warn};

use crate::drops_told::DropsTold;
use crate::estimate_log::{EstimateLog, Written};
use crate::live_score::LiveScore;

/// Rows that wait: half a minute of everything at 200 Hz, seven seconds at 1 kHz; 2 MB.
const QUEUE: usize = 16_384;

/// Between two flushes, ns: what a crash of this process may cost. A disk that refuses is asked again as often.
const FLUSH: i64 = 1_000_000_000;

/// A row on its way.
#[derive(Debug)]
pub(crate) enum Row {
    Reading(RawReading),
    Truth(Box<Truth>),
    Estimate(Box<NavEstimate>),
    Lagged(Box<NavEstimate>),
    /// Of the ENU frame: latitude, longitude in degrees, height in m. No row of a file, but the score wants it.
    Origin([f64; 3]),
}

/// Where the log directory is, and what stands in its `sensors.toml`.
#[derive(Clone, Debug)]
pub(crate) struct Place {
    pub(crate) folder: PathBuf,
    pub(crate) replace: bool,
    pub(crate) config: String,
}

/// What a whole record was.
#[derive(Debug)]
pub(crate) struct Ended {
    pub(crate) written: Written,
    pub(crate) score: Option<serde_json::Value>,
}

/// Where rows for the log directory go.
#[derive(Debug)]
pub(crate) struct DirectoryLog {
    queue: SyncSender<Row>,
    thread: JoinHandle<Result<Ended, LogError>>,
    counts: Arc<Counts>,
    overflow: DropsTold,
}

/// Shared by both sides.
#[derive(Debug, Default)]
struct Counts {
    /// The queue was full.
    overflowed: AtomicU64,
    /// The disk refused.
    refused: AtomicU64,
    /// Time of the newest flush, ns; 0 once it was taken.
    flush_ns: AtomicI64,
}

impl DirectoryLog {
    /// Begins the log directory. One that the disk has no room for is begun later.
    pub(crate) fn create(mut place: Place) -> Result<DirectoryLog, LogError> {
        let counts = Arc::new(Counts::default());
        let (files, refusal) = match place.open() {
            Ok(files) => (Some(files), None),
            Err(reason) if reason.is_refusal() => (None, Some(Refusal::begin(reason, 0))),
            Err(reason) => return Err(reason),
        };
        let (queue, rows) = sync_channel(QUEUE);
        let folder = place.folder.clone();
        let directory =
            Directory { place, files, refusal, live_score: LiveScore::default(), counts: Arc::clone(&counts) };
        let spawned =
            std::thread::Builder::new().name("log directory".to_owned()).spawn(move || directory.write(&rows));
        let thread = spawned.map_err(|source| LogError::Io {
            file: folder,
            action: "start the thread that writes the log directory",
            source,
        })?;
        Ok(DirectoryLog { queue, thread, counts, overflow: DropsTold::default() })
    }

    /// Takes a row, or counts it.
    pub(crate) fn take(&self, row: Row) {
        if let Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) = self.queue.try_send(row) {
            self.counts.overflowed.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Rows that came here and are not in the files.
    pub(crate) fn dropped(&self) -> u64 {
        self.counts.overflowed.load(Ordering::Relaxed) + self.counts.refused.load(Ordering::Relaxed)
    }

    /// Says now and then what the queue has not taken.
    pub(crate) fn say_drops(&mut self, mono: i64) {
        if let Some(dropped) = self.overflow.news(self.counts.overflowed.load(Ordering::Relaxed), mono) {
            warn!(dropped, "the disk is too slow for the record: rows are not in the log directory");
        }
    }

    /// Time of the newest flush, ns, once.
    pub(crate) fn flush_ns(&self) -> Option<i64> {
        Some(self.counts.flush_ns.swap(0, Ordering::Relaxed)).filter(|&ns| ns > 0)
    }

    /// Waits until everything taken is written and the files are whole; how many rows are not in them.
    pub(crate) fn finish(mut self) -> Result<(Ended, u64), LogError> {
        self.say_drops(i64::MAX);
        drop(self.queue);
        let ended = self.thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
        let Counts { overflowed, refused, .. } = &*self.counts;
        Ok((ended, overflowed.load(Ordering::Relaxed) + refused.load(Ordering::Relaxed)))
    }
}

impl Place {
    fn open(&mut self) -> Result<Files, LogError> {
        let options = LogWriterOptions { arrival_columns: true, replace: self.replace };
        let mut log = LogWriter::create(&self.folder, options)?;
        // What lies there from now on is this record's own, and another try may replace it.
        self.replace = true;
        log.sensors_toml(&self.config)?;
        Ok(Files { log, estimates: EstimateLog::create(&self.folder)?, lagged: None })
    }
}

/// The files of one record.
struct Files {
    log: LogWriter,
    estimates: EstimateLog,
    /// Begun with the first of them.
    lagged: Option<EstimateWriter>,
}

impl Files {
    fn row(&mut self, row: &Row, live_score: &mut LiveScore) -> Result<(), LogError> {
        match row {
            Row::Reading(reading) => self.log.reading(reading),
            Row::Truth(truth) => self.log.truth(truth),
            Row::Estimate(estimate) => self.estimates.take(estimate, &mut |written| live_score.estimate(written)),
            Row::Lagged(estimate) => match &mut self.lagged {
                Some(writer) => writer.write(estimate),
                none => none.insert(EstimateWriter::create_lagged(self.log.path())?).write(estimate),
            },
            Row::Origin(_) => Ok(()),
        }
    }

    fn flush(&mut self) -> Result<(), LogError> {
        self.log.flush()?;
        self.estimates.flush()?;
        self.lagged.as_mut().map_or(Ok(()), EstimateWriter::flush)
    }

    fn finish(self) -> Result<Written, LogError> {
        self.log.finish()?;
        self.lagged.map_or(Ok(()), EstimateWriter::finish)?;
        self.estimates.finish()
    }
}

/// Since when and why nothing is written.
struct Refusal {
    reason: LogError,
    mono: i64,
    /// Rows that were refused before.
    refused_before: u64,
}

impl Refusal {
    fn begin(reason: LogError, refused_before: u64) -> Refusal {
        error!(error = one_line(&reason), "the disk takes no more of the record: rows are dropped until it does");
        Refusal { reason, mono: monotonic_now(), refused_before }
    }
}

/// The log directory, seen from the thread that writes it.
struct Directory {
    place: Place,
    /// `None` until the disk has taken them.
    files: Option<Files>,
    refusal: Option<Refusal>,
    live_score: LiveScore,
    counts: Arc<Counts>,
}

impl Directory {
    fn write(mut self, rows: &Receiver<Row>) -> Result<Ended, LogError> {
        let mut next_flush = monotonic_now() + FLUSH;
        loop {
            let patience = Duration::from_nanos((next_flush - monotonic_now()).max(0) as u64);
            match rows.recv_timeout(patience) {
                Ok(row) => self.row(&row),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return self.finish(),
            }
            if monotonic_now() >= next_flush {
                next_flush = monotonic_now() + FLUSH;
                self.flush();
            }
        }
    }

    fn row(&mut self, row: &Row) {
        match row {
            Row::Origin(origin) => return self.live_score.origin(*origin),
            Row::Truth(truth) => self.live_score.truth(truth),
            _ => {}
        }
        let written = match (&mut self.files, &self.refusal) {
            (Some(files), None) => files.row(row, &mut self.live_score),
            _ => {
                self.counts.refused.fetch_add(1, Ordering::Relaxed);
                return;
            }
        };
        if let Err(reason) = written {
            // It may still get into its file; rather one too many is counted than one too few.
            let refused_before = self.counts.refused.fetch_add(1, Ordering::Relaxed);
            // A number that is none says nothing about the disk.
            if matches!(reason, LogError::Io { .. }) {
                self.refusal = Some(Refusal::begin(reason, refused_before));
            }
        }
    }

    fn flush(&mut self) {
        let mono = monotonic_now();
        let flushed = match &mut self.files {
            Some(files) => files.flush(),
            None => self.place.open().map(|files| self.files = Some(files)),
        };
        self.counts.flush_ns.store((monotonic_now() - mono).max(1), Ordering::Relaxed);
        let refused = self.counts.refused.load(Ordering::Relaxed);
        self.refusal = match (flushed, self.refusal.take()) {
            (Ok(()), Some(before)) => {
                let dropped = refused - before.refused_before;
                let for_s = (monotonic_now() - before.mono) as f64 * 1e-9;
                warn!(dropped, for_s, "the disk takes the record again; the rows of the time between are missing");
                None
            }
            (Ok(()), None) => None,
            (Err(reason), None) => Some(Refusal::begin(reason, refused)),
            (Err(reason), Some(before)) => Some(Refusal { reason, ..before }),
        };
    }

    fn finish(mut self) -> Result<Ended, LogError> {
        if let Some(refusal) = self.refusal.as_ref().filter(|_| self.files.is_none()) {
            warn!(for_s = (monotonic_now() - refusal.mono) as f64 * 1e-9, "the disk has taken nothing of this record");
            self.flush();
        }
        match (self.files, self.refusal) {
            (Some(files), _) => Ok(Ended { written: files.finish()?, score: self.live_score.finish() }),
            (None, Some(Refusal { reason, .. })) => Err(reason),
            (None, None) => unreachable!("files that could not be begun were refused"),
        }
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test may fail where it stands")]
    use super::*;
    use shared_types::{Header, ImuSample, Time};

    fn sample(step: i64) -> Row {
        let header = Header::at(Time(step * 5_000_000));
        Row::Reading(RawReading::Imu(ImuSample { header, gyro_body: [0.1; 3], accel_body: [9.8; 3] }))
    }

    fn place(folder: PathBuf) -> Place {
        Place { folder, replace: false, config: "[fgo]\nwindow = 20\n".to_owned() }
    }

    #[test]
    fn what_a_full_queue_does_not_take_is_counted_and_nobody_waits() {
        let (queue, rows) = sync_channel(2);
        let thread = std::thread::spawn(|| Err(LogError::NoForeignRows { file: PathBuf::new() }));
        let log = DirectoryLog { queue, thread, counts: Arc::default(), overflow: DropsTold::default() };
        (0..5).for_each(|step| log.take(sample(step)));
        assert_eq!((log.dropped(), rows.try_iter().count()), (3, 2));
    }

    #[test]
    fn a_folder_that_the_disk_does_not_take_is_begun_once_it_does() {
        let folder = tempfile::tempdir().unwrap();
        let place = place(folder.path().join("out"));
        let source = std::io::ErrorKind::StorageFull.into();
        let reason = LogError::Io { file: place.folder.clone(), action: "create the directory", source };
        let counts: Arc<Counts> = Arc::default();
        let refusal = Some(Refusal::begin(reason, 0));
        let live_score = LiveScore::default();
        let mut directory = Directory { place, files: None, refusal, live_score, counts: Arc::clone(&counts) };
        (0..7).for_each(|step| directory.row(&sample(step)));
        directory.flush();
        (7..10).for_each(|step| directory.row(&sample(step)));
        directory.finish().unwrap();
        assert_eq!(counts.refused.load(Ordering::Relaxed), 7);
        let written = std::fs::read_to_string(folder.path().join("out/imu.csv")).unwrap();
        assert_eq!(written.lines().count(), 1 + 3, "{written}");
    }

    #[test]
    fn a_folder_that_is_none_is_refused_at_once() {
        let reason = DirectoryLog::create(place(PathBuf::from("/proc/no-folder"))).unwrap_err();
        assert!(!reason.is_refusal() && reason.to_string().contains("/proc/no-folder"), "{reason}");
    }
}
