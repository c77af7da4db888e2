//! A consumer of estimates in a process of its own, which knows when the sample behind each of them was published.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};

use ilns_bus::{Bus, BusError, Prefix, Reader, Subscriber};
use ilns_runtime::{Latency, RealTime, monotonic_now};
use shared_types::{Heartbeat, ImuSample, Mode, NavEstimate, Process, Sensor, Solution, channel};

use super::{LatencyError, Window, joined};

/// Samples whose estimate may be under way: seconds of them at any rate.
const REMEMBERED: usize = 8192;

/// Samples, and solutions, that a trace holds at most: some 60 MB of JSON.
const TRACED: usize = 200_000;

/// One sample from its driver to this consumer, monotonic ns.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub(super) sequence: u64,
    pub(super) t_arrival: i64,
    pub(super) published: i64,
    pub(super) estimated: i64,
    pub(super) received: i64,
}

/// One solve, monotonic ns; its length is CPU time.
#[derive(Clone, Copy, Debug)]
pub(super) struct Solve {
    pub(super) id: u64,
    pub(super) published: i64,
    pub(super) solve_ns: u64,
}

/// What was found in the window.
#[derive(Debug)]
pub(super) struct Consumed {
    /// From the driver's publication to the estimate's.
    pub(super) imu_to_estimate: Latency,
    /// From the estimate's publication to its receipt here.
    pub(super) estimate_to_consumer: Latency,
    /// From the driver's publication to the receipt here.
    pub(super) end_to_end: Latency,
    /// Samples published in the window.
    pub(super) samples: u64,
    /// Of those, without an estimate received here.
    pub(super) unanswered: u64,
    /// Estimates missing by sequence number.
    pub(super) estimates_lost: u64,
    /// Samples that this observer itself missed.
    pub(super) samples_unseen: u64,
    /// The last heartbeat of each process.
    pub(super) beats: BTreeMap<Process, Heartbeat>,
    /// For a trace, if one is wanted.
    pub(super) rows: Vec<Row>,
    /// For a trace, if one is wanted.
    pub(super) solves: Vec<Solve>,
}

impl Consumed {
    /// Samples that the propagator itself missed.
    pub(super) fn lost_at_propagator(&self) -> u64 {
        self.beats.get(&Process::Propagator).map_or(0, |beat| beat.sensors[Sensor::Imu.index()].lost)
    }
}

/// The consumer at work.
#[derive(Debug)]
pub(super) struct Consumer {
    thread: JoinHandle<Result<Consumed, String>>,
    navigates: Arc<AtomicBool>,
}

impl Consumer {
    /// Joins the set in a thread of its own: ports belong to the thread that made them.
    pub(super) fn start(prefix: &Prefix, real_time: RealTime, window: &Arc<Window>, traces: bool) -> Consumer {
        let navigates = Arc::new(AtomicBool::new(false));
        let (there, window, flag) = (prefix.clone(), Arc::clone(window), Arc::clone(&navigates));
        let thread = thread::spawn(move || {
            real_time.enter();
            consume(&there, &window, &flag, traces).map_err(|error| error.to_string())
        });
        Consumer { thread, navigates }
    }

    /// Whether an estimate has come that stands on a solution.
    pub(super) fn navigates(&self) -> bool {
        self.navigates.load(Ordering::Relaxed)
    }

    /// What was found, once the window is closed.
    pub(super) fn finish(self) -> Result<Consumed, LatencyError> {
        joined(self.thread)
    }
}

fn consume(prefix: &Prefix, window: &Window, navigates: &AtomicBool, traces: bool) -> Result<Consumed, BusError> {
    let bus = Bus::join(prefix, Process::Monitor, 0)?;
    let waiter = bus.waiter(Reader::Vehicle)?;
    let mut estimates = bus.subscriber_since(&channel::ESTIMATE, 0)?;
    let mut observer = Observer::new(&bus, window, traces)?;
    // More than come between two wake-ups; it grows on a machine that stands still for longer.
    let mut received: Vec<(NavEstimate, i64)> = Vec::with_capacity(256);
    while !window.is_closed() {
        waiter.wait();
        while let Some(estimate) = estimates.receive() {
            received.push((estimate, monotonic_now()));
        }
        // After the receipts: a consumer has better things to do than to look at samples.
        observer.look();
        for (estimate, at) in received.drain(..) {
            if estimate.mode() != Mode::Initialising {
                navigates.store(true, Ordering::Relaxed);
            }
            observer.enter(&estimate, at);
        }
    }
    Ok(observer.finish(estimates.lost()))
}

/// Knows when each sample was published, and how the processes are.
struct Observer<'a> {
    window: &'a Window,
    traces: bool,
    samples: Subscriber<ImuSample>,
    solutions: Subscriber<Solution>,
    health: Subscriber<Heartbeat>,
    /// By sequence, modulo [`REMEMBERED`].
    remembered: Vec<Option<ImuSample>>,
    found: Consumed,
}

impl Observer<'_> {
    fn new<'a>(bus: &Bus, window: &'a Window, traces: bool) -> Result<Observer<'a>, BusError> {
        Ok(Observer {
            window,
            traces,
            samples: bus.subscriber_since(&channel::IMU, 0)?,
            solutions: bus.subscriber_since(&channel::SOLUTION, 0)?,
            health: bus.subscriber(&channel::HEALTH)?,
            remembered: vec![None; REMEMBERED],
            found: Consumed {
                imu_to_estimate: Latency::precise(),
                estimate_to_consumer: Latency::precise(),
                end_to_end: Latency::precise(),
                samples: 0,
                unanswered: 0,
                estimates_lost: 0,
                samples_unseen: 0,
                beats: BTreeMap::new(),
                rows: Vec::new(),
                solves: Vec::new(),
            },
        })
    }

    fn look(&mut self) {
        while let Some(sample) = self.samples.receive() {
            self.found.samples += u64::from(self.window.holds(sample.header.t_published));
            self.remembered[sample.header.sequence as usize % REMEMBERED] = Some(sample);
        }
        while let Some(solution) = self.solutions.receive() {
            if self.traces && self.window.holds(solution.header.t_published) && self.found.solves.len() < TRACED {
                let (id, published) = (solution.id, solution.header.t_published);
                self.found.solves.push(Solve { id, published, solve_ns: solution.solve_ns });
            }
        }
        while let Some(beat) = self.health.receive() {
            if let Some(process) = Process::from_index(beat.process)
                && u32::from(beat.header.source) == beat.process
            {
                self.found.beats.insert(process, beat);
            }
        }
    }

    fn enter(&mut self, estimate: &NavEstimate, received: i64) {
        let sequence = estimate.header.origin_sequence;
        let remembered = &mut self.remembered[sequence as usize % REMEMBERED];
        // One estimate a sample; what is said without a sample names the last one again, and has been taken already.
        let Some(sample) = remembered.take_if(|sample| sample.header.sequence == sequence) else { return };
        let published = sample.header.t_published;
        if !self.window.holds(published) {
            return;
        }
        let estimated = estimate.header.t_published;
        self.found.imu_to_estimate.record(estimated - published);
        self.found.estimate_to_consumer.record(received - estimated);
        self.found.end_to_end.record(received - published);
        if self.traces && self.found.rows.len() < TRACED {
            let t_arrival = sample.header.t_arrival;
            self.found.rows.push(Row { sequence, t_arrival, published, estimated, received });
        }
    }

    fn finish(mut self, estimates_lost: u64) -> Consumed {
        self.found.estimates_lost = estimates_lost;
        self.found.samples_unseen = self.samples.lost();
        self.found.unanswered = self.found.samples - self.found.end_to_end.brief().count;
        self.found
    }
}
