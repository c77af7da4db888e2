//! A run that has ended, for the page: looked at as a live one is, ten times a second of data time, through the same model.

use std::path::Path;

use ilns_recording::{
    ESTIMATE_FILES, EstimateRow, LogDirectory, LogError, SUMMARY_FILE, SensorSummary, Summary, read_estimates,
};
use shared_types::{
    Duration, FrameOrigin, Header, Heartbeat, Message, NavEstimate, Process, ProcessState, REJECT_REASONS, SENSORS,
    SensorHealth, Time, Truth,
};

use crate::compact::compact_json;
use crate::history::{History, Kind, Limits, Sample};
use crate::model::Model;
use crate::snapshot::{CalibrationFound, Snapshot};

/// Between two looks, of data time.
const LOOK: Duration = Duration(100_000_000);

/// Between two states of the tables, in looks.
const STATE_EVERY: u64 = 20;

/// Folds a finished run.
#[derive(Debug)]
pub struct Finished {
    /// What the run's messages are folded into.
    pub model: Model,
    history: History,
    next_look: Time,
    looks: u64,
    title: String,
}

/// A finished run as the page takes it.
#[derive(Clone, Debug)]
pub struct Run {
    /// The history as JSON.
    pub json: String,
    /// The last state.
    pub end: Snapshot,
}

impl Finished {
    /// Nothing has been folded yet. The page is headed by `title`.
    pub fn new(title: &str) -> Finished {
        Finished {
            model: Model::new(title),
            history: History::new(Limits::FINISHED),
            next_look: Time::MIN,
            looks: 0,
            title: title.to_owned(),
        }
    }

    /// Folds an estimate, and looks at the whole if that is due.
    pub fn estimate(&mut self, estimate: &NavEstimate) {
        self.model.estimate(estimate);
        let t = estimate.t_valid();
        if t >= self.next_look {
            self.look(t);
            self.next_look = t + LOOK;
        }
    }

    /// Folds the preprocessor's account at the data time `t`, which a live one gives with its heartbeat.
    pub fn sensors(&mut self, health: &[SensorHealth; SENSORS.len()], t: Time) {
        self.model.heartbeat(&account(health, t));
    }

    fn look(&mut self, t: Time) {
        self.model.settle(t.0);
        let snapshot = self.model.snapshot();
        if let Some(sample) = Sample::of(&snapshot) {
            self.history.sample(sample);
        }
        let news = self.model.take_news();
        for keyframe in &news.keyframes {
            self.history.keyframe(keyframe, &compact_json(keyframe));
        }
        for fix in &news.fixes {
            self.history.fix(&compact_json(fix));
        }
        if self.looks.is_multiple_of(STATE_EVERY) {
            self.history.state(&snapshot.brief_json());
        }
        self.looks += 1;
    }

    /// The whole; `None` when no estimate ever came.
    pub fn end(mut self) -> Option<Run> {
        let t = self.model.snapshot().t?;
        // What waited for more is looked at as it is.
        for _ in 0..2 {
            self.look(Time::from_seconds(t));
        }
        let mut end = self.model.snapshot();
        // There were no processes; their clock is not this one.
        end.processes.clear();
        end.hops.clear();
        (end.estimates.age, end.speed) = (None, None);
        Some(self.close(end))
    }

    fn close(self, end: Snapshot) -> Run {
        Run { json: self.history.json(Kind::Finished, &self.title, &end), end }
    }

    /// A run of which estimates are left, in `out` (a folder of `ilns replay`, or an `estimate.csv`), and perhaps the log
    /// that it came from: its truth, buoys and fixes are then shown, too. `None` when the file has no estimate.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn from_files(out: &Path, log: Option<&LogDirectory>, title: &str) -> Result<Option<Run>, LogError> {
        let estimates = if out.is_dir() { out.join(ESTIMATE_FILES[0]) } else { out.to_owned() };
        let summary = estimates.with_file_name(SUMMARY_FILE);
        let summary = if summary.exists() { Some(Summary::read(&summary)?) } else { None };
        let mut finished = Finished::new(title);
        if let Some(summary) = &summary {
            let [lat_deg, lon_deg, height] = summary.origin;
            finished.model.frame_origin(&FrameOrigin { header: Header::default(), lat_deg, lon_deg, height });
        }
        let mut truths = log.map(LogDirectory::truth).transpose()?;
        let mut fixes = log.map(LogDirectory::gnss).transpose()?;
        if let Some(log) = log {
            log.buoy_fixes()?.iter().for_each(|fix| finished.model.buoy(fix));
        }
        let mut next_truth = truths.as_mut().and_then(Iterator::next).transpose()?;
        let mut next_fix = fixes.as_mut().and_then(Iterator::next).transpose()?;
        for row in read_estimates(&estimates)? {
            let row = row?;
            while let Some(truth) = next_truth.filter(|truth: &Truth| truth.t_valid() <= row.t) {
                finished.model.truth(&truth);
                next_truth = truths.as_mut().and_then(Iterator::next).transpose()?;
            }
            while let Some(fix) = next_fix.filter(|fix| fix.t_valid() <= row.t) {
                finished.model.gnss(&fix);
                next_fix = fixes.as_mut().and_then(Iterator::next).transpose()?;
            }
            finished.estimate(&estimate(&row));
        }
        let Some(t) = finished.model.snapshot().t else { return Ok(None) };
        finished.look(Time::from_seconds(t));
        let mut end = finished.model.snapshot();
        (end.estimates.age, end.speed) = (None, None);
        if let Some(summary) = &summary {
            sum_up(&mut end, summary);
        }
        finished.history.state(&end.brief_json());
        Ok(Some(finished.close(end)))
    }
}

/// As the preprocessor's heartbeat says it.
fn account(health: &[SensorHealth; SENSORS.len()], t: Time) -> Heartbeat {
    Heartbeat {
        header: Header { source: Process::Preprocessor as u16, t_published: t.0, ..Header::default() },
        process: Process::Preprocessor as u32,
        state: ProcessState::Running as u32,
        pid: 0,
        restarts: 0,
        cpu_ns: 0,
        resident_bytes: 0,
        dropped: 0,
        handled: 0,
        sensors: *health,
        hop_in: Default::default(),
        end_to_end: Default::default(),
        work: Default::default(),
    }
}

/// A row of the file as the message that it was.
fn estimate(row: &EstimateRow) -> NavEstimate {
    // The file has no correlations.
    let diagonal = |sigma: [f64; 3]| [sigma[0].powi(2), 0.0, 0.0, sigma[1].powi(2), 0.0, sigma[2].powi(2)];
    let sigma_rpy = row.sigma_rpy_deg.map(f64::to_radians);
    NavEstimate {
        header: Header::at(row.t),
        solution: row.solution.unwrap_or(0),
        t_keyframe: row.t_keyframe.unwrap_or(row.t).0,
        position_enu: row.position_enu,
        velocity_enu: row.velocity_enu,
        q_enu_body: row.q_enu_body,
        accel_bias: row.accel_bias,
        gyro_bias: row.gyro_bias,
        position_cov: diagonal(row.sigma_position_enu),
        velocity_cov: diagonal(row.sigma_velocity_enu),
        attitude_cov: diagonal(sigma_rpy),
        sigma_rpy,
        lat_lon_h: row.lat_lon_h,
        aiding_age: [f64::INFINITY; 5],
        mode: row.mode.unwrap_or(shared_types::Mode::Ok as u32),
        reserved: 0,
    }
}

/// The sensors as the run's summary has them.
fn sum_up(end: &mut Snapshot, summary: &Summary) {
    for row in &mut end.sensors {
        let Some(SensorSummary { received, used, rejected, time_offset, calibrations }) =
            summary.sensors.get(row.sensor.name())
        else {
            continue;
        };
        (row.received, row.used) = (*received, *used);
        let named = REJECT_REASONS.into_iter().map(|reason| reason.name());
        row.rejected = named.filter_map(|reason| Some((reason, *rejected.get(reason)?))).collect();
        row.time_offset = time_offset.map(|offset| offset.offset_s);
        row.time_offset_sigma = time_offset.map(|offset| offset.sigma_s);
        row.calibration = calibrations.iter().next().map(|(name, found)| CalibrationFound {
            name: name.clone(),
            value: found.value,
            sigma: found.sigma,
            unit: found.unit.clone(),
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{estimate_at, report_at, solution_at, truth_at};

    #[test]
    fn a_finished_run_is_looked_at_ten_times_a_second_of_its_own_time() {
        let mut finished = Finished::new("log");
        for index in 0..2000 {
            let t = 10.0 + f64::from(index) * 0.005;
            if index % 200 == 0 {
                let id = u64::from(index as u32 / 200);
                finished.model.solution(&shared_types::Solution { id, ..solution_at(t) });
                finished.model.diagnostics(&shared_types::KeyframeReport { solution: id, ..report_at(t) });
                finished.model.truth(&truth_at(t, [0.0; 3]));
            }
            finished.estimate(&estimate_at(t, [0.5, 0.0, 0.0]));
        }
        let run = finished.end().expect("there were estimates");
        let json: serde_json::Value = serde_json::from_str(&run.json).expect("valid JSON");
        let len = |list: &serde_json::Value| list.as_array().expect("a list").len();
        assert_eq!((json["kind"].as_str(), json["title"].as_str()), (Some("finished"), Some("log")));
        assert_eq!((len(&json["track"]["t"]), len(&json["keyframes"]), len(&json["states"])), (101, 10, 6));
        assert!(json["now"]["processes"].as_array().expect("a list").is_empty());
        let error = json["track"]["de"][5].as_f64().expect("there is a truth");
        assert!((error - 0.5).abs() < 1e-3, "{error}");
    }

    #[test]
    fn without_an_estimate_there_is_no_run() {
        assert!(Finished::new("log").end().is_none());
    }
}
