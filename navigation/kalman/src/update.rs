//! One sensor at one instant: evaluated at the filter's state, gated, weighed, folded in.
//!
//! ```text
//! innovation   whitened by S = J P Jᵀ + R;  gate χ² 99.9 %, ranges on two sides, an epoch without its median if it shares an offset
//! weight       w of the kernel at the innovation: R/w                                     (one step of the reweighting)
//! iterated     w of the kernel at the residual, at every linearisation
//! ```
//!
//! Gate, kernel and their memory are `nav_models::judging`, the smoother's own.

use nav_models::imu_history::ImuHistory;
use nav_models::innovation::Innovation;
use nav_models::judging::{Candidate, EPOCH_MAX, Judges};
use nav_models::recovery::{Checked, Loosening, SUSPICIOUS_EPOCHS, loosening, loosening_by_shift};
use nav_models::robust::credited_weight;
use nav_models::row::{MeasuredRows, ROWS_MAX, Row};
use nav_models::sensors::{GyroAt, Model};
use nav_models::state::NavState;
use nav_models::world::WorldModel;
use shared_types::{
    Config, FactorReport, Kernel, KeyframeReport, RejectReason, SENSORS, Sensor, SensorConfig, SensorCounts, Time,
};

use crate::common_offset::decorrelate;
use crate::filter::{Filter, Linearised};
use crate::timeline::{Entry, Outcome, Timeline};

/// A reading that has been evaluated at the filter's state.
#[derive(Clone, Copy, Debug)]
struct Evaluated {
    /// Its place in the timeline.
    index: usize,
    model: Model,
    kernel: Kernel,
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
        self.model.components()
    }

    fn kernel(&self) -> Kernel {
        self.kernel
    }
}

/// What an update needs to see of the world around the filter.
pub(crate) struct Surroundings<'a> {
    pub(crate) config: &'a Config,
    pub(crate) world: &'a WorldModel,
    pub(crate) history: &'a ImuHistory,
}

/// Where an update writes what it decided.
pub(crate) struct Ledger<'a> {
    pub(crate) judges: &'a mut Judges,
    pub(crate) counts: &'a mut [SensorCounts; SENSORS.len()],
    pub(crate) report: &'a mut KeyframeReport,
}

/// Takes groups of the timeline in. Holds nothing but room.
#[derive(Clone, Debug)]
pub(crate) struct Updater {
    group: Vec<Evaluated>,
    rows: Vec<Row>,
    pending: Vec<Checked>,
}

impl Updater {
    pub(crate) fn new() -> Updater {
        Updater {
            group: Vec::with_capacity(EPOCH_MAX),
            rows: Vec::with_capacity(EPOCH_MAX.max(ROWS_MAX)),
            pending: Vec::with_capacity(EPOCH_MAX),
        }
    }

    /// By how much the filters have to give way first: whole epochs were refused, and this one agrees with itself on another
    /// place than `filter`; or those that passed see it there together.
    pub(crate) fn loosening(
        &mut self,
        timeline: &mut Timeline,
        group: core::ops::Range<usize>,
        filter: &Filter,
        judges: &mut Judges,
        config: &Config,
    ) -> Option<Loosening> {
        let first = *timeline.get_mut(group.start);
        let by_shift = judges.take_shift(first.t).map(|shift| loosening_by_shift(shift, &config.vehicle.imu));
        let (count, since) = judges.epochs_refused();
        let Some(since) = since.filter(|_| first.sensor == Sensor::Lbl && count >= SUSPICIOUS_EPOCHS) else {
            return by_shift;
        };
        self.pending.clear();
        for index in group.take(EPOCH_MAX) {
            let entry = timeline.get_mut(index);
            self.pending.push((entry.measurement, entry.reading));
        }
        let height_sigma = filter.covariance[(2, 2)].max(0.0).sqrt();
        let state = filter.state.retract(&filter.mean());
        loosening(&self.pending, first.t, &state, height_sigma, first.t - since, config).or(by_shift)
    }

    /// Takes one group in, linearised up to `iterations` times. Returns what the filter did, or `None` if nothing of the group reached it.
    pub(crate) fn take_in(
        &mut self,
        timeline: &mut Timeline,
        group: core::ops::Range<usize>,
        filter: &mut Filter,
        iterations: usize,
        around: &Surroundings<'_>,
        ledger: &mut Ledger<'_>,
    ) -> Option<Linearised> {
        let first = *timeline.get_mut(group.start);
        let config = *around.config.navigator.sensor(first.sensor)?;
        let offset_sigma = around.config.navigator.lbl_common_offset_sigma;
        let shares_offset = first.sensor == Sensor::Lbl && offset_sigma > 0.0;
        ledger.judges.observe_speed(first.t, filter.state.velocity_enu.norm());
        self.group.clear();
        for index in group {
            let entry = timeline.get_mut(index);
            let evaluated = if self.group.len() == EPOCH_MAX {
                Err(RejectReason::TooMany)
            } else {
                evaluate(index, entry, filter, &config, around, ledger.judges)
            };
            match evaluated {
                Ok(evaluated) => self.group.push(evaluated),
                Err(reason) => refuse(entry, reason, ledger),
            }
        }
        self.judge(timeline, first.t, first.sensor, &config, shares_offset, ledger);
        if self.group.is_empty() {
            return None;
        }
        let (members, rows) = (&self.group, &mut self.rows);
        let mut is_first = true;
        let linearise = |state: &NavState, rows: &mut Vec<Row>| {
            for member in members {
                let mut measured = member.rows;
                if !is_first {
                    // One that was usable and no longer is (a heading near the vertical) keeps the rows that it had.
                    match member.model.rows_at(state, around.world) {
                        Ok(anew) => measured = anew,
                        Err(_) => continue,
                    }
                }
                rows.extend_from_slice(measured.as_slice());
            }
            if !is_first {
                weigh_by_residuals(members, rows, shares_offset.then_some(offset_sigma));
            }
            is_first = false;
            if shares_offset {
                decorrelate(rows, offset_sigma);
            }
        };
        match filter.update(iterations, linearise, rows) {
            Ok(done) => Some(done),
            Err(_) => {
                for member in &self.group {
                    let entry = timeline.get_mut(member.index);
                    entry.settle(Outcome::Refused(RejectReason::NotFinite), &mut ledger.counts[entry.sensor.index()]);
                }
                self.group.clear();
                None
            }
        }
    }

    /// Gates the group, sets weights, counts and lists. What was refused leaves the group.
    fn judge(
        &mut self,
        timeline: &mut Timeline,
        t: Time,
        sensor: Sensor,
        config: &SensorConfig,
        shares_offset: bool,
        ledger: &mut Ledger<'_>,
    ) {
        let Ledger { judges, counts, report } = ledger;
        let admitted = judges.judge(sensor, config, shares_offset, t, &mut self.group, |member, verdict| {
            let entry = timeline.get_mut(member.index);
            if entry.outcome.is_none() {
                report.list(FactorReport {
                    t_valid: entry.t.0,
                    sensor: sensor as u32,
                    rows: member.model.components() as u32,
                    buoy: entry.buoy(),
                    refused: if verdict.refused { 1 + RejectReason::Gated as u32 } else { 0 },
                    whitened: member.innovation.whitened,
                    nis: member.innovation.nis,
                    weight: verdict.weight,
                    gate: verdict.gate,
                });
            }
            let outcome = if verdict.refused { Outcome::Refused(RejectReason::Gated) } else { Outcome::Used };
            entry.settle(outcome, &mut counts[sensor.index()]);
        });
        self.group.truncate(admitted);
    }
}

fn evaluate(
    index: usize,
    entry: &Entry,
    filter: &Filter,
    config: &SensorConfig,
    around: &Surroundings<'_>,
    judges: &Judges,
) -> Result<Evaluated, RejectReason> {
    let gyro = || {
        let gyro_body = around.history.at(entry.t)?.gyro_body;
        Some(GyroAt { gyro_body, dt_imu: around.history.sampling_period_at(entry.t).as_seconds() })
    };
    let model = Model::of(&entry.reading, &around.config.vehicle, &filter.state, around.world, gyro)?;
    let rows = model.rows_at(&filter.state, around.world).map_err(|_| RejectReason::NotFinite)?;
    let innovation = Innovation::of(rows.as_slice(), &filter.mean(), &filter.covariance);
    Ok(Evaluated { index, model, kernel: judges.kernel(entry.sensor, config), rows, innovation })
}

/// Counts and lists a reading that could not be judged.
pub(crate) fn refuse(entry: &mut Entry, reason: RejectReason, ledger: &mut Ledger<'_>) {
    if entry.outcome.is_none() {
        ledger.report.list_refused(entry.t, entry.measurement.kind, reason);
    }
    entry.settle(Outcome::Refused(reason), &mut ledger.counts[entry.sensor.index()]);
}

/// Weights of the kernels at the residuals of rows just evaluated; with an offset of that 1-sigma, at what it leaves.
fn weigh_by_residuals(members: &[Evaluated], rows: &mut [Row], offset_sigma: Option<f64>) {
    let Some(kernel) = members.first().map(|member| member.kernel) else { return };
    match offset_sigma {
        Some(sigma) => {
            let (mut mean, mut total) = (0.0, 1.0 / (sigma * sigma));
            for row in rows.iter() {
                mean += row.residual * row.inverse_sigma;
                total += row.inverse_sigma * row.inverse_sigma;
            }
            let offset = if total > 0.0 { mean / total } else { 0.0 };
            for row in rows {
                row.weight = credited_weight(kernel, 1, (row.residual - offset * row.inverse_sigma).powi(2));
            }
        }
        // Ranges bear weights of their own; the rows of any other measurement share one.
        None if members.len() > 1 => {
            rows.iter_mut().for_each(|row| row.weight = credited_weight(kernel, 1, row.residual.powi(2)));
        }
        None => {
            let s = rows.iter().map(|row| row.residual.powi(2)).sum();
            let weight = credited_weight(kernel, rows.len(), s);
            rows.iter_mut().for_each(|row| row.weight = weight);
        }
    }
}
