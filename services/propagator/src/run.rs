//! The story of this process: woken by a sample, publish where the vehicle is; then look for a newer solution to stand on.

use std::time::Duration;

use ilns_bus::{Bus, Prefix, Publisher, Reader, Subscriber, Waiter};
use ilns_runtime::{HeartbeatBuilder, ProcessArgs, Shutdown, monotonic_now};
use shared_types::{Heartbeat, ImuSample, NavEstimate, Process, ProcessState, Sensor, Solution, Time, channel};
use tracing::{error, warn};

use crate::error::PropagatorError;
use crate::fast_path::FastPath;
use crate::rhythm::Rhythm;
use crate::silence::Silence;

/// What the propagator is told.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    #[expect(missing_docs, reason = "a doc comment here would become the help text of the whole group")]
    pub process: ProcessArgs,
}

/// Runs the propagator until SIGTERM or SIGINT.
///
/// # Errors
/// [`PropagatorError`] when it cannot begin.
pub fn run(args: &Args) -> Result<(), PropagatorError> {
    run_until(args, &args.process.begin()?)
}

/// Runs the propagator until `shutdown` is requested.
///
/// # Errors
/// [`PropagatorError`] when it cannot begin.
pub fn run_until(args: &Args, shutdown: &Shutdown) -> Result<(), PropagatorError> {
    let config = args.process.load_config()?;
    let real_time = args.process.real_time(Process::Propagator)?;
    let bus = Bus::join(&Prefix::new(&args.process.prefix)?, Process::Propagator, args.process.epoch)?;
    let mut ports = Ports {
        samples: bus.subscriber(&channel::IMU)?,
        solutions: bus.subscriber(&channel::SOLUTION)?,
        estimates: bus.publisher(&channel::ESTIMATE)?,
        health: bus.publisher(&channel::HEALTH)?,
    };
    let waiter = if real_time.polls() { Waiter::polling() } else { bus.waiter(Reader::Propagator)? };
    let mut fast_path = FastPath::new(&config);
    let rate = args.process.start.map_or(1.0, |start| start.rate);
    let mut silence = Silence::new(rate);
    // Who never sleeps has nothing to be woken from.
    let mut rhythm = (!real_time.polls()).then(Rhythm::default);
    let mut heartbeat = HeartbeatBuilder::new(Process::Propagator, args.process.epoch);
    heartbeat.state = ProcessState::Running;
    // Samples from before are what a restart catches up with; whoever steers has their estimates or no use for them.
    let mono_start = monotonic_now();
    real_time.enter();

    while !shutdown.requested() {
        let now = monotonic_now();
        let patience = silence.patience(now);
        let patience = rhythm.map_or(patience, |rhythm| rhythm.patience(now, patience));
        waiter.wait_for(Duration::from_nanos(patience as u64));
        while let Some(sample) = ports.samples.receive() {
            let received = monotonic_now();
            let is_live = sample.header.t_published >= mono_start;
            let estimate = fast_path.advance(&sample);
            if is_live {
                heartbeat.received_at(&sample.header, received);
                if let Some(rhythm) = &mut rhythm {
                    rhythm.heard(received);
                }
                if let Some(estimate) = estimate {
                    silence.heard(Time(sample.header.t_valid), monotonic_now());
                    ports.estimates.publish(estimate);
                    heartbeat.end_to_end.record(monotonic_now() - sample.header.t_arrival);
                }
            }
        }
        if let Some(rhythm) = &mut rhythm
            && rhythm.is_due(monotonic_now())
        {
            fast_path.rehearse(rhythm.period() * 1e-9 * rate);
        }
        // After the samples: standing on a new solution takes longer than one step, and an estimate must not wait for it.
        if let Some(solution) = ports.solutions.newest() {
            let mono = monotonic_now();
            if let Err(reason) = fast_path.rebase(&solution) {
                warn!(%reason, "the solution is not used");
            }
            heartbeat.work.record(monotonic_now() - mono);
        }
        if let Some(now) = silence.due(monotonic_now())
            && let Some(estimate) = fast_path.without_imu(now)
        {
            ports.estimates.publish(estimate);
        }
        if monotonic_now() >= heartbeat.next_beat() {
            bus.check_owner()?;
        }
        ports.beat(&mut heartbeat, &fast_path);
    }
    heartbeat.state = ProcessState::Stopping;
    ports.health.publish(heartbeat.build());
    Ok(())
}

/// The channels of this process.
struct Ports {
    samples: Subscriber<ImuSample>,
    solutions: Subscriber<Solution>,
    estimates: Publisher<NavEstimate>,
    health: Publisher<Heartbeat>,
}

impl Ports {
    fn beat(&mut self, heartbeat: &mut HeartbeatBuilder, fast_path: &FastPath) {
        if monotonic_now() < heartbeat.next_beat() {
            return;
        }
        let imu = &mut heartbeat.sensors[Sensor::Imu.index()];
        let lost_before = imu.lost;
        *imu = *fast_path.imu();
        imu.lost = self.samples.lost();
        if imu.lost > lost_before {
            warn!(channel = "sensor/imu", lost = imu.lost - lost_before, "IMU samples are lost");
        }
        // Refused by the propagator's own last look, hence dropped as if no queue had taken it.
        let dropped = self.estimates.dropped() + fast_path.unsound();
        if dropped > heartbeat.dropped && fast_path.unsound() > 0 {
            error!(
                unsound = fast_path.unsound(),
                "estimates held a number that is none; INVALID was published instead"
            );
        }
        heartbeat.dropped = dropped;
        if let Some(beat) = heartbeat.beat(monotonic_now()) {
            self.health.publish(beat);
        }
        self.estimates.update();
    }
}
