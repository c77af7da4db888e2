//! What a replay leaves: the estimate files, the score on the way, the summary at the end.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use hdrhistogram::Histogram;
use ilns_recording::{
    CalibrationSummary, ESTIMATE_FILES, EstimateWriter, LogDirectory, SUMMARY_FILE, SensorSummary, SolveTimes, Summary,
    TimeOffsetSummary,
};
use nav_evaluation::{EstimatePoint, Score, Scorer, Window};
use nav_geometry::Geodetic;
use shared_types::{AIDING, CALIBRATIONS, Mode, NavEstimate, SENSORS, Sensor, SensorCounts, Time};

use crate::background::BackgroundWriter;
use crate::error::ReplayError;
use crate::progress::Progress;
use crate::score::{TruthFeed, table};

/// What only the navigator and its caller know about the run.
#[derive(Clone, Debug)]
pub struct RunFacts {
    /// Injected into the readings.
    pub faults: Vec<String>,
    /// By name.
    pub estimator: &'static str,
    /// Intervals in the window; 0 of a filter.
    pub window: usize,
    /// Keyframes solved.
    pub keyframes: u64,
    /// Keyframes that gave no solution.
    pub keyframes_unsolved: u64,
    /// Over all keyframes.
    pub iterations: u64,
    /// CPU time per keyframe with a full window, or any of a filter, ns.
    pub solve_ns: Histogram<u64>,
    /// Readings read per sensor, in the order of [`SENSORS`].
    pub received: [u64; 7],
    /// What became of them, in the same order.
    pub counts: [SensorCounts; 7],
    /// Time offsets of the [`AIDING`] sensors and their sigmas, s.
    pub time_offsets: ([f64; 5], [f64; 5]),
    /// What [`CALIBRATIONS`] are found to be off by and its sigmas.
    pub calibrations: ([f64; 2], [f64; 2]),
}

/// The results of a run under construction; none bears its name before [`ReplayOutput::finish`].
#[derive(Debug)]
pub struct ReplayOutput {
    out: PathBuf,
    started: Instant,
    estimates: BackgroundWriter,
    /// Begun with the first of them.
    lagged: Option<EstimateWriter>,
    written: u64,
    truth: Option<TruthFeed>,
    scorer: Option<Scorer>,
    origin: [f64; 3],
    modes: [u64; 5],
    first: Option<Time>,
    last: Option<Time>,
    progress: Progress,
}

impl ReplayOutput {
    /// Begins the results of a replay of `log` in `out`; those of an earlier run in it are removed.
    ///
    /// `started`: when the process did, for `wall_s`.
    ///
    /// # Errors
    /// The folder cannot be made, or the truth has a bad header.
    pub fn create(out: &Path, log: &LogDirectory, started: Instant) -> Result<ReplayOutput, ReplayError> {
        let truth = TruthFeed::of(log)?;
        let estimates = BackgroundWriter::create(out)?;
        let summary = out.join(SUMMARY_FILE);
        if summary.exists() {
            fs::remove_file(&summary).map_err(|source| ReplayError::Io { file: summary, action: "delete", source })?;
        }
        Ok(ReplayOutput {
            out: out.to_owned(),
            started,
            estimates,
            lagged: None,
            written: 0,
            truth,
            scorer: None,
            origin: [0.0; 3],
            modes: [0; 5],
            first: None,
            last: None,
            progress: Progress::new(),
        })
    }

    /// The ENU frame is fixed: latitude, longitude in degrees, height in m. To be said before the first estimate that is written.
    pub fn set_origin(&mut self, origin: [f64; 3]) {
        let [lat, lon, height] = origin;
        self.origin = origin;
        self.scorer = Some(Scorer::new(Geodetic::from_degrees(lat, lon, height), Window::default()));
    }

    /// Takes a published estimate; one that is still INITIALISING is neither written nor scored.
    ///
    /// # Errors
    /// A bad row of the truth; of this estimate or one before it, a number that is not finite or a full disk.
    pub fn estimate(&mut self, estimate: &NavEstimate) -> Result<(), ReplayError> {
        let t = Time(estimate.header.t_valid);
        self.progress.at(t);
        if estimate.mode() == Mode::Initialising {
            return Ok(());
        }
        self.written += 1;
        self.modes[estimate.mode() as usize] += 1;
        self.first.get_or_insert(t);
        self.last = Some(t);
        if let (Some(truth), Some(scorer)) = (&mut self.truth, &mut self.scorer) {
            truth.feed(t, scorer)?;
            scorer.estimate(&EstimatePoint::from(estimate));
        }
        self.estimates.write(estimate)?;
        Ok(())
    }

    /// Takes the estimate of a window ago.
    ///
    /// # Errors
    /// A number that is not finite or a full disk.
    pub fn lagged(&mut self, estimate: &NavEstimate) -> Result<(), ReplayError> {
        let writer = match &mut self.lagged {
            Some(writer) => writer,
            none => none.insert(EstimateWriter::create_lagged(&self.out)?),
        };
        writer.write(estimate)?;
        Ok(())
    }

    /// Completes all files and returns what `summary.json` says; prints the score as a table to standard error.
    ///
    /// # Errors
    /// An estimate that is not finite, a full disk.
    pub fn finish(mut self, facts: &RunFacts) -> Result<Summary, ReplayError> {
        self.progress.done();
        let score = self.scorer.as_ref().and_then(Scorer::score);
        let estimates = self.written;
        let duration_s = match (self.first, self.last) {
            (Some(first), Some(last)) => (last - first).as_seconds(),
            _ => 0.0,
        };
        let modes = self.mode_shares(estimates);
        self.estimates.finish()?;
        if let Some(lagged) = self.lagged.take() {
            lagged.finish()?;
        }
        let wall_s = self.started.elapsed().as_secs_f64();
        let summary = Summary {
            lost: 0,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            estimator: facts.estimator.to_owned(),
            faults: facts.faults.clone(),
            window: facts.window,
            duration_s,
            wall_s,
            speed: duration_s / wall_s,
            estimates,
            keyframes: facts.keyframes,
            keyframes_unsolved: facts.keyframes_unsolved,
            iterations: facts.iterations,
            solve_us: solve_times(&facts.solve_ns),
            sensors: SENSORS
                .iter()
                .map(|sensor| {
                    let index = sensor.index();
                    let mut summary = SensorSummary::new(facts.received[index], &facts.counts[index]);
                    summary.time_offset = time_offset(facts, *sensor);
                    summary.calibrations = calibrations(facts, *sensor);
                    (sensor.name().to_owned(), summary)
                })
                .collect(),
            origin: self.origin,
            modes,
            score: score.as_ref().map(|score| serde_json::to_value(score).expect("a score has string keys only")),
        };
        summary.write(&self.out)?;
        report(&summary, score.as_ref());
        Ok(summary)
    }

    fn mode_shares(&self, estimates: u64) -> BTreeMap<String, f64> {
        Mode::ALL
            .iter()
            .filter(|mode| self.modes[**mode as usize] > 0)
            .map(|mode| (mode.name().to_owned(), self.modes[*mode as usize] as f64 / estimates as f64))
            .collect()
    }
}

/// What was found of a sensor's stamps; `None` where nothing spoke against them.
fn time_offset(facts: &RunFacts, sensor: Sensor) -> Option<TimeOffsetSummary> {
    let place = AIDING.iter().position(|&aiding| aiding == sensor)?;
    let (offset_s, sigma_s) = (facts.time_offsets.0[place], facts.time_offsets.1[place]);
    (offset_s != 0.0).then_some(TimeOffsetSummary { offset_s, sigma_s })
}

/// What was found of a sensor's calibrations.
fn calibrations(facts: &RunFacts, sensor: Sensor) -> BTreeMap<String, CalibrationSummary> {
    let found = CALIBRATIONS.into_iter().filter(|calibration| calibration.sensor() == sensor);
    let found = found.map(|calibration| {
        let (unit, scale) = calibration.shown_in();
        let [value, sigma] = [facts.calibrations.0, facts.calibrations.1].map(|of| of[calibration.index()] * scale);
        (calibration.name().to_owned(), CalibrationSummary { value, sigma, unit: unit.to_owned() })
    });
    found.filter(|(_, found)| found.value != 0.0).collect()
}

fn solve_times(solve_ns: &Histogram<u64>) -> SolveTimes {
    let micros = |ns: u64| ns as f64 * 1e-3;
    SolveTimes {
        p50: micros(solve_ns.value_at_quantile(0.5)),
        p99: micros(solve_ns.value_at_quantile(0.99)),
        max: micros(solve_ns.max()),
    }
}

/// For the person who started it.
fn report(summary: &Summary, score: Option<&Score>) {
    eprintln!(
        "{:.1} s of data in {:.2} s ({:.0} times real time): {} estimates, {} keyframes",
        summary.duration_s, summary.wall_s, summary.speed, summary.estimates, summary.keyframes
    );
    if summary.keyframes_unsolved > 0 {
        eprintln!("{} keyframes gave no solution", summary.keyframes_unsolved);
    }
    for (sensor, counts) in summary.sensors.iter().filter(|(_, counts)| !counts.rejected.is_empty()) {
        let reasons: Vec<String> = counts.rejected.iter().map(|(reason, count)| format!("{reason} {count}")).collect();
        eprintln!(
            "{sensor}: {} of {} refused ({})",
            counts.rejected.values().sum::<u64>(),
            counts.received,
            reasons.join(", ")
        );
    }
    if let Some(score) = score {
        eprint!("{}", table(score));
    }
}

/// The estimates of a run: its file itself, or the file in the folder that `ilns replay` wrote.
pub(crate) fn estimate_file(out: &Path) -> PathBuf {
    if out.is_dir() { out.join(ESTIMATE_FILES[0]) } else { out.to_owned() }
}
