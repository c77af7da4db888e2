//! The story of this process: fifty times a second, hand what has come to the threads that write it down.

use std::path::PathBuf;

use ilns_bus::{Bus, Prefix, Publisher};
use ilns_recording::Summary;
use ilns_runtime::{HeartbeatBuilder, ProcessArgs, Shutdown, monotonic_now};
use shared_types::{Heartbeat, Process, ProcessState, channel};
use tracing::{info, warn};

use crate::directory_log::{DirectoryLog, Ended, Place, Row};
use crate::error::RecorderError;
use crate::mcap_log::{Entry, McapArgs, McapLog};
use crate::ports::Inputs;
use crate::tally::Tally;

/// Between two looks at the queues, ns: the shortest queue holds 64 readings, and nobody is kept waiting.
const LOOK: i64 = 20_000_000;

/// What the recorder is told.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    #[expect(missing_docs, reason = "a doc comment here would become the help text of the whole group")]
    pub process: ProcessArgs,
    /// Folder for the recorded log and the estimates. A restarted recorder goes on in a folder of its own below it.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Replace a log that the folder already holds.
    #[arg(long)]
    pub replace: bool,
    #[command(flatten)]
    #[expect(missing_docs, reason = "a doc comment here would become the help text of the whole group")]
    pub mcap: McapArgs,
}

impl Args {
    /// What a recorder that died had written is not touched by the next.
    fn folder(&self) -> PathBuf {
        match self.process.epoch {
            0 => self.out.clone(),
            epoch => self.out.join(format!("restart-{epoch}")),
        }
    }
}

/// Runs the recorder until SIGTERM or SIGINT.
///
/// # Errors
/// [`RecorderError`] when it cannot begin, or when the disk still refuses at the end.
pub fn run(args: &Args) -> Result<(), RecorderError> {
    run_until(args, &args.process.begin()?)
}

/// Runs the recorder until `shutdown` is requested.
///
/// # Errors
/// As [`run`].
pub fn run_until(args: &Args, shutdown: &Shutdown) -> Result<(), RecorderError> {
    let mono_start = monotonic_now();
    args.process.real_time(Process::Recorder)?.enter();
    let config = args.process.load_config()?;
    let bus = Bus::join(&Prefix::new(&args.process.prefix)?, Process::Recorder, args.process.epoch)?;
    let mut health = bus.publisher(&channel::HEALTH)?;
    let mut record = Record {
        inputs: Inputs::open(&bus)?,
        directory: DirectoryLog::create(Place {
            folder: args.folder(),
            replace: args.replace,
            config: config.to_toml(),
        })?,
        mcap: McapLog::create(&args.folder(), args.mcap, args.replace, config.to_toml())?,
        folder: args.folder(),
        tally: Tally::new(&config),
        origin: None,
        lost_told: 0,
        heartbeat: HeartbeatBuilder::new(Process::Recorder, args.process.epoch),
        mono_start,
    };
    record.heartbeat.state = ProcessState::Running;

    while shutdown.sleep_until(monotonic_now() + LOOK) {
        record.write_down();
        if monotonic_now() >= record.heartbeat.next_beat() && bus.check_owner().is_err() {
            break;
        }
        record.beat(&mut health);
    }
    // What was sent before the end belongs to the record.
    record.write_down();
    record.finish(&mut health)?;
    // Whatever the reason for the end, the record is whole.
    Ok(bus.check_owner()?)
}

/// A record in the making.
struct Record {
    inputs: Inputs,
    directory: DirectoryLog,
    mcap: McapLog,
    folder: PathBuf,
    tally: Tally,
    /// Of the ENU frame: latitude, longitude in degrees, height in m.
    origin: Option<[f64; 3]>,
    /// Messages that did not reach this process, as they were last said.
    lost_told: u64,
    heartbeat: HeartbeatBuilder,
    mono_start: i64,
}

impl Record {
    fn write_down(&mut self) {
        let Record { inputs, directory, mcap, tally, origin, heartbeat, mono_start, .. } = self;
        let had_origin = origin.is_some();
        // The frame first: estimates and truth are compared in it.
        while let Some(found) = inputs.frame_origin.receive() {
            origin.get_or_insert([found.lat_deg, found.lon_deg, found.height]);
        }
        while let Some(solution) = inputs.solutions.receive() {
            origin.get_or_insert(solution.origin);
            tally.solution(&solution);
        }
        if let Some(origin) = origin.filter(|_| !had_origin) {
            directory.take(Row::Origin(origin));
            mcap.origin(origin);
        }
        inputs.readings(&mut |reading| {
            heartbeat.handled += 1;
            heartbeat.reading(reading.sensor(), reading.t_valid());
            mcap.take(|| Entry::Reading(*reading));
            directory.take(Row::Reading(*reading));
        });
        while let Some(truth) = inputs.truth.receive() {
            mcap.take(|| Entry::Truth(Box::new(truth)));
            directory.take(Row::Truth(Box::new(truth)));
        }
        while let Some(estimate) = inputs.estimates.receive() {
            heartbeat.handled += 1;
            if estimate.header.t_published >= *mono_start {
                heartbeat.hop_in.record(monotonic_now() - estimate.header.t_published);
            }
            mcap.estimate(&estimate);
            directory.take(Row::Estimate(Box::new(estimate)));
        }
        while let Some(estimate) = inputs.lagged.receive() {
            directory.take(Row::Lagged(Box::new(estimate)));
        }
        while let Some(beat) = inputs.health.receive() {
            tally.heartbeat(&beat);
            mcap.take(|| Entry::Health(Box::new(beat)));
        }
        while let Some(report) = inputs.diagnostics.receive() {
            mcap.take(|| Entry::Report(Box::new(report)));
        }
    }

    /// Counts what is not in the record: what did not reach this process, and what it did not get rid of. Returns the former.
    fn count_losses(&mut self) -> u64 {
        let lost = self.inputs.count_losses(&mut self.heartbeat);
        self.heartbeat.dropped = lost + self.directory.dropped();
        lost
    }

    fn beat(&mut self, health: &mut Publisher<Heartbeat>) {
        if monotonic_now() < self.heartbeat.next_beat() {
            return;
        }
        if let Some(ns) = self.directory.flush_ns() {
            self.heartbeat.work.record(ns);
        }
        let lost = self.count_losses();
        self.mcap.say_drops(lost);
        self.directory.say_drops(monotonic_now());
        if lost > self.lost_told {
            warn!(lost = lost - self.lost_told, "messages did not reach the recorder (is the CPU starved?)");
            self.lost_told = lost;
        }
        if let Some(beat) = self.heartbeat.beat(monotonic_now()) {
            health.publish(beat);
        }
    }

    fn finish(mut self, health: &mut Publisher<Heartbeat>) -> Result<(), RecorderError> {
        let lost = self.count_losses();
        self.mcap.finish(lost);
        let (Ended { written, score }, dropped) = self.directory.finish()?;
        let wall_s = (monotonic_now() - self.mono_start) as f64 * 1e-9;
        let summary = Summary {
            origin: self.origin.unwrap_or_default(),
            score,
            lost: lost + dropped,
            ..self.tally.summary(&written, wall_s, self.inputs.solutions.lost())
        };
        summary.write(&self.folder)?;
        if summary.lost + written.not_finite + written.out_of_order > 0 {
            let (not_finite, out_of_order) = (written.not_finite, written.out_of_order);
            warn!(lost, dropped, not_finite, out_of_order, "the record is not whole");
        }
        info!(folder = %self.folder.display(), estimates = summary.estimates, "recorded");
        self.heartbeat.state = ProcessState::Stopping;
        self.heartbeat.dropped = summary.lost;
        health.publish(self.heartbeat.build());
        Ok(())
    }
}
