//! Logs that real vehicles recorded. They are not part of the project: `ILNS_LOGS` names a folder of log directories, and
//! without it these tests say that they are skipped.

#[expect(dead_code, reason = "another test file uses the other parts")]
mod harness;

use std::path::PathBuf;

use harness::ilns;
use serde_json::Value;

/// Horizontal RMS that a log may have against its reference, m. Generous: the references are smoothers over the same
/// fixes, and nothing is tuned to any of these logs.
fn bound(name: &str) -> f64 {
    match name {
        // A slow rover whose satellite fixes and poses disagree by decimetres.
        "canada_rover" => 0.6,
        // A car at 10 m/s whose inertial data and course disagree by degrees in sharp turns.
        "kitti_gtsam" => 2.0,
        _ => 0.3,
    }
}

fn logs() -> Option<Vec<PathBuf>> {
    let Some(folder) = std::env::var_os("ILNS_LOGS") else {
        eprintln!("skipped: ILNS_LOGS is not set, no recorded log is replayed");
        return None;
    };
    let entries = std::fs::read_dir(folder).expect("ILNS_LOGS names a folder");
    let mut logs: Vec<PathBuf> =
        entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| path.join("imu.csv").exists()).collect();
    logs.sort();
    Some(logs)
}

#[test]
fn recorded_logs_replay_from_end_to_end_with_and_without_satellites() {
    let Some(logs) = logs() else { return };
    assert!(!logs.is_empty(), "ILNS_LOGS holds no log");
    let folder = tempfile::tempdir().expect("a temporary folder");
    for log in logs {
        let name = log.file_name().and_then(|name| name.to_str()).expect("a name").to_owned();
        for options in [&[][..], &["--no-gnss"]] {
            let out = folder.path().join(format!("{name}{}", options.len()));
            let (log, out_text) = (log.to_str().expect("text"), out.to_str().expect("text"));
            let output = ilns(&[&["replay", log, "--out", out_text], options].concat());
            let errors = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success(), "{name} {options:?}: {errors}");
            let summary = std::fs::read_to_string(out.join("summary.json")).expect("it was written");
            let summary: Value = serde_json::from_str(&summary).expect("it is JSON");
            let rms = summary["score"]["rms_horizontal"].as_f64().expect("the log has a truth");
            eprintln!("{name} {options:?}: {rms:.3} m horizontal RMS");
            assert!(rms < bound(&name), "{name} {options:?}: {rms} m");
            let share = summary["estimates"].as_f64().expect("a count")
                / summary["sensors"]["imu"]["used"].as_f64().expect("a count");
            assert!(share > 0.99, "{name} {options:?}: an estimate for {share} of the samples");
        }
    }
}
