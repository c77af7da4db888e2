//! Recorded logs without positions: satellite fixes of the first minute, then inertial data, Doppler velocities and depth
//! alone. The fixes that are withheld are what the estimate is held against; nothing is simulated from a reference but
//! what the log itself says of its Doppler velocities.

use std::path::{Path, PathBuf};

use ilns_recording::{LogDirectory, LogError};
use ilns_replay::ReplayError;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use nav_geometry::{Geodetic, LocalFrame};
use shared_types::{Config, Duration, GnssFix, Mode, NavEstimate, RawReading, Sensor, Time};

use super::bench::{Bench, BenchError};
use super::recorded::navigate;
use super::section::Table;
use super::spread::number;
use crate::parallel::in_parallel_on;

/// Fixes are heard for so long.
const HEARD_FOR: Duration = Duration(60_000_000_000);
const METHODS: [(&str, bool, &[&str]); 3] = [
    ("SW = 20", false, &["lbl.enabled=false"]),
    ("EKF", false, &["lbl.enabled=false", "estimator=ekf"]),
    ("batch", true, &["lbl.enabled=false"]),
];

/// Horizontal distances of an estimate to the fixes that it never heard, in the order of time.
struct Distances {
    withheld: usize,
    /// m.
    horizontal: Vec<f64>,
    /// Of the last, m.
    sigma: f64,
}

/// The table, of the logs that have fixes, Doppler velocities and ten withheld fixes at least.
pub fn table(bench: &Bench<'_>, logs: &[(String, PathBuf)]) -> Result<Table, BenchError> {
    let logs: Vec<&(String, PathBuf)> =
        logs.iter().filter(|(_, log)| ["gnss.csv", "dvl.csv"].iter().all(|file| log.join(file).exists())).collect();
    let runs: Vec<(&Path, bool, &[&str])> =
        logs.iter().flat_map(|(_, log)| METHODS.map(|(_, is_batch, sets)| (log.as_path(), is_batch, sets))).collect();
    let distances = in_parallel_on(bench.threads(), &runs, |(log, is_batch, sets)| distances(log, *is_batch, sets))?;
    let mut rows = Vec::new();
    for ((name, _), distances) in logs.iter().zip(distances.chunks(METHODS.len())) {
        if distances.iter().any(|distances| distances.horizontal.len() < 10) {
            continue;
        }
        let cells = distances.iter().map(|distances| {
            let mut sorted = distances.horizontal.clone();
            sorted.sort_by(f64::total_cmp);
            let at = |share: f64| number(sorted[(share * (sorted.len() - 1) as f64) as usize]);
            let last = distances.horizontal.last().copied().unwrap_or(f64::NAN);
            format!("{}, {}, {} ± {}", at(0.5), at(0.95), number(last), number(distances.sigma))
        });
        rows.push([name.clone(), distances[0].withheld.to_string()].into_iter().chain(cells).collect());
    }
    Ok(Table {
        caption: "Fixes of the first 60 s only, no ranges: horizontal distance to the withheld fixes, m: median, 95 %, at the end ± its \
                  1-sigma"
            .to_owned(),
        head: ["log", "fixes withheld"].into_iter().chain(METHODS.map(|(name, ..)| name)).map(str::to_owned).collect(),
        note: "Distances hold the error of the fixes themselves, and of an antenna whose place is known to decimetres. A course without a \
               compass turns with the gyroscopes: this is dead reckoning."
            .to_owned(),
        rows,
    })
}

fn distances(dir: &Path, is_batch: bool, sets: &[&str]) -> Result<Distances, ReplayError> {
    let log = LogDirectory::open(dir)?;
    let config = Config::load(log.config().map(std::slice::from_ref).unwrap_or_default(), &[]);
    let lever_arm = Vector3::from(config.map_err(ilns_runtime::RuntimeError::from)?.vehicle.gnss.lever_arm_body);
    let fixes = log.gnss()?.collect::<Result<Vec<GnssFix>, LogError>>()?;
    let t_first = fixes.first().map_or(Time::MIN, |fix| Time(fix.header.t_valid));
    let is_heard = |t_valid: i64| Time(t_valid) - t_first <= HEARD_FOR;
    let withheld: Vec<&GnssFix> = fixes.iter().filter(|fix| !is_heard(fix.header.t_valid)).collect();
    let mut waiting = withheld.iter().peekable();
    let mut distances = Distances { withheld: withheld.len(), horizontal: Vec::new(), sigma: f64::NAN };
    let keep = |reading: &RawReading| match reading {
        RawReading::Gnss(fix) => is_heard(fix.header.t_valid),
        other => other.sensor() != Sensor::Lbl,
    };
    navigate(dir, is_batch, sets, keep, |origin, estimate| {
        let frame = LocalFrame::new(origin);
        while let Some(fix) = waiting.next_if(|fix| fix.header.t_valid <= estimate.header.t_valid) {
            if estimate.mode() == Mode::Initialising {
                continue;
            }
            distances.horizontal.push(distance(&frame, estimate, &lever_arm, fix));
            distances.sigma = (estimate.position_cov[0] + estimate.position_cov[3]).sqrt();
        }
    })?;
    Ok(distances)
}

/// From the antenna where the estimate has it at the time of the fix, within one IMU sample, to the fix, m.
fn distance(frame: &LocalFrame, estimate: &NavEstimate, lever_arm: &Vector3<f64>, fix: &GnssFix) -> f64 {
    let [w, x, y, z] = estimate.q_enu_body;
    let attitude = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    let since = (Time(estimate.header.t_valid) - Time(fix.header.t_valid)).as_seconds();
    let antenna =
        Vector3::from(estimate.position_enu) - Vector3::from(estimate.velocity_enu) * since + attitude * lever_arm;
    let height = if fix.height.is_finite() { fix.height } else { 0.0 };
    (antenna - frame.to_enu(&Geodetic::from_degrees(fix.lat_deg, fix.lon_deg, height))).xy().norm()
}
