//! Recorded logs of real vehicles parse whole. They lie in the folder named by `ILNS_LOGS`; without it nothing is shown.
#![expect(clippy::unwrap_used, reason = "a failing set-up is a failing test")]

use std::path::{Path, PathBuf};

use ilns_recording::LogDirectory;
use shared_types::{RawReading, SENSORS, Time, Truth};

/// Every folder with an `imu.csv`; empty without `ILNS_LOGS`.
fn real_logs() -> Vec<PathBuf> {
    let Some(folder) = std::env::var_os("ILNS_LOGS") else {
        eprintln!("skipped: ILNS_LOGS is not set");
        return Vec::new();
    };
    let folder = PathBuf::from(folder);
    let mut logs: Vec<PathBuf> = std::fs::read_dir(&folder)
        .unwrap_or_else(|error| panic!("{}: {error}", folder.display()))
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.join("imu.csv").exists())
        .collect();
    logs.sort();
    assert!(!logs.is_empty(), "{} holds no log", folder.display());
    logs
}

fn rows_in(file: &Path) -> usize {
    std::fs::read_to_string(file).unwrap().lines().count() - 1
}

#[test]
fn every_row_of_the_real_logs_becomes_a_reading() {
    for dir in real_logs() {
        let log = LogDirectory::open(&dir).unwrap();
        log.check_buoys().unwrap();
        let mut count = [0; 7];
        let mut last = Time::MIN;
        for reading in log.merged().unwrap() {
            let reading = reading.unwrap();
            assert!(reading.t_valid() >= last, "{}: {reading:?} after {last}", dir.display());
            last = reading.t_valid();
            count[reading.sensor().index()] += 1;
            if let RawReading::Lbl(range) = reading {
                assert!((1..=8).contains(&range.in_epoch), "{}: {range:?}", dir.display());
            }
        }
        for sensor in SENSORS {
            let file = dir.join(format!("{sensor}.csv"));
            let expected = if log.has(sensor) { rows_in(&file) } else { 0 };
            assert_eq!(count[sensor.index()], expected, "{}", file.display());
        }
        let truth: Vec<Truth> = log.truth().unwrap().map(Result::unwrap).collect();
        assert_eq!(truth.len(), rows_in(&dir.join("truth.csv")), "{}", dir.display());
        eprintln!("{}: {} readings, {} rows of truth", dir.display(), count.iter().sum::<usize>(), truth.len());
    }
}
