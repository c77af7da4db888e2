//! What is known at one moment, ready to be drawn or to be written as JSON.
//!
//! `None` is "not known (yet)"; it becomes `-` on screens and `null` in JSON, as do numbers that are none.

use core::fmt;
use std::collections::BTreeMap;

use serde::{Serialize, Serializer};
use shared_types::{Duration, HopLatency, Mode, Process, ProcessState, RejectReason, Sensor, SolutionStatus};

use crate::compact::compact_json;
use crate::detail::{Histogram, Hop, Ring};

/// Everything that is known.
#[derive(Clone, Debug, Serialize)]
pub struct Snapshot {
    /// Name of the set.
    pub prefix: String,
    /// Data time, s.
    pub t: Option<f64>,
    /// Seconds of data time per second.
    pub speed: Option<f64>,
    /// What the newest estimate may be trusted for.
    #[serde(serialize_with = "mode_name")]
    pub mode: Option<Mode>,
    /// Latitude, longitude in degrees and ellipsoidal height in m of the ENU origin.
    pub origin: Option<[f64; 3]>,
    /// Where the vehicle is; `None` while initialising.
    pub pose: Option<Pose>,
    /// Against the truth, if there is one.
    pub error: Option<TruthError>,
    /// The stream of estimates.
    pub estimates: Estimates,
    /// The newest solution.
    pub solver: Option<Solver>,
    /// The newest keyframe's factors.
    pub keyframe: Option<Keyframe>,
    /// From an IMU sample's arrival to its published estimate.
    pub end_to_end: Option<Distribution>,
    /// Every measured hop of every process.
    pub hops: Vec<Hop>,
    /// Latencies as the messages tell them.
    pub histograms: Vec<Histogram>,
    /// The ranges of the newest epoch.
    pub rings: Vec<Ring>,
    /// Every sensor, in the order of the house.
    pub sensors: Vec<SensorRow>,
    /// Buoys by number.
    pub buoys: Vec<Buoy>,
    /// Every process that was heard of.
    pub processes: Vec<ProcessRow>,
    /// The newest of what happened, oldest first.
    pub events: Vec<Event>,
}

impl Snapshot {
    /// What tables show of another moment, as JSON: buoys and events are left out, as the newest snapshot has them all.
    pub(crate) fn brief_json(&self) -> String {
        #[derive(Serialize)]
        struct Brief<'a> {
            t: Option<f64>,
            #[serde(serialize_with = "mode_name")]
            mode: Option<Mode>,
            pose: &'a Option<Pose>,
            error: &'a Option<TruthError>,
            solver: &'a Option<Solver>,
            sensors: &'a [SensorRow],
            rings: &'a [Ring],
        }
        let Snapshot { t, mode, pose, error, solver, sensors, rings, .. } = self;
        compact_json(&Brief { t: *t, mode: *mode, pose, error, solver, sensors, rings })
    }
}

/// The newest estimate.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Pose {
    /// m.
    pub position_enu: [f64; 3],
    /// m/s.
    pub velocity_enu: [f64; 3],
    /// Length of the velocity, m/s.
    pub speed: f64,
    /// Latitude, degrees.
    pub lat_deg: f64,
    /// Longitude, degrees.
    pub lon_deg: f64,
    /// Ellipsoidal height, m.
    pub height: f64,
    /// Roll and pitch (positive: nose down, as body y points left), and heading clockwise from true north at the vehicle.
    pub roll_pitch_heading_deg: [f64; 3],
    /// 1-sigma, m.
    pub sigma_position_enu: [f64; 3],
    /// Horizontal covariance, m²: east-east, east-north, north-north.
    pub covariance_horizontal: [f64; 3],
    /// 1-sigma, m/s.
    pub sigma_velocity_enu: [f64; 3],
    /// 1-sigma about body x, body y and the up axis.
    pub sigma_roll_pitch_heading_deg: [f64; 3],
}

/// Estimate minus truth at the truth's own time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TruthError {
    /// Data time of the truth, s.
    pub t: f64,
    /// Where the vehicle really was, m.
    pub truth_enu: [f64; 3],
    /// m.
    pub position_enu: [f64; 3],
    /// Each axis in its own sigma.
    pub position_in_sigmas: [f64; 3],
    /// Horizontal distance, m.
    pub horizontal: f64,
    /// Horizontal Mahalanobis distance √(eᵀ P⁻¹ e).
    pub horizontal_in_sigmas: f64,
    /// Of the angles.
    pub roll_pitch_heading_deg: [f64; 3],
    /// Each angle in its own sigma.
    pub roll_pitch_heading_in_sigmas: [f64; 3],
    /// Root mean square per axis since the monitor began, m.
    pub rms_position_enu: [f64; 3],
}

/// The stream of estimates.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Estimates {
    /// Per second of data time.
    pub rate: Option<f64>,
    /// Received by the monitor.
    pub received: u64,
    /// Missing by sequence.
    pub lost: u64,
    /// Since the newest was published, s of the machine's clock.
    pub age: Option<f64>,
}

/// The newest solution.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Solver {
    /// Solutions since the estimation began.
    pub solutions: u64,
    /// Since its keyframe, s of data time.
    pub age: Option<f64>,
    /// CPU time of the newest solve, s.
    pub solve: Option<f64>,
    /// CPU time of solves since the solver began.
    pub solves: Option<Distribution>,
    /// Iterations of the newest solve.
    pub iterations: u32,
    /// Keyframes in the window.
    pub window: u32,
    /// `converged`, `not converged` or `damped`.
    #[serde(serialize_with = "status_name")]
    pub status: Option<SolutionStatus>,
}

/// What the newest keyframe held.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Keyframe {
    /// Data time, s.
    pub t: f64,
    /// Factors that were used.
    pub used: usize,
    /// Factors that were refused.
    pub refused: usize,
    /// Mean squared normalised innovation per residual row of the used factors; 1 is as expected.
    pub nis_per_row: Option<f64>,
    /// Half the weighted sum of squares before and after the solve.
    pub cost: [f64; 2],
}

/// A distribution of times, s.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Distribution {
    /// How many were measured.
    pub count: u64,
    /// Median.
    pub p50: f64,
    /// 99th percentile.
    pub p99: f64,
    /// Longest.
    pub max: f64,
}

impl Distribution {
    /// `None` when nothing was measured.
    pub(crate) fn of(latency: &HopLatency) -> Option<Distribution> {
        let seconds = |ns: u64| ns as f64 * 1e-9;
        (latency.count > 0).then(|| Distribution {
            count: latency.count,
            p50: seconds(latency.p50_ns),
            p99: seconds(latency.p99_ns),
            max: seconds(latency.max_ns),
        })
    }
}

/// One sensor as the preprocessor receives it and the estimator uses it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SensorRow {
    /// Its short name.
    #[serde(serialize_with = "sensor_name")]
    pub sensor: Sensor,
    /// Readings per second of data time; 0 while it is silent.
    pub rate: Option<f64>,
    /// Since the newest reading, s of data time.
    pub age: Option<f64>,
    /// Since the newest reading that the estimate uses, s of data time.
    pub used_age: Option<f64>,
    /// Readings received.
    pub received: u64,
    /// Readings missing by sequence.
    pub lost: u64,
    /// Readings that became factors.
    pub used: u64,
    /// Refused by the preprocessor or the estimator, by reason.
    pub rejected: BTreeMap<&'static str, u64>,
    /// It was heard and is not any more.
    pub is_silent: bool,
    /// Newest innovation of the sensor in its own sigmas, √(NIS / rows) over the factors of its newest keyframe.
    pub innovation: Option<f64>,
    /// Whether a gate stood before the factors of that keyframe.
    pub is_gated: Option<bool>,
    /// What that lets through, as `innovation` is written: 0 to the largest √(NIS / rows), for ranges from the longest to the
    /// shortest in sigmas of each.
    pub gate: Option<[f64; 2]>,
    /// How much too late its stamps are found to be, s; `None` while nothing speaks against them.
    pub time_offset: Option<f64>,
    /// 1-sigma of that, s.
    pub time_offset_sigma: Option<f64>,
    /// What it is found to be miscalibrated by; `None` while nothing speaks against its configuration.
    pub calibration: Option<CalibrationFound>,
}

/// A systematic error of a sensor, in a unit for readers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CalibrationFound {
    /// Which.
    pub name: String,
    /// What it is off by.
    pub value: f64,
    /// 1-sigma of that.
    pub sigma: f64,
    /// Of both.
    pub unit: String,
}

impl SensorRow {
    /// All refusals that are held against the sensor: not those of readings from before the start, or while it is switched off.
    pub fn rejected_total(&self) -> u64 {
        self.rejected.iter().filter(|(reason, _)| SensorRow::is_blamed(reason)).map(|(_, count)| count).sum()
    }

    /// Whether a reason of refusal speaks against the sensor.
    pub(crate) fn is_blamed(reason: &str) -> bool {
        ![RejectReason::BeforeStart, RejectReason::Disabled].map(RejectReason::name).contains(&reason)
    }
}

/// Newest position of a buoy.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Buoy {
    /// Its number.
    pub buoy: u32,
    /// Whether it stays where it is.
    pub is_moored: bool,
    /// Latitude, degrees.
    pub lat_deg: f64,
    /// Longitude, degrees.
    pub lon_deg: f64,
    /// Ellipsoidal height, m.
    pub height: f64,
    /// In the frame of the estimates, m; `None` before that is fixed.
    pub position_enu: Option<[f64; 3]>,
}

/// One process.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ProcessRow {
    /// Which.
    #[serde(serialize_with = "process_name")]
    pub name: Process,
    /// Its number; 0 while it is dead.
    pub pid: u32,
    /// Where it stands, in its own words or, for the dead, in the supervisor's.
    #[serde(serialize_with = "state_name")]
    pub state: Option<ProcessState>,
    /// How often it was restarted.
    pub restarts: u32,
    /// Share of one core, %.
    pub cpu_percent: Option<f64>,
    /// Resident memory, bytes.
    pub resident_bytes: Option<u64>,
    /// Messages that it published and no queue took.
    pub dropped: u64,
    /// Since its last own heartbeat, s of the machine's clock.
    pub silence: Option<f64>,
}

impl ProcessRow {
    /// In its loop, or through with its work, and heard of lately.
    pub fn is_well(&self) -> bool {
        /// Four heartbeats, s.
        const LATELY: f64 = 2.0;
        let in_order = matches!(self.state, Some(ProcessState::Running | ProcessState::Finished));
        in_order && self.silence.is_some_and(|silence| silence < LATELY)
    }
}

/// Something happened.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// Data time at which it was noticed, s.
    pub t: Option<f64>,
    /// What.
    pub kind: EventKind,
}

impl Serialize for Event {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Shape {
            t: Option<f64>,
            what: String,
            is_bad: bool,
        }
        Shape { t: self.t, what: self.kind.to_string(), is_bad: self.kind.is_bad() }.serialize(to)
    }
}

/// What can happen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EventKind {
    /// The estimate's mode; `from` is `None` at the first one.
    Mode {
        /// Before.
        from: Option<Mode>,
        /// From now on.
        to: Mode,
    },
    /// A process died and will be restarted.
    Ended(Process),
    /// A process is there again, for the how many-th time.
    Restarted(Process, u32),
    /// A process died too often.
    GivenUp(Process),
    /// No reading for much longer than usual.
    SensorSilent(Sensor),
    /// Readings come again, after so much data time.
    SensorBack(Sensor, Duration),
}

impl EventKind {
    /// Whether something got worse by it.
    pub fn is_bad(&self) -> bool {
        match self {
            EventKind::Mode { to, .. } => *to > Mode::Ok,
            EventKind::Ended(_) | EventKind::GivenUp(_) | EventKind::SensorSilent(_) => true,
            EventKind::Restarted(..) | EventKind::SensorBack(..) => false,
        }
    }
}

impl fmt::Display for EventKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            EventKind::Mode { from: None, to } => write!(f, "mode {to}"),
            EventKind::Mode { from: Some(from), to } => write!(f, "mode {from} -> {to}"),
            EventKind::Ended(process) => write!(f, "{process} ended"),
            EventKind::Restarted(process, times) => write!(f, "{process} is back (restart {times})"),
            EventKind::GivenUp(process) => write!(f, "{process} ended too often and is given up"),
            EventKind::SensorSilent(sensor) => write!(f, "{sensor} is silent"),
            EventKind::SensorBack(sensor, after) => write!(f, "{sensor} is back after {:.1} s", after.as_seconds()),
        }
    }
}

/// The word on screens.
pub(crate) fn status_word(status: SolutionStatus) -> &'static str {
    match status {
        SolutionStatus::Converged => "converged",
        SolutionStatus::NotConverged => "not converged",
        SolutionStatus::Damped => "damped",
        SolutionStatus::Loosened => "loosened",
        SolutionStatus::Inconsistent => "inconsistent",
    }
}

fn mode_name<S: Serializer>(mode: &Option<Mode>, to: S) -> Result<S::Ok, S::Error> {
    mode.map(Mode::name).serialize(to)
}

pub(crate) fn status_name<S: Serializer>(status: &Option<SolutionStatus>, to: S) -> Result<S::Ok, S::Error> {
    status.map(status_word).serialize(to)
}

fn state_name<S: Serializer>(state: &Option<ProcessState>, to: S) -> Result<S::Ok, S::Error> {
    state.map(ProcessState::name).serialize(to)
}

pub(crate) fn sensor_name<S: Serializer>(sensor: &Sensor, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(sensor.name())
}

pub(crate) fn process_name<S: Serializer>(process: &Process, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(process.name())
}
