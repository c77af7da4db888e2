//! `ilns score --tum`: any trajectory in TUM format (a SLAM system's, a vendor's) against a truth, as the benchmarks score it.
//!
//! A `truth.csv` is brought into the ENU frame of its log first; another TUM file is taken as it is. The figures are those of
//! `evo_ape` and `evo_rpe`.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use ilns_recording::{read_truth, read_tum};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use nav_evaluation::{Distances, Motion, Pose, Window, absolute_error, associate, relative_error};
use nav_geometry::{Geodetic, LocalFrame};
use serde::Serialize;
use shared_types::{Duration, Time, Truth};

use crate::error::ReplayError;
use crate::origin;

/// What concerns a trajectory in TUM format.
#[derive(Args, Clone, Debug)]
pub struct TrajectoryArgs {
    /// Score this trajectory in TUM format (`t x y z qx qy qz qw`) instead of an estimate.csv: ATE as evo_ape has it.
    #[arg(long, value_name = "FILE")]
    pub tum: Option<PathBuf>,
    /// What of the trajectory's frame is arbitrary, and fitted before errors are taken (no scale).
    #[arg(long, value_enum, default_value_t, requires = "tum")]
    pub align: Alignment,
    /// Relative error too, over stretches of so many metres: RPE as evo_rpe has it.
    #[arg(long, value_name = "M", value_parser = parse_positive, requires = "tum")]
    pub rpe: Option<f64>,
    /// Poses further apart in time are not held against each other, s.
    #[arg(long, value_name = "S", value_parser = parse_positive, default_value = "0.01", requires = "tum")]
    pub max_difference: f64,
}

impl Default for TrajectoryArgs {
    fn default() -> Self {
        TrajectoryArgs { tum: None, align: Alignment::None, rpe: None, max_difference: 0.01 }
    }
}

/// On the command line and in the result.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Alignment {
    /// Nothing: it is the frame of the truth.
    #[default]
    None,
    /// Place and heading.
    Yaw,
    /// Place and attitude (Umeyama without scale).
    Se3,
}

fn parse_positive(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value: &f64| value.is_finite() && *value > 0.0);
    value.ok_or_else(|| "expected a positive number".to_owned())
}

/// What came of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TrajectoryScore {
    /// Poses of the trajectory.
    pub poses: u64,
    /// Poses of the truth.
    pub truth_poses: u64,
    /// First and last pair, s of data time.
    pub t_first_s: f64,
    /// Last pair.
    pub t_last_s: f64,
    /// What was fitted.
    pub align: Alignment,
    /// Absolute trajectory error, m.
    pub ate: Distances,
    /// Relative pose error, m.
    pub rpe: Option<Distances>,
    /// Length of its stretches, m.
    pub rpe_length: Option<f64>,
}

impl TrajectoryScore {
    /// The figures for a reader.
    pub fn table(&self) -> String {
        let mut text = format!(
            "{} pairs of {} poses and {} of the truth, {:.1} s, aligned: {}\n{:<28}{:>12}{:>12}{:>12}{:>12}{:>12}\n",
            self.ate.count,
            self.poses,
            self.truth_poses,
            self.t_last_s - self.t_first_s,
            match self.align {
                Alignment::None => "nothing",
                Alignment::Yaw => "place and heading",
                Alignment::Se3 => "place and attitude",
            },
            "",
            "RMSE",
            "mean",
            "median",
            "min",
            "max"
        );
        let mut row = |name: &str, d: &Distances| {
            let [rmse, mean, median, min, max] = [d.rmse, d.mean, d.median, d.min, d.max];
            writeln!(text, "{name:<28}{rmse:>12.6}{mean:>12.6}{median:>12.6}{min:>12.6}{max:>12.6}")
                .expect("a String takes everything");
        };
        row("absolute error (ATE), m", &self.ate);
        if let (Some(rpe), Some(length)) = (&self.rpe, self.rpe_length) {
            row(&format!("relative over {length} m, m"), rpe);
        }
        text
    }
}

/// Holds the trajectory `tum` against `truth`, a `truth.csv` or another TUM file.
///
/// `origin`: of the ENU frame in which a `truth.csv` is to be taken (degrees, degrees, m); where nothing says it and the frame is
/// fitted anyway, the first row.
///
/// # Errors
/// A bad file, an unknown origin, no common time.
pub fn score_trajectory(
    tum: &Path,
    truth: &Path,
    origin: Option<[f64; 3]>,
    window: Window,
    args: &TrajectoryArgs,
) -> Result<TrajectoryScore, ReplayError> {
    let mut estimates = read_poses(tum)?;
    let mut truths = match truth.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("csv")) {
        true => truth_poses(truth, tum, origin, args.align)?,
        false => read_poses(truth)?,
    };
    let (poses, truth_count) = (estimates.len() as u64, truths.len() as u64);
    for poses in [&mut estimates, &mut truths] {
        poses.retain(|pose| window.from <= pose.t && pose.t <= window.to);
    }
    let pairs = associate(&estimates, &truths, Duration::from_seconds(args.max_difference));
    let motion = match args.align {
        Alignment::None => Motion::None,
        Alignment::Yaw => Motion::Yaw,
        Alignment::Se3 => Motion::Se3,
    };
    let (Some(ate), Some(first), Some(last)) = (absolute_error(&pairs, motion), pairs.first(), pairs.last()) else {
        return Err(ReplayError::NoCommonPoses {
            estimate: tum.to_owned(),
            truth: truth.to_owned(),
            max_difference_s: args.max_difference,
            estimate_span: span(&estimates),
            truth_span: span(&truths),
        });
    };
    let rpe = match args.rpe {
        None => None,
        Some(length) => {
            let rpe = relative_error(&pairs, length);
            Some(rpe.ok_or_else(|| ReplayError::NoStretches { estimate: tum.to_owned(), length })?)
        }
    };
    Ok(TrajectoryScore {
        poses,
        truth_poses: truth_count,
        t_first_s: first.truth.t.as_seconds(),
        t_last_s: last.truth.t.as_seconds(),
        align: args.align,
        ate,
        rpe,
        rpe_length: args.rpe,
    })
}

fn span(poses: &[Pose]) -> String {
    match (poses.first(), poses.last()) {
        (Some(first), Some(last)) => format!("{} to {} s", first.t, last.t),
        _ => "nothing within the limits given".to_owned(),
    }
}

fn read_poses(file: &Path) -> Result<Vec<Pose>, ReplayError> {
    let pose = |row: ilns_recording::TumRow| Pose {
        t: row.t,
        position: row.position.into(),
        attitude: attitude(row.quaternion),
    };
    Ok(read_tum(file)?.into_iter().map(pose).collect())
}

/// The truth in the ENU frame of its log. Rows without a position are passed over.
fn truth_poses(truth: &Path, tum: &Path, origin: Option<[f64; 3]>, align: Alignment) -> Result<Vec<Pose>, ReplayError> {
    let rows = read_truth(truth)?.collect::<Result<Vec<Truth>, _>>()?;
    let place = |row: &Truth| Geodetic::from_degrees(row.lat_deg, row.lon_deg, row.height);
    let is_placed = |row: &&Truth| [row.lat_deg, row.lon_deg, row.height].iter().all(|value| value.is_finite());
    let frame = match (origin::find(origin, tum, Some(truth)), rows.iter().find(is_placed)) {
        (Ok(origin), _) => origin,
        // Where the frame is fitted, any will do.
        (Err(ReplayError::NoOrigin { .. }), Some(first)) if align != Alignment::None => place(first),
        (Err(error), _) => return Err(error),
    };
    let frame = LocalFrame::new(frame);
    let pose = |row: &Truth| Pose {
        t: Time(row.header.t_valid),
        position: frame.to_enu(&place(row)),
        attitude: attitude(row.q_enu_body),
    };
    Ok(rows.iter().filter(is_placed).map(pose).collect())
}

/// From Hamilton (w, x, y, z); rounding in files is taken out.
fn attitude([w, x, y, z]: [f64; 4]) -> Option<UnitQuaternion<f64>> {
    let is_reported = Vector3::new(x, y, z).norm_squared() + w * w > 0.5;
    is_reported.then(|| UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)))
}
