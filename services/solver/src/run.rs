//! The story of this process: wait for a keyframe's bracket, solve as hard as the queue allows, publish, say how it goes.

use std::collections::VecDeque;
use std::path::PathBuf;

use ilns_bus::{Bus, Prefix, Reader, Waiter};
use ilns_runtime::{HeartbeatBuilder, ProcessArgs, Reloads, Shutdown, monotonic_now};
use nav_pipeline::{ChosenEstimator, Effort, Estimator, EstimatorError};
use rustix::time::{ClockId, clock_gettime};
use shared_types::{Measurement, Process, ProcessState, SENSORS, Solution};
use tracing::{debug, warn};

use crate::beginning::Beginning;
use crate::error::SolverError;
use crate::keeper::{Keeper, Places};
use crate::ports::{Inputs, Outputs};
use crate::recent::Recent;

/// Keyframes that may wait behind the one at hand before it is only taken in, and solved with a later one.
const HOLD_BEHIND: usize = 3;

/// Between two lines about being behind, ns.
const BETWEEN_WORDS: i64 = 10_000_000_000;

/// What the solver is told.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    #[expect(missing_docs, reason = "a doc comment here would become the help text of the whole group")]
    pub process: ProcessArgs,
    /// Folder that outlives a restart of the machine, such as /var/lib/ilns: the last solution is kept there once a second. After a restart
    /// of at most five minutes the run begins from it where nothing else tells the place. It takes a clock that goes on without power.
    #[arg(long, value_name = "DIR")]
    pub keep: Option<PathBuf>,
}

/// Runs the solver until SIGTERM or SIGINT.
///
/// # Errors
/// [`SolverError`] when it cannot begin.
pub fn run(args: &Args) -> Result<(), SolverError> {
    run_until(args, &args.process.begin()?)
}

/// Runs the solver until `shutdown` is requested.
///
/// # Errors
/// [`SolverError`] when it cannot begin.
pub fn run_until(args: &Args, shutdown: &Shutdown) -> Result<(), SolverError> {
    let mut config = args.process.load_config()?;
    let real_time = args.process.real_time(Process::Solver)?;
    let prefix = Prefix::new(&args.process.prefix)?;
    let bus = Bus::join(&prefix, Process::Solver, args.process.epoch)?;
    let mut inputs = Inputs::open(&bus)?;
    let mut outputs = Outputs::open(&bus)?;
    let waiter = if real_time.polls() { Waiter::polling() } else { bus.waiter(Reader::Solver)? };
    let mut reloads = Reloads::begin(Process::Solver, &prefix.run_directory(), &mut config);
    let places = Places::new(&prefix, args.keep.as_deref());
    let mut keeper = Keeper::start(&places, &config);
    let mut beginning = Beginning::find(&places, &config, &args.process);
    let mut recent = Recent::new();
    let mut origin = None;
    let mut heartbeat = HeartbeatBuilder::new(Process::Solver, args.process.epoch);
    heartbeat.state = ProcessState::Running;
    let mut behind = Behind::default();
    let mut waiting = VecDeque::with_capacity(inputs_capacity());
    let mono_start = monotonic_now();
    real_time.enter();

    while !shutdown.requested() {
        waiter.wait();
        if let Some(newest) = inputs.frame_origin.newest() {
            beginning.estimator.set_origin(&newest);
            origin = Some(newest);
        }
        // Everything that has come, so that the number of keyframes in it says how far behind this process is.
        while let Some(measurement) = inputs.measurements.receive() {
            if measurement.header.t_published >= mono_start {
                heartbeat.received(&measurement.header);
            }
            waiting.push_back(measurement);
        }
        if let Some(next) = reloads.take(monotonic_now()) {
            beginning.go_on_under(&next, recent.stand(&config, &next).as_ref(), origin.as_ref());
            keeper.go_on_under(&next);
            config = next;
            recent.take().rev().for_each(|measurement| waiting.push_front(measurement));
        }
        let mut keyframes = waiting.iter().filter(|measurement| measurement.kind == Measurement::KEYFRAME).count();
        while let Some(measurement) = waiting.pop_front() {
            let effort = if measurement.kind == Measurement::KEYFRAME {
                keyframes -= 1;
                let effort = effort_with(keyframes);
                // What came before this process is history, which is never solved one by one.
                if measurement.header.t_published >= mono_start {
                    behind.count(effort);
                }
                effort
            } else {
                Effort::Full
            };
            beginning.hear(&measurement);
            recent.hear(&measurement);
            if let Some(solution) =
                ingest(&mut beginning.estimator, &measurement, effort, &mut keeper, &mut outputs, &mut heartbeat)
            {
                recent.solved(&solution);
            }
        }
        // A restarted propagator gets the latched solution without waiting for the next one.
        outputs.solution.update();
        behind.say(monotonic_now());
        if monotonic_now() >= heartbeat.next_beat() {
            bus.check_owner()?;
        }
        beat(&beginning.estimator, &inputs, &mut outputs, &mut heartbeat);
    }
    heartbeat.state = ProcessState::Stopping;
    outputs.health.publish(heartbeat.build());
    Ok(())
}

fn inputs_capacity() -> usize {
    shared_types::channel::MEASUREMENTS.spec.queue
}

/// As hard as the keyframes behind this one allow: load costs freshness of corrections, never an estimate.
fn effort_with(behind: usize) -> Effort {
    match behind {
        0 => Effort::Full,
        1..HOLD_BEHIND => Effort::Reduced,
        _ => Effort::Hold,
    }
}

/// What this process did not get done in time.
#[derive(Clone, Copy, Debug, Default)]
struct Behind {
    /// Keyframes with one iteration only, and those without a solution of their own, since it was last said.
    reduced: u64,
    held: u64,
    next_word: i64,
}

impl Behind {
    fn count(&mut self, effort: Effort) {
        self.reduced += u64::from(effort == Effort::Reduced);
        self.held += u64::from(effort == Effort::Hold);
    }

    /// Says now and then what has gathered, if a solution was missing; `mono`: monotonic ns.
    fn say(&mut self, mono: i64) {
        if self.held > 0 && mono >= self.next_word {
            let Behind { reduced, held, .. } = *self;
            warn!(reduced, skipped = held, "the solver is behind: keyframes are solved with later ones");
            *self = Behind { next_word: mono + BETWEEN_WORDS, ..Behind::default() };
        }
    }
}

/// Returns the solution that it has published.
fn ingest(
    estimator: &mut ChosenEstimator,
    measurement: &Measurement,
    effort: Effort,
    keeper: &mut Keeper,
    outputs: &mut Outputs,
    heartbeat: &mut HeartbeatBuilder,
) -> Option<Solution> {
    // Asking the clock costs more than taking in a sample.
    let began = if measurement.kind == Measurement::KEYFRAME { thread_cpu_ns() } else { 0 };
    match estimator.ingest(measurement, effort) {
        Ok(Some(mut solution)) => {
            solution.solve_ns = (thread_cpu_ns() - began) as u64;
            heartbeat.work.record(solution.solve_ns as i64);
            solution.header.origin_t_arrival = measurement.header.t_arrival;
            debug!(
                solution = solution.id,
                t = %measurement.t_keyframe(),
                solve_us = solution.solve_ns / 1000,
                iterations = solution.iterations,
                effort = ?effort,
                "solved"
            );
            outputs.solution.publish(solution);
            keeper.keep(&solution);
            outputs.diagnostics.publish(*estimator.report());
            if let Some(lagged) = estimator.lagged() {
                outputs.lagged.publish(lagged);
            }
            return Some(solution);
        }
        Ok(None) => {}
        // After a restart the channel's history repeats what the solution already covers: no news.
        Err(error @ EstimatorError::Unsolvable { .. }) => {
            warn!(t = %measurement.t_keyframe(), %error, "keyframe without a solution");
        }
        Err(error) => debug!(t = %measurement.t_valid(), %error, "measurement refused"),
    }
    None
}

/// CPU time of this thread, ns.
fn thread_cpu_ns() -> i64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec * 1_000_000_000 + time.tv_nsec
}

fn beat(estimator: &ChosenEstimator, inputs: &Inputs, outputs: &mut Outputs, heartbeat: &mut HeartbeatBuilder) {
    let now = monotonic_now();
    if now < heartbeat.next_beat() {
        return;
    }
    for sensor in SENSORS {
        let health = &mut heartbeat.sensors[sensor.index()];
        let counts = &estimator.counts()[sensor.index()];
        health.received = counts.used + counts.rejected_total();
        health.rejected = counts.rejected;
    }
    heartbeat.sensors[0].lost = inputs.measurements.lost();
    heartbeat.dropped = outputs.solution.dropped();
    if let Some(beat) = heartbeat.beat(now) {
        outputs.health.publish(beat);
    }
}
