//! The sensors: as the preprocessor receives them (its heartbeats) and as the estimator uses them (its solutions).

use std::collections::BTreeMap;

use shared_types::{
    AIDING, CALIBRATIONS, FactorReport, KeyframeReport, REJECT_REASONS, SENSORS, Sensor, SensorCounts, SensorHealth,
    Solution, Time,
};

use super::slope::Slope;
use crate::snapshot::{CalibrationFound, EventKind, SensorRow};

const SECOND: i64 = 1_000_000_000;

/// A sensor is silent after so many of its longest steps between readings ...
const STEPS_OF_SILENCE: i64 = 3;

/// ... but not before this, ns: heartbeats look at it twice a second only.
const SHORTEST_SILENCE: i64 = 2 * SECOND;

/// One sensor.
#[derive(Clone, Debug)]
struct Line {
    health: SensorHealth,
    /// Readings received against their own time.
    rate: Slope,
    /// Data time at the last heartbeat.
    t_heard: Option<Time>,
    /// Silent for longer than this is silent, ns; found anew at every reading.
    patience: i64,
    is_silent: bool,
}

impl Line {
    fn new() -> Line {
        Line {
            health: SensorHealth::NONE,
            rate: Slope::over(10 * SECOND),
            t_heard: None,
            patience: SHORTEST_SILENCE,
            is_silent: false,
        }
    }

    fn t_newest(&self) -> Option<Time> {
        (self.health.t_newest != i64::MIN).then_some(Time(self.health.t_newest))
    }

    /// Takes in what the preprocessor says at the data time `now`; an end or a new beginning is news.
    fn enter(&mut self, sensor: Sensor, health: &SensorHealth, now: Option<Time>) -> Option<EventKind> {
        let t_before = self.t_newest();
        self.health = *health;
        self.t_heard = now;
        let t_newest = self.t_newest()?;
        let mut news = None;
        if t_before.is_none_or(|before| before != t_newest) {
            if self.is_silent {
                // The rate over the silence would say nothing of now.
                self.rate.clear();
                self.is_silent = false;
                news = t_before.map(|before| EventKind::SensorBack(sensor, t_newest - before));
            }
            self.rate.enter(t_newest.0, health.received as i64);
            let longest = self.rate.longest_step().unwrap_or(0);
            self.patience = SHORTEST_SILENCE.max(longest.saturating_mul(STEPS_OF_SILENCE));
        } else if !self.is_silent && now.is_some_and(|now| (now - t_newest).0 > self.patience) {
            self.is_silent = true;
            news = Some(EventKind::SensorSilent(sensor));
        }
        news
    }
}

/// Every sensor.
#[derive(Clone, Debug)]
pub(super) struct Sensors {
    lines: [Line; SENSORS.len()],
    counts: [SensorCounts; SENSORS.len()],
    /// Innovation in sigmas at the newest keyframe that has the sensor.
    innovations: [Option<f64>; SENSORS.len()],
    /// What its gate lets through there; twice 0 without one.
    gates: [Option<[f64; 2]>; SENSORS.len()],
    /// Time offset and its 1-sigma, s.
    time_offsets: [Option<[f64; 2]>; SENSORS.len()],
    calibrations: [Option<CalibrationFound>; SENSORS.len()],
}

impl Sensors {
    pub(super) fn new() -> Sensors {
        Sensors {
            lines: core::array::from_fn(|_| Line::new()),
            counts: Default::default(),
            innovations: Default::default(),
            gates: Default::default(),
            time_offsets: Default::default(),
            calibrations: Default::default(),
        }
    }

    /// Takes in the preprocessor's account, heard at the data time `now`.
    pub(super) fn health(&mut self, health: &[SensorHealth; 7], now: Option<Time>, news: &mut impl FnMut(EventKind)) {
        for (sensor, (line, health)) in SENSORS.into_iter().zip(self.lines.iter_mut().zip(health)) {
            if let Some(kind) = line.enter(sensor, health, now) {
                // Moored buoys say where they are once and need not repeat it.
                if sensor != Sensor::Buoys {
                    news(kind);
                }
            }
        }
    }

    /// Takes in the estimator's account.
    pub(super) fn solution(&mut self, solution: &Solution) {
        self.counts = solution.counts;
        let offsets = solution.time_offset.into_iter().zip(solution.time_offset_sigma);
        for (sensor, (offset, sigma)) in AIDING.into_iter().zip(offsets) {
            self.time_offsets[sensor.index()] = (sigma > 0.0).then_some([offset, sigma]);
        }
        let found = solution.calibration.into_iter().zip(solution.calibration_sigma);
        for (calibration, (value, sigma)) in CALIBRATIONS.into_iter().zip(found) {
            let (unit, scale) = calibration.shown_in();
            self.calibrations[calibration.sensor().index()] = (sigma > 0.0).then(|| CalibrationFound {
                name: calibration.name().to_owned(),
                value: value * scale,
                sigma: sigma * scale,
                unit: unit.to_owned(),
            });
        }
    }

    /// Takes in what a keyframe's factors say.
    pub(super) fn report(&mut self, report: &KeyframeReport) {
        let factors = &report.factors[..report.factors.len().min(report.factor_count as usize)];
        for sensor in AIDING {
            let of_sensor = || factors.iter().filter(|factor| factor.sensor == sensor as u32);
            let rows: u32 = of_sensor().map(|factor| factor.rows).sum();
            if rows > 0 {
                let nis: f64 = of_sensor().map(|factor| factor.nis).sum();
                self.innovations[sensor.index()] = Some((nis / f64::from(rows)).sqrt());
                let newest = of_sensor().rfind(|factor| factor.rows > 0);
                let per_row = |factor: &FactorReport| factor.gate.map(|limit| limit / f64::from(factor.rows).sqrt());
                self.gates[sensor.index()] = newest.map(per_row);
            }
        }
    }

    /// Data time of the newest IMU sample that the preprocessor has seen.
    pub(super) fn t_newest_imu(&self) -> Option<Time> {
        self.lines[Sensor::Imu.index()].t_newest()
    }

    /// One sensor; `used_age` is known to the estimate. Ages are those at the last heartbeat, or, when heartbeats fail
    /// to come (`is_stale`), those at `now`.
    pub(super) fn row(&self, sensor: Sensor, used_age: Option<f64>, now: Option<Time>, is_stale: bool) -> SensorRow {
        let (line, counts) = (&self.lines[sensor.index()], &self.counts[sensor.index()]);
        let seen_at = if is_stale { now } else { line.t_heard };
        let age = seen_at.zip(line.t_newest()).map(|(seen, newest)| (seen - newest).as_seconds().max(0.0));
        let is_silent = line.is_silent && sensor != Sensor::Buoys;
        let rejected: BTreeMap<&'static str, u64> = REJECT_REASONS
            .into_iter()
            .map(|reason| (reason.name(), line.health.rejected[reason.index()] + counts.rejected[reason.index()]))
            .filter(|&(_, count)| count > 0)
            .collect();
        SensorRow {
            sensor,
            rate: if is_silent { Some(0.0) } else { line.rate.per_second() },
            age,
            used_age: used_age.filter(|age| age.is_finite()),
            received: line.health.received,
            lost: line.health.lost,
            used: counts.used,
            rejected,
            is_silent,
            innovation: self.innovations[sensor.index()],
            is_gated: self.gates[sensor.index()].map(|gate| gate != [0.0; 2]),
            gate: self.gates[sensor.index()].filter(|gate| *gate != [0.0; 2]),
            time_offset: self.time_offsets[sensor.index()].map(|[offset, _]| offset),
            time_offset_sigma: self.time_offsets[sensor.index()].map(|[_, sigma]| sigma),
            calibration: self.calibrations[sensor.index()].clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{report_at, solution_at};
    use shared_types::{Duration, RejectReason};

    fn heard(received: u64, seconds: f64) -> [SensorHealth; 7] {
        let mut health = [SensorHealth::NONE; 7];
        health[Sensor::Dvl.index()] =
            SensorHealth { received, t_newest: Time::from_seconds(seconds).0, ..SensorHealth::NONE };
        health
    }

    /// A DVL at 1 Hz until 20 s and again from 50 s, seen twice a second.
    fn watched(until: f64) -> (Sensors, Vec<EventKind>) {
        let mut sensors = Sensors::new();
        let mut news = Vec::new();
        let mut now = 0.0;
        while now <= until {
            let whole = now.floor();
            let last = if (20.0..50.0).contains(&whole) { 20.0 } else { whole };
            let received = if whole >= 50.0 { whole as u64 - 29 } else { last as u64 };
            sensors.health(&heard(received, last), Some(Time::from_seconds(now)), &mut |kind| news.push(kind));
            now += 0.5;
        }
        (sensors, news)
    }

    #[test]
    fn rate_and_age_are_in_data_time() {
        let row = watched(15.5).0.row(Sensor::Dvl, Some(f64::INFINITY), None, false);
        assert_eq!((row.rate, row.age, row.used_age), (Some(1.0), Some(0.5), None));
        assert_eq!((row.received, row.is_silent), (15, false));
    }

    #[test]
    fn silence_is_noticed_once_and_so_is_its_end() {
        let (sensors, news) = watched(40.0);
        assert_eq!(news, [EventKind::SensorSilent(Sensor::Dvl)]);
        let row = sensors.row(Sensor::Dvl, None, None, false);
        assert_eq!((row.rate, row.age, row.is_silent), (Some(0.0), Some(20.0), true));
        let (sensors, news) = watched(55.0);
        assert_eq!(
            news,
            [EventKind::SensorSilent(Sensor::Dvl), EventKind::SensorBack(Sensor::Dvl, Duration(30 * SECOND))]
        );
        assert_eq!(sensors.row(Sensor::Dvl, None, None, false).rate, Some(1.0));
    }

    #[test]
    fn a_sensor_that_was_never_heard_is_not_missed() {
        let (sensors, news) = watched(19.0);
        let row = sensors.row(Sensor::Gnss, None, None, false);
        assert_eq!((row.rate, row.age, row.received, row.is_silent), (None, None, 0, false));
        assert!(news.is_empty(), "{news:?}");
    }

    #[test]
    fn ages_grow_when_the_preprocessor_is_gone() {
        let row = watched(15.5).0.row(Sensor::Dvl, None, Some(Time::from_seconds(19.0)), true);
        assert_eq!(row.age, Some(4.0));
    }

    #[test]
    fn refusals_of_preprocessor_and_estimator_are_added_up() {
        let mut sensors = Sensors::new();
        let mut health = heard(9, 1.0);
        health[Sensor::Dvl.index()].rejected[RejectReason::OutOfRange.index()] = 2;
        let mut solution = solution_at(1.0);
        solution.counts[Sensor::Dvl.index()].used = 4;
        solution.counts[Sensor::Dvl.index()].rejected[RejectReason::Gated.index()] = 3;
        sensors.health(&health, None, &mut |_| {});
        sensors.solution(&solution);
        let row = sensors.row(Sensor::Dvl, None, None, false);
        assert_eq!(row.rejected.into_iter().collect::<Vec<_>>(), [("gated", 3), ("out_of_range", 2)]);
        assert_eq!(row.used, 4);
    }

    #[test]
    fn innovation_and_time_offset_are_those_of_the_newest_keyframe_with_the_sensor() {
        let mut sensors = Sensors::new();
        let mut report = report_at(1.0);
        for (factor, nis) in report.factors[..2].iter_mut().zip([1.0, 7.0]) {
            *factor = FactorReport { sensor: Sensor::Lbl as u32, rows: 1, nis, ..FactorReport::default() };
        }
        report.factors[1].gate = [-4.0, 5.0];
        report.factors[2] = FactorReport {
            sensor: Sensor::Dvl as u32,
            rows: 3,
            gate: [0.0, 12.0_f64.sqrt()],
            ..FactorReport::default()
        };
        report.factors[3] = FactorReport { sensor: Sensor::Ps as u32, rows: 1, ..FactorReport::default() };
        report.factor_count = 4;
        sensors.report(&report);
        report.factor_count = 0;
        sensors.report(&report);
        let mut solution = solution_at(1.0);
        (solution.time_offset[2], solution.time_offset_sigma[2]) = (0.05, 0.01);
        (solution.calibration[0], solution.calibration_sigma[0]) = (0.01, 0.001);
        sensors.solution(&solution);
        let lbl = sensors.row(Sensor::Lbl, None, None, false);
        assert_eq!((lbl.innovation, lbl.time_offset), (Some(2.0), None));
        let found = lbl.calibration.as_ref().expect("its sigma is not 0");
        assert_eq!(
            (found.name.as_str(), found.value, found.sigma, found.unit.as_str()),
            ("range_scale", 1.0, 0.1, "%")
        );
        let dvl = sensors.row(Sensor::Dvl, None, None, false);
        assert_eq!(dvl.calibration, None);
        assert_eq!((dvl.innovation, dvl.time_offset, dvl.time_offset_sigma), (Some(0.0), Some(0.05), Some(0.01)));
        let gate = |sensor| {
            let row = sensors.row(sensor, None, None, false);
            (row.is_gated, row.gate)
        };
        assert_eq!(gate(Sensor::Lbl), (Some(true), Some([-4.0, 5.0])));
        let (is_gated, limits) = gate(Sensor::Dvl);
        assert_eq!(
            (is_gated, limits.map(|[low, high]| [low, (high * 1e9).round() / 1e9])),
            (Some(true), Some([0.0, 2.0]))
        );
        assert_eq!(gate(Sensor::Ps), (Some(false), None), "no gate stands before its factors");
        assert_eq!(gate(Sensor::Gnss), (None, None), "nothing is known");
    }
}
