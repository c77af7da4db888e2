//! The processes: one emulator per sensor, and one for the truth.

use std::rc::Rc;

use ilns_bus::{Bus, BusError, Prefix};
use ilns_runtime::{HeartbeatBuilder, ProcessArgs, RealTime, RuntimeError, Shutdown, StartClock};
use shared_types::{Channel, Duration, Message, Process, Sensor, Time, channel};

use crate::emulator::Emulator;
use crate::source::{Readings, Source, SourceArgs, SourceError};

/// What an emulator is told.
#[derive(Clone, Debug, clap::Args)]
pub struct EmulatorArgs {
    #[command(flatten)]
    #[expect(missing_docs, reason = "a doc comment here would become the help text of the whole group")]
    pub process: ProcessArgs,
    #[command(flatten)]
    #[expect(missing_docs, reason = "a doc comment here would become the help text of the whole group")]
    pub source: SourceArgs,
    /// Seconds of data time from the start after which nothing more is sent.
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,
    /// Seconds of data time per second, for an emulator that is started by hand; --start says it otherwise.
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    pub rate: f64,
}

/// An emulator that cannot begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum EmulatorError {
    /// Arguments, signals.
    #[error(transparent)]
    Runtime(#[from] RuntimeError),
    /// The bus.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// The scenario or log.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// Not an emulator.
    #[error("{0} is not an emulator")]
    NotAnEmulator(Process),
}

/// Every emulator, in the order in which they are started.
pub const EMULATORS: [Process; 8] = [
    Process::EmulatorTruth,
    Process::EmulatorBuoys,
    Process::EmulatorLbl,
    Process::EmulatorGnss,
    Process::EmulatorDvl,
    Process::EmulatorMcp,
    Process::EmulatorPs,
    Process::EmulatorImu,
];

/// What `emulator` has to emulate in `source`: nothing when the sensor is not fitted.
pub fn is_fitted(source: &Source, emulator: Process) -> bool {
    match sensor_of(emulator) {
        Some(sensor) => source.has(sensor),
        None => emulator == Process::EmulatorTruth && source.has_truth(),
    }
}

fn sensor_of(emulator: Process) -> Option<Sensor> {
    emulator.name().strip_prefix("emulator-").and_then(Sensor::from_name)
}

/// Runs one emulator until it is told to stop.
///
/// # Errors
/// [`EmulatorError`] when it cannot begin, or when the log holds something unreadable.
pub fn run(emulator: Process, args: &EmulatorArgs) -> Result<(), EmulatorError> {
    run_until(emulator, args, args.process.begin()?)
}

/// Runs one emulator until `shutdown` is requested.
///
/// # Errors
/// As [`run`].
pub fn run_until(emulator: Process, args: &EmulatorArgs, shutdown: Shutdown) -> Result<(), EmulatorError> {
    let real_time = args.process.real_time(emulator)?;
    let source = Source::open(&args.source)?;
    let place = Place::take(emulator, args, &source, shutdown, real_time)?;
    match emulator {
        Process::EmulatorImu => place.emulate(&channel::IMU, source.imu()?, |_| false),
        Process::EmulatorLbl => place.emulate(&channel::LBL, source.lbl()?, |_| false),
        Process::EmulatorGnss => place.emulate(&channel::GNSS, source.gnss()?, |_| false),
        Process::EmulatorDvl => place.emulate(&channel::DVL, source.dvl()?, |_| false),
        Process::EmulatorMcp => place.emulate(&channel::MCP, source.mcp()?, |_| false),
        Process::EmulatorPs => place.emulate(&channel::PS, source.ps()?, |_| false),
        Process::EmulatorBuoys => place.emulate(&channel::BUOYS, source.buoys()?, |fix| fix.moored == 1),
        Process::EmulatorTruth => place.emulate(&channel::TRUTH, source.truth()?, |_| false),
        other => Err(EmulatorError::NotAnEmulator(other)),
    }
}

/// An emulator's place in the set and in time.
struct Place {
    bus: Rc<Bus>,
    emulator: Process,
    epoch: u32,
    clock: StartClock,
    until: Time,
    shutdown: Shutdown,
    real_time: RealTime,
}

impl Place {
    fn take(
        emulator: Process,
        args: &EmulatorArgs,
        source: &Source,
        shutdown: Shutdown,
        real_time: RealTime,
    ) -> Result<Place, EmulatorError> {
        let bus = Bus::join(&Prefix::new(&args.process.prefix)?, emulator, args.process.epoch)?;
        let clock = match args.process.start {
            Some(clock) => clock,
            None => StartClock::now_is(source.start()?, args.rate),
        };
        let until = args.duration.map_or(Time::MAX, |seconds| clock.data + Duration::from_seconds(seconds));
        Ok(Place { bus: Rc::new(bus), emulator, epoch: args.process.epoch, clock, until, shutdown, real_time })
    }

    fn emulate<T: Message>(
        self,
        channel: &Channel<T>,
        readings: Readings<T>,
        holds: impl Fn(&T) -> bool,
    ) -> Result<(), EmulatorError> {
        let emulator = Emulator {
            readings,
            publisher: self.bus.publisher(channel)?,
            health: self.bus.publisher(&channel::HEALTH)?,
            bus: Rc::clone(&self.bus),
            heartbeat: HeartbeatBuilder::new(self.emulator, self.epoch),
            clock: self.clock,
            shutdown: self.shutdown,
            until: self.until,
            sensor: sensor_of(self.emulator),
        };
        self.real_time.enter();
        emulator.run(self.epoch > 0, holds)?;
        Ok(self.bus.check_owner()?)
    }
}
