//! What all experiments share: their command line, trials on all cores with a bar, and who ran it when.

use std::path::PathBuf;
use std::process::Command;
use std::time::Instant;

use ilns_replay::ReplayError;
use ilns_replay::figure::{Curve, CurveFigure, Panel, PlanFigure};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use sim_world::Preset;

use super::section::Section;
use super::spread::Spread;
use crate::parallel::{all_cores, in_parallel_on};
use crate::trial::{CurvePoint, Outcome, Trial, TrialError};

/// What to run.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Folder for tables, figures and the report; made where there is none. What other experiments left in it stays in the report.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Seeds per row, 1 to N.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..))]
    pub seeds: u64,
    /// Seconds of data time to run at most, for a quick look.
    #[arg(long, value_name = "S")]
    pub until: Option<f64>,
    /// Threads; the results are the same for any number, but for run times.
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// A sequence of KAIST complex urban, such as urban38, for Experiment III.
    #[arg(long, value_name = "DIR")]
    pub kaist: Option<PathBuf>,
}

/// What can stop an experiment.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// A trial.
    #[error(transparent)]
    Trial(#[from] TrialError),
    /// A log or a result file.
    #[error(transparent)]
    Replay(#[from] ReplayError),
}

/// The set that the paper calls FGO-ILNS: IMU, LBL and, though it does not say so, PS.
pub const ILNS: [&str; 3] = ["gnss.enabled=false", "dvl.enabled=false", "mcp.enabled=false"];
/// Ranges as the paper uses them.
pub const DIFFERENCES: &str = "lbl.common_offset_sigma=inf";

/// An experiment in progress.
pub struct Bench<'a> {
    /// Of the command line.
    pub args: &'a Args,
    started: Instant,
    id: &'static str,
}

impl Bench<'_> {
    /// Begins one.
    pub fn new<'a>(args: &'a Args, id: &'static str) -> Bench<'a> {
        Bench { args, started: Instant::now(), id }
    }

    /// A trial of Table I's noises with those settings, as long as the command line allows.
    pub fn trial(&self, scenario: &'static str, seed: u64, sets: &[&str]) -> Trial {
        Trial {
            sets: sets.iter().map(|set| (*set).to_owned()).collect(),
            until: self.args.until,
            curve_every: Some(1.0),
            ..Trial::new(scenario, Preset::Paper, seed)
        }
    }

    /// At most `seconds` of data time.
    pub fn until(&self, seconds: f64) -> Option<f64> {
        Some(self.args.until.map_or(seconds, |until| until.min(seconds)))
    }

    /// Trials of one row, over the seeds of the command line.
    pub fn seeds(&self, trial: impl Fn(u64) -> Trial) -> Vec<Trial> {
        (1..=self.args.seeds).map(trial).collect()
    }

    /// Runs trials row by row: one list of outcomes a row, in its order.
    ///
    /// # Errors
    /// Of the first trial that cannot be run.
    pub fn rows<R: Send>(
        &self,
        what: &str,
        rows: &[Vec<Trial>],
        run: impl Fn(&Trial) -> Result<R, TrialError> + Sync,
    ) -> Result<Vec<Vec<R>>, BenchError> {
        let trials: Vec<&Trial> = rows.iter().flatten().collect();
        let bar = bar(&format!("{} {what}", self.id), trials.len() as u64);
        let outcomes = in_parallel_on(self.threads(), &trials, |trial| {
            let outcome = run(trial);
            bar.inc(1);
            outcome
        });
        bar.finish_and_clear();
        let mut outcomes = outcomes?.into_iter();
        Ok(rows.iter().map(|row| outcomes.by_ref().take(row.len()).collect()).collect())
    }

    /// As [`Bench::rows`], each trial through the navigator.
    ///
    /// # Errors
    /// Of the first trial that cannot be run.
    pub fn outcomes(&self, what: &str, rows: &[Vec<Trial>]) -> Result<Vec<Vec<Outcome>>, BenchError> {
        self.rows(what, rows, |trial| trial.run(&[]))
    }

    /// Threads to run on.
    pub fn threads(&self) -> usize {
        self.args.threads.unwrap_or_else(all_cores)
    }

    /// Head of the section.
    pub fn section(&self, title: &str, setting: &str) -> Section {
        Section {
            id: self.id.to_owned(),
            title: title.to_owned(),
            setting: setting.to_owned(),
            seeds: format!("seeds 1 to {}", self.args.seeds),
            version: version(),
            command: format!(
                "cargo run --release -p experiments -- {} --out DIR --seeds {}{}",
                self.id,
                self.args.seeds,
                self.args.until.map_or(String::new(), |until| format!(" --until {until}"))
            ),
            ..Section::default()
        }
    }

    /// Completes the section and leaves its files.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn finish(&self, mut section: Section) -> Result<Section, BenchError> {
        section.took = format!("{:.0} s on {} threads", self.started.elapsed().as_secs_f64(), self.threads());
        section.write(&self.args.out)?;
        eprintln!("{}: {}, {}", section.id, section.seeds, section.took);
        Ok(section)
    }
}

/// A bar on standard error, for a person at a terminal.
fn bar(what: &str, length: u64) -> ProgressBar {
    // Hidden by itself where standard error is no terminal.
    let bar = ProgressBar::with_draw_target(Some(length), ProgressDrawTarget::stderr());
    let style = ProgressStyle::with_template("{msg:<28} [{bar:30}] {pos}/{len} {elapsed} (about {eta} left)");
    bar.set_style(style.expect("the template is well formed").progress_chars("=> "));
    bar.set_message(what.to_owned());
    bar
}

/// `0.1.0, commit abc1234`, as far as git knows it.
fn version() -> String {
    let describe = Command::new("git").args(["describe", "--always", "--dirty", "--exclude", "*"]).output();
    let commit = describe.ok().filter(|output| output.status.success());
    let commit = commit.map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned());
    let version = env!("CARGO_PKG_VERSION");
    commit.map_or(version.to_owned(), |commit| format!("{version}, commit {commit}"))
}

/// Root mean square of the horizontal error between two times, m; `None` where the curve has no point.
pub fn horizontal_rms(outcome: &Outcome, from: f64, to: f64) -> Option<f64> {
    let squares: Vec<f64> = outcome
        .curve
        .iter()
        .filter(|point| from <= point.t && point.t <= to)
        .map(|point| point.error_enu[0].powi(2) + point.error_enu[1].powi(2))
        .collect();
    (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}

/// Mean and spread of a figure of a row.
pub fn over(row: &[Outcome], figure: impl Fn(&Outcome) -> f64) -> Spread {
    Spread::of(row.iter().map(figure))
}

/// In how many runs of one row the horizontal error is lower than in the other's of the same seed, and of how many.
pub fn lower_in(ours: &[Outcome], theirs: &[Outcome]) -> (usize, usize) {
    let lower =
        ours.iter().zip(theirs).filter(|(ours, theirs)| ours.score.rms_horizontal < theirs.score.rms_horizontal);
    (lower.count(), ours.len())
}

/// RMS east, north, up of a row.
pub fn rms(row: &[Outcome]) -> [Spread; 3] {
    [0, 1, 2].map(|axis| over(row, |outcome| outcome.score.rms_enu[axis]))
}

/// Error of a run and its three sigmas along one axis.
pub fn error_curve(name: &str, outcome: &Outcome, axis: usize, with_band: bool) -> Curve {
    let shown = || outcome.curve.chunks(outcome.curve.len().div_ceil(CURVE_POINTS).max(1)).map(|of| worst(of, axis));
    let band = |point: &CurvePoint| [point.t, -3.0 * point.sigma_enu[axis], 3.0 * point.sigma_enu[axis]];
    Curve {
        name: name.to_owned(),
        points: shown().map(|point| [point.t, point.error_enu[axis]]).collect(),
        band: if with_band { shown().map(band).collect() } else { Vec::new() },
    }
}

/// Points of a curve on the page: about as many as it has pixels.
const CURVE_POINTS: usize = 600;

/// Of a stretch, the point that matters. A stretch is never empty.
fn worst(stretch: &[CurvePoint], axis: usize) -> &CurvePoint {
    let size = |point: &CurvePoint| point.error_enu[axis].abs();
    stretch.iter().max_by(|a, b| size(a).total_cmp(&size(b))).expect("chunks have a point")
}

/// East, north and up errors of several runs over time, one under the other; the band is that of the last.
pub fn error_figure(title: &str, runs: &[(&str, &Outcome)]) -> CurveFigure {
    let panel = |(axis, name): (usize, &str)| Panel {
        y_label: format!("{name}, m"),
        curves: (1..).zip(runs).map(|(at, (name, run))| error_curve(name, run, axis, at == runs.len())).collect(),
        y_range: None,
    };
    CurveFigure {
        title: title.to_owned(),
        x_label: "time, s".to_owned(),
        panels: [(0, "east"), (1, "north"), (2, "up")].map(panel).into(),
        ..CurveFigure::default()
    }
}

/// Truth and estimate of several runs from above.
pub fn plan_figure(title: &str, runs: &[(&str, &Outcome)], buoys: Vec<(u32, [f64; 2])>) -> PlanFigure {
    let of = |point: &CurvePoint, share: f64| [0, 1].map(|axis| point.truth_enu[axis] + share * point.error_enu[axis]);
    let track = |run: &Outcome, share: f64| run.curve.iter().map(|point| of(point, share)).collect();
    let truth = runs.first().map(|(_, run)| ("truth".to_owned(), track(run, 0.0)));
    let estimates = runs.iter().map(|(name, run)| ((*name).to_owned(), track(run, 1.0)));
    PlanFigure { title: title.to_owned(), tracks: truth.into_iter().chain(estimates).collect(), buoys }
}

/// Where the buoys of a scenario are moored.
pub fn buoys_of(trial: &Trial) -> Result<Vec<(u32, [f64; 2])>, TrialError> {
    let all = trial.place()?.buoys.all;
    Ok(all.iter().map(|buoy| (buoy.number, [buoy.position_enu[0], buoy.position_enu[1]])).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_the_same_for_any_number_of_threads() {
        let run = |threads: usize| {
            let args = Args { out: PathBuf::new(), seeds: 3, until: Some(40.0), threads: Some(threads), kaist: None };
            let bench = Bench::new(&args, "test");
            let row = bench.seeds(|seed| bench.trial("stable", seed, &ILNS));
            let outcomes = bench.outcomes("", &[row]).expect("the scenario is built in");
            outcomes[0].iter().map(|outcome| outcome.score.clone()).collect::<Vec<_>>()
        };
        let alone = run(1);
        assert_eq!(alone, run(3));
        assert_ne!(alone[0], alone[1], "seeds differ");
    }
}
