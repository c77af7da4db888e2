//! `ilns latency`: runs the whole set and measures every hop from an inertial sample to a consumer, beside bare hops of the
//! same rate, payload and wake-up in the same run.
//!
//! Times are one-way, from the sender's stamp to the receiver's, on CLOCK_MONOTONIC, unfiltered: whatever was published in
//! the window of measurement counts, and what got lost is told.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::thread;

use ilns_bus::{Owner, Prefix};
use ilns_runtime::{
    LogFormat, ProcessFile, RealTime, Shutdown, StartClock, answer, load_config, monotonic_now, start_logging,
};
use shared_types::Process;
use sim_emulators::simulate::PresetName;
use sim_emulators::source::{Source, SourceArgs};

use crate::Outcome;
use crate::plan::{Wishes, children, common_arguments};
use crate::supervisor::Supervisor;

mod consumer;
pub mod load;
mod mission;
mod page_faults;
mod reference;
mod report;
mod trace;

use consumer::Consumer;
use reference::References;
pub use reference::{SENDER, SenderArgs};
use report::Report;

/// What a measurement is told.
#[derive(Debug, clap::Args)]
pub struct LatencyArgs {
    /// Inertial samples per second, 50 to 2000.
    #[arg(long, value_name = "HZ", default_value_t = 200, value_parser = clap::value_parser!(u32).range(50..=2000))]
    rate: u32,
    /// Seconds that are measured, after the estimates have begun.
    #[arg(long, value_name = "S", default_value_t = 20.0, value_parser = seconds)]
    duration: f64,
    /// Keep every core busy with other work meanwhile.
    #[arg(long)]
    load: bool,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
    /// TOML file with cores, priorities and wake-ups of the processes. The bare hops get the same: their sender what
    /// emulator-imu has, their receivers and the consumer what propagator has, but for its core.
    #[arg(long, value_name = "FILE")]
    processes: Option<PathBuf>,
    /// Write a trace of every sample for Perfetto (ui.perfetto.dev) or chrome://tracing.
    #[arg(long, value_name = "FILE")]
    trace: Option<PathBuf>,
    /// Name of the set that is measured; without it, one that no other run has.
    #[arg(long, value_name = "NAME")]
    prefix: Option<String>,
    /// Least severity that is logged: error, warn, info, debug or trace.
    #[arg(long, value_name = "LEVEL", default_value = "warn")]
    log_level: String,
}

/// Longest measurement, s: a day.
const LONGEST: f64 = 86_400.0;

/// From the first process's start to the first reading, ns.
const LEAD: i64 = 600_000_000;

/// From the first navigating estimate to the window of measurement, ns: connections are made at first messages.
const WARM_UP: i64 = 1_000_000_000;

/// From the window's end to the end, ns: what is under way arrives, and every process beats once more.
const DRAIN: i64 = 1_200_000_000;

/// How long the first navigating estimate is waited for, ns.
const PATIENCE: i64 = 60_000_000_000;

/// The window of measurement, shared by all who measure: monotonic ns of publication, from and until.
#[derive(Debug)]
struct Window {
    from: AtomicI64,
    until: AtomicI64,
    /// Measuring is over: threads end.
    closed: AtomicBool,
}

impl Window {
    fn new() -> Arc<Window> {
        let never = || AtomicI64::new(i64::MAX);
        Arc::new(Window { from: never(), until: never(), closed: AtomicBool::new(false) })
    }

    fn open(&self, from: i64, until: i64) {
        self.until.store(until, Ordering::Relaxed);
        self.from.store(from, Ordering::Relaxed);
    }

    fn holds(&self, t_published: i64) -> bool {
        (self.from.load(Ordering::Relaxed)..self.until.load(Ordering::Relaxed)).contains(&t_published)
    }

    fn close(&self) {
        self.closed.store(true, Ordering::Relaxed);
    }

    fn is_closed(&self) -> bool {
        self.closed.load(Ordering::Relaxed)
    }
}

/// A measurement that came to nothing.
#[derive(Debug, thiserror::Error)]
enum LatencyError {
    /// The set does not navigate.
    #[error("no navigating estimate within {} s; the lines above, or --log-level info, say why", PATIENCE / 1_000_000_000)]
    NoEstimate,
    /// Somebody stopped it.
    #[error("stopped before the measurement was whole")]
    Stopped,
    /// The trace cannot be written.
    #[error("--trace {}: it cannot be written", .0.display())]
    Trace(PathBuf, #[source] std::io::Error),
    /// A thread that measures is gone.
    #[error("a measuring thread ended early: {0}")]
    Thread(String),
}

fn seconds(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| "expected a number of seconds".to_owned())?;
    if (0.5..=LONGEST).contains(&number) { Ok(number) } else { Err(format!("expected 0.5 to {LONGEST} seconds")) }
}

/// Measures and prints.
pub fn run(args: &LatencyArgs) -> Outcome {
    start_logging(&args.log_level, LogFormat::Auto)?;
    let shutdown = Shutdown::on_signals()?;
    let prefix = match &args.prefix {
        Some(name) => Prefix::new(name)?,
        None => Prefix::new(&format!("latency-{}", std::process::id()))?,
    };
    let processes = args.processes.as_deref().map(ProcessFile::read).transpose()?.unwrap_or_default();
    let receiver = RealTime::of(Process::Propagator, args.processes.as_deref())?.anywhere();
    // A path that cannot be written is told before the measurement, not after it.
    let trace = args.trace.as_deref().map(|file| trace::create(file).map_err(|e| LatencyError::Trace(file.into(), e)));
    let trace = trace.transpose()?;
    let mut owner = Owner::take(&prefix)?;
    owner.offer_bare_hop()?;
    let scenario = mission::write(&prefix, f64::from(args.rate), args.duration)?;
    let source_args = SourceArgs {
        scenario: scenario.to_string_lossy().into_owned(),
        log: None,
        seed: 1,
        preset: PresetName::Realistic,
        faults: Vec::new(),
        fault_seed: None,
    };
    let source = Source::open(&source_args)?;
    let config = load_config(source.config().as_slice(), None, &[])?;
    let wishes = Wishes {
        source: &source_args,
        duration: None,
        out: None,
        keep: None,
        headless: true,
        processes: &processes,
        web: None,
        web_token: None,
        foxglove: None,
    };
    let clock = StartClock { data: mission::START, mono: monotonic_now() + LEAD, rate: 1.0 };
    let log = (args.log_level.as_str(), LogFormat::Auto);
    let common = common_arguments(&prefix, &config, args.processes.as_deref(), &clock, log)?;

    let window = Window::new();
    // Children first: a process is told of the end of the thread that started it, which is this one.
    let references = References::start(&prefix, &clock, args.rate, args.processes.as_deref(), receiver, &window)?;
    let consumer = Consumer::start(&prefix, receiver, &window, args.trace.is_some());
    let mut supervisor = Supervisor::start(owner, children(&wishes, &source), common)?;
    let measured = measure(args, &mut supervisor, &consumer, &window, &shutdown);
    window.close();
    let references = references.finish();
    let consumed = consumer.finish();
    supervisor.stop();
    let conditions = measured?;
    let (references, consumed) = (references?, consumed?);
    if let (Some(file), Some(path)) = (trace, &args.trace) {
        trace::write(file, &consumed).map_err(|e| LatencyError::Trace(path.clone(), e))?;
    }
    let report = Report::new(args, receiver.polls(), conditions, &consumed, &references);
    answer(&if args.json { serde_json::to_string(&report)? } else { report.table() })?;
    Ok(())
}

/// How the machine was while it was measured.
#[derive(Debug)]
struct Conditions {
    load_average: f64,
    page_faults: BTreeMap<&'static str, page_faults::PageFaults>,
}

/// Waits for the first navigating estimate, then for the window to pass.
fn measure(
    args: &LatencyArgs,
    supervisor: &mut Supervisor,
    consumer: &Consumer,
    window: &Window,
    shutdown: &Shutdown,
) -> Result<Conditions, LatencyError> {
    let patience = monotonic_now() + PATIENCE;
    while !consumer.navigates() {
        supervisor.watch();
        if shutdown.requested() {
            return Err(LatencyError::Stopped);
        }
        if monotonic_now() > patience {
            return Err(LatencyError::NoEstimate);
        }
    }
    let load = args.load.then(load::saturate);
    let from = monotonic_now() + WARM_UP;
    let until = from + (args.duration * 1e9) as i64;
    window.open(from, until);
    let mut faults_before = None;
    while monotonic_now() < until {
        supervisor.watch();
        if faults_before.is_none() && monotonic_now() >= from {
            faults_before = Some(page_faults::count(supervisor));
        }
        if shutdown.requested() {
            return Err(LatencyError::Stopped);
        }
    }
    let page_faults = page_faults::between(&faults_before.unwrap_or_default(), &page_faults::count(supervisor));
    let load_average = load::average();
    drop(load);
    while monotonic_now() < until + DRAIN && !shutdown.requested() {
        supervisor.watch();
    }
    Ok(Conditions { load_average, page_faults })
}

/// What a joined thread gives back.
fn joined<T>(thread: thread::JoinHandle<Result<T, String>>) -> Result<T, LatencyError> {
    match thread.join() {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(reason)) => Err(LatencyError::Thread(reason)),
        Err(_) => Err(LatencyError::Thread("it panicked".to_owned())),
    }
}

/// Sends the bare messages until told to stop: the other side of [`References`].
pub fn send_references(args: &SenderArgs) -> Outcome {
    reference::send(args)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_holds_what_is_published_in_it_and_nothing_before_it_is_opened() {
        let window = Window::new();
        assert!(!window.holds(0) && !window.holds(i64::MAX));
        window.open(10, 20);
        assert_eq!([9, 10, 19, 20].map(|t| window.holds(t)), [false, true, true, false]);
    }

    #[test]
    fn a_duration_is_half_a_second_to_a_day() {
        assert_eq!([seconds("0.5"), seconds("86400")], [Ok(0.5), Ok(86_400.0)]);
        for bad in ["0.4", "nan", "inf", "-1", "x", "86401"] {
            assert!(seconds(bad).is_err(), "{bad}");
        }
    }
}
