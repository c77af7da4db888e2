//! What the catalogue expects of a run with a fault, and whether it came true.

use shared_types::{Mode, RejectReason, Sensor};

use crate::faults::run::{ABEAM, BUOY, PASSED, Row, TURN, Trace};

/// The catalogue says 3, which the largest of a run's hundred or so independent errors exceeds by chance in a quarter of all
/// honest runs; it exceeds 4 in one of two hundred.
const PEAK: f64 = 4.0;

/// One figure of the catalogue. Sigmas are those of the estimate itself, `clean` is the run of the same seed without faults.
#[derive(Clone, Copy, Debug)]
pub enum Expect {
    /// Horizontal RMS over the whole run at most so many times that of `clean`.
    Ratio(f64),
    /// The same from so many s after the beginning of the fault on: (s, times).
    RatioAfter(f64, f64),
    /// Largest error at most [`PEAK`] sigmas, or what `clean` has where that is more.
    Peak,
    /// Back within 1.2 times the RMS of `clean`, this many s after the end of the fault.
    Recovered(f64),
    /// The same, this many s after the estimation began; until then no error is counted.
    Settled(f64),
    /// No step of the estimate by more than so many sigmas (or what `clean` has meanwhile, where that is more) in the 10 s
    /// after the end of the fault.
    StepAfter(f64),
    /// No step of the estimate by more than so many sigmas (or what `clean` has meanwhile, where that is more), from the
    /// beginning of the fault to 10 s after its end.
    Step(f64),
    /// The estimate differs from that of `clean` by so many of its sigmas at most, all the time.
    Effect(f64),
    /// Heading at most so many deg further off than that of `clean`.
    Heading(f64),
    /// Height at most so many m off; not in the first second, before a depth has been heard.
    Vertical(f64),
    /// Every reading that the fault spoilt is counted under this reason.
    Counted(Sensor, RejectReason),
    /// At least this share of the spoilt readings is refused, for whatever reason.
    Refused(Sensor, f64),
    /// This mode, or a worse one, is declared so many s after the beginning of the fault.
    Declared(Mode, f64),
    /// The first reading of the sensor after the end of the fault is accepted within so many s.
    Accepted(Sensor, f64),
    /// With one buoy, passed on a straight course: its distance is known to so many m, whatever the place.
    Distance(f64),
    /// With one buoy: mean of squared error over sigma at most so large, horizontally, until the turn.
    Nees(f64),
    /// With one buoy: so many s after the turn the estimate is for good nearer to the vehicle than to its mirror image.
    Resolved(f64),
}

/// From the first fault's beginning to the last one's end, s.
#[derive(Clone, Copy, Debug)]
pub struct FaultTime {
    /// s.
    pub from: f64,
    /// s; infinite where a fault does not end.
    pub to: f64,
}

/// A figure that was not reached: which, and what was found.
pub struct Miss {
    /// As in the table.
    pub what: String,
    /// Found.
    pub found: f64,
}

impl Expect {
    /// As in the table.
    fn name(self) -> String {
        match self {
            Expect::Ratio(limit) => format!("RMS <= {limit} x clean"),
            Expect::RatioAfter(s, limit) => format!("RMS <= {limit} x clean after {s} s"),
            Expect::Peak => format!("peak <= {PEAK} sigma"),
            Expect::Recovered(limit) => format!("recovered <= {limit} s"),
            Expect::Settled(limit) => format!("settled <= {limit} s"),
            Expect::StepAfter(limit) => format!("step after <= {limit} sigma"),
            Expect::Step(limit) => format!("step <= {limit} sigma"),
            Expect::Effect(limit) => format!("effect <= {limit} sigma"),
            Expect::Heading(limit) => format!("heading <= {limit} deg"),
            Expect::Vertical(limit) => format!("height <= {limit} m"),
            Expect::Counted(sensor, reason) => format!("{sensor} {} counted", reason.name()),
            Expect::Refused(sensor, share) => format!("{sensor} refused >= {:.0} %", 100.0 * share),
            Expect::Declared(mode, limit) => format!("{mode} <= {limit} s"),
            Expect::Accepted(sensor, limit) => format!("{sensor} accepted <= {limit} s"),
            Expect::Distance(limit) => format!("distance of the buoy <= {limit} m off"),
            Expect::Nees(limit) => format!("NEES <= {limit}"),
            Expect::Resolved(limit) => format!("mirror resolved <= {limit} s"),
        }
    }

    /// `None`: it came true.
    pub fn miss(self, trace: &Trace, clean: &Trace, time: FaultTime) -> Option<Miss> {
        let found = self.found(trace, clean, time);
        let is_met = match self {
            Expect::Ratio(limit)
            | Expect::RatioAfter(_, limit)
            | Expect::Recovered(limit)
            | Expect::Settled(limit)
            | Expect::Effect(limit)
            | Expect::Heading(limit)
            | Expect::Vertical(limit)
            | Expect::Declared(_, limit)
            | Expect::Accepted(_, limit)
            | Expect::Distance(limit)
            | Expect::Nees(limit)
            | Expect::Resolved(limit) => found <= limit,
            Expect::Step(limit) | Expect::StepAfter(limit) => found <= self.found(clean, clean, time).max(limit),
            Expect::Peak => found <= clean.worst().0.max(PEAK),
            Expect::Counted(..) => found >= 1.0,
            Expect::Refused(_, share) => found >= share,
        };
        (!is_met).then(|| Miss { what: self.name(), found })
    }

    /// The figure; infinite where it was not reached at all.
    fn found(self, trace: &Trace, clean: &Trace, time: FaultTime) -> f64 {
        let since = |t: f64| trace.rows.iter().filter(move |row| row.t >= t);
        match self {
            Expect::Ratio(_) => trace.rms_since(f64::MIN)[0] / clean.rms_since(f64::MIN)[0],
            Expect::RatioAfter(s, _) => trace.rms_since(time.from + s)[0] / clean.rms_since(time.from + s)[0],
            Expect::Peak => trace.worst().0,
            Expect::Recovered(_) => trace.recovery(clean, time.to).unwrap_or(f64::INFINITY),
            Expect::Settled(_) => trace.recovery(clean, clean.began()).unwrap_or(f64::INFINITY),
            Expect::Step(_) | Expect::StepAfter(_) => {
                let first = if matches!(self, Expect::Step(_)) { time.from } else { time.to };
                let during = since(first).filter(|row| row.t <= time.to + 10.0);
                during.map(|row| row.step).fold(0.0, f64::max)
            }
            Expect::Effect(_) => trace.deviation(clean, f64::MIN, f64::MAX),
            Expect::Heading(_) => {
                let worst = |trace: &Trace| {
                    let after = trace.rows.iter().filter(|row| row.t >= time.from);
                    after.map(|row| row.heading_error_deg.abs()).fold(0.0, f64::max)
                };
                worst(trace) - worst(clean)
            }
            Expect::Vertical(_) => {
                let heard = trace.rows.first().map_or(0.0, |row| row.t + 1.0);
                since(time.from.max(heard)).map(|row| row.error_enu[2].abs()).fold(0.0, f64::max)
            }
            Expect::Counted(sensor, reason) => {
                let count = |trace: &Trace| trace.rejected[sensor.index()][reason.index()];
                (count(trace).saturating_sub(count(clean))) as f64 / spoilt(trace, sensor)
            }
            Expect::Refused(sensor, _) => {
                let count = |trace: &Trace| trace.rejected[sensor.index()].iter().sum::<u64>();
                (count(trace).saturating_sub(count(clean))) as f64 / spoilt(trace, sensor)
            }
            Expect::Declared(mode, _) => {
                let before = trace.modes.iter().rev().find(|(t, _)| *t <= time.from);
                let after = trace.modes.iter().filter(|(t, _)| *t > time.from && *t <= time.to);
                let is_told = |&&(_, found): &&(f64, Mode)| found >= mode;
                match before.filter(is_told).or_else(|| after.filter(is_told).min_by(|a, b| a.0.total_cmp(&b.0))) {
                    Some((t, _)) => (t - time.from).max(0.0),
                    None => f64::INFINITY,
                }
            }
            Expect::Accepted(sensor, _) => trace.accepted_after(sensor, time.to).unwrap_or(f64::INFINITY),
            Expect::Distance(_) => {
                let straight = since(PASSED).filter(|row| row.t < TURN[0]);
                straight.map(|row| distance_error(row).abs()).fold(0.0, f64::max)
            }
            Expect::Nees(_) => trace.until(TURN[0]).nees()[0],
            Expect::Resolved(_) => {
                let is_wrong = |row: &&Row| row.error_enu[0].hypot(row.error_enu[1]) >= ABEAM;
                match trace.rows.iter().rfind(is_wrong) {
                    Some(last) if trace.rows.last().is_some_and(|end| end.t <= last.t) => f64::INFINITY,
                    Some(last) => (last.t - TURN[1]).max(0.0),
                    None => 0.0,
                }
            }
        }
    }
}

/// How much further from the buoy the estimate is than the vehicle, m.
fn distance_error(row: &Row) -> f64 {
    let distance = |place: [f64; 3]| (0..3).map(|axis| (place[axis] - BUOY[axis]).powi(2)).sum::<f64>().sqrt();
    let estimated = [0, 1, 2].map(|axis| row.truth_enu[axis] + row.error_enu[axis]);
    distance(estimated) - distance(row.truth_enu)
}

/// Readings of a sensor that its faults changed or sent twice.
fn spoilt(trace: &Trace, sensor: Sensor) -> f64 {
    let of_sensor = trace.tallies.iter().filter(|(spec, _)| spec.sensor() == sensor);
    of_sensor.map(|(_, tally)| (tally.touched + tally.repeated) as f64).sum()
}
