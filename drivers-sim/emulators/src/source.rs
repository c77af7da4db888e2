//! Where the emulated readings come from: a simulated world or a recorded log.

use std::path::PathBuf;

use clap::ValueEnum;
use ilns_recording::{LogDirectory, LogError};
use shared_types::{
    BuoyFix, ConfigText, DvlVelocity, GnssFix, ImuSample, LblRange, McpHeading, Message, PsDepth, Sensor, Time, Truth,
};
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
pub(crate) type Readings<T> = Box<dyn Iterator<Item = Result<T, SourceError>>>;

/// An open source.
#[derive(Debug)]
pub enum Source {
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
        match &args.log {
            Some(dir) => Ok(Source::Log(LogDirectory::open(dir)?)),
            None => Ok(Source::World(World::new(&load_scenario(&args.scenario)?, args.preset.into(), args.seed)?)),
        }
    }

    /// The facts of the vehicle that come with the source.
    pub fn config(&self) -> Option<ConfigText> {
        match self {
            Source::World(world) => Some(ConfigText::new("sensors.toml of the scenario", world.sensors_toml())),
            Source::Log(log) => log.config().cloned(),
        }
    }

    /// Whether it knows where the vehicle really is.
    pub fn has_truth(&self) -> bool {
        match self {
            Source::World(_) => true,
            Source::Log(log) => log.has_truth(),
        }
    }

    /// Whether the sensor is fitted.
    pub fn has(&self, sensor: Sensor) -> bool {
        match self {
            // A scenario's sensor is fitted if it ever says something.
            Source::World(world) => match sensor {
                Sensor::Imu => world.imu().next().is_some(),
                Sensor::Lbl => world.lbl().next().is_some(),
                Sensor::Gnss => world.gnss().next().is_some(),
                Sensor::Dvl => world.dvl().next().is_some(),
                Sensor::Mcp => world.mcp().next().is_some(),
                Sensor::Ps => world.ps().next().is_some(),
                Sensor::Buoys => world.buoys().next().is_some(),
            },
            Source::Log(log) => log.has(sensor),
        }
    }

    /// Data time of the start: that of the scenario, or the first IMU sample of the log, which is when estimation can begin.
    ///
    /// # Errors
    /// [`SourceError::Log`] when that sample cannot be read.
    pub fn start(&self) -> Result<Time, SourceError> {
        match self {
            Source::World(_) => Ok(Time(0)),
            Source::Log(log) => Ok(log.imu()?.next().transpose()?.map_or(Time(0), |sample| sample.t_valid())),
        }
    }
}

/// Readings of each kind, whatever the source.
macro_rules! readings {
    ($($(#[$meta:meta])* $name:ident: $type:ty;)*) => {
        impl Source {
            $(
                $(#[$meta])*
                pub(crate) fn $name(&self) -> Result<Readings<$type>, SourceError> {
                    Ok(match self {
                        Source::World(world) => Box::new(world.$name().map(Ok)),
                        Source::Log(log) => Box::new(log.$name()?.map(|reading| Ok(reading?))),
                    })
                }
            )*

            pub(crate) fn truth(&self) -> Result<Readings<Truth>, SourceError> {
                Ok(match self {
                    Source::World(world) => Box::new(world.truth_rows(TRUTH_RATE).map(Ok)),
                    Source::Log(log) => Box::new(log.truth()?.map(|truth| Ok(truth?))),
                })
            }
        }
    };
}

readings! {
    imu: ImuSample;
    lbl: LblRange;
    gnss: GnssFix;
    dvl: DvlVelocity;
    mcp: McpHeading;
    ps: PsDepth;
    buoys: BuoyFix;
}
