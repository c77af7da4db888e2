//! Scores and pictures of a run whose errors are known.
#![expect(clippy::unwrap_used, reason = "a failing set-up is a failing test")]

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use hdrhistogram::Histogram;
use ilns_recording::{LogDirectory, LogWriter, LogWriterOptions, SUMMARY_FILE, Summary};
use ilns_replay::{PlotArgs, ReplayError, ReplayOutput, RunFacts, ScoreArgs, plot, score};
use nav_geometry::{Geodetic, LocalFrame};
use shared_types::{BuoyFix, Header, ImuSample, Mode, NavEstimate, RejectReason, SensorCounts, Time, Truth};
use tempfile::TempDir;

const ORIGIN: [f64; 3] = [36.38, 127.36, 0.0];
const PERIOD_NS: i64 = 5_000_000;
const SAMPLES: i64 = 60_000;

/// A circle of 100 m, a tenth of a degree north-east of anywhere that matters.
fn position_deg(nanos: i64) -> [f64; 3] {
    let phase = Time(nanos).as_seconds() * 0.02;
    [ORIGIN[0] + 9e-4 * phase.sin(), ORIGIN[1] + 1.1e-3 * phase.cos(), -5.0]
}

fn frame() -> LocalFrame {
    LocalFrame::new(Geodetic::from_degrees(ORIGIN[0], ORIGIN[1], ORIGIN[2]))
}

/// Half a metre too far east, and without aiding from 100 s to 150 s.
fn estimate(nanos: i64) -> NavEstimate {
    let lat_lon_h = position_deg(nanos);
    let position_enu = frame().to_enu(&Geodetic::from_degrees(lat_lon_h[0], lat_lon_h[1], lat_lon_h[2]));
    let mode = if (100..150).contains(&(nanos / 1_000_000_000)) { Mode::DeadReckoning } else { Mode::Ok };
    NavEstimate {
        header: Header::at(Time(nanos)),
        solution: 0,
        t_keyframe: 0,
        position_enu: [position_enu.x + 0.5, position_enu.y, position_enu.z],
        velocity_enu: [0.0; 3],
        q_enu_body: [1.0, 0.0, 0.0, 0.0],
        accel_bias: [0.0; 3],
        gyro_bias: [0.0; 3],
        position_cov: [0.25, 0.0, 0.0, 0.25, 0.0, 0.25],
        velocity_cov: [1.0, 0.0, 0.0, 1.0, 0.0, 1.0],
        attitude_cov: [1e-4, 0.0, 0.0, 1e-4, 0.0, 1e-4],
        sigma_rpy: [0.01; 3],
        lat_lon_h,
        aiding_age: [0.0; 5],
        mode: mode as u32,
        reserved: 0,
    }
}

/// A log with a truth and a buoy.
fn log() -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    let mut writer = LogWriter::create(dir.path(), LogWriterOptions::default()).unwrap();
    writer.imu(&ImuSample { header: Header::default(), gyro_body: [0.0; 3], accel_body: [0.0, 0.0, 9.8] }).unwrap();
    let header = Header::default();
    writer.buoy(&BuoyFix { header, buoy: 7, moored: 1, lat_deg: 36.3805, lon_deg: 127.361, height: 0.0 }).unwrap();
    for index in 0..SAMPLES / 20 {
        let nanos = index * 20 * PERIOD_NS;
        let [lat_deg, lon_deg, height] = position_deg(nanos);
        let truth = Truth {
            header: Header::at(Time(nanos)),
            lat_deg,
            lon_deg,
            height,
            q_enu_body: [1.0, 0.0, 0.0, 0.0],
            velocity_enu: [0.0; 3],
        };
        writer.truth(&truth).unwrap();
    }
    writer.finish().unwrap();
    dir
}

fn replay(log: &TempDir, out: &Path) -> Summary {
    let log = LogDirectory::open(log.path()).unwrap();
    let mut output = ReplayOutput::create(out, &log, Instant::now()).unwrap();
    output.set_origin(ORIGIN);
    output.estimate(&NavEstimate { mode: Mode::Initialising as u32, ..estimate(0) }).unwrap();
    for index in 0..SAMPLES {
        output.estimate(&estimate(index * PERIOD_NS)).unwrap();
    }
    output.finish(&facts()).unwrap()
}

fn facts() -> RunFacts {
    let mut counts = [SensorCounts::default(); 7];
    counts[1].rejected[RejectReason::Gated.index()] = 3;
    let mut solve_ns = Histogram::new(3).unwrap();
    solve_ns.record(120_000).unwrap();
    RunFacts {
        faults: Vec::new(),
        estimator: "fgo",
        window: 20,
        keyframes: 300,
        keyframes_unsolved: 0,
        iterations: 310,
        solve_ns,
        received: [9; 7],
        counts,
        time_offsets: ([0.0, 0.0, 0.25, 0.0, 0.0], [0.0, 0.0, 0.01, 0.0, 0.0]),
        calibrations: ([0.003, 0.0], [1e-4, 0.0]),
    }
}

fn score_args(estimate: PathBuf, truth: PathBuf) -> ScoreArgs {
    let trajectory = ilns_replay::TrajectoryArgs::default();
    ScoreArgs { estimate: Some(estimate), truth, trajectory, json: true, from: None, to: None, origin: None }
}

#[test]
fn the_summary_holds_what_was_promised() {
    let (log, out) = (log(), tempfile::tempdir().unwrap());
    let summary = replay(&log, out.path());
    let read = Summary::read(out.path().join(SUMMARY_FILE)).unwrap();
    // These are measured, of all digits, and a reader of JSON may miss the last bit of such a number.
    assert!((read.speed / summary.speed - 1.0).abs() < 1e-14 && (read.wall_s / summary.wall_s - 1.0).abs() < 1e-14);
    assert_eq!(summary, Summary { speed: summary.speed, wall_s: summary.wall_s, ..read });
    assert_eq!((summary.estimates, summary.keyframes, summary.iterations), (SAMPLES as u64, 300, 310));
    assert!((summary.duration_s - 299.995).abs() < 1e-9, "{summary:?}");
    assert_eq!(summary.sensors["lbl"].rejected["gated"], 3);
    let scale = &summary.sensors["lbl"].calibrations["range_scale"];
    assert!((scale.value - 0.3).abs() < 1e-12 && (scale.sigma - 0.01).abs() < 1e-12 && scale.unit == "%", "{scale:?}");
    assert!(summary.sensors["dvl"].calibrations.is_empty());
    assert_eq!(summary.origin, ORIGIN);
    assert!((summary.modes["DEAD_RECKONING"] - 50.0 / 300.0).abs() < 1e-9);
    // A histogram of three digits keeps 0.1 %.
    assert!((summary.solve_us.p50 - 120.0).abs() < 0.12, "{:?}", summary.solve_us);
    let score = summary.score.unwrap();
    assert!((score["rms_enu"][0].as_f64().unwrap() - 0.5).abs() < 1e-6, "{score}");
    assert!((score["nees_enu"][0].as_f64().unwrap() - 1.0).abs() < 1e-5, "{score}");
    assert!(score["rms_horizontal"].as_f64().unwrap() < 0.500_01);
}

#[test]
fn results_bear_their_names_only_when_whole() {
    let (log, out) = (log(), tempfile::tempdir().unwrap());
    replay(&log, out.path());
    // The next run fails on its way.
    let directory = LogDirectory::open(log.path()).unwrap();
    let mut output = ReplayOutput::create(out.path(), &directory, Instant::now()).unwrap();
    output.set_origin(ORIGIN);
    output.estimate(&estimate(0)).unwrap();
    let bad = NavEstimate { position_enu: [f64::NAN; 3], ..estimate(PERIOD_NS) };
    output.estimate(&bad).unwrap();
    // Written in the background: told with the next batch, at the end at the latest.
    output.finish(&facts()).unwrap_err();
    let mut names: Vec<String> =
        fs::read_dir(out.path()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    assert_eq!(names, ["estimate.csv.partial", "estimate.tum.partial"]);
}

#[test]
fn a_score_of_the_files_needs_an_origin_and_a_common_time() {
    let (log, out) = (log(), tempfile::tempdir().unwrap());
    replay(&log, out.path());
    let args = score_args(out.path().join("estimate.csv"), log.path().join("truth.csv"));
    score::run(&args).unwrap();
    score::run(&score_args(out.path().to_owned(), args.truth.clone())).expect("the folder will do");

    let late = ScoreArgs { from: Some(Time(900_000_000_000)), ..args.clone() };
    assert!(matches!(score::run(&late).unwrap_err(), ReplayError::NoCommonTime { .. }));

    fs::remove_file(out.path().join(SUMMARY_FILE)).unwrap();
    assert!(matches!(score::run(&args).unwrap_err(), ReplayError::NoOrigin { .. }));
    score::run(&ScoreArgs { origin: Some(ORIGIN), ..args }).unwrap();
}

#[test]
fn missing_files_are_named() {
    let (log, out) = (log(), tempfile::tempdir().unwrap());
    replay(&log, out.path());
    let no_truth = score_args(out.path().join("estimate.csv"), log.path().join("nowhere.csv"));
    let message = score::run(&no_truth).unwrap_err().to_string();
    assert!(message.ends_with("nowhere.csv: cannot open"), "{message}");
    let no_estimate = ScoreArgs { origin: Some(ORIGIN), ..score_args(out.path().join("x.csv"), no_truth.truth) };
    assert!(score::run(&no_estimate).is_err());
}

#[test]
fn the_picture_shows_the_outage_and_stays_small() {
    let (log, out) = (log(), tempfile::tempdir().unwrap());
    replay(&log, out.path());
    let svg = out.path().join("run.svg");
    let args = PlotArgs {
        out: out.path().to_owned(),
        truth: Some(log.path().join("truth.csv")),
        svg: svg.clone(),
        title: "A circle".to_owned(),
        origin: None,
    };
    plot::run(&args).unwrap();
    let picture = fs::read_to_string(&svg).unwrap();
    assert!(picture.len() < 300_000, "{} bytes", picture.len());
    for word in ["<title>A circle</title>", "dead reckoning", "buoy", "east, m", "up, m", "truth", ">7</text>"] {
        assert!(picture.contains(word), "{word}");
    }
    assert!(!picture.contains("NaN") && !picture.contains("inf"));
    // Nothing is loaded from elsewhere.
    assert!(!picture.contains("href") && !picture.contains("<script"));

    // Without a truth there is the plan alone.
    plot::run(&PlotArgs { truth: None, ..args }).unwrap();
    let plan = fs::read_to_string(&svg).unwrap();
    assert!(!plan.contains("position error") && plan.contains("east, m"));
}
