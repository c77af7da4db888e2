//! What is known, folded from messages: pure, so that every view and every test has the same.
//!
//! Clocks enter as data: data time with the messages, the machine's with [`Model::settle`]. Messages of one look may be
//! folded in any order between channels; what belongs together by time is joined in `settle`.

mod attitude;
mod comparison;
mod events;
mod keyframes;
mod latencies;
mod processes;
mod sensors;
mod sightings;
mod slope;
mod stream;

use std::collections::BTreeMap;

use nalgebra::Vector3;
use nav_geometry::{Geodetic, LocalFrame};
use shared_types::{
    AIDING, BuoyFix, FrameOrigin, GnssFix, Heartbeat, KeyframeReport, LblRange, Mode, NavEstimate, Process, SENSORS,
    Sensor, Solution, SolutionStatus, Time, Truth,
};

use crate::detail::{Hop, News};
use crate::snapshot::{Buoy, Distribution, EventKind, Keyframe, Pose, Snapshot, Solver, TruthError};
use attitude::{roll_pitch_heading, unit_quaternion};
use comparison::Comparison;
use events::Events;
use keyframes::Keyframes;
use latencies::LogHistogram;
use processes::{Processes, is_own_word};
use sensors::Sensors;
use sightings::{Sightings, buoy_enu};
use stream::EstimateStream;

/// The preprocessor's account is old after this, s.
const STALE: f64 = 1.5;

/// An error is shown for so long after its truth, s of data time: a truth may come once a second, and may end.
const TRUTH_LASTS: f64 = 3.0;

/// News that nobody takes are forgotten beyond so many of a kind.
const NEWS_KEPT: usize = 256;

/// Everything that is known of a set.
#[derive(Clone, Debug)]
pub struct Model {
    prefix: String,
    /// CLOCK_MONOTONIC of the last look, ns.
    now: i64,
    frame: Option<LocalFrame>,
    estimates: EstimateStream,
    solution: Option<Solution>,
    report: Option<KeyframeReport>,
    comparison: Comparison,
    sensors: Sensors,
    buoys: BTreeMap<u32, BuoyFix>,
    keyframes: Keyframes,
    sightings: Sightings,
    imu_to_estimate: LogHistogram,
    solves: LogHistogram,
    news: News,
    processes: Processes,
    events: Events,
}

impl Model {
    /// Nothing is known of the set `prefix` yet.
    pub fn new(prefix: &str) -> Model {
        Model {
            prefix: prefix.to_owned(),
            now: 0,
            frame: None,
            estimates: EstimateStream::new(),
            solution: None,
            report: None,
            comparison: Comparison::default(),
            sensors: Sensors::new(),
            buoys: BTreeMap::new(),
            keyframes: Keyframes::default(),
            sightings: Sightings::default(),
            imu_to_estimate: LogHistogram::new(),
            solves: LogHistogram::new(),
            news: News::default(),
            processes: Processes::default(),
            events: Events::default(),
        }
    }

    /// Folds in a message of `nav/estimate`.
    pub fn estimate(&mut self, estimate: &NavEstimate) {
        let news = self.estimates.enter(estimate);
        if estimate.header.origin_t_arrival > 0 {
            self.imu_to_estimate.record(estimate.header.t_published - estimate.header.origin_t_arrival);
        }
        self.comparison.estimate(estimate);
        if let Some(kind) = news {
            self.event(kind);
        }
    }

    /// Folds in a message of `nav/solution`.
    pub fn solution(&mut self, solution: &Solution) {
        let [lat_deg, lon_deg, height] = solution.origin;
        self.set_frame(lat_deg, lon_deg, height);
        self.sensors.solution(solution);
        self.keyframes.solution(solution);
        // The channel repeats its last message to late joiners.
        if self.solution.as_ref().is_none_or(|last| last.id != solution.id) {
            self.solves.record(i64::try_from(solution.solve_ns).unwrap_or(i64::MAX));
        }
        self.solution = Some(*solution);
    }

    /// Folds in a message of `nav/diagnostics`.
    pub fn diagnostics(&mut self, report: &KeyframeReport) {
        self.sensors.report(report);
        self.sightings.report(report);
        self.keyframes.report(report);
        self.report = Some(*report);
    }

    /// Folds in a message of `sensor/lbl`.
    pub fn lbl(&mut self, range: &LblRange) {
        self.sightings.lbl(range);
    }

    /// Folds in a message of `sensor/gnss`.
    pub fn gnss(&mut self, fix: &GnssFix) {
        self.sightings.gnss(fix);
    }

    /// Folds in a message of `nav/frame_origin`.
    pub fn frame_origin(&mut self, origin: &FrameOrigin) {
        self.set_frame(origin.lat_deg, origin.lon_deg, origin.height);
    }

    /// Folds in a message of `sensor/buoys`.
    pub fn buoy(&mut self, fix: &BuoyFix) {
        self.buoys.insert(fix.buoy, *fix);
    }

    /// Folds in a message of `sim/truth`.
    pub fn truth(&mut self, truth: &Truth) {
        self.comparison.truth(truth);
    }

    /// Folds in a message of `health`.
    pub fn heartbeat(&mut self, beat: &Heartbeat) {
        let Some(process) = Process::from_index(beat.process) else { return };
        if let Some(kind) = self.processes.enter(process, beat) {
            self.event(kind);
        }
        if process == Process::Preprocessor && is_own_word(beat) {
            let mut news = Vec::new();
            let t_imu = Time(beat.sensors[Sensor::Imu.index()].t_newest);
            let now = self.t().max((t_imu != Time::MIN).then_some(t_imu));
            self.sensors.health(&beat.sensors, now, &mut |kind| news.push(kind));
            news.into_iter().for_each(|kind| self.event(kind));
        }
    }

    /// Ends a look at the channels, at the monotonic time `now` (ns).
    pub fn settle(&mut self, now: i64) {
        self.now = now;
        self.estimates.settle();
        let t = self.t();
        if let Some(frame) = &self.frame {
            self.comparison.settle(frame);
            self.sightings.settle(t, frame, &mut self.news.fixes);
        }
        self.keyframes.settle(&mut self.news.keyframes);
        forget_beyond(NEWS_KEPT, &mut self.news.keyframes);
        forget_beyond(NEWS_KEPT, &mut self.news.fixes);
    }

    /// What has become whole since the last call, for whoever keeps a history.
    pub fn take_news(&mut self) -> News {
        core::mem::take(&mut self.news)
    }

    /// What is known at the last [`Model::settle`].
    pub fn snapshot(&self) -> Snapshot {
        let own_word = |process| self.processes.own_word(process);
        Snapshot {
            prefix: self.prefix.clone(),
            t: self.t().map(Time::as_seconds),
            speed: self.estimates.speed(),
            mode: self.estimates.mode(),
            origin: self.frame.map(|frame| frame.origin().to_degrees()),
            pose: self.estimates.newest().and_then(|estimate| self.pose(estimate)),
            error: self.comparison.newest().filter(|error| self.is_current(error)).cloned(),
            estimates: self.estimates.brief(self.now),
            solver: self.solution.as_ref().map(|solution| self.solver(solution)),
            keyframe: self.report.as_ref().map(keyframe),
            end_to_end: own_word(Process::Propagator).and_then(|beat| Distribution::of(&beat.end_to_end)),
            hops: self.hops(),
            histograms: [self.imu_to_estimate.brief("imu_to_estimate"), self.solves.brief("solve")]
                .into_iter()
                .flatten()
                .collect(),
            rings: self.rings(),
            sensors: self.sensor_rows(),
            buoys: self.buoys.values().map(|fix| self.buoy_row(fix)).collect(),
            processes: self.processes.rows(self.now),
            events: self.events.list(),
        }
    }

    /// Data time: that of the newest estimate or, without a propagator, of the newest IMU sample.
    fn t(&self) -> Option<Time> {
        self.estimates.t_newest().max(self.sensors.t_newest_imu())
    }

    fn is_current(&self, error: &TruthError) -> bool {
        self.t().is_some_and(|t| t.as_seconds() - error.t <= TRUTH_LASTS)
    }

    fn event(&mut self, kind: EventKind) {
        self.events.enter(self.t(), kind);
    }

    fn set_frame(&mut self, lat_deg: f64, lon_deg: f64, height: f64) {
        let origin = Geodetic::from_degrees(lat_deg, lon_deg, height);
        // It is fixed for a run; every solution repeats it.
        if self.frame.is_none_or(|frame| frame.origin() != origin) && lat_deg.is_finite() && lon_deg.is_finite() {
            self.frame = Some(LocalFrame::new(origin));
        }
    }

    fn pose(&self, estimate: &NavEstimate) -> Option<Pose> {
        if estimate.mode() == Mode::Initialising {
            return None;
        }
        let q_enu_body = unit_quaternion(estimate.q_enu_body)?;
        let r_enu_body = q_enu_body.to_rotation_matrix().into_inner();
        // North at the vehicle is not north at the origin: the meridians meet.
        let r_local_body = match &self.frame {
            Some(frame) => frame.local_axes_at(&Vector3::from(estimate.position_enu)).tr_mul(&r_enu_body),
            None => r_enu_body,
        };
        let [lat_deg, lon_deg, height] = estimate.lat_lon_h;
        let diagonal = |[ee, _, _, nn, _, uu]: [f64; 6]| [ee.sqrt(), nn.sqrt(), uu.sqrt()];
        Some(Pose {
            position_enu: estimate.position_enu,
            velocity_enu: estimate.velocity_enu,
            speed: Vector3::from(estimate.velocity_enu).norm(),
            lat_deg,
            lon_deg,
            height,
            roll_pitch_heading_deg: roll_pitch_heading(&r_local_body).map(f64::to_degrees),
            sigma_position_enu: diagonal(estimate.position_cov),
            covariance_horizontal: [0, 1, 3].map(|place| estimate.position_cov[place]),
            sigma_velocity_enu: diagonal(estimate.velocity_cov),
            sigma_roll_pitch_heading_deg: estimate.sigma_rpy.map(f64::to_degrees),
        })
    }

    fn solver(&self, solution: &Solution) -> Solver {
        let work = self.processes.own_word(Process::Solver).map(|beat| beat.work);
        Solver {
            solutions: solution.id,
            age: self.t().map(|t| (t - Time(solution.t_keyframe)).as_seconds()),
            solve: (solution.solve_ns > 0).then_some(solution.solve_ns as f64 * 1e-9),
            solves: work.as_ref().and_then(Distribution::of),
            iterations: solution.iterations,
            window: solution.keyframes,
            status: SolutionStatus::from_index(solution.status),
        }
    }

    fn hops(&self) -> Vec<Hop> {
        let of_process = |process: Process| {
            let beat = self.processes.own_word(process)?;
            let hops = [("hop_in", &beat.hop_in), ("work", &beat.work), ("end_to_end", &beat.end_to_end)];
            Some(hops.into_iter().filter_map(move |(what, latency)| {
                Distribution::of(latency).map(|distribution| Hop { process, what, distribution })
            }))
        };
        Process::ALL.into_iter().filter_map(of_process).flatten().collect()
    }

    fn rings(&self) -> Vec<crate::Ring> {
        let up = self.estimates.newest().map_or(0.0, |estimate| estimate.position_enu[2]);
        self.frame.as_ref().map_or_else(Vec::new, |frame| self.sightings.rings(frame, &self.buoys, up))
    }

    fn buoy_row(&self, fix: &BuoyFix) -> Buoy {
        let BuoyFix { buoy, lat_deg, lon_deg, height, .. } = *fix;
        let position_enu = self.frame.as_ref().and_then(|frame| buoy_enu(frame, fix)).map(Into::into);
        Buoy { buoy, is_moored: fix.moored != 0, lat_deg, lon_deg, height, position_enu }
    }

    fn sensor_rows(&self) -> Vec<crate::SensorRow> {
        let is_stale = self.processes.silence(Process::Preprocessor, self.now).is_none_or(|silence| silence > STALE);
        let used_age = |sensor| {
            let estimate = self.estimates.newest()?;
            AIDING.iter().position(|&aiding| aiding == sensor).map(|index| estimate.aiding_age[index])
        };
        SENSORS.into_iter().map(|sensor| self.sensors.row(sensor, used_age(sensor), self.t(), is_stale)).collect()
    }
}

fn keyframe(report: &KeyframeReport) -> Keyframe {
    let factors = &report.factors[..report.factors.len().min(report.factor_count as usize)];
    let used = || factors.iter().filter(|factor| factor.refused == 0);
    let rows: u32 = used().map(|factor| factor.rows).sum();
    let nis: f64 = used().map(|factor| factor.nis).sum();
    Keyframe {
        t: Time(report.t_keyframe).as_seconds(),
        used: used().count(),
        refused: factors.len() - used().count(),
        nis_per_row: (rows > 0).then(|| nis / f64::from(rows)),
        cost: report.cost,
    }
}

/// Keeps the newest.
fn forget_beyond<T>(kept: usize, list: &mut Vec<T>) {
    let excess = list.len().saturating_sub(kept);
    list.drain(..excess);
}

#[cfg(test)]
mod tests;
