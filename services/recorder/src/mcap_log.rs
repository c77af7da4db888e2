//! The MCAP beside the log directory: a thread of its own behind a bounded queue.
//!
//! The loop that empties shared memory never waits for it. What the full queue does not take is counted and said, in the log
//! and in the recording itself; the log directory has it all the same. A disk that refuses ends the MCAP, not the record.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

use ilns_recording::LogError;
use ilns_recording::mcap::{EstimateThinning, McapWriter, RecorderStatus};
use ilns_runtime::monotonic_now;
use shared_types::{Heartbeat, KeyframeReport, NavEstimate, RawReading, Time, Truth};
use tracing::{error, info, warn};

use crate::drops_told::DropsTold;

/// Messages that wait: twenty seconds of everything at full rate, some 2 MB.
const QUEUE: usize = 8192;
/// Between two flushes, ns: half of what a crash may cost, so that a late one costs no more.
const FLUSH: i64 = 500_000_000;

/// What is written, and how much of it.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct McapArgs {
    /// Write the log directory only.
    #[arg(long)]
    pub no_mcap: bool,
    /// A further MCAP is begun beyond this many megabytes.
    #[arg(long, value_name = "MB", default_value_t = 1024, value_parser = clap::value_parser!(u64).range(1..))]
    pub mcap_size: u64,
    /// A further MCAP is begun after this many minutes of data time.
    #[arg(long, value_name = "MINUTES", default_value_t = 60, value_parser = clap::value_parser!(u64).range(1..))]
    pub mcap_minutes: u64,
    /// Megabytes that the MCAP leaves free on the disk, for the log directory: below, it is finished early.
    #[arg(long, value_name = "MB", default_value_t = 512)]
    pub free_space: u64,
}

impl Default for McapArgs {
    fn default() -> McapArgs {
        McapArgs { no_mcap: false, mcap_size: 1024, mcap_minutes: 60, free_space: 512 }
    }
}

const MEGABYTE: u64 = 1_000_000;

/// A message on its way.
#[derive(Debug)]
pub(crate) enum Entry {
    Reading(RawReading),
    Truth(Box<Truth>),
    Estimate(Box<NavEstimate>),
    Origin([f64; 3]),
    Report(Box<KeyframeReport>),
    Health(Box<Heartbeat>),
}

/// Where messages for the MCAP go.
#[derive(Debug)]
pub(crate) struct McapLog {
    queue: Option<SyncSender<Entry>>,
    thread: Option<JoinHandle<()>>,
    counts: Arc<Counts>,
    drops: DropsTold,
    has_origin: bool,
    thinning: EstimateThinning,
}

/// Shared by both sides.
#[derive(Debug, Default)]
struct Counts {
    /// Not taken by the queue, or by a file that has ended.
    dropped: AtomicU64,
    /// Did not reach this process.
    lost: AtomicU64,
    /// The MCAP has ended before the run, which was said.
    ended: AtomicBool,
}

impl Counts {
    fn status(&self) -> RecorderStatus {
        let (dropped, lost) = (self.dropped.load(Ordering::Relaxed), self.lost.load(Ordering::Relaxed));
        RecorderStatus { dropped, lost }
    }
}

impl McapLog {
    /// Begins `recording.mcap` in `folder`; those of an earlier record are deleted if it is to be replaced.
    pub(crate) fn create(folder: &Path, args: McapArgs, replace: bool, config: String) -> Result<McapLog, LogError> {
        let counts = Arc::new(Counts::default());
        if args.no_mcap {
            return Ok(McapLog::new(None, None, counts));
        }
        if replace {
            delete_earlier(folder)?;
        }
        let writer = match McapWriter::create(file(folder, 0), &config) {
            Err(reason) if reason.is_refusal() => {
                error!(error = ilns_runtime::one_line(&reason), "no MCAP is written");
                return Ok(McapLog::new(None, None, counts));
            }
            other => other?,
        };
        let (queue, entries) = sync_channel(QUEUE);
        let files =
            Files { folder: folder.to_owned(), args, config, writer: Some(writer), number: 0, begun: None, counts };
        let counts = Arc::clone(&files.counts);
        let spawned = std::thread::Builder::new().name("mcap".to_owned()).spawn(move || files.write(&entries));
        let thread = spawned.map_err(|source| LogError::Io {
            file: folder.to_owned(),
            action: "start the thread that writes the MCAP",
            source,
        })?;
        Ok(McapLog::new(Some(queue), Some(thread), counts))
    }

    fn new(queue: Option<SyncSender<Entry>>, thread: Option<JoinHandle<()>>, counts: Arc<Counts>) -> McapLog {
        let (drops, thinning) = (DropsTold::default(), EstimateThinning::default());
        McapLog { queue, thread, counts, drops, has_origin: false, thinning }
    }

    /// Takes the frame's origin, once.
    pub(crate) fn origin(&mut self, origin: [f64; 3]) {
        if !std::mem::replace(&mut self.has_origin, true) {
            self.take(|| Entry::Origin(origin));
        }
    }

    /// Takes an estimate where the file wants one: nine of ten would only wait to be passed over.
    pub(crate) fn estimate(&mut self, estimate: &NavEstimate) {
        if self.thinning.wants(estimate) {
            self.take(|| Entry::Estimate(Box::new(*estimate)));
        }
    }

    /// Takes a message, or counts it.
    pub(crate) fn take(&self, entry: impl FnOnce() -> Entry) {
        let Some(queue) = &self.queue else { return };
        if let Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) = queue.try_send(entry()) {
            self.counts.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Messages that did not reach this process, for the record; says now and then what the queue has not taken.
    pub(crate) fn say_drops(&mut self, lost: u64) {
        self.counts.lost.store(lost, Ordering::Relaxed);
        if !self.counts.ended.load(Ordering::Relaxed) {
            self.say(monotonic_now());
        }
    }

    fn say(&mut self, mono: i64) {
        if let Some(dropped) = self.drops.news(self.counts.status().dropped, mono) {
            warn!(dropped, "messages are not in the MCAP, only in the log directory");
        }
    }

    /// Waits until everything taken is written and the file is whole.
    pub(crate) fn finish(mut self, lost: u64) {
        self.counts.lost.store(lost, Ordering::Relaxed);
        self.queue = None;
        if self.thread.take().is_some_and(|thread| thread.join().is_err()) {
            error!("the thread that writes the MCAP has died (`ilns recording recover` makes the file whole)");
        }
        self.say(i64::MAX);
    }
}

/// `recording.mcap`, `recording-1.mcap`, ...
fn file(folder: &Path, number: u32) -> PathBuf {
    match number {
        0 => folder.join("recording.mcap"),
        number => folder.join(format!("recording-{number}.mcap")),
    }
}

fn delete_earlier(folder: &Path) -> Result<(), LogError> {
    for file in (0..).map(|number| file(folder, number)).take_while(|file| file.exists()) {
        std::fs::remove_file(&file).map_err(|source| LogError::Io { file, action: "delete", source })?;
    }
    Ok(())
}

/// The files, seen from the thread that writes them.
struct Files {
    folder: PathBuf,
    args: McapArgs,
    config: String,
    /// `None` once the MCAP has ended.
    writer: Option<McapWriter>,
    number: u32,
    /// Data time at which the present file begins.
    begun: Option<Time>,
    counts: Arc<Counts>,
}

impl Files {
    fn write(mut self, entries: &Receiver<Entry>) {
        let mut next_flush = monotonic_now() + FLUSH;
        loop {
            let patience = Duration::from_nanos((next_flush - monotonic_now()).max(0) as u64);
            let written = match entries.recv_timeout(patience) {
                Ok(entry) => self.entry(&entry),
                Err(RecvTimeoutError::Timeout) => Ok(()),
                Err(RecvTimeoutError::Disconnected) => break,
            };
            let flushed = if monotonic_now() >= next_flush {
                next_flush = monotonic_now() + FLUSH;
                self.flush()
            } else {
                Ok(())
            };
            self.end_on(written.and(flushed));
        }
        let ended = self.flush().and_then(|()| self.writer.take().map_or(Ok(()), McapWriter::finish));
        self.end_on(ended);
    }

    fn end_on(&mut self, result: Result<(), LogError>) {
        if let Err(reason) = result {
            let (error, file) = (ilns_runtime::one_line(&reason), file(&self.folder, self.number));
            error!(file = %file.display(), error, "the MCAP ends here; the log directory goes on");
            // Its own try to finish may fail as this did.
            self.writer = None;
            self.counts.ended.store(true, Ordering::Relaxed);
        }
    }

    fn entry(&mut self, entry: &Entry) -> Result<(), LogError> {
        let Some(writer) = &mut self.writer else {
            self.counts.dropped.fetch_add(1, Ordering::Relaxed);
            return Ok(());
        };
        match entry {
            Entry::Reading(reading) => writer.reading(reading),
            Entry::Truth(truth) => writer.truth(truth),
            Entry::Estimate(estimate) => writer.estimate(estimate),
            Entry::Origin(origin) => writer.origin(*origin),
            Entry::Report(report) => writer.report(report),
            Entry::Health(beat) => writer.heartbeat(beat),
        }
    }

    fn flush(&mut self) -> Result<(), LogError> {
        let Some(writer) = &mut self.writer else { return Ok(()) };
        writer.flush(self.counts.status())?;
        let t = writer.t_newest();
        let begun = *self.begun.get_or_insert(t);
        let minutes = (t - begun).as_seconds() / 60.0;
        if writer.bytes() >= self.args.mcap_size * MEGABYTE || minutes >= self.args.mcap_minutes as f64 {
            self.number += 1;
            self.begun = Some(t);
            writer.go_on_in(file(&self.folder, self.number), &self.config)?;
            info!(file = %file(&self.folder, self.number).display(), "the recording goes on in another MCAP");
        }
        if free_space(&self.folder).is_some_and(|free| free < self.args.free_space * MEGABYTE) {
            let limit_mb = self.args.free_space;
            warn!(limit_mb, "the disk is nearly full: the MCAP ends here, the log directory goes on");
            self.counts.ended.store(true, Ordering::Relaxed);
            return self.writer.take().map_or(Ok(()), McapWriter::finish);
        }
        Ok(())
    }
}

/// Bytes that this process may still write; `None` where the operating system does not say.
fn free_space(folder: &Path) -> Option<u64> {
    let found = rustix::fs::statvfs(folder).ok()?;
    Some(found.f_bavail.saturating_mul(found.f_frsize))
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test may fail where it stands")]
    use super::*;
    use ilns_recording::mcap::{export, inspect};
    use shared_types::{Header, ImuSample};

    fn sample(step: u64) -> Entry {
        let header = Header { sequence: step, ..Header::at(Time(step as i64 * 5_000_000)) };
        Entry::Reading(RawReading::Imu(ImuSample { header, gyro_body: [0.1; 3], accel_body: [9.8; 3] }))
    }

    fn files(folder: &Path, args: McapArgs) -> Files {
        let writer = Some(McapWriter::create(file(folder, 0), "").unwrap());
        let counts = Arc::new(Counts::default());
        Files { folder: folder.to_owned(), args, config: String::new(), writer, number: 0, begun: None, counts }
    }

    #[test]
    fn a_recording_goes_on_in_further_files_and_nothing_is_lost_between_them() {
        let folder = tempfile::tempdir().unwrap();
        let mut files = files(folder.path(), McapArgs { mcap_minutes: 1, free_space: 0, ..McapArgs::default() });
        // 150 s at 200 Hz, flushed each second.
        for step in 0..30_000 {
            files.entry(&sample(step)).unwrap();
            if step % 200 == 199 {
                files.flush().unwrap();
            }
        }
        files.writer.take().unwrap().finish().unwrap();
        let all: Vec<PathBuf> = (0..3).map(|number| file(folder.path(), number)).collect();
        assert!(!file(folder.path(), 3).exists());
        for file in &all {
            assert!(inspect(file).unwrap().ending.is_whole());
        }
        assert_eq!(export(&all, folder.path().join("log")).unwrap().rows["imu.csv"], 30_000);
    }

    #[test]
    fn a_file_that_is_large_enough_is_followed_by_another() {
        let folder = tempfile::tempdir().unwrap();
        let mut files = files(folder.path(), McapArgs { mcap_size: 0, free_space: 0, ..McapArgs::default() });
        files.entry(&sample(0)).unwrap();
        files.flush().unwrap();
        assert_eq!(files.number, 1);
        assert!(inspect(file(folder.path(), 0)).unwrap().ending.is_whole());
    }

    #[test]
    fn on_a_disk_that_is_nearly_full_the_file_is_finished_and_the_rest_is_counted() {
        let folder = tempfile::tempdir().unwrap();
        let args = McapArgs { free_space: u64::MAX / MEGABYTE, ..McapArgs::default() };
        let mut files = files(folder.path(), args);
        files.entry(&sample(0)).unwrap();
        files.flush().unwrap();
        files.entry(&sample(1)).unwrap();
        let found = inspect(file(folder.path(), 0)).unwrap();
        assert!(found.ending.is_whole());
        assert_eq!(files.counts.status().dropped, 1);
    }

    #[test]
    fn what_a_full_queue_does_not_take_is_counted_and_nobody_waits() {
        let (queue, entries) = sync_channel(2);
        let log = McapLog::new(Some(queue), None, Arc::default());
        for step in 0..5 {
            log.take(|| sample(step));
        }
        assert_eq!(log.counts.status().dropped, 3);
        assert_eq!(entries.try_iter().count(), 2);
    }
}
