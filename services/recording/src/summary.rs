//! `summary.json`: what a run was, what it took and what became of every reading.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};
use shared_types::{REJECT_REASONS, SensorCounts};

use crate::error::LogError;

/// Its name beside `estimate.csv`.
pub const SUMMARY_FILE: &str = "summary.json";

/// A run in numbers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Version of the program.
    pub version: String,
    /// Estimator by name.
    pub estimator: String,
    /// Faults injected into the readings; none in any run that is not an experiment.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<String>,
    /// Intervals in the window.
    pub window: usize,
    /// Data time from the first to the last estimate, s.
    pub duration_s: f64,
    /// Time that the whole process took, s.
    pub wall_s: f64,
    /// `duration_s / wall_s`: times real time.
    pub speed: f64,
    /// Rows of `estimate.csv`.
    pub estimates: u64,
    /// Keyframes solved.
    pub keyframes: u64,
    /// Keyframes that gave no solution, for want of inertial samples or of a regular matrix.
    #[serde(default)]
    pub keyframes_unsolved: u64,
    /// Readings, rows of the truth and estimates of a live run that are not in its record: they did not reach the recorder, or the
    /// disk did not take them.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub lost: u64,
    /// Solver iterations over all keyframes.
    pub iterations: u64,
    /// CPU time per keyframe with a full window, µs.
    pub solve_us: SolveTimes,
    /// By the sensor's short name.
    pub sensors: BTreeMap<String, SensorSummary>,
    /// Latitude (deg), longitude (deg), ellipsoidal height (m) of the ENU origin.
    pub origin: [f64; 3],
    /// Share of the estimates in each mode, by its name; absent ones are zero.
    pub modes: BTreeMap<String, f64>,
    /// Score against the truth, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub score: Option<serde_json::Value>,
}

/// Quantiles of the time that one keyframe costs, µs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SolveTimes {
    /// Median.
    pub p50: f64,
    /// 99 of 100 take less.
    pub p99: f64,
    /// The longest.
    pub max: f64,
}

/// What became of a sensor's readings.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SensorSummary {
    /// Read.
    pub received: u64,
    /// Became part of the estimate.
    pub used: u64,
    /// Refused, by the reason's name; reasons that did not occur are left out.
    pub rejected: BTreeMap<String, u64>,
    /// How late its stamps were found to be at the end; left out where nothing spoke against them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_offset: Option<TimeOffsetSummary>,
    /// What it was found to be miscalibrated by at the end, by name; nothing where nothing spoke against its configuration.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub calibrations: BTreeMap<String, CalibrationSummary>,
}

/// A systematic error of a sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CalibrationSummary {
    /// What it is off by.
    pub value: f64,
    /// 1-sigma of that.
    pub sigma: f64,
    /// Of both.
    pub unit: String,
}

/// A sensor's time offset.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TimeOffsetSummary {
    /// How much too late its stamps are, s.
    pub offset_s: f64,
    /// 1-sigma of that, s.
    pub sigma_s: f64,
}

/// Nothing was lost: not worth a line.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands over a reference")]
fn is_zero(count: &u64) -> bool {
    *count == 0
}

impl SensorSummary {
    /// From the navigator's counts.
    pub fn new(received: u64, counts: &SensorCounts) -> SensorSummary {
        let rejected = REJECT_REASONS.iter().zip(counts.rejected).filter(|&(_, count)| count > 0);
        SensorSummary {
            received,
            used: counts.used,
            rejected: rejected.map(|(reason, count)| (reason.name().to_owned(), count)).collect(),
            time_offset: None,
            calibrations: BTreeMap::new(),
        }
    }
}

impl Summary {
    /// Writes `summary.json` into `out`, whole or not at all.
    ///
    /// # Errors
    /// [`LogError::Io`].
    pub fn write(&self, out: impl AsRef<Path>) -> Result<(), LogError> {
        let file = out.as_ref().join(SUMMARY_FILE);
        let partial = file.with_extension("json.partial");
        let mut text = serde_json::to_string_pretty(self).expect("a summary has string keys only");
        text.push('\n');
        fs::write(&partial, text).map_err(LogError::io(&partial, "write"))?;
        fs::rename(&partial, &file).map_err(LogError::io(&partial, "rename"))
    }

    /// Reads a `summary.json`.
    ///
    /// # Errors
    /// [`LogError::Io`], or [`LogError::Summary`] if it is none.
    pub fn read(file: impl AsRef<Path>) -> Result<Summary, LogError> {
        let file = file.as_ref();
        let text = fs::read_to_string(file).map_err(LogError::io(file, "read"))?;
        serde_json::from_str(&text).map_err(|error| LogError::Summary {
            file: file.to_owned(),
            line: error.line(),
            message: error.to_string(),
        })
    }
}

#[cfg(test)]
mod tests {
    use shared_types::RejectReason;

    use super::*;

    #[test]
    fn only_reasons_that_occurred_are_listed() {
        let mut counts = SensorCounts { used: 7, ..SensorCounts::default() };
        counts.rejected[RejectReason::Gated.index()] = 2;
        let summary = SensorSummary::new(9, &counts);
        assert_eq!(summary.rejected, BTreeMap::from([("gated".to_owned(), 2)]));
        assert_eq!((summary.received, summary.used), (9, 7));
    }

    #[test]
    fn a_summary_is_read_back_and_leaves_no_partial_file() {
        let out = tempfile::tempdir().expect("a temporary directory");
        let summary = Summary { estimator: "fgo".to_owned(), origin: [36.38, 127.36, 0.0], ..Summary::default() };
        summary.write(out.path()).expect("it can be written");
        assert_eq!(Summary::read(out.path().join(SUMMARY_FILE)).expect("it can be read"), summary);
        assert_eq!(fs::read_dir(out.path()).expect("it exists").count(), 1);
    }

    #[test]
    fn another_file_is_no_summary() {
        let out = tempfile::tempdir().expect("a temporary directory");
        let file = out.path().join(SUMMARY_FILE);
        fs::write(&file, "{\"estimator\": 3}").expect("it can be written");
        let message = Summary::read(&file).expect_err("the estimator is no text").to_string();
        assert!(message.contains("summary.json:1:"), "{message}");
    }
}
