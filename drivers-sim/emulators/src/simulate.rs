//! `ilns simulate`: a scenario played into a log directory with its truth, without bus or clock.
//!
//! The directory gets its name when it is whole; until then it is called `DIR.partial-<process id>`.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use ilns_recording::{LogError, LogWriter, LogWriterOptions};
use sim_faults::{FaultSpec, FaultStream};
use sim_world::{Preset, World};

use crate::scenario_source::{ScenarioSourceError, load_scenario};

/// Rows of truth per second: scoring carries the estimate to the truth's time, not the other way round.
const TRUTH_RATE: f64 = 10.0;

/// What `ilns simulate` is asked for.
#[derive(Args, Clone, Debug)]
pub struct SimulateArgs {
    /// What is simulated: mission, stable, outage, survey, or the path of a scenario file.
    #[arg(value_name = "SCENARIO")]
    pub scenario: String,
    /// Which noise is drawn: the same seed gives the same log.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// How large the sensor errors are.
    #[arg(long, value_enum, default_value_t = PresetName::Paper)]
    pub preset: PresetName,
    /// Log directory to write; it must not exist or be empty.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// A fault, such as dvl.false_lock@600..660 or lbl.multipath=0.2 (drivers-sim/faults/README.md lists them). May be
    /// given several times. The log is then a recording: its rows say when they arrived.
    #[arg(long = "fault", value_name = "SPEC")]
    pub faults: Vec<FaultSpec>,
    /// What the faults draw; without it, --seed.
    #[arg(long, value_name = "N")]
    pub fault_seed: Option<u64>,
}

/// A [`Preset`] on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PresetName {
    /// Table I of the paper.
    Paper,
    /// The same with an accelerometer that exists: 100 µg/√Hz instead of the printed 0.1.
    Realistic,
    /// Exact readings.
    None,
}

impl From<PresetName> for Preset {
    fn from(name: PresetName) -> Preset {
        match name {
            PresetName::Paper => Preset::Paper,
            PresetName::Realistic => Preset::Realistic,
            PresetName::None => Preset::None,
        }
    }
}

/// A simulation that did not come about.
#[derive(Debug, thiserror::Error)]
pub enum SimulateError {
    /// The scenario.
    #[error(transparent)]
    Scenario(#[from] ScenarioSourceError),
    /// The output directory is in use.
    #[error("--out {}: it exists and is not an empty directory (choose another or delete it)", out.display())]
    OutInUse {
        /// As given.
        out: PathBuf,
    },
    /// A log file could not be written.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The finished directory could not be given its name.
    #[error("--out {}: cannot {action}", out.display())]
    Io {
        /// As given.
        out: PathBuf,
        /// What was tried.
        action: &'static str,
        /// Why.
        source: io::Error,
    },
}

/// Plays the scenario into `args.out`: all sensor files, `sensors.toml`, and `truth.csv`.
///
/// # Errors
/// [`SimulateError`]; the output directory then does not exist, or is as empty as it was.
pub fn run(args: &SimulateArgs) -> Result<(), SimulateError> {
    let scenario = load_scenario(&args.scenario)?;
    let world = World::new(&scenario, args.preset.into(), args.seed).map_err(ScenarioSourceError::from)?;
    refuse_used(&args.out)?;
    let partial = partial_name(&args.out);
    let written = write_log(&world, world.faults(&args.faults, args.fault_seed), &partial)
        .map_err(SimulateError::from)
        .and_then(|()| {
            let failed =
                |source| SimulateError::Io { out: args.out.clone(), action: "rename the finished log to it", source };
            fs::rename(&partial, &args.out).map_err(failed)
        });
    if written.is_err() && partial.exists() {
        let failed = |source| SimulateError::Io { out: partial.clone(), action: "delete the unfinished log", source };
        fs::remove_dir_all(&partial).map_err(failed)?;
    }
    written
}

fn refuse_used(out: &Path) -> Result<(), SimulateError> {
    let in_use = || SimulateError::OutInUse { out: out.to_owned() };
    match fs::read_dir(out) {
        Ok(mut entries) => entries.next().map_or(Ok(()), |_| Err(in_use())),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(error) if error.kind() == io::ErrorKind::NotADirectory => Err(in_use()),
        Err(source) => Err(SimulateError::Io { out: out.to_owned(), action: "look into it", source }),
    }
}

/// Beside the directory that it becomes, so that renaming moves no data.
fn partial_name(out: &Path) -> PathBuf {
    // Through its components, so that a slash at the end does not put it inside.
    let mut name = out.components().collect::<PathBuf>().into_os_string();
    name.push(format!(".partial-{}", std::process::id()));
    PathBuf::from(name)
}

fn write_log(world: &World, faults: FaultStream, dir: &Path) -> Result<(), LogError> {
    // Late and doubtful stamps run backwards in a file; only the order of arrival is one.
    let options = LogWriterOptions { arrival_columns: !faults.is_empty(), ..LogWriterOptions::default() };
    let mut log = LogWriter::create(dir, options)?;
    log.sensors_toml(&world.sensors_toml())?;
    faults.over(world.readings().map(Ok)).try_for_each(|reading| log.reading(&reading?))?;
    world.truth_rows(TRUTH_RATE).try_for_each(|truth| log.truth(&truth))?;
    log.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ilns_recording::LogDirectory;
    use shared_types::{RawReading, Sensor};
    use sim_world::BUILTIN_SCENARIOS;

    /// A minute of the stable run, so that the test is short.
    fn args(dir: &Path) -> SimulateArgs {
        let scenario = dir.join("minute.toml");
        fs::write(&scenario, BUILTIN_SCENARIOS[1].1.replace("until = 617.0", "until = 60.0")).expect("it is writable");
        SimulateArgs {
            scenario: scenario.to_str().expect("it is UTF-8").to_owned(),
            seed: 3,
            preset: PresetName::Realistic,
            out: dir.join("logs/run"),
            faults: Vec::new(),
            fault_seed: None,
        }
    }

    fn names(dir: &Path) -> Vec<String> {
        let entries = fs::read_dir(dir).expect("it exists");
        let mut names: Vec<String> =
            entries.map(|entry| entry.expect("it is readable").file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_simulated_log_reads_back_to_the_readings_of_the_world() {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let args = args(dir.path());
        run(&args).expect("it is written");
        assert_eq!(names(&dir.path().join("logs")), ["run"]);
        let expected = ["buoys.csv", "dvl.csv", "imu.csv", "lbl.csv", "mcp.csv", "ps.csv", "sensors.toml", "truth.csv"];
        assert_eq!(names(&args.out), expected);

        let scenario = load_scenario(&args.scenario).expect("it is valid");
        let world = World::new(&scenario, Preset::Realistic, 3).expect("it is valid");
        let log = LogDirectory::open(&args.out).expect("it is a log");
        let mut read = 0;
        for (found, made) in log.merged().expect("it opens").zip(world.readings()) {
            let found = found.expect("it reads");
            assert_eq!(found.t_valid(), made.t_valid());
            match (found, made) {
                (RawReading::Imu(a), RawReading::Imu(b)) => {
                    assert_eq!((a.gyro_body, a.accel_body), (b.gyro_body, b.accel_body));
                }
                (RawReading::Lbl(a), RawReading::Lbl(b)) => {
                    assert_eq!((a.buoy, a.range, a.in_epoch), (b.buoy, b.range, b.in_epoch));
                }
                (RawReading::Dvl(a), RawReading::Dvl(b)) => assert_eq!(a.velocity_dvl, b.velocity_dvl),
                (a, b) => assert_eq!(a.sensor(), b.sensor()),
            }
            read += 1;
        }
        assert_eq!(read, world.readings().count());
        let truths = log.truth().expect("it opens").map(|row| row.expect("it reads"));
        assert!(truths.map(|row| row.q_enu_body).eq(world.truth_rows(TRUTH_RATE).map(|row| row.q_enu_body)));
    }

    #[test]
    fn a_log_with_faults_reads_back_in_the_order_of_arrival() {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let faults = ["dvl.delay=2@20..30", "ps.nan=0.5@20..30", "lbl.stamp=-0.3@20..30", "mcp.duplicate=1@20..30"];
        let faults = faults.map(|spec| spec.parse().expect("a fault"));
        let args = SimulateArgs { faults: faults.to_vec(), ..args(dir.path()) };
        run(&args).expect("it is written");
        let log = LogDirectory::open(&args.out).expect("it is a log");
        assert!(log.is_recording());
        let read: Vec<RawReading> = log.merged().expect("it opens").map(|r| r.expect("it reads")).collect();
        let of = |sensor: Sensor| read.iter().filter(move |reading| reading.sensor() == sensor);
        let late = of(Sensor::Dvl).filter(|r| r.header().t_arrival - r.header().t_valid == 2_000_000_000).count();
        assert_eq!(late, 50);
        let early = of(Sensor::Lbl).filter(|r| r.header().t_arrival - r.header().t_valid == 300_000_000).count();
        assert_eq!(early, 40);
        assert!(of(Sensor::Ps).any(|r| matches!(r, RawReading::Ps(ps) if ps.depth.is_nan())));
        assert_eq!(of(Sensor::Mcp).count(), 700);
        assert!(read.is_sorted_by_key(|reading| reading.header().t_arrival));
        assert!(log.truth().expect("it opens").all(|row| row.is_ok_and(|row| row.lat_deg.is_finite())));
    }

    #[test]
    fn a_directory_in_use_is_refused_and_left_as_it_was() {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let args = args(dir.path());
        fs::create_dir_all(&args.out).expect("it can be made");
        fs::write(args.out.join("imu.csv"), "precious").expect("it is writable");
        let error = run(&args).expect_err("it is in use").to_string();
        assert!(error.ends_with("it exists and is not an empty directory (choose another or delete it)"), "{error}");
        assert_eq!(names(&args.out), ["imu.csv"]);
        assert_eq!(names(&dir.path().join("logs")), ["run"]);

        let file = SimulateArgs { out: args.out.join("imu.csv"), ..args };
        assert!(matches!(run(&file), Err(SimulateError::OutInUse { .. })));
    }

    #[test]
    fn an_empty_directory_is_filled() {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let args = args(dir.path());
        fs::create_dir_all(&args.out).expect("it can be made");
        run(&args).expect("it is written");
        assert!(args.out.join("truth.csv").exists());
    }

    #[test]
    fn an_unknown_scenario_leaves_no_trace() {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let args = SimulateArgs { scenario: "misson".to_owned(), ..args(dir.path()) };
        assert!(matches!(run(&args), Err(SimulateError::Scenario(_))));
        assert!(!dir.path().join("logs").exists());
    }
}
