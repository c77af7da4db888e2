//! `ilns replay`: a log directory through the whole navigator in one thread.
//!
//! The work is `nav-pipeline`'s, in line and without a clock; here files come in, files go out, and a clock looks at the
//! solves. The same log gives the same bytes.

use std::time::Instant;

use hdrhistogram::Histogram;
use ilns_recording::{LogDirectory, Summary};
use ilns_runtime::answer;
use nav_pipeline::{Navigator, Output, Rebase, SolveClock};
use rustix::time::{ClockId, clock_gettime};
use shared_types::{BuoyFix, Config, Duration, RawReading, SENSORS, SensorCounts};
use sim_faults::{ArrivalClock, FaultSpec, FaultStream};

use crate::args::ReplayArgs;
use crate::error::ReplayError;
use crate::navigate::as_recorded;
use crate::output::{ReplayOutput, RunFacts};

/// Longest solve told apart from longer ones, ns.
pub(crate) const LONGEST_SOLVE: u64 = 60_000_000_000;

/// Runs `ilns replay`.
///
/// # Errors
/// A log, a configuration or an output folder that cannot be used, in one line.
pub fn run(args: &ReplayArgs) -> Result<(), ReplayError> {
    let started = Instant::now();
    let log = LogDirectory::open(&args.dir)?;
    let config = args.load_config(log.config())?;
    let Some(out) = args.out.as_ref().filter(|_| !args.navigator.print_config) else {
        return answer(&config.to_toml()).map_err(ReplayError::Print);
    };
    log.check_buoys()?;
    let output = ReplayOutput::create(out, &log, started)?;
    let injected = Injected { specs: &args.faults, seed: args.fault_seed };
    replay(&log, &config, rebase(args)?, &injected, output)?;
    Ok(())
}

/// When corrections reach the published estimate.
fn rebase(args: &ReplayArgs) -> Result<Rebase, ReplayError> {
    match &args.follow[..] {
        [] => Ok(Rebase::After(args.solve_latency.unwrap_or(Duration::ZERO))),
        files => as_recorded(files),
    }
}

/// Faults that the log has not, but the navigator is to meet.
struct Injected<'a> {
    specs: &'a [FaultSpec],
    seed: u64,
}

impl Injected<'_> {
    fn stream(&self, is_recording: bool) -> FaultStream {
        let clock = if is_recording { ArrivalClock::Arrival } else { ArrivalClock::Valid };
        FaultStream::new(self.specs, self.seed, clock)
    }

    /// Every position of every buoy, as it is reported.
    fn buoy_fixes(&self, log: &LogDirectory) -> Result<Vec<BuoyFix>, ReplayError> {
        let fixes = log.buoys()?.map(|fix| fix.map(RawReading::Buoy));
        let mut reported = Vec::new();
        for reading in self.stream(log.is_recording()).over(fixes) {
            if let RawReading::Buoy(fix) = reading? {
                reported.push(fix);
            }
        }
        Ok(reported)
    }
}

/// Drives the navigator over a log.
fn replay(
    log: &LogDirectory,
    config: &Config,
    rebase: Rebase,
    injected: &Injected<'_>,
    mut output: ReplayOutput,
) -> Result<Summary, ReplayError> {
    let merged = log.merged()?;
    let mut navigator = Navigator::new(config, rebase);
    // Live, a buoy is where its fixes so far say; a recording repeats that, any other log is interpolated.
    if !merged.is_recording() {
        navigator = navigator.with_known_buoys(injected.buoy_fixes(log)?);
    }
    let mut keyframes = 0;
    let mut iterations = 0;
    let mut solve_ns =
        Histogram::new_with_bounds(1, LONGEST_SOLVE, 3).expect("1 < LONGEST_SOLVE / 2 and 3 digits are in bounds");
    let mut clock = ThreadClock;
    let mut failed = Ok(());
    let mut sink = |event: Output<'_>| match event {
        Output::Origin(origin) => output.set_origin([origin.lat_deg, origin.lon_deg, origin.height]),
        Output::Estimate(estimate) => {
            if failed.is_ok() {
                failed = output.estimate(estimate);
            }
        }
        Output::Lagged(estimate) => {
            if failed.is_ok() {
                failed = output.lagged(estimate);
            }
        }
        Output::Solution(solution, _) => {
            keyframes += 1;
            iterations += u64::from(solution.iterations);
            if config.navigator.estimator.is_filter() || solution.keyframes as usize > config.navigator.fgo.window {
                solve_ns.saturating_record(solution.solve_ns);
            }
        }
    };
    let faults = injected.stream(merged.is_recording());
    for reading in faults.over(merged) {
        navigator.push(&reading?, &mut clock, &mut sink);
    }
    navigator.finish(&mut clock, &mut sink);
    failed?;
    let estimator = config.navigator.estimator.name();
    let window = if config.navigator.estimator.is_filter() { 0 } else { config.navigator.fgo.window };
    let faults = injected.specs.iter().map(ToString::to_string).collect();
    output.finish(&RunFacts { faults, estimator, window, keyframes, iterations, solve_ns, ..facts_of(&navigator) })
}

/// What the navigator itself counted.
pub(crate) fn facts_of(navigator: &Navigator) -> RunFacts {
    let mut facts = RunFacts {
        faults: Vec::new(),
        estimator: "",
        window: 0,
        keyframes: 0,
        keyframes_unsolved: navigator.keyframe_errors(),
        iterations: 0,
        solve_ns: Histogram::new(3).expect("3 digits are in bounds"),
        received: [0; 7],
        counts: [SensorCounts::default(); 7],
        time_offsets: navigator.time_offsets(),
        calibrations: navigator.calibrations(),
    };
    for sensor in SENSORS {
        let index = sensor.index();
        facts.received[index] = navigator.health()[index].received;
        facts.counts[index].used = navigator.counts()[index].used;
        for (reason, count) in navigator.rejected(index) {
            facts.counts[index].rejected[reason.index()] = count;
        }
    }
    facts
}

/// CPU time of this thread.
pub(crate) struct ThreadClock;

impl SolveClock for ThreadClock {
    fn thread_ns(&mut self) -> u64 {
        let time = clock_gettime(ClockId::ThreadCPUTime);
        time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64
    }
}
