//! From readings of the closing interval to factors on its keyframes: increments, gates, first weights, counts.

use nalgebra::Vector3;
use nav_models::preintegration::{Piece, Preintegration};
use nav_models::sensors::{DvlModel, GnssModel, LblModel, McpModel, PsModel};
use shared_types::{
    AIDING, Config, FACTORS_MAX, FactorReport, Kernel, KeyframeReport, Measurement, Reading, RejectReason, SENSORS,
    Sensor, SensorCounts, Time,
};

use crate::factor::{Factor, MeasuredRows, Model, Stamp};
use crate::innovation::{Innovation, Refusals, median};
use crate::interval::{ImuHistory, ImuModel, OpenInterval};
use crate::kernels::Block;
use crate::robust::{ImprobableShare, settle};
use crate::rows::{DIM, Row};
use crate::time_offsets::TimeOffsets;
use crate::window::Window;

/// Ranges of one epoch; further ones are counted as too many.
const EPOCH_MAX: usize = 32;
/// With an unknown common offset the median of fewer ranges proves nothing (§3.3).
const MEDIAN_MIN: usize = 3;

/// A reading that waits for its keyframe.
pub type Pending = (Measurement, Reading);

/// What tying needs to see of the interval that is being closed.
pub struct Closing<'a> {
    /// The interval's prefixes.
    pub open: &'a OpenInterval,
    /// The whole of it.
    pub whole: &'a Preintegration,
    /// Raw samples, for readings of older intervals.
    pub history: &'a ImuHistory,
    /// The instrument.
    pub imu: &'a ImuModel,
    /// Covariance of the newest keyframe but one before its new measurements.
    pub covariance_before: &'a Block<DIM>,
    /// Predicted covariance of the newest keyframe.
    pub covariance_newest: &'a Block<DIM>,
}

/// A factor that has been evaluated.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    factor: Factor,
    rows: MeasuredRows,
    innovation: Innovation,
}

/// What each sensor has been up to.
#[derive(Clone, Debug)]
pub struct Ties {
    config: Config,
    shares: [ImprobableShare; SENSORS.len()],
    refusals: [Refusals; SENSORS.len()],
    epoch: Vec<Candidate>,
    epoch_factors: Vec<Factor>,
    epoch_rows: Vec<Row>,
    /// How late each sensor's stamps are.
    pub offsets: TimeOffsets,
    /// Room for a piece that has to be integrated.
    side: Preintegration,
    /// Used and refused since the start.
    pub counts: [SensorCounts; SENSORS.len()],
    /// Newest used measurement per aiding sensor.
    pub t_last_used: [Time; AIDING.len()],
}

impl Ties {
    /// Nothing seen yet.
    pub fn new(config: &Config) -> Ties {
        Ties {
            config: config.clone(),
            shares: [ImprobableShare::default(); SENSORS.len()],
            refusals: [Refusals::default(); SENSORS.len()],
            epoch: Vec::with_capacity(EPOCH_MAX),
            epoch_factors: Vec::with_capacity(EPOCH_MAX),
            epoch_rows: Vec::with_capacity(EPOCH_MAX),
            offsets: TimeOffsets::new(config.navigator.sensors.map(|sensor| sensor.time_offset)),
            side: Preintegration::new(Vector3::zeros(), Vector3::zeros()),
            counts: [SensorCounts::default(); SENSORS.len()],
            t_last_used: [Time::MIN; AIDING.len()],
        }
    }

    /// Whole epochs of ranges refused in a row, and since when.
    pub fn epochs_refused(&self) -> (u32, Option<Time>) {
        self.refusals[Sensor::Lbl.index()].run()
    }

    /// Counts a refusal.
    pub fn refuse(&mut self, sensor: Sensor, reason: RejectReason) {
        self.counts[sensor.index()].rejected[reason.index()] += 1;
    }

    /// Puts the readings that were taken up to `t` first, in their order, and says how many they are.
    pub fn sort_out(&self, pending: &mut [Pending], t: Time) -> usize {
        let is_later = |(measurement, _): &Pending| {
            place(measurement).is_some_and(|place| measurement.t_valid() - self.offsets.of(place) > t)
        };
        let mut ready = 0;
        for index in 0..pending.len() {
            if !is_later(&pending[index]) {
                pending[ready..=index].rotate_right(1);
                ready += 1;
            }
        }
        ready
    }

    /// Ties every pending reading to its keyframe, in order; ranges of one epoch and keyframe together.
    pub fn tie_all(
        &mut self,
        pending: &[Pending],
        window: &mut Window,
        closing: &Closing<'_>,
        report: &mut KeyframeReport,
    ) {
        let mut rest = pending;
        while let Some((first, _)) = rest.first() {
            let together = rest
                .iter()
                .take_while(|(other, _)| {
                    other.kind == Sensor::Lbl as u32
                        && other.kind == first.kind
                        && other.epoch == first.epoch
                        && other.t_keyframe == first.t_keyframe
                })
                .count()
                .max(1);
            let (group, others) = rest.split_at(together);
            rest = others;
            self.tie_group(group, window, closing, report);
        }
    }

    fn tie_group(
        &mut self,
        group: &[Pending],
        window: &mut Window,
        closing: &Closing<'_>,
        report: &mut KeyframeReport,
    ) {
        let Some(sensor) = group.first().and_then(|(measurement, _)| measurement.sensor()) else { return };
        let Some(index) = window.index_at(group[0].0.t_keyframe()) else {
            group.iter().for_each(|_| self.refuse(sensor, RejectReason::OlderThanWindow));
            return;
        };
        self.epoch.clear();
        for (measurement, reading) in group {
            if self.epoch.len() == EPOCH_MAX {
                self.refuse(sensor, RejectReason::TooMany);
                continue;
            }
            match self.candidate(measurement, reading, index, window, closing) {
                Ok(candidate) => self.epoch.push(candidate),
                Err(reason) => {
                    self.refuse(sensor, reason);
                    list_refused(report, measurement, reason);
                }
            }
        }
        self.judge(sensor, report);
        if self.epoch.is_empty() {
            return;
        }
        if self.epoch[0].factor.shares_offset() {
            self.epoch_factors.clear();
            self.epoch_rows.clear();
            for candidate in &self.epoch {
                self.epoch_factors.push(candidate.factor);
                self.epoch_rows.extend_from_slice(candidate.rows.as_slice());
            }
            window.tie(index, &self.epoch_factors, &self.epoch_rows);
        } else {
            for candidate in &self.epoch {
                window.tie(index, core::slice::from_ref(&candidate.factor), candidate.rows.as_slice());
            }
        }
    }

    /// Evaluates one reading at its keyframe.
    fn candidate(
        &mut self,
        measurement: &Measurement,
        reading: &Reading,
        index: usize,
        window: &Window,
        closing: &Closing<'_>,
    ) -> Result<Candidate, RejectReason> {
        let world = window.world();
        let vehicle = &self.config.vehicle;
        let place = place(measurement).ok_or(RejectReason::Malformed)?;
        let t = measurement.t_valid() - self.offsets.of(place);
        let node = &window.nodes()[index];
        let side = &mut self.side;
        let piece = piece_to(t, index, window, closing, side)?;
        let increment = piece.as_ref().map(|piece| *piece.increment());
        let model = match *reading {
            Reading::Lbl { range, buoy_enu, buoy_sigma, .. } => {
                Model::Lbl(LblModel::new(range, buoy_enu, buoy_sigma, &vehicle.lbl))
            }
            Reading::Gnss { antenna_enu, sigma_enu } => {
                Model::Gnss(GnssModel::new(antenna_enu, sigma_enu, &vehicle.gnss, world))
            }
            Reading::Dvl { velocity_dvl } => {
                let gyro_body = closing.history.at(t).ok_or(RejectReason::NoImu)?.gyro_body;
                let dt = closing.history.sampling_period_at(t).as_seconds();
                Model::Dvl(DvlModel::new(velocity_dvl, gyro_body, &vehicle.dvl, &vehicle.imu, dt))
            }
            Reading::Mcp { heading } => {
                if !McpModel::is_usable(&node.state, world) {
                    return Err(RejectReason::NearVertical);
                }
                Model::Mcp(McpModel::new(heading, &vehicle.mcp))
            }
            Reading::Ps { depth } => Model::Ps(PsModel::new(depth, vehicle)),
            Reading::Imu { .. } | Reading::Keyframe { .. } => return Err(RejectReason::Malformed),
        };
        let mut factor = Factor::new(t, model, increment, Kernel::None);
        let sensor = factor.sensor();
        let configured = self.config.navigator.sensor(sensor).map_or(Kernel::None, |config| config.kernel);
        factor.kernel = settle(configured, &self.shares[sensor.index()]);
        if let Reading::Lbl { buoy, epoch, .. } = *reading {
            factor = factor.of_epoch(epoch, buoy, self.config.navigator.lbl_common_offset_sigma);
        }
        let stamp =
            self.offsets.sigma(place).and_then(|sigma| closing.history.at(t).map(|point| Stamp { point, sigma }));
        let rows = factor
            .whiten(&node.linearised, piece.as_ref(), stamp.as_ref(), world)
            .map_err(|_| RejectReason::NotFinite)?;
        // The state of the keyframe before has its own covariance; an older one's is at most that of the newest.
        let covariance =
            if index + 2 == window.nodes().len() { closing.covariance_before } else { closing.covariance_newest };
        let innovation = Innovation::of(rows.as_slice(), &node.delta, covariance);
        Ok(Candidate { factor, rows, innovation })
    }

    /// Gates the group, sets first weights, counts and lists. What was refused leaves the group.
    fn judge(&mut self, sensor: Sensor, report: &mut KeyframeReport) {
        let Some(first) = self.epoch.first() else { return };
        let (shares_offset, t) = (first.factor.shares_offset(), first.factor.t);
        let mut is_gated = self.config.navigator.sensor(sensor).is_some_and(|config| config.gate);
        if shares_offset {
            let mut offsets = [0.0; EPOCH_MAX];
            for (offset, candidate) in offsets.iter_mut().zip(&self.epoch) {
                let row = &candidate.rows.as_slice()[0];
                // Whitened innovation times √S and σ: the innovation in m.
                let s = (1.0 + candidate.innovation.state_share).sqrt();
                *offset = candidate.innovation.whitened[0] * s / row.inverse_sigma;
            }
            match median(&mut offsets[..self.epoch.len()]) {
                Some(offset) if self.epoch.len() >= MEDIAN_MIN => {
                    for candidate in &mut self.epoch {
                        let s = (1.0 + candidate.innovation.state_share).sqrt();
                        let in_sigmas = offset * candidate.rows.as_slice()[0].inverse_sigma;
                        candidate.innovation = candidate.innovation.without_offset(in_sigmas, s);
                    }
                }
                _ => is_gated = false,
            }
        }
        let admits = self.refusals[sensor.index()].admits_next();
        let mut passed_any = false;
        let offsets = &mut self.offsets;
        let (share, counts) = (&mut self.shares[sensor.index()], &mut self.counts[sensor.index()]);
        let t_last_used = AIDING.iter().position(|&aiding| aiding == sensor).map(|at| &mut self.t_last_used[at]);
        let mut t_newest = Time::MIN;
        self.epoch.retain_mut(|candidate| {
            let components = candidate.factor.components();
            share.observe(candidate.innovation.nis, components);
            let passes = candidate.innovation.passes(sensor, components);
            passed_any |= passes;
            let refused = is_gated && !passes && !admits;
            let weight = candidate.innovation.first_weight(candidate.factor.kernel);
            offsets.observe(candidate.factor.place(), &candidate.innovation, components, weight);
            candidate.rows.as_mut_slice().iter_mut().for_each(|row| row.weight = weight);
            list_candidate(report, candidate, weight, refused);
            if refused {
                counts.rejected[RejectReason::Gated.index()] += 1;
                offsets.observe_refused(candidate.factor.place(), &candidate.innovation, weight);
            } else {
                counts.used += 1;
                t_newest = t_newest.max(candidate.factor.t);
            }
            !refused
        });
        if let Some(t_last_used) = t_last_used {
            *t_last_used = t_newest.max(*t_last_used);
        }
        if is_gated {
            self.refusals[sensor.index()].observe(t, passed_any);
        }
    }
}

/// Place of a measurement's sensor in [`AIDING`].
pub fn place(measurement: &Measurement) -> Option<usize> {
    let sensor = measurement.sensor()?;
    AIDING.iter().position(|&aiding| aiding == sensor)
}

/// The piece from keyframe `index` to `t`, with `side` as room for what has to be integrated; `None` where they coincide.
fn piece_to<'a>(
    t: Time,
    index: usize,
    window: &Window,
    closing: &Closing<'a>,
    side: &'a mut Preintegration,
) -> Result<Option<Piece<'a>>, RejectReason> {
    let nodes = window.nodes();
    let node = &nodes[index];
    if t == node.t {
        return Ok(None);
    }
    let newest = nodes.len() - 1;
    let is_inside = newest > 0 && t > nodes[newest - 1].t && t < nodes[newest].t;
    if is_inside && index + 1 >= newest {
        let prefix = closing.open.up_to(t, closing.imu, side).ok_or(RejectReason::NoImu)?;
        let is_backward = index == newest;
        return Ok(Some(if is_backward { Piece::backward(prefix, closing.whole) } else { Piece::Forward(prefix) }));
    }
    let biases = (&node.state.accel_bias, &node.state.gyro_bias);
    let integrated = closing.history.integrate(node.t, t, biases.0, biases.1, closing.imu);
    *side = integrated.ok_or(if t < nodes[0].t { RejectReason::OlderThanWindow } else { RejectReason::NoImu })?;
    Ok(Some(Piece::Forward(side)))
}

fn list_candidate(report: &mut KeyframeReport, candidate: &Candidate, weight: f64, refused: bool) {
    let count = report.factor_count as usize;
    if count == FACTORS_MAX {
        report.factors_left_out += 1;
        return;
    }
    report.factors[count] = FactorReport {
        t_valid: candidate.factor.t.0,
        sensor: candidate.factor.sensor() as u32,
        rows: candidate.factor.components() as u32,
        buoy: candidate.factor.buoy,
        refused: if refused { 1 + RejectReason::Gated as u32 } else { 0 },
        whitened: candidate.innovation.whitened,
        nis: candidate.innovation.nis,
        weight,
    };
    report.factor_count += 1;
}

fn list_refused(report: &mut KeyframeReport, measurement: &Measurement, reason: RejectReason) {
    let count = report.factor_count as usize;
    if count == FACTORS_MAX {
        report.factors_left_out += 1;
        return;
    }
    report.factors[count] = FactorReport {
        t_valid: measurement.header.t_valid,
        sensor: measurement.kind,
        refused: 1 + reason as u32,
        ..FactorReport::default()
    };
    report.factor_count += 1;
}
