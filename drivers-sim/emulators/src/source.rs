//! Where the emulated readings come from: a simulated world or a recorded log.

use std::path::PathBuf;

use clap::ValueEnum;
use ilns_recording::{LogDirectory, LogError};
use shared_types::{
    BuoyFix, ConfigText, DvlVelocity, GnssFix, ImuSample, LblRange, McpHeading, Message, PsDepth, RawReading, Sensor,
    Time, Truth,
};
use sim_faults::{ArrivalClock, FaultSpec, FaultStream};
use sim_world::{ScenarioError, World};

use crate::scenario_source::{ScenarioSourceError, load_scenario};
use crate::simulate::PresetName;

/// What is simulated unless another scenario or a log is named.
pub const DEFAULT_SCENARIO: &str = "mission";

/// Rows of truth per second, as many as a simulated log has.
const TRUTH_RATE: f64 = 10.0;

/// Which readings are emulated.
#[derive(Clone, Debug, clap::Args)]
pub struct SourceArgs {
    /// What is simulated: mission, stable, outage, survey, or the path of a scenario file.
    #[arg(long, value_name = "NAME|FILE", default_value = DEFAULT_SCENARIO, conflicts_with = "log")]
    pub scenario: String,
    /// Folder of a recorded log whose readings are replayed instead of simulated ones.
    #[arg(long, value_name = "DIR")]
    pub log: Option<PathBuf>,
    /// Which noise is drawn: the same seed gives the same readings.
    #[arg(long, value_name = "N", default_value_t = 1, conflicts_with = "log")]
    pub seed: u64,
    /// How large the simulated sensor errors are.
    #[arg(long, value_enum, default_value_t = PresetName::Paper, conflicts_with = "log")]
    pub preset: PresetName,
    /// A fault, such as dvl.false_lock@600..660 or lbl.multipath=0.2 (drivers-sim/faults/README.md lists them). May be
    /// given several times.
    #[arg(long = "fault", value_name = "SPEC")]
    pub faults: Vec<FaultSpec>,
    /// What the faults draw; without it, the seed of the scenario, or 1 for a log.
    #[arg(long, value_name = "N")]
    pub fault_seed: Option<u64>,
}

impl SourceArgs {
    /// Name of the preset, as the command line takes it.
    pub fn preset_name(&self) -> String {
        self.preset.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }
}

/// A source that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// A scenario that does not exist or cannot be read.
    #[error(transparent)]
    Scenario(#[from] ScenarioSourceError),
    /// A scenario that cannot be sailed.
    #[error(transparent)]
    World(#[from] ScenarioError),
    /// A log that cannot be used.
    #[error(transparent)]
    Log(#[from] LogError),
}

/// Readings of one sensor, in the order in which they are sent.
pub(crate) type Readings<T> = Box<dyn Iterator<Item = Result<Due<T>, SourceError>>>;

/// A reading and when it is sent.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Due<T> {
    /// Data time; that of the reading, unless a fault makes it late.
    pub(crate) t: Time,
    pub(crate) reading: T,
}

impl<T: Message> Due<T> {
    /// When it is valid.
    pub(crate) fn when_valid(reading: T) -> Due<T> {
        Due { t: reading.t_valid(), reading }
    }
}

/// An open source with its faults.
#[derive(Debug)]
pub struct Source {
    origin: Origin,
    faults: Vec<FaultSpec>,
    fault_seed: Option<u64>,
}

#[derive(Debug)]
enum Origin {
    /// Simulated.
    World(World),
    /// Recorded.
    Log(LogDirectory),
}

impl Source {
    /// Opens what the arguments name.
    ///
    /// # Errors
    /// [`SourceError`], naming the scenario or log and the mend.
    pub fn open(args: &SourceArgs) -> Result<Source, SourceError> {
        let origin = match &args.log {
            Some(dir) => Origin::Log(LogDirectory::open(dir)?),
            None => Origin::World(World::new(&load_scenario(&args.scenario)?, args.preset.into(), args.seed)?),
        };
        Ok(Source { origin, faults: args.faults.clone(), fault_seed: args.fault_seed })
    }

    /// What stands between the readings and the bus; each emulator has one of its own, with the faults of its sensor in it.
    fn fault_stream(&self) -> FaultStream {
        match &self.origin {
            Origin::World(world) => world.faults(&self.faults, self.fault_seed),
            Origin::Log(_) => FaultStream::new(&self.faults, self.fault_seed.unwrap_or(1), ArrivalClock::Valid),
        }
    }

    /// The facts of the vehicle that come with the source.
    pub fn config(&self) -> Option<ConfigText> {
        match &self.origin {
            Origin::World(world) => Some(ConfigText::new("sensors.toml of the scenario", world.sensors_toml())),
            Origin::Log(log) => log.config().cloned(),
        }
    }

    /// Whether it knows where the vehicle really is.
    pub fn has_truth(&self) -> bool {
        match &self.origin {
            Origin::World(_) => true,
            Origin::Log(log) => log.has_truth(),
        }
    }

    /// Whether the sensor is fitted.
    pub fn has(&self, sensor: Sensor) -> bool {
        match &self.origin {
            // A scenario's sensor is fitted if it ever says something.
            Origin::World(world) => match sensor {
                Sensor::Imu => world.imu().next().is_some(),
                Sensor::Lbl => world.lbl().next().is_some(),
                Sensor::Gnss => world.gnss().next().is_some(),
                Sensor::Dvl => world.dvl().next().is_some(),
                Sensor::Mcp => world.mcp().next().is_some(),
                Sensor::Ps => world.ps().next().is_some(),
                Sensor::Buoys => world.buoys().next().is_some(),
            },
            Origin::Log(log) => log.has(sensor),
        }
    }

    /// Data time of the start: that of the scenario, or the first IMU sample of the log, which is when estimation can begin.
    ///
    /// # Errors
    /// [`SourceError::Log`] when that sample cannot be read.
    pub fn start(&self) -> Result<Time, SourceError> {
        match &self.origin {
            Origin::World(_) => Ok(Time(0)),
            Origin::Log(log) => Ok(log.imu()?.next().transpose()?.map_or(Time(0), |sample| sample.t_valid())),
        }
    }
}

/// Readings of each kind, whatever the source, as their sensor's faults leave them.
macro_rules! readings {
    ($($name:ident: $type:ty, $variant:ident;)*) => {
        impl Source {
            $(
                pub(crate) fn $name(&self) -> Result<Readings<$type>, SourceError> {
                    let raw: Box<dyn Iterator<Item = Result<RawReading, SourceError>>> = match &self.origin {
                        Origin::World(world) => Box::new(world.$name().map(|reading| Ok(RawReading::$variant(reading)))),
                        Origin::Log(log) => Box::new(log.$name()?.map(|reading| Ok(RawReading::$variant(reading?)))),
                    };
                    Ok(Box::new(self.fault_stream().over(raw).filter_map(|reading| match reading {
                        Ok(RawReading::$variant(reading)) => {
                            Some(Ok(Due { t: Time(reading.header.t_arrival), reading }))
                        }
                        Ok(_) => None,
                        Err(error) => Some(Err(error)),
                    })))
                }
            )*
        }
    };
}

readings! {
    imu: ImuSample, Imu;
    lbl: LblRange, Lbl;
    gnss: GnssFix, Gnss;
    dvl: DvlVelocity, Dvl;
    mcp: McpHeading, Mcp;
    ps: PsDepth, Ps;
    buoys: BuoyFix, Buoy;
}

impl Source {
    /// The truth, which no fault touches.
    pub(crate) fn truth(&self) -> Result<Readings<Truth>, SourceError> {
        Ok(match &self.origin {
            Origin::World(world) => Box::new(world.truth_rows(TRUTH_RATE).map(|truth| Ok(Due::when_valid(truth)))),
            Origin::Log(log) => Box::new(log.truth()?.map(|truth| Ok(Due::when_valid(truth?)))),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_reaches_the_readings_of_its_sensor_and_when_they_are_sent() {
        let faults = ["ps.bias=2@10..12", "ps.delay=3@10..12"].map(|spec| spec.parse().expect("a fault"));
        let args = |faults: &[FaultSpec]| SourceArgs {
            scenario: "stable".to_owned(),
            log: None,
            seed: 1,
            preset: PresetName::None,
            faults: faults.to_vec(),
            fault_seed: None,
        };
        let depths = |faults: &[FaultSpec]| -> Vec<Due<PsDepth>> {
            let source = Source::open(&args(faults)).expect("built in");
            source.ps().expect("fitted").take(200).map(|due| due.expect("simulated")).collect()
        };
        let (clean, faulty) = (depths(&[]), depths(&faults));
        assert!(clean.iter().all(|due| due.t == due.reading.t_valid()));
        let late: Vec<&Due<PsDepth>> = faulty.iter().filter(|due| due.t != due.reading.t_valid()).collect();
        assert_eq!(late.len(), 20);
        for due in late {
            let right = clean.iter().find(|clean| clean.t == due.reading.t_valid()).expect("the same instants");
            assert_eq!((due.t - due.reading.t_valid()).as_seconds(), 3.0);
            assert!((due.reading.depth - right.reading.depth - 2.0).abs() < 1e-12);
        }
        assert!(faulty.is_sorted_by_key(|due| due.t));
    }
}
