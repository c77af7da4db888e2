//! Parts of what is known that views draw one by one: keyframes with their factors, fixes, ranges, latencies.

use serde::Serialize;
use shared_types::{Process, Sensor, SolutionStatus};

use crate::snapshot::{Distribution, process_name, sensor_name, status_name};

/// A solved keyframe with every factor that its newest interval brought.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct KeyframeDetail {
    /// Data time, s.
    pub t: f64,
    /// Number of the solution.
    pub solution: u64,
    /// Iterations of the solve.
    pub iterations: u32,
    /// Keyframes in the window.
    pub window: u32,
    /// Half the weighted sum of squares before and after the solve.
    pub cost: [f64; 2],
    /// CPU time of the solve, s.
    pub solve: Option<f64>,
    /// How it ended.
    #[serde(serialize_with = "status_name")]
    pub status: Option<SolutionStatus>,
    /// Found time offset and its 1-sigma per [`shared_types::AIDING`] sensor, s; zero sigma: nothing spoke against the stamps.
    pub time_offsets: Vec<[f64; 2]>,
    /// Factors that the report had no room for.
    pub left_out: u32,
    /// Used and refused factors, innovations as they were when the keyframe closed.
    pub factors: Vec<Factor>,
}

/// One factor.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Factor {
    /// Whose reading.
    #[serde(serialize_with = "sensor_name")]
    pub sensor: Sensor,
    /// Data time at which the reading was valid, s.
    pub t: f64,
    /// Rows of the residual.
    pub rows: u32,
    /// Buoy of a range.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub buoy: Option<u32>,
    /// Why it is not used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refused: Option<&'static str>,
    /// Innovation whitened by its own covariance, predicted minus measured, one number a row.
    pub whitened: Vec<f64>,
    /// Squared normalised innovation; chi-square distributed with `rows` degrees of freedom if all is as modelled.
    pub nis: f64,
    /// Robust weight in use, 1 at most.
    pub weight: f64,
    /// What the gate lets through, in sigmas: of the whitened innovation of a range, else of √NIS.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gate: Option<[f64; 2]>,
}

/// A satellite fix and what became of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Fix {
    /// Data time, s.
    pub t: f64,
    /// Of the antenna, m.
    pub position_enu: [f64; 3],
    /// What became of it.
    pub fate: Fate,
}

/// A range of the newest epoch, as a circle on the map.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ring {
    /// Number of the buoy.
    pub buoy: u32,
    /// Data time, s.
    pub t: f64,
    /// Slant range, m.
    pub range: f64,
    /// Where the buoy is, m.
    pub buoy_enu: [f64; 3],
    /// Horizontal distance that the slant range leaves at the estimated depth, m.
    pub radius: f64,
    /// What became of it.
    pub fate: Fate,
}

/// What became of a reading.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Fate {
    /// No keyframe has named it (yet).
    #[default]
    Unknown,
    /// It became a factor.
    Used,
    /// It was refused, and this is why.
    Refused(&'static str),
}

/// One hop of one process in brief, from its heartbeats.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Hop {
    /// Who measured it.
    #[serde(serialize_with = "process_name")]
    pub process: Process,
    /// `hop_in`: from publication to receipt on the main input. `work`: CPU time of the main piece of work. `end_to_end`:
    /// from the origin's arrival to the own publication.
    pub what: &'static str,
    /// Its distribution since the process began, s.
    #[serde(flatten)]
    pub distribution: Distribution,
}

/// How often a time fell into which bin; ten bins a decade.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Histogram {
    /// What was timed: `imu_to_estimate` or `solve`.
    pub what: &'static str,
    /// Lower edge of bin `i` is `10^(first_decade + i / 10)` s; the first and last bins hold what lies beyond them, too.
    pub first_decade: i32,
    /// Counts, trailing zeros left out.
    pub counts: Vec<u64>,
}

/// What is new since the last look.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct News {
    /// Solved keyframes, oldest first.
    pub keyframes: Vec<KeyframeDetail>,
    /// Fixes whose fate is settled.
    pub fixes: Vec<Fix>,
}
