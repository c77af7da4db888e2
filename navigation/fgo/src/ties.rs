//! From readings of the closing interval to factors on its keyframes: increments, gates, first weights, counts.

use nalgebra::Vector3;
use nav_models::anchor::Anchor;
use nav_models::innovation::Innovation;
use nav_models::judging::{Candidate, EPOCH_MAX, Judges, Verdict};
use nav_models::preintegration::{Piece, Preintegration, Turned};
use nav_models::recovery::Checked;
use nav_models::rounds::Rounds;
use nav_models::row::Row;
use nav_models::sensors::GyroAt;
use nav_models::wide;
use shared_types::{
    AIDING, Config, FactorReport, Kernel, KeyframeReport, Measurement, Reading, RejectReason, SENSORS, Sensor,
    SensorCounts, Time,
};

use crate::factor::{Doubts, Factor, MeasuredRows, Model};
use crate::interval::{ImuHistory, ImuModel, OpenInterval};
use crate::kernels::Block;
use crate::moorings::Moorings;
use crate::rows::DIM;
use crate::systematic::{Systematics, errors_of};
use crate::window::Window;

/// A reading that waits for its keyframe.
pub type Pending = Checked;

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
struct Evaluated {
    factor: Factor,
    rows: MeasuredRows,
    innovation: Innovation,
}

impl Candidate for Evaluated {
    fn rows(&mut self) -> &mut [Row] {
        self.rows.as_mut_slice()
    }

    fn innovation(&mut self) -> &mut Innovation {
        &mut self.innovation
    }

    fn components(&self) -> usize {
        self.factor.components()
    }

    fn kernel(&self) -> Kernel {
        self.factor.kernel
    }
}

/// What each sensor has been up to.
#[derive(Clone, Debug)]
pub struct Ties {
    config: Config,
    judges: Judges,
    /// The candidates of one group are the first `heard`. Those behind them are room: a candidate is a kilobyte and a half, and is made
    /// in its place.
    epoch: Vec<Evaluated>,
    heard: usize,
    epoch_factors: Vec<Factor>,
    epoch_rows: Vec<Row>,
    /// Ranges that came one by one.
    pub rounds: Rounds,
    /// Buoys that may lie elsewhere than they are said to.
    pub moorings: Moorings,
    /// What is systematically wrong with each sensor's readings.
    pub systematics: Systematics,
    /// The keyframe that readings were last tied to, at its linearisation point.
    anchor: Option<(usize, Anchor)>,
    /// Room for a piece that has to be integrated.
    side: Preintegration,
    /// Room for one that is turned round.
    turned: Turned,
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
            judges: Judges::default(),
            epoch: Vec::with_capacity(EPOCH_MAX),
            heard: 0,
            epoch_factors: Vec::with_capacity(EPOCH_MAX),
            epoch_rows: Vec::with_capacity(EPOCH_MAX),
            rounds: Rounds::default(),
            moorings: Moorings::new(config),
            systematics: Systematics::new(&config.navigator.sensors),
            anchor: None,
            side: Preintegration::new(Vector3::zeros(), Vector3::zeros()),
            turned: Turned::default(),
            counts: [SensorCounts::default(); SENSORS.len()],
            t_last_used: [Time::MIN; AIDING.len()],
        }
    }

    /// Whole epochs of ranges refused in a row, and since when.
    pub fn epochs_refused(&self) -> (u32, Option<Time>) {
        self.judges.epochs_refused()
    }

    /// How far ranges or fixes of late see the vehicle beside the state, m, where no chance explains that; each is told once.
    pub fn take_shift(&mut self, t: Time) -> Option<f64> {
        self.judges.take_shift(t)
    }

    /// Whether several sensors have begun to be off the state together: the inertial ones are to blame.
    pub fn is_inertial_to_blame(&self) -> bool {
        self.judges.is_inertial_to_blame()
    }

    /// Improbable satellite fixes in a row, and since when, if no range speaks for the state.
    pub fn fixes_improbable(&self) -> (u32, Option<Time>) {
        let (count, since) = self.judges.fixes_improbable();
        let lbl = AIDING.iter().position(|&aiding| aiding == Sensor::Lbl).map_or(Time::MIN, |at| self.t_last_used[at]);
        if since.is_some_and(|since| lbl < since) { (count, since) } else { (0, None) }
    }

    /// Forgets what was concluded from a state that was wrong.
    pub fn begin_anew(&mut self) {
        self.judges = Judges::default();
        self.rounds.forget();
        self.systematics = Systematics::new(&self.config.navigator.sensors);
    }

    /// Counts a refusal.
    pub fn refuse(&mut self, sensor: Sensor, reason: RejectReason) {
        self.counts[sensor.index()].rejected[reason.index()] += 1;
    }

    /// Puts the readings that were taken up to `t` first, in their order, and says how many they are.
    pub fn sort_out(&self, pending: &mut [Pending], t: Time) -> usize {
        let is_later = |(measurement, _): &Pending| {
            place(measurement).is_some_and(|place| measurement.t_valid() - self.systematics.offset(place) > t)
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
        self.anchor = None;
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
        let node = &window.nodes()[index];
        self.judges.observe_speed(node.t, node.state.velocity_enu.norm());
        let from = match self.anchor {
            Some((of, anchor)) if of == index => anchor,
            _ => Anchor::new(&node.linearised, window.world()),
        };
        self.anchor = Some((index, from));
        self.heard = 0;
        for (measurement, reading) in group {
            if self.heard == EPOCH_MAX {
                self.refuse(sensor, RejectReason::TooMany);
                continue;
            }
            if let Err(reason) = self.evaluate(measurement, reading, (index, &from), window, closing) {
                self.refuse(sensor, reason);
                report.list_refused(measurement.t_valid(), measurement.kind, reason);
            }
        }
        self.judge(sensor, report);
        let admitted = &self.epoch[..self.heard];
        let Some(first) = admitted.first() else { return };
        if first.factor.shares_offset() {
            self.epoch_factors.clear();
            self.epoch_rows.clear();
            for candidate in admitted {
                self.epoch_factors.push(candidate.factor);
                self.epoch_rows.extend_from_slice(candidate.rows.as_slice());
            }
            window.tie(index, &self.epoch_factors, &self.epoch_rows);
        } else {
            for candidate in admitted {
                if !window.tie_jointly(index, &candidate.factor, &candidate.rows) {
                    window.tie(index, core::slice::from_ref(&candidate.factor), candidate.rows.as_slice());
                }
            }
        }
    }

    /// Evaluates one reading at its keyframe, the one of that index, in its place in the epoch.
    fn evaluate(
        &mut self,
        measurement: &Measurement,
        reading: &Reading,
        (index, from): (usize, &Anchor),
        window: &Window,
        closing: &Closing<'_>,
    ) -> Result<(), RejectReason> {
        let world = window.world();
        let vehicle = &self.config.vehicle;
        let place = place(measurement).ok_or(RejectReason::Malformed)?;
        let t = measurement.t_valid() - self.systematics.offset(place);
        let node = &window.nodes()[index];
        let piece = piece_to(t, index, window, closing, &mut self.side, &mut self.turned)?;
        let is_estimated = self.systematics.is_estimated(place);
        let point = closing.history.at(t);
        let gyro = || {
            let gyro_body = point?.gyro_body;
            Some(GyroAt { gyro_body, dt_imu: closing.history.sampling_period_at(t).as_seconds() })
        };
        let mut model = Model::of(reading, vehicle, &node.state, world, gyro)?;
        for &(_, error) in &errors_of(place)[1..] {
            model.correct(self.systematics.of(error));
        }
        let sensor = model.sensor();
        let kernel =
            self.config.navigator.sensor(sensor).map_or(Kernel::None, |config| self.judges.kernel(sensor, config));
        if self.heard == self.epoch.len() {
            self.epoch.push(Evaluated {
                factor: Factor::new(t, model, None, kernel),
                rows: MeasuredRows::default(),
                innovation: Innovation::default(),
            });
        }
        let Evaluated { factor, rows, innovation } = &mut self.epoch[self.heard];
        factor.renew(t, model, kernel);
        factor.increment = piece.as_ref().map(|piece| *piece.increment());
        if let Reading::Lbl { buoy, epoch, is_moored, .. } = *reading {
            factor.join_epoch(epoch, buoy, self.config.navigator.lbl_common_offset_sigma);
            factor.mooring = if is_moored { self.moorings.place(buoy) } else { None };
        }
        let doubts = Doubts { point: point.filter(|_| is_estimated), sigmas: self.systematics.sigmas(place) };
        factor.whiten(from, piece.as_ref(), Some(&doubts), world, rows).map_err(|_| RejectReason::NotFinite)?;
        // The state of the keyframe before has its own covariance; an older one's is at most that of the newest.
        let covariance =
            if index + 2 == window.nodes().len() { closing.covariance_before } else { closing.covariance_newest };
        *innovation = wide!(Innovation::of(rows.as_slice(), &node.delta, covariance));
        self.heard += 1;
        Ok(())
    }

    /// Gates the group, sets first weights, counts and lists. What was refused leaves the group.
    fn judge(&mut self, sensor: Sensor, report: &mut KeyframeReport) {
        let heard = &mut self.epoch[..self.heard];
        let (Some(first), Some(config)) = (heard.first(), self.config.navigator.sensor(sensor)) else { return };
        let (shares_offset, t) = (first.factor.shares_offset(), first.factor.t);
        let (systematics, counts) = (&mut self.systematics, &mut self.counts[sensor.index()]);
        let rounds = &mut self.rounds;
        let mut t_newest = Time::MIN;
        self.heard = self.judges.judge(sensor, config, shares_offset, t, heard, |candidate, verdict| {
            let (place, components) = (candidate.factor.place(), candidate.factor.components());
            systematics.observe(place, &candidate.innovation, components, verdict.weight);
            list_candidate(report, candidate, verdict);
            if let Model::Lbl(model) = &candidate.factor.model
                && !shares_offset
            {
                // Whatever is admitted for want of others, or because its calibration is in doubt.
                let innovation = &candidate.innovation;
                let sigma_row = 1.0 / candidate.rows.as_slice()[0].inverse_sigma;
                let residual = innovation.whitened[0] * (1.0 + innovation.state_share).sqrt() * sigma_row;
                let own = model.sigma.hypot(model.buoy_sigma).hypot(innovation.state_share.sqrt() * sigma_row);
                rounds.hear(candidate.factor.t, candidate.factor.buoy, model, residual / own);
            }
            if verdict.refused {
                counts.rejected[RejectReason::Gated.index()] += 1;
                if !verdict.contradicted {
                    systematics.observe_refused(place, &candidate.innovation, verdict.weight);
                }
            } else {
                counts.used += 1;
                t_newest = t_newest.max(candidate.factor.t);
            }
        });
        if let Some(at) = AIDING.iter().position(|&aiding| aiding == sensor) {
            self.t_last_used[at] = t_newest.max(self.t_last_used[at]);
        }
    }
}

/// Place of a measurement's sensor in [`AIDING`].
pub fn place(measurement: &Measurement) -> Option<usize> {
    let sensor = measurement.sensor()?;
    AIDING.iter().position(|&aiding| aiding == sensor)
}

/// The piece from keyframe `index` to `t`, with room for what has to be integrated and turned round; `None` where they coincide.
#[inline(always)]
fn piece_to<'a>(
    t: Time,
    index: usize,
    window: &Window,
    closing: &Closing<'a>,
    side: &'a mut Preintegration,
    turned: &'a mut Turned,
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
        return Ok(Some(if is_backward {
            Piece::backward(prefix, closing.whole, turned)
        } else {
            Piece::Forward(prefix)
        }));
    }
    let biases = (&node.state.accel_bias, &node.state.gyro_bias);
    let integrated = closing.history.integrate(node.t, t, biases.0, biases.1, closing.imu);
    *side = integrated.ok_or(if t < nodes[0].t { RejectReason::OlderThanWindow } else { RejectReason::NoImu })?;
    Ok(Some(Piece::Forward(side)))
}

fn list_candidate(report: &mut KeyframeReport, candidate: &Evaluated, verdict: Verdict) {
    report.list(FactorReport {
        t_valid: candidate.factor.t.0,
        sensor: candidate.factor.sensor() as u32,
        rows: candidate.factor.components() as u32,
        buoy: candidate.factor.buoy,
        refused: if verdict.refused { 1 + RejectReason::Gated as u32 } else { 0 },
        whitened: candidate.innovation.whitened,
        nis: candidate.innovation.nis,
        weight: verdict.weight,
        gate: verdict.gate,
    });
}
