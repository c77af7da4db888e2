//! Whatever a file or a message holds: a value or one line that says what is wrong; no panic, nothing without end.
//!
//! Good files of each kind lie in `tests/corpus` of the crate concerned, and in `deploy/`. Each test says how often it ran its
//! parser: `cargo test --release --test fuzz -- --nocapture`. `ILNS_FUZZ=20` makes that twenty times as often.

mod mutation;

use std::fs;
use std::path::{Path, PathBuf};

use ilns_monitor::Model;
use ilns_propagator::FastPath;
use ilns_recording::mcap::{McapWriter, RecorderStatus, export, inspect, recover};
use ilns_recording::{
    Checkpoint, Durability, LogDirectory, read_checkpoint, read_estimates, read_truth, read_tum, write_checkpoint,
};
use ilns_runtime::{ProcessFile, StartClock};
use mutation::{Spoilt, fuzz, wounded};
use nav_pipeline::{ChosenEstimator, Effort, Estimator, LastKnown};
use proptest::prelude::*;
use proptest::test_runner::TestCaseResult;
use shared_types::{
    Clocks, Config, ConfigText, Duration, FrameOrigin, Header, Heartbeat, HopLatency, ImuSample, KeyframeCause,
    KeyframeReport, LblRange, Measurement, Mode, NavEstimate, RawReading, Reading, SensorHealth, Solution, Time, Truth,
};
use tempfile::TempDir;

/// How often, in an ordinary run times `ILNS_FUZZ`.
fn times(executions: u32) -> u32 {
    let factor = std::env::var("ILNS_FUZZ").ok().and_then(|factor| factor.parse().ok()).unwrap_or(1);
    executions.saturating_mul(factor)
}

fn read(path: &str) -> Vec<u8> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn one_line(error: &dyn std::error::Error) -> Result<(), TestCaseError> {
    let line = ilns_runtime::one_line(error);
    let is_legible = !line.is_empty() && line.chars().count() <= 1_000 && !line.chars().any(char::is_control);
    prop_assert!(is_legible, "{line:?}");
    Ok(())
}

const LOG: [&str; 9] =
    ["imu.csv", "lbl.csv", "buoys.csv", "gnss.csv", "dvl.csv", "mcp.csv", "ps.csv", "truth.csv", "sensors.toml"];

/// In memory where there is such a place: a disk would be most of the time.
fn temporary() -> TempDir {
    let memory = Path::new("/dev/shm");
    let place = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
    tempfile::tempdir_in(place).expect("a temporary folder")
}

fn log_folder() -> TempDir {
    let folder = temporary();
    for name in LOG {
        let good = read(&format!("services/recording/tests/corpus/log/{name}"));
        fs::write(folder.path().join(name), good).expect("writable");
    }
    folder
}

/// Everything that a log directory is asked for.
fn read_log(folder: &Path) -> Result<usize, ilns_recording::LogError> {
    let log = LogDirectory::open(folder)?;
    log.check_buoys()?;
    let mut rows = 0;
    if log.has_truth() {
        for row in log.truth()? {
            row?;
            rows += 1;
        }
    }
    for reading in log.merged()? {
        reading?;
        rows += 1;
    }
    Ok(rows)
}

#[test]
fn the_corpus_itself_is_good() {
    assert_eq!(read_log(log_folder().path()).expect("it is a good log"), 3 + 3 + 2 + 2 + 2 + 2 + 2 + 2);
}

#[test]
fn a_log_directory_with_any_file_spoilt_is_read_or_refused_in_one_line() {
    let folder = log_folder();
    let mut corpus: Vec<Vec<u8>> =
        LOG.iter().map(|name| read(&format!("services/recording/tests/corpus/log/{name}"))).collect();
    // As a recorder writes it; in the place of the first.
    corpus.push(read("services/recording/tests/corpus/log-recorded-imu.csv"));
    fuzz("log directory", times(8_000), wounded(corpus.clone()), |Spoilt { index, bytes }| {
        let name = LOG[index % LOG.len()];
        let length = bytes.len();
        fs::write(folder.path().join(name), bytes).expect("writable");
        let outcome = read_log(folder.path());
        fs::write(folder.path().join(name), &corpus[index % LOG.len()]).expect("writable");
        match outcome {
            // A row takes two bytes at least.
            Ok(rows) => prop_assert!(rows <= 32 + length, "{rows} rows out of {length} bytes"),
            Err(error) => one_line(&error)?,
        }
        Ok(())
    });
}

#[test]
fn estimates_truths_and_trajectories_are_read_or_refused_in_one_line() {
    let folder = temporary();
    let file = folder.path().join("file");
    let corpus = vec![
        read("services/recording/tests/corpus/estimate.csv"),
        read("services/recording/tests/corpus/log/truth.csv"),
        read("services/recording/tests/corpus/estimate.tum"),
    ];
    fuzz("estimate.csv, truth.csv, *.tum", times(20_000), wounded(corpus), |Spoilt { index, bytes }| {
        fs::write(&file, &bytes).expect("writable");
        let rows = match index {
            0 => read_estimates(&file).and_then(|rows| rows.collect::<Result<Vec<_>, _>>()).map(|rows| rows.len()),
            1 => read_truth(&file).and_then(|rows| rows.collect::<Result<Vec<_>, _>>()).map(|rows| rows.len()),
            _ => read_tum(&file).map(|rows| rows.len()),
        };
        match rows {
            Ok(rows) => prop_assert!(rows <= bytes.len()),
            Err(error) => one_line(&error)?,
        }
        Ok(())
    });
}

#[test]
fn settings_are_refused_in_one_line_or_come_back_from_their_own_print() {
    let corpus = vec![
        read("shared-types/tests/corpus/navigator.toml"),
        read("deploy/navigator.toml"),
        read("services/recording/tests/corpus/log/sensors.toml"),
    ];
    fuzz("settings (TOML)", times(20_000), wounded(corpus), |Spoilt { bytes, .. }| {
        let Ok(text) = String::from_utf8(bytes) else { return Ok(()) };
        match Config::load(&[ConfigText::new("file.toml", text)], &[]) {
            Ok(config) => {
                let again = Config::load(&[ConfigText::new("again.toml", config.to_toml())], &[]);
                prop_assert_eq!(again.expect("what is printed can be read"), config);
            }
            Err(error) => one_line(&error)?,
        }
        Ok(())
    });
}

#[test]
fn a_single_setting_on_the_command_line_is_taken_or_refused_in_one_line() {
    let corpus = ["fgo.window=30", "dvl.lever_arm=[1,2,3]", "estimator=ekf", "lbl.common_offset_sigma=inf"];
    let corpus = corpus.iter().map(|text| text.as_bytes().to_vec()).collect();
    fuzz("--set, --start", times(20_000), wounded(corpus), |Spoilt { bytes, .. }| {
        let text = String::from_utf8_lossy(&bytes).into_owned();
        if let Err(error) = text.parse::<StartClock>() {
            one_line(&error)?;
        }
        if let Err(error) = Config::load(&[], &[text]) {
            one_line(&error)?;
        }
        Ok(())
    });
}

#[test]
fn a_scenario_is_sailed_or_refused_in_one_line() {
    let corpus = vec![read("tests/short.toml"), read("deploy/scenarios/stable.toml")];
    fuzz("scenario (TOML)", times(8_000), wounded(corpus), |Spoilt { bytes, .. }| {
        let Ok(text) = String::from_utf8(bytes) else { return Ok(()) };
        let scenario = match sim_world::Scenario::parse(&text, Path::new("scenario.toml")) {
            Ok(scenario) => scenario,
            Err(error) => return one_line(&error),
        };
        match sim_world::World::new(&scenario, sim_world::Preset::Realistic, 1) {
            Ok(world) => {
                for sample in world.imu().take(3) {
                    prop_assert!(sample.gyro_body.iter().chain(&sample.accel_body).all(|number| number.is_finite()));
                }
            }
            Err(error) => one_line(&error)?,
        }
        Ok(())
    });
}

#[test]
fn a_process_file_is_taken_or_refused_in_one_line() {
    let corpus = vec![read("deploy/bench.toml"), read("deploy/vehicle.toml")];
    fuzz("process file (TOML)", times(20_000), wounded(corpus), |Spoilt { bytes, .. }| {
        let Ok(text) = String::from_utf8(bytes) else { return Ok(()) };
        if let Err(error) = ProcessFile::parse(&text, Path::new("processes.toml"), 4) {
            one_line(&error)?;
        }
        Ok(())
    });
}

/// A sound solution.
fn solution() -> Solution {
    let mut solution = Solution {
        header: Header { t_published: 1_000, ..Header::at(Time(17_000_000_000)) },
        id: 41,
        t_keyframe: 17_000_000_000,
        keyframes: 20,
        ..Solution::empty()
    };
    (0..15).for_each(|axis| solution.covariance[axis][axis] = 0.01 * (axis as f64 + 1.0));
    solution
}

/// As a checkpoint, whose checksum stands at bytes 12 to 16 and covers what follows.
fn checkpoint(folder: &Path) -> (PathBuf, Vec<u8>) {
    let file = folder.join("solution");
    write_checkpoint(&file, &written(), Durability::Process).expect("writable");
    let bytes = fs::read(&file).expect("just written");
    (file, bytes)
}

fn written() -> Checkpoint {
    Checkpoint { configuration: 7, written: Clocks { boot: 5, mono: 1_000, wall: 1_000 }, solution: solution() }
}

#[test]
fn no_spoilt_checkpoint_is_taken_up() {
    let folder = temporary();
    let (file, good) = checkpoint(folder.path());
    fuzz("checkpoint", times(20_000), wounded(vec![good.clone()]), |Spoilt { bytes, .. }| {
        prop_assume!(bytes != good);
        fs::write(&file, bytes).expect("writable");
        one_line(&read_checkpoint(&file).expect_err("it is spoilt"))
    });
}

#[test]
fn a_checkpoint_with_a_right_checksum_over_wrong_content_does_no_harm() {
    let folder = temporary();
    let (file, good) = checkpoint(folder.path());
    fuzz(
        "checkpoint, checksum made right",
        times(20_000),
        wounded(vec![good[16..].to_vec()]),
        |Spoilt { bytes: payload, .. }| {
            let mut bytes = good[..12].to_vec();
            bytes.extend(crc32fast::hash(&payload).to_le_bytes());
            bytes.extend(payload);
            fs::write(&file, bytes).expect("writable");
            match read_checkpoint(&file) {
                Ok(Some(Checkpoint { solution, .. })) => stand_on(&solution).and_then(|()| begin_from(&solution)),
                Ok(None) => unreachable!("the file is there"),
                Err(error) => one_line(&error),
            }
        },
    );
}

/// Estimates that stand on a solution, whatever it holds, are sound, or there are none.
fn stand_on(solution: &Solution) -> TestCaseResult {
    let mut fast_path = FastPath::new(&Config::default());
    let _refused = fast_path.rebase(solution);
    for step in 0..4 {
        if let Some(estimate) =
            fast_path.advance(&sample(17_000_000_000 + step * 5_000_000, [0.0, 0.0, 0.1, 0.0, 0.0, 9.8]))
        {
            is_sound(&estimate)?;
        }
    }
    if let Some(estimate) = fast_path.without_imu(Time(18_000_000_000)) {
        is_sound(&estimate)?;
    }
    Ok(())
}

/// A run that begins from the last place known, whatever that is, begins with numbers, or does not begin.
fn begin_from(solution: &Solution) -> TestCaseResult {
    let start = Time(20_000_000_000);
    let Some(last) = LastKnown::of(solution, start) else { return Ok(()) };
    let mut estimator = ChosenEstimator::new(&Config::default());
    estimator.set_origin(&FrameOrigin { header: Header::at(start), lat_deg: 36.0, lon_deg: 127.0, height: 0.0 });
    estimator.remember(&last);
    let mut told = None;
    let mut hear = |t: Time, reading: &Reading| {
        if let Ok(Some(found)) = estimator.ingest(&Measurement::new(t, t, reading), Effort::Full) {
            told = Some(found);
        }
    };
    let end = start + Duration(2_500_000_000);
    for step in 0..=50 {
        let t = start + Duration(step * 50_000_000);
        hear(t, &Reading::Imu { gyro_body: [0.0, 0.0, 0.1], accel_body: [0.0, 0.0, 9.8] });
    }
    hear(end, &Reading::Mcp { heading: 1.0 });
    hear(end, &Reading::Keyframe { cause: KeyframeCause::Age });
    let Some(told) = told else { return Ok(()) };
    let vectors = [&told.position_enu[..], &told.velocity_enu, &told.q_enu_body];
    let mut numbers = vectors.into_iter().chain(told.covariance.iter().map(|row| &row[..])).flatten();
    prop_assert!(numbers.all(|number| number.is_finite()), "{:?}", told);
    prop_assert!((0..15).all(|axis| told.covariance[axis][axis] > 0.0), "{:?}", told);
    Ok(())
}

fn is_sound(e: &NavEstimate) -> TestCaseResult {
    let vectors = [&e.position_enu[..], &e.velocity_enu, &e.q_enu_body, &e.accel_bias, &e.gyro_bias, &e.lat_lon_h];
    let covariances = [&e.position_cov[..], &e.velocity_cov, &e.attitude_cov, &e.sigma_rpy];
    let mut numbers = vectors.iter().chain(&covariances).flat_map(|numbers| numbers.iter());
    prop_assert!(numbers.all(|number| number.is_finite()), "{:?}", e);
    Ok(())
}

fn sample(t: i64, numbers: [f64; 6]) -> ImuSample {
    let [wx, wy, wz, fx, fy, fz] = numbers;
    ImuSample { header: Header::at(Time(t)), gyro_body: [wx, wy, wz], accel_body: [fx, fy, fz] }
}

/// Any `f64` there is, the awkward ones often.
fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -200.0..200.0_f64,
        2 => any::<u64>().prop_map(f64::from_bits),
        1 => prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(f64::NEG_INFINITY), Just(0.0), Just(-0.0), Just(f64::MAX)],
    ]
}

fn any_time() -> impl Strategy<Value = i64> {
    prop_oneof![4 => 0..60_000_000_000_i64, 1 => any::<i64>(), 1 => prop_oneof![Just(i64::MIN), Just(i64::MAX)]]
}

#[test]
fn a_measurement_of_any_content_is_a_checked_reading_or_named() {
    let drawn = (any_time(), any_time(), prop_oneof![0..8_u32, Just(100), any::<u32>()], any::<u32>());
    let drawn = (drawn, prop::collection::vec(any_number(), 12));
    fuzz("nav/measurements", times(100_000), drawn, |((t_valid, t_keyframe, kind, epoch), values)| {
        let values = values.try_into().expect("twelve");
        let message = Measurement { header: Header::at(Time(t_valid)), t_keyframe, kind, epoch, values };
        match Reading::try_from(&message) {
            Ok(Reading::Imu { gyro_body, accel_body }) => {
                prop_assert!(gyro_body.iter().chain(&accel_body).all(|number| number.is_finite()));
            }
            Ok(Reading::Lbl { range, buoy_enu, buoy_sigma, .. }) => {
                prop_assert!(range.is_finite() && range > 0.0 && buoy_sigma.is_finite() && buoy_sigma >= 0.0);
                prop_assert!(buoy_enu.iter().all(|number| number.is_finite()));
            }
            Ok(Reading::Gnss { antenna_enu, sigma_enu }) => {
                prop_assert!(antenna_enu.iter().all(|number| number.is_finite()));
                prop_assert!(sigma_enu.iter().all(|&sigma| sigma > 0.0));
            }
            Ok(Reading::Dvl { velocity_dvl }) => prop_assert!(velocity_dvl.iter().all(|number| number.is_finite())),
            Ok(Reading::Mcp { heading: number } | Reading::Ps { depth: number }) => prop_assert!(number.is_finite()),
            Ok(Reading::Keyframe { .. }) => {}
            Err(error) => one_line(&error)?,
        }
        Ok(())
    });
}

#[test]
fn the_fast_path_publishes_sound_estimates_or_none_whatever_samples_and_solutions_hold() {
    let samples = prop::collection::vec((any_time(), prop::array::uniform6(any_number())), 1..6);
    let drawn = (samples, any_time(), prop::collection::vec(any_number(), 16), 0..256_usize, any_number());
    fuzz("sensor/imu, nav/solution", times(20_000), drawn, |(samples, t_keyframe, numbers, at, entry)| {
        let mut wild = Solution { t_keyframe, ..solution() };
        wild.position_enu.copy_from_slice(&numbers[..3]);
        wild.velocity_enu.copy_from_slice(&numbers[3..6]);
        if at % 2 == 0 {
            wild.q_enu_body.copy_from_slice(&numbers[6..10]);
            wild.origin.copy_from_slice(&numbers[10..13]);
        }
        wild.accel_bias.copy_from_slice(&numbers[13..16]);
        if at < 225 {
            wild.covariance[at / 15][at % 15] = entry;
        }
        let mut fast_path = FastPath::new(&Config::default());
        for (index, (t, numbers)) in samples.into_iter().enumerate() {
            if index == 1 {
                let _refused = fast_path.rebase(&wild);
            }
            if let Some(estimate) = fast_path.advance(&sample(t, numbers)) {
                is_sound(&estimate)?;
            }
        }
        stand_on(&wild)
    });
}

#[test]
fn the_monitor_shows_messages_of_any_content() {
    let drawn =
        (any_time(), prop::collection::vec(any_number(), 16), prop::collection::vec(any::<u32>(), 8), any::<u64>());
    fuzz("health, nav/*, sim/truth at the monitor", times(20_000), drawn, |(t, numbers, words, long)| {
        let triple = |at: usize| [numbers[at], numbers[at + 1], numbers[at + 2]];
        let header =
            Header { sequence: long, epoch: words[0], source: words[1] as u16, t_published: t, ..Header::at(Time(t)) };
        let mut model = Model::new("fuzz");
        let origin = FrameOrigin { header, lat_deg: numbers[0], lon_deg: numbers[1], height: numbers[2] };
        model.frame_origin(&origin);
        let hop = HopLatency {
            count: long,
            p50_ns: long,
            p90_ns: 0,
            p99_ns: u64::MAX,
            p99_9_ns: 1,
            p99_99_ns: 2,
            max_ns: long,
        };
        model.heartbeat(&Heartbeat {
            header,
            process: words[2] % 20,
            state: words[3] % 9,
            pid: words[4],
            restarts: words[5],
            cpu_ns: long,
            resident_bytes: long,
            dropped: long,
            handled: long,
            sensors: [SensorHealth { received: long, lost: long, ..SensorHealth::NONE }; 7],
            hop_in: hop,
            end_to_end: hop,
            work: hop,
        });
        let mut report =
            KeyframeReport { header, solution: long, t_keyframe: t, factor_count: words[6], ..KeyframeReport::empty() };
        report.factors_left_out = words[7];
        model.diagnostics(&report);
        model.solution(&Solution {
            header,
            id: long,
            t_keyframe: t,
            position_enu: triple(3),
            status: words[5],
            ..solution()
        });
        model.lbl(&LblRange { header, buoy: words[6], in_epoch: words[7], range: numbers[6] });
        let estimate = NavEstimate {
            header,
            solution: long,
            t_keyframe: t,
            position_enu: triple(0),
            velocity_enu: triple(3),
            q_enu_body: [numbers[6], numbers[7], numbers[8], numbers[9]],
            accel_bias: triple(10),
            gyro_bias: triple(11),
            position_cov: [numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[5]],
            velocity_cov: [numbers[1]; 6],
            attitude_cov: [numbers[2]; 6],
            sigma_rpy: triple(12),
            lat_lon_h: triple(13),
            aiding_age: [numbers[5]; 5],
            mode: words[7] % 7,
            reserved: 0,
        };
        model.estimate(&estimate);
        model.estimate(&NavEstimate { mode: Mode::Ok as u32, ..estimate });
        model.truth(&Truth {
            header,
            lat_deg: numbers[3],
            lon_deg: numbers[4],
            height: numbers[5],
            q_enu_body: [numbers[9], numbers[8], numbers[7], numbers[6]],
            velocity_enu: triple(0),
        });
        model.settle(t);
        let json = serde_json::to_string(&model.snapshot());
        prop_assert!(json.is_ok(), "{json:?}");
        Ok(())
    });
}

#[test]
fn an_mcap_is_read_recovered_and_exported_or_refused_in_one_line() {
    let folder = temporary();
    let good = folder.path().join("good.mcap");
    let mut writer = McapWriter::create(&good, "[lbl]\nsigma = 1.0\n").expect("writable");
    let log = log_folder();
    let readings = LogDirectory::open(log.path()).and_then(|log| log.merged()).expect("a good log");
    for reading in readings {
        let reading: RawReading = reading.expect("good");
        writer.reading(&reading).expect("writable");
    }
    writer.flush(RecorderStatus::default()).expect("writable");
    writer.finish().expect("writable");
    let bytes = fs::read(&good).expect("just written");
    let file = folder.path().join("spoilt.mcap");
    fuzz("recording.mcap", times(3_000), wounded(vec![bytes]), |Spoilt { bytes, .. }| {
        fs::write(&file, bytes).expect("writable");
        let whole = folder.path().join("whole.mcap");
        let exported = folder.path().join("exported");
        let _ = fs::remove_file(&whole);
        let _ = fs::remove_dir_all(&exported);
        if let Err(error) = inspect(&file) {
            one_line(&error)?;
        }
        if let Err(error) = recover(&file, &whole) {
            one_line(&error)?;
        }
        if let Err(error) = export(&[&file], &exported) {
            one_line(&error)?;
        }
        Ok(())
    });
}
