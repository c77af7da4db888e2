//! A log directory through the navigator for somebody who wants to see everything that it says, not only the estimates.

use std::collections::VecDeque;
use std::path::PathBuf;

use ilns_recording::{LogDirectory, mcap, read_estimates};
use nav_pipeline::{Navigator, Output, Rebase};
use shared_types::{
    Config, Duration, FrameOrigin, KeyframeReport, Message, NavEstimate, RawReading, SENSORS, SensorHealth, Solution,
    Time, Truth,
};

use crate::error::ReplayError;
use crate::replay::ThreadClock;

/// Between two accounts of the sensors, of data time: as a live preprocessor gives them.
const ACCOUNT: Duration = Duration(500_000_000);

/// Sees a navigator at work.
pub trait Watcher {
    /// A reading, before the navigator gets it.
    fn reading(&mut self, reading: &RawReading);
    /// A row of the log's truth, not later than the estimates that follow.
    fn truth(&mut self, truth: &Truth);
    /// The frame was fixed.
    fn origin(&mut self, origin: &FrameOrigin);
    /// A keyframe was solved.
    fn solution(&mut self, solution: &Solution, report: &KeyframeReport);
    /// An estimate was made.
    fn estimate(&mut self, estimate: &NavEstimate);
    /// What was received and refused so far, in the order of [`SENSORS`], at the data time `t`.
    fn sensors(&mut self, health: &[SensorHealth; SENSORS.len()], t: Time);
}

/// Navigates the log; with `follow`, the `estimate.csv` or the MCAP files of the same run, corrections reach the estimates when
/// they did in that run.
///
/// # Errors
/// The log or `follow` cannot be read.
pub fn navigate(
    log: &LogDirectory,
    config: &Config,
    follow: &[PathBuf],
    watcher: &mut impl Watcher,
) -> Result<(), ReplayError> {
    let rebase = if follow.is_empty() { Rebase::After(Duration::ZERO) } else { as_recorded(follow)? };
    let merged = log.merged()?;
    let mut navigator = Navigator::new(config, rebase);
    if !merged.is_recording() {
        navigator = navigator.with_known_buoys(log.buoy_fixes()?);
    }
    let mut truths = log.truth()?;
    let mut truth = truths.next().transpose()?;
    let (mut clock, mut next_account) = (ThreadClock, Time::MIN);
    for reading in merged {
        let reading = reading?;
        watcher.reading(&reading);
        if let RawReading::Imu(sample) = &reading {
            let t = sample.t_valid();
            while let Some(row) = truth.filter(|row| row.t_valid() <= t) {
                watcher.truth(&row);
                truth = truths.next().transpose()?;
            }
            if t >= next_account {
                watcher.sensors(navigator.health(), t);
                next_account = t + ACCOUNT;
            }
        }
        navigator.push(&reading, &mut clock, &mut |output| show(watcher, output));
    }
    navigator.finish(&mut clock, &mut |output| show(watcher, output));
    Ok(())
}

fn show(watcher: &mut impl Watcher, output: Output<'_>) {
    match output {
        Output::Origin(origin) => watcher.origin(origin),
        Output::Estimate(estimate) => watcher.estimate(estimate),
        Output::Lagged(_) => {}
        Output::Solution(solution, report) => watcher.solution(solution, report),
    }
}

/// When each solution reached the estimates of `files`: an `estimate.csv`, or the MCAP files of one recording.
///
/// # Errors
/// One cannot be read, or does not name the solutions.
pub(crate) fn as_recorded(files: &[PathBuf]) -> Result<Rebase, ReplayError> {
    if files.iter().all(|file| file.extension().is_some_and(|extension| extension == "mcap")) {
        return Ok(Rebase::AsRecorded(mcap::solutions(files)?.into()));
    }
    let mut schedule = VecDeque::new();
    for file in files {
        for row in read_estimates(file)? {
            let row = row?;
            let Some(solution) = row.solution else {
                return Err(ReplayError::NotFollowable { file: file.clone() });
            };
            if schedule.back().is_none_or(|&(_, last)| last != solution) {
                schedule.push_back((row.t, solution));
            }
        }
    }
    Ok(Rebase::AsRecorded(schedule))
}
