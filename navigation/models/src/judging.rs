//! Which measurements of one sensor count, and how much: gates, adaptive kernels, refusals in a row (§3.3, §4.2 of the method).
//!
//! One set of rules for every estimator, so that a comparison of estimators is not one of gates.

use shared_types::{Duration, Kernel, SENSORS, Sensor, SensorConfig, Time};

use crate::doubt::{Doubt, is_shared};
use crate::innovation::{Innovation, Refusals, median};
use crate::robust::{ImprobableShare, credit, settle};
use crate::row::Row;

/// Ranges of one epoch; further ones are counted as too many.
pub const EPOCH_MAX: usize = 32;
/// With an unknown common offset the median of fewer ranges proves nothing (§3.3).
const MEDIAN_MIN: usize = 3;
/// How long a state stays to blame after two fixes or epochs of ranges within [`DISSENT_WITHIN`] disagreed with it.
const DISSENT_FOR: Duration = Duration(10_000_000_000);
const DISSENT_WITHIN: Duration = Duration(10_000_000_000);
/// A sensor that has been silent for longer settles no doubt.
const SETTLED_BY: Duration = Duration(10_000_000_000);

/// A measurement that has been evaluated and waits for its judgement.
pub trait Candidate {
    /// Its whitened rows.
    fn rows(&mut self) -> &mut [Row];
    /// Against its prediction.
    fn innovation(&mut self) -> &mut Innovation;
    /// Degrees of freedom of a test on it.
    fn components(&self) -> usize;
    /// Robust kernel in force.
    fn kernel(&self) -> Kernel;
}

/// What was decided on one candidate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verdict {
    /// Its gate refused it.
    pub refused: bool,
    /// Weight of its kernel at its innovation.
    pub weight: f64,
    /// What the gate lets through, as [`Innovation::gate`] has it; twice 0 without one.
    pub gate: [f64; 2],
}

/// What each sensor has been up to, in the order of [`SENSORS`].
#[derive(Clone, Copy, Debug)]
pub struct Judges {
    shares: [ImprobableShare; SENSORS.len()],
    refusals: [Refusals; SENSORS.len()],
    /// Newest reading.
    t_heard: [Time; SENSORS.len()],
    /// Newest fix or epoch of ranges most of which is improbable.
    t_improbable: Time,
    /// The same, the second of two close to each other.
    t_dissent: Time,
    /// What each sensor has been like of late, beside what it is like.
    doubts: [Doubt; SENSORS.len()],
}

impl Default for Judges {
    fn default() -> Self {
        Judges {
            shares: Default::default(),
            refusals: Default::default(),
            t_heard: [Time::MIN; SENSORS.len()],
            t_improbable: Time::MIN,
            t_dissent: Time::MIN,
            doubts: Default::default(),
        }
    }
}

impl Judges {
    /// The kernel in force of a sensor: an adaptive one is narrow while the sensor is not what its sigma says. Unless fixes or
    /// whole epochs of ranges disagree with the state as well: then the state is to blame, its inertial sensors are not what
    /// *their* sigmas say, and who is believed less had better not be the one that could mend it.
    pub fn kernel(&self, sensor: Sensor, config: &SensorConfig) -> Kernel {
        let is_state_to_blame = self.t_heard[sensor.index()] <= self.t_dissent + DISSENT_FOR;
        settle(config.kernel, self.shares[sensor.index()].is_suspicious() && !is_state_to_blame)
    }

    /// Whether several sensors have begun to be off the state together: the inertial ones are to blame. Only where one has spoken of
    /// late that says where the vehicle is or heads: biases that are let loose in dead reckoning would take the course along, and
    /// nothing would bring it back.
    pub fn is_inertial_to_blame(&self) -> bool {
        let newest = self.t_heard.iter().max().copied().unwrap_or(Time::MIN);
        let could_settle_it = [Sensor::Lbl, Sensor::Gnss, Sensor::Mcp].into_iter().any(|sensor| {
            self.t_heard[sensor.index()] > Time::MIN && newest - self.t_heard[sensor.index()] <= SETTLED_BY
        });
        could_settle_it && is_shared(&self.doubts)
    }

    /// Whole epochs of ranges refused in a row, and since when.
    pub fn epochs_refused(&self) -> (u32, Option<Time>) {
        self.refusals[Sensor::Lbl.index()].run()
    }

    /// Satellite fixes in a row that a gate would refuse, and since when: they are believed less, by their kernel.
    pub fn fixes_improbable(&self) -> (u32, Option<Time>) {
        self.refusals[Sensor::Gnss.index()].run()
    }

    /// Judges what one sensor measured at `t`: gates, sets weights, tells of each. What was refused leaves the group.
    /// With `shares_offset` the group is an epoch of ranges with a common unknown offset, judged without its median.
    pub fn judge<C: Candidate>(
        &mut self,
        sensor: Sensor,
        config: &SensorConfig,
        shares_offset: bool,
        t: Time,
        group: &mut Vec<C>,
        mut tell: impl FnMut(&mut C, Verdict),
    ) {
        if group.is_empty() {
            return;
        }
        self.t_heard[sensor.index()] = t;
        let mut is_gated = config.gate;
        if shares_offset {
            is_gated &= take_out_median(group);
        }
        let admits = self.refusals[sensor.index()].admits_next();
        let (share, doubt) = (&mut self.shares[sensor.index()], &mut self.doubts[sensor.index()]);
        let (mut passed_any, mut improbable, all) = (false, 0, group.len());
        group.retain_mut(|candidate| {
            let components = candidate.components();
            let kernel = candidate.kernel();
            let innovation = candidate.innovation();
            let is_improbable = share.observe(innovation.nis, components);
            doubt.observe(t, is_improbable);
            improbable += usize::from(is_improbable);
            let passes = innovation.passes(sensor, components);
            passed_any |= passes;
            let refused = is_gated && !passes && !admits;
            let weight = innovation.first_weight(kernel);
            let counted = weight * credit(kernel, components);
            candidate.rows().iter_mut().for_each(|row| row.weight = counted);
            let gate = if is_gated { Innovation::gate(sensor, components) } else { [0.0; 2] };
            tell(candidate, Verdict { refused, weight, gate });
            !refused
        });
        // Of a single range nothing is known of its kind: it may be an echo.
        if 2 * improbable > all && (sensor == Sensor::Gnss || sensor == Sensor::Lbl && all > 1) {
            if t - self.t_improbable <= DISSENT_WITHIN {
                self.t_dissent = self.t_dissent.max(t);
            }
            self.t_improbable = self.t_improbable.max(t);
        }
        if is_gated || sensor == Sensor::Gnss {
            self.refusals[sensor.index()].observe(t, passed_any);
        }
    }
}

/// Takes the median of an epoch's innovations out of each; `false` where too few ranges are there to know it.
fn take_out_median<C: Candidate>(epoch: &mut [C]) -> bool {
    let mut offsets = [0.0; EPOCH_MAX];
    let count = epoch.len().min(EPOCH_MAX);
    if count < MEDIAN_MIN {
        return false;
    }
    for (offset, candidate) in offsets.iter_mut().zip(epoch.iter_mut()) {
        // Whitened innovation times √S and σ: the innovation in m.
        let s = (1.0 + candidate.innovation().state_share).sqrt();
        *offset = candidate.innovation().whitened[0] * s / candidate.rows()[0].inverse_sigma;
    }
    let Some(offset) = median(&mut offsets[..count]) else { return false };
    for candidate in epoch {
        let in_sigmas = offset * candidate.rows()[0].inverse_sigma;
        let innovation = candidate.innovation();
        let s = (1.0 + innovation.state_share).sqrt();
        *innovation = innovation.without_offset(in_sigmas, s);
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::Config;

    struct Read(Innovation);

    impl Candidate for Read {
        fn rows(&mut self) -> &mut [Row] {
            &mut []
        }
        fn innovation(&mut self) -> &mut Innovation {
            &mut self.0
        }
        fn components(&self) -> usize {
            1
        }
        fn kernel(&self) -> Kernel {
            Kernel::None
        }
    }

    /// Half a minute in which each of these sensors is read once a second, four sigmas off from the tenth on.
    fn blamed(sensors: &[Sensor]) -> bool {
        let config = Config::default();
        let mut judges = Judges::default();
        for second in 0..30 {
            let whitened = [if second < 10 { 0.5 } else { 4.0 }, 0.0, 0.0];
            let nis = whitened[0] * whitened[0];
            for &sensor in sensors {
                let t = Time::from_seconds(f64::from(second));
                let mut group = vec![Read(Innovation { whitened, nis, state_share: 0.0, slopes: Default::default() })];
                judges.judge(sensor, config.navigator.sensor(sensor).expect("aiding"), false, t, &mut group, |_, _| {});
            }
        }
        judges.is_inertial_to_blame()
    }

    #[test]
    fn inertial_sensors_are_to_blame_where_one_that_can_settle_it_is_heard() {
        assert!(blamed(&[Sensor::Dvl, Sensor::Mcp]));
        assert!(blamed(&[Sensor::Lbl, Sensor::Dvl]));
        assert!(!blamed(&[Sensor::Dvl, Sensor::Ps]), "dead reckoning");
        assert!(!blamed(&[Sensor::Mcp]), "one alone");
    }
}
