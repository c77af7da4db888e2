//! The story of this process: fifty times a second, write down what has come; every second, hand it to the disk.

use std::path::PathBuf;

use ilns_bus::{Bus, Prefix, Publisher};
use ilns_recording::{EstimateWriter, LogWriter, LogWriterOptions, Summary};
use ilns_runtime::{HeartbeatBuilder, ProcessArgs, Shutdown, monotonic_now};
use shared_types::{Heartbeat, Process, ProcessState, channel};
use tracing::{info, warn};

use crate::error::RecorderError;
use crate::estimate_log::EstimateLog;
use crate::live_score::LiveScore;
use crate::mcap_log::{Entry, McapArgs, McapLog};
use crate::ports::Inputs;
use crate::tally::Tally;

/// Between two looks at the queues, ns: the shortest queue holds 64 readings, and nobody is kept waiting.
const LOOK: i64 = 20_000_000;

/// Between two flushes, ns: what a crash of this process may cost.
const FLUSH: i64 = 1_000_000_000;

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
/// [`RecorderError`] when it cannot begin, or when the disk refuses.
pub fn run(args: &Args) -> Result<(), RecorderError> {
    run_until(args, &args.process.begin()?)
}

/// Runs the recorder until `shutdown` is requested.
///
/// # Errors
/// [`RecorderError`] when it cannot begin, or when the disk refuses.
pub fn run_until(args: &Args, shutdown: &Shutdown) -> Result<(), RecorderError> {
    let mono_start = monotonic_now();
    args.process.real_time(Process::Recorder)?.enter();
    let config = args.process.load_config()?;
    let bus = Bus::join(&Prefix::new(&args.process.prefix)?, Process::Recorder, args.process.epoch)?;
    let mut health = bus.publisher(&channel::HEALTH)?;
    let mut record = Record {
        inputs: Inputs::open(&bus)?,
        log: LogWriter::create(args.folder(), LogWriterOptions { arrival_columns: true, replace: args.replace })?,
        mcap: McapLog::create(&args.folder(), args.mcap, args.replace, config.to_toml())?,
        estimates: EstimateLog::create(&args.folder())?,
        lagged: None,
        tally: Tally::new(&config),
        origin: None,
        live_score: LiveScore::default(),
        heartbeat: HeartbeatBuilder::new(Process::Recorder, args.process.epoch),
        mono_start,
    };
    record.log.sensors_toml(&config.to_toml())?;
    record.heartbeat.state = ProcessState::Running;

    let mut next_flush = mono_start + FLUSH;
    while shutdown.sleep_until(monotonic_now() + LOOK) {
        record.write_down()?;
        if monotonic_now() >= next_flush {
            next_flush += FLUSH;
            record.flush()?;
        }
        record.beat(&mut health);
    }
    // What was sent before the end belongs to the record.
    record.write_down()?;
    record.finish(&mut health)
}

/// A record in the making.
struct Record {
    inputs: Inputs,
    log: LogWriter,
    mcap: McapLog,
    estimates: EstimateLog,
    /// Begun with the first of them.
    lagged: Option<EstimateWriter>,
    tally: Tally,
    /// Of the ENU frame: latitude, longitude in degrees, height in m.
    origin: Option<[f64; 3]>,
    live_score: LiveScore,
    heartbeat: HeartbeatBuilder,
    mono_start: i64,
}

impl Record {
    fn write_down(&mut self) -> Result<(), RecorderError> {
        let Record { inputs, log, mcap, estimates, lagged, tally, origin, live_score, heartbeat, mono_start } = self;
        // The frame first: estimates and truth are compared in it.
        while let Some(found) = inputs.frame_origin.receive() {
            origin.get_or_insert([found.lat_deg, found.lon_deg, found.height]);
        }
        while let Some(solution) = inputs.solutions.receive() {
            origin.get_or_insert(solution.origin);
            tally.solution(&solution);
        }
        if let Some(origin) = *origin {
            live_score.origin(origin);
            mcap.origin(origin);
        }
        inputs.readings(&mut |reading| {
            heartbeat.handled += 1;
            heartbeat.reading(reading.sensor(), reading.t_valid());
            mcap.take(|| Entry::Reading(*reading));
            log.reading(reading)
        })?;
        while let Some(truth) = inputs.truth.receive() {
            live_score.truth(&truth);
            mcap.take(|| Entry::Truth(Box::new(truth)));
            log.truth(&truth)?;
        }
        while let Some(estimate) = inputs.estimates.receive() {
            heartbeat.handled += 1;
            if estimate.header.t_published >= *mono_start {
                heartbeat.hop_in.record(monotonic_now() - estimate.header.t_published);
            }
            mcap.estimate(&estimate);
            estimates.take(&estimate, &mut |written| live_score.estimate(written))?;
        }
        while let Some(estimate) = inputs.lagged.receive() {
            if lagged.is_none() {
                *lagged = Some(EstimateWriter::create_lagged(log.path())?);
            }
            if let Some(writer) = lagged {
                writer.write(&estimate)?;
            }
        }
        while let Some(beat) = inputs.health.receive() {
            tally.heartbeat(&beat);
            mcap.take(|| Entry::Health(Box::new(beat)));
        }
        while let Some(report) = inputs.diagnostics.receive() {
            mcap.take(|| Entry::Report(Box::new(report)));
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), RecorderError> {
        let mono = monotonic_now();
        self.log.flush()?;
        self.estimates.flush()?;
        if let Some(lagged) = &mut self.lagged {
            lagged.flush()?;
        }
        self.heartbeat.work.record(monotonic_now() - mono);
        Ok(())
    }

    fn beat(&mut self, health: &mut Publisher<Heartbeat>) {
        if monotonic_now() < self.heartbeat.next_beat() {
            return;
        }
        let lost_before = self.heartbeat.dropped;
        self.inputs.count_losses(&mut self.heartbeat);
        self.mcap.say_drops(self.heartbeat.dropped);
        if self.heartbeat.dropped > lost_before {
            warn!(lost = self.heartbeat.dropped - lost_before, "messages did not reach the record (is the disk slow?)");
        }
        if let Some(beat) = self.heartbeat.beat(monotonic_now()) {
            health.publish(beat);
        }
    }

    fn finish(mut self, health: &mut Publisher<Heartbeat>) -> Result<(), RecorderError> {
        let folder = self.log.path().to_owned();
        self.log.finish()?;
        let written = self.estimates.finish()?;
        if let Some(lagged) = self.lagged.take() {
            lagged.finish()?;
        }
        let wall_s = (monotonic_now() - self.mono_start) as f64 * 1e-9;
        let summary = Summary {
            origin: self.origin.unwrap_or_default(),
            score: self.live_score.finish(),
            ..self.tally.summary(&written, wall_s, self.inputs.solutions.lost())
        };
        summary.write(&folder)?;
        let lost = self.inputs.lost_in_all();
        self.mcap.finish(lost);
        if lost + written.not_finite + written.out_of_order > 0 {
            let (not_finite, out_of_order) = (written.not_finite, written.out_of_order);
            warn!(lost, not_finite, out_of_order, "the record is not whole");
        }
        info!(folder = %folder.display(), estimates = summary.estimates, "recorded");
        self.heartbeat.state = ProcessState::Stopping;
        self.inputs.count_losses(&mut self.heartbeat);
        health.publish(self.heartbeat.build());
        Ok(())
    }
}
