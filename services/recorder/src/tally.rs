//! What a live run was, from what its processes said of themselves: the material of `summary.json`.
//!
//! Counts begin anew when a process is restarted; the tally adds up its lives.

use std::collections::BTreeMap;

use ilns_recording::{SensorSummary, SolveTimes, Summary};
use ilns_runtime::Latency;
use shared_types::{Config, Heartbeat, Mode, Process, SENSORS, SensorCounts, SensorHealth, Solution};

use crate::estimate_log::Written;

/// Counts of one sensor over all lives of a process.
type Count = [u64; 2 + shared_types::REJECT_REASONS.len()];

/// Adds up counts that fall back to zero when their process is restarted.
#[derive(Clone, Debug, Default)]
struct Lives {
    epoch: Option<u32>,
    before: [Count; SENSORS.len()],
    now: [Count; SENSORS.len()],
}

impl Lives {
    fn take(&mut self, epoch: u32, counts: [Count; SENSORS.len()]) {
        // A solver that begins from a checkpoint carries its counts on.
        let began_anew = |before: &Count, now: &Count| before.iter().zip(now).any(|(before, now)| now < before);
        if self.epoch.is_some_and(|last| last != epoch) {
            for index in 0..SENSORS.len() {
                if began_anew(&self.now[index], &counts[index]) {
                    for (sum, last) in self.before[index].iter_mut().zip(self.now[index]) {
                        *sum += last;
                    }
                }
            }
        }
        self.epoch = Some(epoch);
        self.now = counts;
    }

    fn total(&self, index: usize) -> Count {
        let mut total = self.before[index];
        for (sum, now) in total.iter_mut().zip(self.now[index]) {
            *sum += now;
        }
        total
    }
}

/// Everything for the summary but the estimates themselves.
#[derive(Debug)]
pub(crate) struct Tally {
    estimator: &'static str,
    window: usize,
    /// Of the preprocessor: received, nothing, rejected by reason.
    readings: Lives,
    /// Of the solver: nothing, used, rejected by reason.
    measurements: Lives,
    keyframes: u64,
    iterations: u64,
    solve: Latency,
}

impl Tally {
    pub(crate) fn new(config: &Config) -> Tally {
        Tally {
            estimator: config.navigator.estimator.name(),
            window: config.navigator.fgo.window,
            readings: Lives::default(),
            measurements: Lives::default(),
            keyframes: 0,
            iterations: 0,
            solve: Latency::new(),
        }
    }

    pub(crate) fn heartbeat(&mut self, beat: &Heartbeat) {
        if Process::from_index(beat.process) == Some(Process::Preprocessor) {
            let count = |health: &SensorHealth| counts(health.received, 0, &health.rejected);
            self.readings.take(beat.restarts, beat.sensors.each_ref().map(count));
        }
    }

    pub(crate) fn solution(&mut self, solution: &Solution) {
        self.keyframes += 1;
        self.iterations += u64::from(solution.iterations);
        let is_full = solution.keyframes as usize > self.window;
        if is_full && solution.solve_ns > 0 {
            self.solve.record(solution.solve_ns as i64);
        }
        let count = |sensor: &SensorCounts| counts(0, sensor.used, &sensor.rejected);
        self.measurements.take(solution.header.epoch, solution.counts.each_ref().map(count));
    }

    /// `lost_solutions`: keyframes that were solved and not heard of. Origin and score are left to the caller.
    pub(crate) fn summary(&self, written: &Written, wall_s: f64, lost_solutions: u64) -> Summary {
        let duration_s = written.span.map_or(0.0, |(first, last)| (last - first).as_seconds());
        let estimates: u64 = written.modes.iter().sum();
        let solve = self.solve.brief();
        let micro = |ns: u64| ns as f64 * 1e-3;
        Summary {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            estimator: self.estimator.to_owned(),
            window: self.window,
            duration_s,
            wall_s,
            speed: duration_s / wall_s,
            estimates,
            keyframes: self.keyframes + lost_solutions,
            iterations: self.iterations,
            solve_us: SolveTimes { p50: micro(solve.p50_ns), p99: micro(solve.p99_ns), max: micro(solve.max_ns) },
            sensors: SENSORS.iter().map(|sensor| (sensor.name().to_owned(), self.sensor(sensor.index()))).collect(),
            modes: modes(written, estimates),
            ..Summary::default()
        }
    }

    fn sensor(&self, index: usize) -> SensorSummary {
        let (readings, measurements) = (self.readings.total(index), self.measurements.total(index));
        let mut account = SensorCounts { used: measurements[1], ..SensorCounts::default() };
        for (reason, count) in account.rejected.iter_mut().enumerate() {
            *count = readings[2 + reason] + measurements[2 + reason];
        }
        SensorSummary::new(readings[0], &account)
    }
}

fn counts(received: u64, used: u64, rejected: &[u64]) -> Count {
    let mut count = [0; 2 + shared_types::REJECT_REASONS.len()];
    (count[0], count[1]) = (received, used);
    count[2..].copy_from_slice(rejected);
    count
}

fn modes(written: &Written, estimates: u64) -> BTreeMap<String, f64> {
    let share = |count: u64| count as f64 / estimates as f64;
    let occurred = Mode::ALL.iter().zip(written.modes).filter(|&(_, count)| count > 0);
    occurred.map(|(mode, count)| (mode.name().to_owned(), share(count))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ilns_runtime::HeartbeatBuilder;
    use shared_types::{Header, RejectReason, Sensor, Time};

    fn beat(process: Process, restarts: u32, received: u64, rejected: u64) -> Heartbeat {
        let mut builder = HeartbeatBuilder::new(process, restarts);
        let dvl = &mut builder.sensors[Sensor::Dvl.index()];
        dvl.received = received;
        dvl.rejected[RejectReason::Duplicate.index()] = rejected;
        builder.build()
    }

    fn solution(epoch: u32, used: u64, keyframes: u32, solve_ns: u64) -> Solution {
        let mut counts = [SensorCounts::default(); 7];
        counts[Sensor::Dvl.index()].used = used;
        counts[Sensor::Dvl.index()].rejected[RejectReason::Gated.index()] = 1;
        Solution {
            header: Header { epoch, ..Header::default() },
            origin: [36.0, 127.0, 1.0],
            t_last_used: [0; 5],
            counts,
            keyframes,
            iterations: 2,
            solve_ns,
            ..Solution::empty()
        }
    }

    #[test]
    fn a_summary_adds_up_what_preprocessor_and_solver_said_last() {
        let mut tally = Tally::new(&Config::default());
        tally.heartbeat(&beat(Process::Preprocessor, 0, 10, 1));
        tally.heartbeat(&beat(Process::Preprocessor, 0, 20, 2));
        tally.heartbeat(&beat(Process::EmulatorDvl, 0, 999, 999));
        tally.solution(&solution(0, 8, 5, 90_000));
        tally.solution(&solution(0, 16, 21, 20_000));
        let written = Written {
            span: Some((Time::from_seconds(10.0), Time::from_seconds(14.0))),
            modes: [0, 3, 0, 1, 0],
            ..Written::default()
        };
        let summary = tally.summary(&written, 2.0, 1);
        let dvl = &summary.sensors["dvl"];
        assert_eq!((dvl.received, dvl.used), (20, 16));
        let expected = BTreeMap::from([("duplicate".to_owned(), 2), ("gated".to_owned(), 1)]);
        assert_eq!(dvl.rejected, expected);
        assert_eq!((summary.keyframes, summary.iterations, summary.estimates), (3, 4, 4));
        assert_eq!((summary.duration_s, summary.speed), (4.0, 2.0));
        assert_eq!(summary.modes, BTreeMap::from([("OK".to_owned(), 0.75), ("DEAD_RECKONING".to_owned(), 0.25)]));
        assert!((19.8..=20.2).contains(&summary.solve_us.max), "only full windows count: {:?}", summary.solve_us);
    }

    #[test]
    fn the_lives_of_a_restarted_process_are_added_up() {
        let mut tally = Tally::new(&Config::default());
        tally.heartbeat(&beat(Process::Preprocessor, 0, 100, 4));
        tally.heartbeat(&beat(Process::Preprocessor, 1, 3, 0));
        tally.heartbeat(&beat(Process::Preprocessor, 1, 30, 1));
        // The solver carries its counts on from a checkpoint.
        tally.solution(&solution(0, 70, 5, 0));
        tally.solution(&solution(1, 75, 5, 0));
        let dvl = &tally.summary(&Written::default(), 1.0, 0).sensors["dvl"];
        assert_eq!((dvl.received, dvl.used), (130, 75));
        assert_eq!(dvl.rejected["duplicate"], 5);
    }
}
