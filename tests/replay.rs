//! Simulate, replay, score: what a reader of the README does with files.

#[expect(dead_code, reason = "another test file uses the other parts")]
mod harness;

use std::path::{Path, PathBuf};

use harness::ilns;
use serde_json::Value;

/// Two minutes with every sensor, at rest for the first five seconds.
const SCENARIO: &str = include_str!("short.toml");

struct Logs {
    folder: tempfile::TempDir,
}

impl Logs {
    fn new() -> Logs {
        let folder = tempfile::tempdir().expect("a temporary folder");
        std::fs::write(folder.path().join("short.toml"), SCENARIO).expect("it can be written");
        Logs { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn simulate(&self, preset: &str, log: &str) {
        let (scenario, out) = (self.path("short.toml"), self.path(log));
        succeed(&["simulate", text(&scenario), "--preset", preset, "--seed", "5", "--out", text(&out)]);
    }

    /// Replays and returns the summary.
    fn replay(&self, log: &str, out: &str, options: &[&str]) -> Value {
        let (log, out) = (self.path(log), self.path(out));
        succeed(&[&["replay", text(&log), "--out", text(&out)], options].concat());
        let summary = std::fs::read_to_string(out.join("summary.json")).expect("it was written");
        serde_json::from_str(&summary).expect("it is JSON")
    }
}

fn text(path: &Path) -> &str {
    path.to_str().expect("temporary paths are text")
}

fn succeed(arguments: &[&str]) -> String {
    let output = ilns(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

#[test]
fn smoothing_leaves_the_same_files_and_smaller_errors() {
    let logs = Logs::new();
    logs.simulate("realistic", "log");
    let causal = logs.replay("log", "causal", &[]);
    let (log, out, again) = (logs.path("log"), logs.path("smoothed"), logs.path("again"));
    for out in [&out, &again] {
        succeed(&["smooth", text(&log), "--out", text(out)]);
    }
    for file in ["estimate.csv", "estimate.tum"] {
        let read = |out: &Path| std::fs::read(out.join(file)).expect("it was written");
        assert!(read(&out) == read(&again), "{file} differs");
    }
    let summary = std::fs::read_to_string(out.join("summary.json")).expect("it was written");
    let summary: Value = serde_json::from_str(&summary).expect("it is JSON");
    let rms = |summary: &Value| summary["score"]["rms_horizontal"].as_f64().expect("there is a truth");
    assert!(rms(&summary) < 0.9 * rms(&causal), "{} against {}", rms(&summary), rms(&causal));
    assert_eq!(summary["estimator"], "fgo batch");
    assert_eq!(summary["sensors"]["lbl"]["received"], causal["sensors"]["lbl"]["received"]);
    // Half a second is too short for a first state.
    let imu = std::fs::read_to_string(log.join("imu.csv")).expect("it was written");
    let short: String = imu.split_inclusive('\n').take(100).collect();
    std::fs::write(log.join("imu.csv"), short).expect("it can be written");
    let output = ilns(&["smooth", text(&log), "--out", text(&out)]);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{errors}");
    assert!(errors.contains("no trajectory") && errors.trim_end().lines().count() == 1, "{errors}");
    assert!(!out.join("estimate.csv").exists(), "the estimates of the run before");
}

#[test]
fn with_a_fixed_lag_each_keyframe_is_shown_once_more_and_better() {
    let logs = Logs::new();
    logs.simulate("realistic", "log");
    let sets = ["--set", "fgo.window=10", "--set", "fgo.fixed_lag=true", "--no-dvl", "--no-mcp", "--no-gnss"];
    logs.replay("log", "out", &sets);
    let truth = logs.path("log").join("truth.csv");
    let rms = |file: &str| {
        let estimate = logs.path("out").join(file);
        let score = succeed(&["score", text(&estimate), "--truth", text(&truth), "--json"]);
        let score: Value = serde_json::from_str(&score).expect("it is JSON");
        score["rms_horizontal"].as_f64().expect("there is a truth")
    };
    let (newest, lagged) = (rms("estimate.csv"), rms("estimate_lagged.csv"));
    assert!(lagged < 0.95 * newest, "{lagged} {newest}");
    logs.replay("log", "out", &[]);
    assert!(!logs.path("out").join("estimate_lagged.csv").exists(), "of the run before");
}

#[test]
fn two_replays_of_one_log_are_the_same_bytes() {
    let logs = Logs::new();
    logs.simulate("realistic", "log");
    let summary = logs.replay("log", "one", &[]);
    logs.replay("log", "two", &[]);
    for file in ["estimate.csv", "estimate.tum"] {
        let read = |out: &str| std::fs::read(logs.path(out).join(file)).expect("it was written");
        assert!(read("one") == read("two"), "{file} differs");
    }
    for key in
        ["estimator", "window", "duration_s", "wall_s", "keyframes", "iterations", "solve_us", "sensors", "origin"]
    {
        assert!(!summary[key].is_null(), "{key} is missing: {summary}");
    }
    for sensor in ["imu", "lbl", "gnss", "dvl", "mcp", "ps"] {
        let counts = &summary["sensors"][sensor];
        let used = counts["used"].as_u64().expect("a count");
        let rejected: u64 = counts["rejected"].as_object().expect("a table").values().filter_map(Value::as_u64).sum();
        let received = counts["received"].as_u64().expect("a count");
        assert!(used > 0, "{sensor}: {counts}");
        // The readings of the interval still open at the end are taken in, too.
        assert_eq!(used + rejected, received, "{sensor}: {counts}");
    }
}

#[test]
fn a_noise_free_log_is_navigated_to_the_millimetre() {
    let logs = Logs::new();
    logs.simulate("none", "log");
    logs.replay("log", "out", &[]);
    let (estimate, truth) = (logs.path("out").join("estimate.csv"), logs.path("log").join("truth.csv"));
    let score = succeed(&["score", text(&estimate), "--truth", text(&truth), "--json"]);
    let score: Value = serde_json::from_str(&score).expect("it is JSON");
    assert!(score["max_horizontal"].as_f64().expect("a number") < 0.01, "{score}");
    let attitude = score["attitude_max_deg"].as_array().expect("three numbers");
    assert!(attitude.iter().all(|a| a.as_f64().expect("a number") < 0.01), "{score}");
}

#[test]
fn a_sensor_left_out_is_counted_and_settings_reach_both_halves() {
    let logs = Logs::new();
    logs.simulate("realistic", "log");
    let summary =
        logs.replay("log", "out", &["--no-dvl", "--window", "5", "--set", "lbl.sigma=0.5", "--solve-latency", "40"]);
    let dvl = &summary["sensors"]["dvl"];
    assert_eq!((dvl["used"].as_u64(), summary["window"].as_u64()), (Some(0), Some(5)));
    assert!(dvl["rejected"]["disabled"].as_u64().is_some_and(|count| count > 0), "{dvl}");
    let log = logs.path("log");
    let printed = succeed(&["replay", text(&log), "--set", "lbl.sigma=0.5", "--set", "fgo.window=7", "--print-config"]);
    let config: toml::Table = toml::from_str(&printed).expect("it is TOML");
    assert_eq!(config["lbl"]["sigma"].as_float(), Some(0.5));
    assert_eq!(config["fgo"]["window"].as_integer(), Some(7));
}

#[test]
fn readings_that_are_bad_one_by_one_are_skipped_and_counted() {
    let logs = Logs::new();
    logs.simulate("realistic", "log");
    let damage = |file: &str, edit: &dyn Fn(usize, &str) -> String| {
        let path = logs.path("log").join(file);
        let whole = std::fs::read_to_string(&path).expect("it was written");
        let lines: Vec<String> = whole.lines().enumerate().map(|(index, line)| edit(index, line)).collect();
        std::fs::write(&path, lines.join("\n") + "\n").expect("it can be written");
    };
    let cell = |line: &str, at: usize, new: &str| {
        let mut cells: Vec<&str> = line.split(',').collect();
        cells[at] = new;
        cells.join(",")
    };
    damage("ps.csv", &|index, line| if index == 300 { cell(line, 1, "99999") } else { line.to_owned() });
    damage("dvl.csv", &|index, line| if index == 200 { cell(line, 2, "nan") } else { line.to_owned() });
    damage("imu.csv", &|index, line| if index == 9000 { cell(line, 4, "inf") } else { line.to_owned() });
    damage("mcp.csv", &|index, line| if index == 400 { format!("{line}\n{line}") } else { line.to_owned() });
    let summary = logs.replay("log", "out", &[]);
    for (sensor, reason) in [("ps", "out_of_range"), ("dvl", "not_finite"), ("imu", "not_finite"), ("mcp", "duplicate")]
    {
        assert_eq!(
            summary["sensors"][sensor]["rejected"][reason].as_u64(),
            Some(1),
            "{sensor}: {}",
            summary["sensors"][sensor]
        );
    }
}

#[test]
fn faults_injected_into_a_log_are_refused_counted_and_repeatable() {
    let logs = Logs::new();
    logs.simulate("realistic", "log");
    let faults =
        ["--fault", "lbl.multipath=0.3@20..50", "--fault", "ps.nan=1@30..31", "--fault", "mcp.duplicate=1@30..31"];
    let clean = logs.replay("log", "clean", &[]);
    let faulty = logs.replay("log", "faulty", &faults);
    logs.replay("log", "again", &[&faults[..], &["--fault-seed", "1"]].concat());
    let read = |out: &str| std::fs::read(logs.path(out).join("estimate.csv")).expect("it was written");
    assert!(read("faulty") == read("again") && read("faulty") != read("clean"));
    assert!(clean["faults"].is_null());
    assert_eq!(faulty["faults"][0], "lbl.multipath=0.3,5,300@20..50", "{faulty}");
    let rejected = |summary: &Value, sensor: &str, reason: &str| {
        summary["sensors"][sensor]["rejected"][reason].as_u64().unwrap_or(0)
    };
    assert_eq!(rejected(&faulty, "ps", "not_finite"), 10);
    assert_eq!(rejected(&faulty, "mcp", "duplicate"), 10);
    let gated = rejected(&faulty, "lbl", "gated");
    // Thirty epochs of four ranges: some 36 too long.
    assert!((20..60).contains(&gated), "{gated}");
    let rms = |summary: &Value| summary["score"]["rms_horizontal"].as_f64().expect("scored");
    assert!(rms(&faulty) < 1.25 * rms(&clean) + 0.01, "{} against {}", rms(&faulty), rms(&clean));

    let log = logs.path("log");
    let output = ilns(&["replay", text(&log), "--out", text(&logs.path("none")), "--fault", "dvl.stick"]);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && errors.contains("dvl has no class"), "{errors}");

    // The same faults when the log is made: it holds what the sensors said then, and the truth is that of a clean one.
    let (scenario, out) = (logs.path("short.toml"), logs.path("made"));
    succeed(
        &[&["simulate", text(&scenario), "--seed", "5", "--preset", "realistic", "--out", text(&out)], &faults[..]]
            .concat(),
    );
    let made = logs.replay("made", "of-made", &[]);
    assert_eq!(rejected(&made, "ps", "not_finite"), 10);
    let truth = |log: &str| std::fs::read(logs.path(log).join("truth.csv")).expect("it was written");
    assert!(truth("made") == truth("log"));
}

#[test]
fn mistakes_are_one_line_with_code_2_and_no_output() {
    let logs = Logs::new();
    logs.simulate("realistic", "log");
    let replace = |file: &str, old: &str, new: &str| {
        let path = logs.path("log").join(file);
        let whole = std::fs::read_to_string(&path).expect("it was written");
        assert!(whole.contains(old), "{file} holds no {old:?}");
        std::fs::write(&path, whole.replacen(old, new, 1)).expect("it can be written");
        (path, whole)
    };
    let cases = [
        ("imu.csv", "t,wx", "t,wy", "imu.csv:1"),
        ("ps.csv", "t,depth\n", "t,depth\n1.0,deep\n", "ps.csv:2"),
        ("dvl.csv", "t,vx,vy,vz\n", "t,vx,vy,vz\n900.0,1,0,0\n", "dvl.csv:3"),
        ("sensors.toml", "[lbl]\n", "[lbl]\nsigmma = 0.3\n", "lbl.sigmma"),
        ("sensors.toml", "gyro_noise_density = ", "gyro_noise_density = -", "imu.gyro_noise_density"),
        ("sensors.toml", "quaternion = [", "quaternion = [7.0, 0.0, 0.0, 0.0] # [", "initial.quaternion"),
    ];
    for (file, old, new, named) in cases {
        let (path, whole) = replace(file, old, new);
        let (log, out) = (logs.path("log"), logs.path("out"));
        let output = ilns(&["replay", text(&log), "--out", text(&out)]);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{file}: {errors}");
        assert!(errors.contains(named) && errors.trim_end().lines().count() == 1, "{file}: {errors}");
        assert!(!out.join("estimate.csv").exists() && !out.join("summary.json").exists(), "{file}");
        std::fs::write(path, whole).expect("it can be written");
    }
    let (whole_log, broken, out) = (logs.path("log"), logs.path("broken"), logs.path("out"));
    let emptied = [
        ("dvl.csv", "", "dvl.csv:1"),
        ("imu.csv", "", "imu.csv:1"),
        ("imu.csv", "t,wx,wy,wz,fx,fy,fz\n", "imu.csv:2"),
        ("buoys.csv", "t,buoy,lat,lon,h\n0,1,36.38,127.36,0\n", "buoy 2 has no position"),
    ];
    for (file, content, named) in emptied {
        std::fs::create_dir_all(&broken).expect("it can be made");
        for entry in std::fs::read_dir(&whole_log).expect("it was written") {
            let path = entry.expect("readable").path();
            std::fs::copy(&path, broken.join(path.file_name().expect("a file"))).expect("it can be copied");
        }
        std::fs::write(broken.join(file), content).expect("it can be written");
        let output = ilns(&["replay", text(&broken), "--out", text(&out)]);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{file}: {errors}");
        assert!(errors.contains(named) && errors.trim_end().lines().count() == 1, "{file}: {errors}");
        assert!(!out.join("estimate.csv").exists() && !out.join("summary.json").exists(), "{file}");
    }
    let nowhere = logs.path("nowhere");
    let output = ilns(&["replay", text(&nowhere), "--out", text(&logs.path("out"))]);
    assert_eq!(output.status.code(), Some(2));
    std::fs::remove_file(logs.path("log").join("imu.csv")).expect("it is there");
    let output = ilns(&["replay", text(&logs.path("log")), "--out", text(&logs.path("out"))]);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && errors.contains("imu.csv"), "{errors}");
}
