//! What every process of the set, and what every command that navigates, is told on its command line.

use std::path::PathBuf;

use rustix::process::{Signal, getppid, set_parent_process_death_signal};
use shared_types::{AIDING, Config, ConfigText, Process, Sensor};

use crate::clock::StartClock;
use crate::configuration::load_config;
use crate::error::RuntimeError;
use crate::logging::start_logging;
use crate::real_time::RealTime;
use crate::shutdown::Shutdown;

/// Under which name a set runs unless told otherwise.
pub const DEFAULT_PREFIX: &str = "main";

/// What a process of the set is told.
#[derive(Clone, Debug, clap::Args)]
pub struct ProcessArgs {
    /// Name of the set to which this process belongs. Sets with different names do not hear each other.
    #[arg(long, value_name = "NAME", default_value = DEFAULT_PREFIX)]
    pub prefix: String,
    /// TOML file with vehicle and navigator settings. Without it every setting has its documented default.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// One setting that overrides the file, such as fgo.window=30. May be given several times.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub sets: Vec<String>,
    /// Which data time (ns) belongs to which CLOCK_MONOTONIC time (ns), and how fast data time runs. The supervisor gives
    /// every process the same.
    #[arg(long, value_name = "DATA_NS,MONO_NS,RATE", allow_hyphen_values = true)]
    pub start: Option<StartClock>,
    /// TOML file with cores, priorities and wake-ups of the processes. Without it the system schedules as it likes.
    #[arg(long, value_name = "FILE")]
    pub processes: Option<PathBuf>,
    /// How often this process has been restarted.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub epoch: u32,
    /// Process number of the supervisor, with which this process ends.
    #[arg(long, value_name = "PID")]
    pub supervisor: Option<u32>,
    /// Least severity that is logged: error, warn, info, debug or trace.
    #[arg(long, value_name = "LEVEL", default_value = "info")]
    pub log_level: String,
    /// Log one JSON object per line.
    #[arg(long)]
    pub log_json: bool,
}

/// As an empty command line.
impl Default for ProcessArgs {
    fn default() -> ProcessArgs {
        ProcessArgs {
            prefix: DEFAULT_PREFIX.to_owned(),
            config: None,
            sets: Vec::new(),
            start: None,
            processes: None,
            epoch: 0,
            supervisor: None,
            log_level: "info".to_owned(),
            log_json: false,
        }
    }
}

impl ProcessArgs {
    /// Begins a process: log lines, the wish to stop, and its end with the supervisor's.
    ///
    /// # Errors
    /// [`RuntimeError`] when the log level is none, signals cannot be caught, or the supervisor is gone already.
    pub fn begin(&self) -> Result<Shutdown, RuntimeError> {
        start_logging(&self.log_level, self.log_json)?;
        let shutdown = Shutdown::on_signals()?;
        if let Some(supervisor) = self.supervisor {
            set_parent_process_death_signal(Some(Signal::TERM)).map_err(|e| RuntimeError::Signals(e.into()))?;
            // It may have died before the line above.
            if getppid().is_none_or(|parent| parent.as_raw_nonzero().get() as u32 != supervisor) {
                return Err(RuntimeError::Orphaned { supervisor });
            }
        }
        Ok(shutdown)
    }

    /// The configuration of this process.
    ///
    /// # Errors
    /// As [`load_config`].
    pub fn load_config(&self) -> Result<Config, RuntimeError> {
        load_config(&[], self.config.as_deref(), &self.sets)
    }

    /// What this process is to ask of the system before its loop.
    ///
    /// # Errors
    /// [`RuntimeError::Processes`], naming file and line.
    pub fn real_time(&self, process: Process) -> Result<RealTime, RuntimeError> {
        Ok(RealTime::of(process, self.processes.as_deref())?)
    }
}

/// How to navigate: what `ilns run` and `ilns replay` are told alike.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct NavigatorArgs {
    /// TOML file with vehicle and navigator settings, on top of those that come with the scenario or log.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Which estimator navigates: fgo (the smoother), ekf or fkf (Kalman filters to compare with).
    #[arg(long, value_name = "NAME")]
    pub estimator: Option<String>,
    /// Length of the sliding window in keyframe intervals, 2 to 500.
    #[arg(long, value_name = "N")]
    pub window: Option<u32>,
    /// One setting that overrides every file, such as dvl.kernel=huber. May be given several times.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub sets: Vec<String>,
    /// Navigate without acoustic ranges.
    #[arg(long)]
    pub no_lbl: bool,
    /// Navigate without satellite fixes.
    #[arg(long)]
    pub no_gnss: bool,
    /// Navigate without Doppler velocities.
    #[arg(long)]
    pub no_dvl: bool,
    /// Navigate without compass headings.
    #[arg(long)]
    pub no_mcp: bool,
    /// Navigate without depths.
    #[arg(long)]
    pub no_ps: bool,
    /// Print the whole effective configuration as TOML and end.
    #[arg(long)]
    pub print_config: bool,
}

impl NavigatorArgs {
    /// The effective configuration; `first` comes with the scenario or log.
    ///
    /// # Errors
    /// As [`load_config`].
    pub fn load_config(&self, first: &[ConfigText]) -> Result<Config, RuntimeError> {
        load_config(first, self.config.as_deref(), &self.overrides())
    }

    /// The options that stand for a `--set`, then every `--set`, which therefore has the last word.
    fn overrides(&self) -> Vec<String> {
        let mut sets: Vec<String> = self.estimator.iter().map(|name| format!("estimator={name}")).collect();
        sets.extend(self.window.map(|window| format!("fgo.window={window}")));
        let dropped = AIDING.into_iter().filter(|&sensor| self.drops(sensor));
        sets.extend(dropped.map(|sensor| format!("{}.enabled=false", sensor.name())));
        sets.extend(self.sets.iter().cloned());
        sets
    }

    fn drops(&self, sensor: Sensor) -> bool {
        match sensor {
            Sensor::Lbl => self.no_lbl,
            Sensor::Gnss => self.no_gnss,
            Sensor::Dvl => self.no_dvl,
            Sensor::Mcp => self.no_mcp,
            Sensor::Ps => self.no_ps,
            Sensor::Imu | Sensor::Buoys => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_and_files_reach_the_configuration_and_options_win() {
        let folder = std::env::temp_dir().join(format!("ilns-runtime-{}.toml", std::process::id()));
        std::fs::write(&folder, "[fgo]\nwindow = 40\nmax_iterations = 7\n").expect("writable");
        let args = NavigatorArgs {
            config: Some(folder.clone()),
            window: Some(12),
            no_dvl: true,
            sets: vec!["lbl.enabled=false".to_owned()],
            ..NavigatorArgs::default()
        };
        let navigator = args.load_config(&[ConfigText::new("log", "[fgo]\nwindow = 30\n")]).expect("valid").navigator;
        std::fs::remove_file(folder).expect("written above");
        assert_eq!((navigator.fgo.window, navigator.fgo.max_iterations), (12, 7));
        let enabled =
            AIDING.map(|sensor| navigator.sensors[AIDING.iter().position(|&s| s == sensor).expect("aiding")].enabled);
        assert_eq!(enabled, [false, true, false, true, true], "lbl, gnss, dvl, mcp, ps");
    }

    #[test]
    fn a_missing_configuration_is_named() {
        let args = NavigatorArgs { config: Some("/no/such.toml".into()), ..NavigatorArgs::default() };
        let error = args.load_config(&[]).expect_err("missing");
        assert!(error.to_string().contains("/no/such.toml"), "{error}");
    }
}
