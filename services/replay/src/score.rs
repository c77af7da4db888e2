//! `ilns score`: how good an estimate file is against a truth.

use std::path::{Path, PathBuf};

use clap::Args;
use ilns_recording::{EstimateRow, LogDirectory, LogReader, read_estimates, read_truth};
use ilns_runtime::answer;
use nalgebra::Vector3;
use nav_evaluation::{EstimatePoint, Pair, Score, Scorer, Window};
use nav_geometry::Geodetic;
use serde::Serialize;
use shared_types::{Time, Truth};

use crate::error::ReplayError;
use crate::origin;
use crate::output::estimate_file;
use crate::trajectory::{TrajectoryArgs, score_trajectory};

/// Holds an estimate file against the truth: RMS, NEES, share within three sigmas; or any trajectory against another.
#[derive(Args, Clone, Debug)]
pub struct ScoreArgs {
    /// A run's folder as `ilns replay` writes it, or an estimate.csv; `summary.json` there gives the origin of the frame.
    #[arg(value_name = "OUT", required_unless_present = "tum", conflicts_with = "tum")]
    pub estimate: Option<PathBuf>,
    /// The truth to hold them against; with --tum, a truth.csv or another trajectory in TUM format.
    #[arg(long, value_name = "DIR/truth.csv")]
    pub truth: PathBuf,
    #[command(flatten)]
    #[expect(missing_docs, reason = "a doc comment here would become the help text of the whole group")]
    pub trajectory: TrajectoryArgs,
    /// Print JSON instead of a table.
    #[arg(long)]
    pub json: bool,
    /// Score from this time on, seconds on the clock of the log.
    #[arg(long, value_name = "T", value_parser = parse_time, allow_hyphen_values = true)]
    pub from: Option<Time>,
    /// Score up to this time, seconds on the clock of the log.
    #[arg(long, value_name = "T", value_parser = parse_time, allow_hyphen_values = true)]
    pub to: Option<Time>,
    /// Origin of the ENU frame (degrees, degrees, m), where no `summary.json` or `sensors.toml` says it.
    #[arg(long, value_name = "LAT,LON,H", value_parser = origin::parse, allow_hyphen_values = true)]
    pub origin: Option<[f64; 3]>,
}

pub(crate) fn parse_time(text: &str) -> Result<Time, String> {
    Time::parse(text.as_bytes()).map_err(|error| error.to_string())
}

/// Scores and prints to standard output.
///
/// # Errors
/// A bad file, an unknown origin, or no common time.
pub fn run(args: &ScoreArgs) -> Result<(), ReplayError> {
    let window = Window { from: args.from.unwrap_or(Time::MIN), to: args.to.unwrap_or(Time::MAX) };
    let text = match (&args.trajectory.tum, &args.estimate) {
        (Some(tum), _) => {
            let score = score_trajectory(tum, &args.truth, args.origin, window, &args.trajectory)?;
            if args.json { json(&score) } else { score.table() }
        }
        (None, Some(out)) => {
            let estimate = estimate_file(out);
            let origin = origin::find(args.origin, &estimate, Some(&args.truth))?;
            let score = score_files(&estimate, &args.truth, origin, window, |_, _| {})?;
            if args.json { json(&score) } else { table(&score) }
        }
        (None, None) => unreachable!("the command line asks for one of them"),
    };
    answer(&text).map_err(ReplayError::Print)
}

fn json(score: &impl Serialize) -> String {
    serde_json::to_string_pretty(score).expect("a score has string keys only") + "\n"
}

/// Reads both files side by side and scores them; `see` is shown each estimate and each pair.
///
/// # Errors
/// A bad file, or no common time.
pub(crate) fn score_files(
    estimate: &Path,
    truth: &Path,
    origin: Geodetic,
    window: Window,
    mut see: impl FnMut(&EstimateRow, &[Pair]),
) -> Result<Score, ReplayError> {
    let mut truths = TruthFeed::new(read_truth(truth)?)?;
    let mut scorer = Scorer::new(origin, window);
    let mut pairs = Vec::new();
    for row in read_estimates(estimate)? {
        let row = row?;
        truths.feed(row.t, &mut scorer)?;
        pairs.clear();
        scorer.estimate_with(&point(&row), |pair| pairs.push(*pair));
        see(&row, &pairs);
    }
    scorer.score().ok_or_else(|| ReplayError::NoCommonTime { estimate: estimate.to_owned(), truth: truth.to_owned() })
}

/// Gives a scorer the truth as far as the estimates have come.
#[derive(Debug)]
pub(crate) struct TruthFeed {
    rows: LogReader<Truth>,
    next: Option<Truth>,
}

impl TruthFeed {
    pub(crate) fn new(mut rows: LogReader<Truth>) -> Result<TruthFeed, ReplayError> {
        let next = rows.next().transpose()?;
        Ok(TruthFeed { rows, next })
    }

    /// The truth of a log; `None` where it has none.
    pub(crate) fn of(log: &LogDirectory) -> Result<Option<TruthFeed>, ReplayError> {
        if log.has_truth() { TruthFeed::new(log.truth()?).map(Some) } else { Ok(None) }
    }

    pub(crate) fn feed(&mut self, up_to: Time, scorer: &mut Scorer) -> Result<(), ReplayError> {
        while let Some(truth) = self.next.filter(|truth| truth.header.t_valid <= up_to.0) {
            scorer.truth(&truth);
            self.next = self.rows.next().transpose()?;
        }
        Ok(())
    }
}

fn point(row: &EstimateRow) -> EstimatePoint {
    EstimatePoint {
        t: row.t,
        position_enu: row.position_enu.into(),
        velocity_enu: row.velocity_enu.into(),
        q_enu_body: EstimatePoint::attitude(row.q_enu_body),
        sigma_position_enu: row.sigma_position_enu.into(),
        sigma_velocity_enu: row.sigma_velocity_enu.into(),
        sigma_rpy: Vector3::from(row.sigma_rpy_deg).map(f64::to_radians),
    }
}

/// The figures for a reader.
pub(crate) fn table(score: &Score) -> String {
    let mut text = format!(
        "{} truth rows over {:.1} s and {:.1} m ({} missed)\n",
        score.samples, score.duration_s, score.distance_m, score.missed
    );
    text += &format!("{:<28}{:>12}{:>12}{:>12}\n", "position", "east", "north", "up");
    text += &row("  RMS, m", Some(score.rms_enu));
    text += &row("  largest, m", Some(score.max_enu));
    text += &row("  final, m", Some(score.final_error_enu));
    text += &row("  final 1-sigma, m", Some(score.final_sigma_enu));
    text += &row("  NEES (1 = honest)", score.nees_enu);
    text += &percent("  within 3 sigma", score.three_sigma_share_enu);
    text += &format!("{:<28}{:>12}{:>12}{:>12}\n", "velocity", "east", "north", "up");
    text += &row("  RMS, m/s", score.velocity_rms_enu);
    text += &row("  NEES (1 = honest)", score.nees_velocity_enu);
    text += &percent("  within 3 sigma", score.three_sigma_share_velocity_enu);
    text += &format!("{:<28}{:>12}{:>12}{:>12}\n", "attitude", "body x", "body y", "up axis");
    text += &row("  RMS, deg", score.attitude_rms_deg);
    text += &row("  largest, deg", score.attitude_max_deg);
    text += &row("  NEES (1 = honest)", score.nees_attitude);
    text += &percent("  within 3 sigma", score.three_sigma_share_attitude);
    text += &single("horizontal RMS, m", Some(score.rms_horizontal));
    text += &single("largest horizontal, m", Some(score.max_horizontal));
    text += &single("RMS in space, m", Some(score.rms_3d));
    text += &single("the same, aligned (ATE), m", Some(score.ate_aligned));
    text += &single("position NEES (3 = honest)", score.nees_position);
    text
}

fn row(name: &str, values: Option<[f64; 3]>) -> String {
    match values {
        Some([x, y, z]) => format!("{name:<28}{x:>12.4}{y:>12.4}{z:>12.4}\n"),
        None => format!("{name:<28}{:>12}{:>12}{:>12}\n", "-", "-", "-"),
    }
}

fn percent(name: &str, shares: Option<[f64; 3]>) -> String {
    match shares {
        Some([x, y, z]) => {
            format!("{name:<28}{:>10.2} %{:>10.2} %{:>10.2} %\n", 100.0 * x, 100.0 * y, 100.0 * z)
        }
        None => row(name, None),
    }
}

fn single(name: &str, value: Option<f64>) -> String {
    match value {
        Some(value) => format!("{name:<28}{value:>12.4}\n"),
        None => format!("{name:<28}{:>12}\n", "-"),
    }
}
