//! The story of this process: wait, take in every reading, hand on what the preprocessor lets go, say how it goes.

use std::path::PathBuf;

use ilns_bus::{Bus, Prefix, Reader, Waiter};
use ilns_runtime::{HeartbeatBuilder, ProcessArgs, Reloads, Shutdown, monotonic_now};
use nav_preprocessing::Preprocessor;
use shared_types::{Header, Measurement, Process, ProcessState, Sensor};
use tracing::{info, warn};

use crate::error::PreprocessorError;
use crate::kept_origin::KeptOrigin;
use crate::ports::{Inputs, Outputs};

/// What the preprocessor is told.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    #[expect(missing_docs, reason = "a doc comment here would become the help text of the whole group")]
    pub process: ProcessArgs,
    /// Folder that outlives a restart of the machine, where the solver keeps its last solution: the frame of a run that begins from that
    /// stays where it was.
    #[arg(long, value_name = "DIR")]
    pub keep: Option<PathBuf>,
}

/// Runs the preprocessor until SIGTERM or SIGINT.
///
/// # Errors
/// [`PreprocessorError`] when it cannot begin.
pub fn run(args: &Args) -> Result<(), PreprocessorError> {
    run_until(args, &args.process.begin()?)
}

/// Runs the preprocessor until `shutdown` is requested.
///
/// # Errors
/// [`PreprocessorError`] when it cannot begin.
pub fn run_until(args: &Args, shutdown: &Shutdown) -> Result<(), PreprocessorError> {
    let mut config = args.process.load_config()?;
    let real_time = args.process.real_time(Process::Preprocessor)?;
    let prefix = Prefix::new(&args.process.prefix)?;
    let bus = Bus::join(&prefix, Process::Preprocessor, args.process.epoch)?;
    let mut inputs = Inputs::open(&bus)?;
    let mut outputs = Outputs::open(&bus)?;
    let waiter = if real_time.polls() { Waiter::polling() } else { bus.waiter(Reader::Preprocessor)? };
    let kept_origin = KeptOrigin::in_folder(&prefix.run_directory());
    let mut reloads = Reloads::begin(Process::Preprocessor, &prefix.run_directory(), &mut config);
    let mut preprocessor = kept_origin.begin(config, (args.keep.as_deref(), prefix.name()))?;
    let mut origin_is_published = false;
    let mut account = Account::new(args.process.epoch);
    real_time.enter();

    while !shutdown.requested() {
        waiter.wait();
        if let Some(newer) = reloads.take(monotonic_now()) {
            preprocessor.go_on_under(&newer);
            info!("another configuration is in force");
        }
        let mut closed_a_keyframe = false;
        inputs.drain(&mut |reading| {
            account.received(reading.header());
            preprocessor.push(reading, &mut |measurement| {
                closed_a_keyframe |= measurement.kind == Measurement::KEYFRAME;
                account.published(&measurement);
                outputs.measurements.publish_quietly(measurement);
            });
        });
        // The solver works once per keyframe: it need not wake for what it only adds up.
        if closed_a_keyframe {
            outputs.measurements.ring();
        }
        if let Some(origin) = preprocessor.origin().filter(|_| !origin_is_published) {
            kept_origin.write(&origin)?;
            outputs.frame_origin.publish(origin);
            info!(lat_deg = origin.lat_deg, lon_deg = origin.lon_deg, height = origin.height, "the frame is fixed");
            origin_is_published = true;
        }
        if monotonic_now() >= account.heartbeat.next_beat() {
            bus.check_owner()?;
        }
        account.beat(&preprocessor, &inputs, &mut outputs, ProcessState::Running);
    }
    account.end(&preprocessor, &inputs, &mut outputs);
    Ok(())
}

/// What this process tells of itself.
struct Account {
    heartbeat: HeartbeatBuilder,
    /// What was published before is history, and its age no latency; monotonic ns.
    mono_start: i64,
}

impl Account {
    fn new(epoch: u32) -> Account {
        Account { heartbeat: HeartbeatBuilder::new(Process::Preprocessor, epoch), mono_start: monotonic_now() }
    }

    fn received(&mut self, header: &Header) {
        if header.t_published >= self.mono_start {
            self.heartbeat.received(header);
        } else {
            self.heartbeat.handled += 1;
        }
    }

    /// Only IMU samples pass through at once; the others wait for data time, which is no latency of this process.
    fn published(&mut self, measurement: &Measurement) {
        if measurement.sensor() == Some(Sensor::Imu) && measurement.header.t_arrival >= self.mono_start {
            self.heartbeat.end_to_end.record(monotonic_now() - measurement.header.t_arrival);
        }
    }

    fn beat(&mut self, preprocessor: &Preprocessor, inputs: &Inputs, outputs: &mut Outputs, state: ProcessState) {
        if monotonic_now() < self.heartbeat.next_beat() {
            return;
        }
        let dropped = outputs.measurements.dropped();
        if dropped > self.heartbeat.dropped {
            warn!(
                channel = "nav/measurements",
                dropped, "a queue is full and measurements are lost (is the solver stuck?)"
            );
        }
        self.heartbeat.dropped = dropped;
        self.heartbeat.state = state;
        self.heartbeat.sensors = *preprocessor.health();
        inputs.count_losses(&mut self.heartbeat.sensors);
        if let Some(beat) = self.heartbeat.beat(monotonic_now()) {
            outputs.health.publish(beat);
        }
        // Late readers get the latched origin and the history of measurements without waiting for the next one.
        outputs.frame_origin.update();
        outputs.measurements.update();
    }

    fn end(mut self, preprocessor: &Preprocessor, inputs: &Inputs, outputs: &mut Outputs) {
        self.heartbeat.state = ProcessState::Stopping;
        self.heartbeat.sensors = *preprocessor.health();
        inputs.count_losses(&mut self.heartbeat.sensors);
        outputs.health.publish(self.heartbeat.build());
    }
}
