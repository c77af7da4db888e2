//! The whole walk of a reading: counted, judged, put in order, converted, tied to its keyframe.
//!
//! ```text
//! IMU sample       ImuGate ──────────────────────────────────────────────────────────────────► out at once
//! aiding reading   EventTime (wait until the IMU is settle past it) → duplicate? possible? → TimeOffsets → out with its
//!                                                                                             keyframe
//! ```
//!
//! Everything but the IMU samples themselves comes out behind the IMU sample that let it go, so the order of what comes
//! out depends on the readings and not on how channels were interleaved. If the IMU stops, nothing is let go.
//!
//! Each reading received is either emitted, or counted under one reason, or held; an accepted buoy position is none of
//! these, it has gone into the tracks.

use shared_types::{
    BuoyFix, Config, Duration, FrameOrigin, GnssFix, Header, ImuSample, KeyframeCause, LblRange, Measurement,
    Navigator, RawReading, Reading, RejectReason, SENSORS, Sensor, SensorHealth, Time, Vehicle,
};

use crate::buoy_tracks::BuoyTracks;
use crate::duplicates::Duplicates;
use crate::event_time::EventTime;
use crate::frozen_sensors::FrozenSensors;
use crate::gates;
use crate::imu_gate::{ImuGate, ImuVerdict, is_possible};
use crate::keyframe_times::KeyframeTimes;
use crate::lbl_epochs::LblEpochs;
use crate::origin::{Origin, OriginError};
use crate::time_offset::TimeOffsets;

/// Without a given attitude, readings from this long before `initial.t` are let through: three times what a still
/// initialisation averages (10 s), and not the hour on deck before it.
const INITIALISATION: Duration = Duration(30_000_000_000);

/// A reading that far ahead of the IMU has a wrong stamp, or the IMU is gone.
const AHEAD_MAX: Duration = Duration(60_000_000_000);

/// An older depth says nothing about whether the antenna is under water: a dead pressure sensor must not refuse
/// satellites for ever.
const DEPTH_MAX_AGE: Duration = Duration(10_000_000_000);

/// Raw readings in, anchored measurements out. Holds a bounded number of readings and allocates nothing per IMU sample.
#[derive(Clone, Debug)]
pub struct Preprocessor {
    vehicle: Vehicle,
    navigator: Navigator,
    imu_gate: ImuGate,
    start: Start,
    event_time: EventTime,
    duplicates: Duplicates,
    frozen: FrozenSensors,
    origin: Origin,
    buoys: BuoyTracks,
    epochs: LblEpochs,
    /// With its time; the median of the last three, so that one wild depth refuses no good fix and lets no bad one in.
    newest_depth: Option<(Time, f64)>,
    recent_depths: [f64; 3],
    times: KeyframeTimes,
    offsets: TimeOffsets,
    health: [SensorHealth; SENSORS.len()],
    sigmas_substituted: u64,
}

/// When the estimation starts.
#[derive(Clone, Debug)]
struct Start {
    configured: Option<Time>,
    /// No attitude is given: the estimator needs what came before the start.
    needs_initialisation: bool,
    t_first_imu: Option<Time>,
    /// Known once the IMU has reached it.
    t: Option<Time>,
    /// The newest sample before the start: the start may lie between two samples.
    last_before: Option<ImuSample>,
}

impl Preprocessor {
    /// Has seen nothing yet.
    pub fn new(config: &Config) -> Preprocessor {
        let (vehicle, navigator) = (config.vehicle.clone(), config.navigator.clone());
        Preprocessor {
            imu_gate: ImuGate::new(&navigator.imu),
            start: Start {
                configured: vehicle.initial.t,
                needs_initialisation: vehicle.initial.q_enu_body.is_none(),
                t_first_imu: None,
                t: None,
                last_before: None,
            },
            event_time: EventTime::new(),
            duplicates: Duplicates::new(),
            frozen: FrozenSensors::new(),
            origin: Origin::new(&vehicle.frame),
            buoys: BuoyTracks::new(navigator.buoy_max_age),
            epochs: LblEpochs::new(),
            newest_depth: None,
            recent_depths: [0.0; 3],
            times: KeyframeTimes::new(&navigator.keyframes, navigator.fgo.window),
            offsets: TimeOffsets::new(navigator.keyframes.anchor),
            health: [SensorHealth::NONE; SENSORS.len()],
            sigmas_substituted: 0,
            vehicle,
            navigator,
        }
    }

    /// With every row of a log's `buoys.csv` known beforehand: tracks are interpolated, not carried on. Buoy positions
    /// that come as readings are then only counted.
    #[must_use]
    pub fn with_known_buoys(mut self, fixes: Vec<BuoyFix>) -> Preprocessor {
        self.buoys = BuoyTracks::with_known(self.navigator.buoy_max_age, fixes);
        self
    }

    /// With the origin that an earlier start of this run published, so that a restart cannot move the frame.
    ///
    /// # Errors
    /// [`OriginError`] where that is no place on Earth.
    pub fn with_origin(mut self, origin: FrameOrigin) -> Result<Preprocessor, OriginError> {
        self.origin.restore(origin)?;
        Ok(self)
    }

    /// Goes on under another configuration, of which only what [`Config::may_become`] lets change is taken: what is known of buoys, clocks
    /// and instruments stays.
    pub fn go_on_under(&mut self, config: &Config) {
        self.buoys.hold_for(config.navigator.buoy_max_age);
        (self.vehicle, self.navigator) = (config.vehicle.clone(), config.navigator.clone());
    }

    /// Takes one reading in; what it lets go is handed to `emit` in the order of the contract of [`Measurement`].
    pub fn push(&mut self, reading: &RawReading, emit: &mut impl FnMut(Measurement)) {
        self.health[reading.sensor().index()].received += 1;
        match reading {
            RawReading::Imu(sample) => self.push_imu(sample, emit),
            aiding => self.push_aiding(aiding),
        }
    }

    /// The readings have come to their end: lets go what the IMU has reached, closed by a last keyframe at its newest
    /// sample; counts the rest as beyond the IMU.
    pub fn finish(&mut self, emit: &mut impl FnMut(Measurement)) {
        if let Some(t_newest) = self.imu_gate.t_newest() {
            self.take_up_to(t_newest, emit);
            if !self.offsets.is_empty() && self.times.may_close(t_newest) {
                self.close(t_newest, KeyframeCause::Age, emit);
            }
        }
        while let Some(reading) = self.event_time.pop() {
            self.reject(reading.sensor(), RejectReason::NoImu);
        }
        if self.start.last_before.take().is_some() {
            self.reject(Sensor::Imu, RejectReason::BeforeStart);
        }
        let health = &mut self.health;
        self.offsets.abandon(|measurement, reason| count(health, measurement.sensor(), reason));
    }

    /// What was received and refused, per sensor in the order of [`SENSORS`]. `lost` is for whoever sees the channel.
    pub fn health(&self) -> &[SensorHealth; SENSORS.len()] {
        &self.health
    }

    /// Origin of the ENU frame, once it is fixed.
    pub fn origin(&self) -> Option<FrameOrigin> {
        self.origin.published()
    }

    /// Readings of a sensor that wait for the IMU or for their keyframe.
    pub fn held(&self, sensor: Sensor) -> usize {
        let before_start = usize::from(sensor == Sensor::Imu && self.start.last_before.is_some());
        before_start + self.event_time.held(sensor) + self.offsets.held(sensor)
    }

    /// Satellite fixes with an impossible sigma, used with the configured one.
    pub fn sigmas_substituted(&self) -> u64 {
        self.sigmas_substituted
    }

    fn push_imu(&mut self, sample: &ImuSample, emit: &mut impl FnMut(Measurement)) {
        let t_before = self.imu_gate.t_newest();
        let is_long_gap = match self.imu_gate.check(sample) {
            ImuVerdict::Reject(reason) => return self.reject(Sensor::Imu, reason),
            ImuVerdict::Accept { long, .. } => long,
        };
        let t = Time(sample.header.t_valid);
        self.health[Sensor::Imu.index()].t_newest = t.0;
        if let (Some(t_before), true) = (t_before, is_long_gap) {
            self.times.on_gap(t_before, t);
        }
        if self.start.t.is_some() {
            emit(imu_measurement(sample));
        } else {
            self.push_imu_before_start(sample, t_before, is_long_gap, emit);
        }
        self.take_up_to(t - self.navigator.keyframes.settle, emit);
    }

    /// Lets through what the initialisation needs, and finds the start: `initial.t`, or the first sample where that is
    /// missing, earlier than all samples, or inside a long gap.
    fn push_imu_before_start(
        &mut self,
        sample: &ImuSample,
        t_before: Option<Time>,
        is_long_gap: bool,
        emit: &mut impl FnMut(Measurement),
    ) {
        let t = Time(sample.header.t_valid);
        self.start.t_first_imu.get_or_insert(t);
        if let Some(t_configured) = self.start.configured.filter(|&t_configured| t < t_configured) {
            if !self.start.needs_initialisation {
                if self.start.last_before.replace(*sample).is_some() {
                    self.reject(Sensor::Imu, RejectReason::BeforeStart);
                }
            } else if t_configured - t <= INITIALISATION {
                emit(imu_measurement(sample));
            } else {
                self.reject(Sensor::Imu, RejectReason::BeforeStart);
            }
            return;
        }
        let t_start = match self.start.configured {
            Some(t_configured) if t_before.is_some() && !is_long_gap => t_configured,
            _ => t,
        };
        self.start.t = Some(t_start);
        self.times.on_start(t_start);
        if let Some(before) = self.start.last_before.take() {
            // Needed to interpolate at a start between two samples, and for nothing else.
            if t_start < t {
                emit(imu_measurement(&before));
            } else {
                self.reject(Sensor::Imu, RejectReason::BeforeStart);
            }
        }
        emit(imu_measurement(sample));
    }

    fn push_aiding(&mut self, reading: &RawReading) {
        let (sensor, t) = (reading.sensor(), reading.t_valid());
        if !is_possible(t) {
            return self.reject(sensor, RejectReason::OutOfRange);
        }
        if self.imu_gate.t_newest().is_some_and(|t_imu| t - t_imu > AHEAD_MAX) {
            return self.reject(sensor, RejectReason::NoImu);
        }
        let t_newest = &mut self.health[sensor.index()].t_newest;
        *t_newest = t.0.max(*t_newest);
        match self.event_time.push(reading) {
            // A moored buoy may have said where it is once and for all, long before the IMU began.
            Some(evicted @ RawReading::Buoy(_)) => self.take(&evicted),
            Some(evicted) => self.reject(evicted.sensor(), RejectReason::NoImu),
            None => {}
        }
    }

    /// Takes readings up and closes keyframes, in order of data time, up to and including `horizon`.
    fn take_up_to(&mut self, horizon: Time, emit: &mut impl FnMut(Measurement)) {
        loop {
            let due = self.times.due().filter(|&(t_due, _)| t_due <= horizon);
            let t_next = self.event_time.t_next().filter(|&t_next| t_next <= horizon);
            match (t_next, due) {
                (Some(t_next), Some((t_due, cause))) if t_due < t_next => self.close(t_due, cause, emit),
                (Some(_), _) => {
                    if let Some(reading) = self.event_time.pop() {
                        self.take(&reading);
                        self.offsets.let_go_at_once(emit);
                    }
                }
                (None, Some((t_due, cause))) => self.close(t_due, cause, emit),
                (None, None) => return,
            }
        }
    }

    fn close(&mut self, t_keyframe: Time, cause: KeyframeCause, emit: &mut impl FnMut(Measurement)) {
        self.times.close(t_keyframe);
        let health = &mut self.health;
        self.offsets.on_keyframe(&self.times, t_keyframe, cause, emit, |measurement, reason| {
            count(health, measurement.sensor(), reason);
        });
    }

    fn take(&mut self, reading: &RawReading) {
        let taken = if self.duplicates.contains_or_insert(reading) {
            Err(RejectReason::Duplicate)
        } else {
            match reading {
                RawReading::Imu(_) => Ok(()),
                RawReading::Buoy(fix) => self.buoys.insert(fix),
                RawReading::Gnss(fix) => self.take_gnss(fix),
                RawReading::Lbl(range) => self.take_lbl(range),
                RawReading::Dvl(raw) => self.take_simple(reading, gates::dvl(raw, &self.navigator)),
                RawReading::Mcp(raw) => self.take_simple(reading, gates::mcp(raw, &self.vehicle)),
                RawReading::Ps(raw) => self.take_simple(reading, gates::ps(raw, &self.navigator)),
            }
        };
        if let Err(reason) = taken {
            self.reject(reading.sensor(), reason);
        }
    }

    /// A reading that needs no frame and no other sensor.
    fn take_simple(&mut self, raw: &RawReading, gated: Result<Reading, RejectReason>) -> Result<(), RejectReason> {
        let reading = gated?;
        self.judge_time(raw.t_valid())?;
        self.judge_enabled(raw.sensor())?;
        if self.frozen.is_frozen(&reading, &self.vehicle) {
            return Err(RejectReason::Stuck);
        }
        if let Reading::Ps { depth } = reading {
            self.note_depth(raw.t_valid(), depth);
        }
        self.offsets.hold(measurement(raw.header(), &reading))
    }

    fn note_depth(&mut self, t: Time, depth: f64) {
        if self.newest_depth.is_none() {
            self.recent_depths = [depth; 3];
        }
        self.recent_depths.rotate_right(1);
        self.recent_depths[0] = depth;
        let [a, b, c] = self.recent_depths;
        self.newest_depth = Some((t, a.min(b).max(a.max(b).min(c))));
    }

    fn take_gnss(&mut self, raw: &GnssFix) -> Result<(), RejectReason> {
        let t = Time(raw.header.t_valid);
        let fix = gates::gnss(raw, &self.vehicle)?;
        self.judge_time(t)?;
        if let Some((t_depth, depth)) = self.newest_depth
            && (t - t_depth).abs() <= DEPTH_MAX_AGE
            && depth > self.navigator.gnss_max_depth
        {
            return Err(RejectReason::WhileDeep);
        }
        let frame = self.origin.frame_or_fix(t, fix.lat_deg, fix.lon_deg, fix.height);
        let height = fix.height.unwrap_or(self.vehicle.frame.surface_height);
        let antenna = nav_geometry::Geodetic::from_degrees(fix.lat_deg, fix.lon_deg, height);
        let antenna_enu = frame.to_enu(&antenna).into();
        self.judge_enabled(Sensor::Gnss)?;
        self.sigmas_substituted += u64::from(fix.sigma_substituted);
        self.offsets.hold(measurement(&raw.header, &Reading::Gnss { antenna_enu, sigma_enu: fix.sigma_enu }))
    }

    fn take_lbl(&mut self, raw: &LblRange) -> Result<(), RejectReason> {
        let t = Time(raw.header.t_valid);
        let range = gates::lbl(raw, &self.navigator)?;
        self.judge_time(t)?;
        self.judge_enabled(Sensor::Lbl)?;
        // Without a frame the estimation has not started, whatever the clock says.
        let frame = self.origin.frame().ok_or(RejectReason::BeforeStart)?;
        let place = self.buoys.at(raw.buoy, t, frame)?;
        let (buoy_enu, buoy_sigma) = (place.enu.into(), self.vehicle.lbl.buoy_sigma.hypot(place.drifted));
        let (epoch, is_moored) = (self.epochs.number(t), place.is_moored);
        let reading = Reading::Lbl { buoy: raw.buoy, epoch, range, buoy_enu, buoy_sigma, is_moored };
        self.offsets.hold(measurement(&raw.header, &reading))?;
        self.times.on_ping(t);
        Ok(())
    }

    /// Whether a reading at `t` is after the start, or needed for it.
    fn judge_time(&self, t: Time) -> Result<(), RejectReason> {
        let Some(t_start) = self.start.t.or(self.start.configured) else {
            return Err(RejectReason::BeforeStart);
        };
        let is_for_initialisation = self.start.needs_initialisation
            && t_start - t <= INITIALISATION
            && self.start.t_first_imu.is_some_and(|t_first| t >= t_first);
        if t >= t_start || is_for_initialisation { Ok(()) } else { Err(RejectReason::BeforeStart) }
    }

    fn judge_enabled(&self, sensor: Sensor) -> Result<(), RejectReason> {
        if self.navigator.is_enabled(sensor) { Ok(()) } else { Err(RejectReason::Disabled) }
    }

    fn reject(&mut self, sensor: Sensor, reason: RejectReason) {
        count(&mut self.health, Some(sensor), reason);
    }
}

fn count(health: &mut [SensorHealth; SENSORS.len()], sensor: Option<Sensor>, reason: RejectReason) {
    if let Some(sensor) = sensor {
        health[sensor.index()].rejected[reason.index()] += 1;
    }
}

fn imu_measurement(sample: &ImuSample) -> Measurement {
    let reading = Reading::Imu { gyro_body: sample.gyro_body, accel_body: sample.accel_body };
    measurement(&sample.header, &reading)
}

/// A measurement not yet tied, under the header of its raw reading; the bus gives it a sequence of its own, so the raw
/// one is also kept as its origin.
fn measurement(raw: &Header, reading: &Reading) -> Measurement {
    let t = Time(raw.t_valid);
    let header = Header { origin_sequence: raw.sequence, origin_t_arrival: raw.t_arrival, ..*raw };
    Measurement { header, ..Measurement::new(t, t, reading) }
}
