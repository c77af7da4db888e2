//! Which measurements of one sensor count, and how much: gates, adaptive kernels, refusals in a row (§3.3, §4.2 of the method).
//!
//! One set of rules for every estimator, so that a comparison of estimators is not one of gates.

use shared_types::{Duration, Kernel, SENSORS, Sensor, SensorConfig, Time};

use crate::doubt::{Doubt, is_shared};
use crate::innovation::{Innovation, Refusals, median};
use crate::persistence::Persistence;
use crate::pull::Pull;
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
/// So long a sensor vouches for the state that has agreed with it: several epochs of ranges.
const VOUCHES_FOR: Duration = Duration(5_000_000_000);
/// After so long nobody vouches against a sensor any more: what is off for longer may be the state after all.
const VOUCHED_AGAINST: Duration = Duration(300_000_000_000);
/// Before that what is refused may be refused for its stamp.
const CONTRADICTED_FOR: Duration = Duration(10_000_000_000);
/// So long what a velocity has done to the state may show.
const FORCED_LATELY: Duration = Duration(60_000_000_000);
/// Slower than this, m/s, a vehicle is where it is, whatever it heads for: no position speaks for or against a heading.
const UNDER_WAY: f64 = 0.3;
/// A depth or a heading that stamps so late would explain, s, is nobody's to refuse for long: while it dives or turns a vehicle has
/// another soon.
const LATE_AT_MOST: f64 = 0.3;
/// A reading of which its kernel leaves less counts for nothing.
const NEGLIGIBLE: f64 = 0.01;

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
    /// Others contradict its sensor, and have for long: what it says is no evidence of its stamps either.
    pub contradicted: bool,
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
    /// Newest fix, velocity or epoch of ranges most of which the gate would let through.
    t_agreed: [Time; SENSORS.len()],
    /// What they have been like on average.
    persistence: [Persistence; SENSORS.len()],
    /// Where ranges and fixes see the vehicle beside the state.
    pulls: [Pull; SENSORS.len()],
    /// The same of those that a gate would let through.
    shifts: [Pull; SENSORS.len()],
    /// Newest velocity that was admitted although its gate refuses it.
    t_velocity_forced: Time,
    /// Newest time under way.
    t_under_way: Time,
    /// A fix of the present run of refusals counted for nothing.
    is_fix_far: bool,
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
            t_agreed: [Time::MIN; SENSORS.len()],
            persistence: Default::default(),
            pulls: Default::default(),
            shifts: Default::default(),
            t_velocity_forced: Time::MIN,
            t_under_way: Time::MIN,
            is_fix_far: false,
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

    /// How far ranges of late, or fixes where no range is heard, see the vehicle beside the state, m, where no chance explains that.
    /// Each is told once: what is to be told again has to be seen anew.
    pub fn take_shift(&mut self, t: Time) -> Option<f64> {
        let is_heard = |sensor: &Sensor| {
            let t_heard = self.t_heard[sensor.index()];
            t_heard > Time::MIN && (t - t_heard).abs() <= VOUCHES_FOR
        };
        let heard = [Sensor::Lbl, Sensor::Gnss].into_iter().find(is_heard)?.index();
        // A velocity that has had its way against the state puts it elsewhere along the way, as late stamps do.
        let is_forced = self.t_velocity_forced > Time::MIN && t - self.t_velocity_forced <= FORCED_LATELY;
        let shift = self.shifts[heard].shift(is_forced)?;
        self.shifts[heard] = Pull::default();
        Some(shift)
    }

    /// Takes in how fast the vehicle is at `t`, m/s.
    pub fn observe_speed(&mut self, t: Time, speed: f64) {
        if speed >= UNDER_WAY {
            self.t_under_way = self.t_under_way.max(t);
        }
    }

    /// Whether others, by agreeing with the state, say that it is this sensor that is wrong: where the vehicle is, against its
    /// velocity and its fixes, under way against its heading; how fast it rises, against its depth. Not for ever, nor where the inertial
    /// sensors are to blame, nor a velocity or a heading where ranges or fixes together see the vehicle elsewhere: then the state is
    /// wrong.
    fn is_contradicted(&self, sensor: Sensor, t: Time) -> bool {
        let witnesses: &[Sensor] = match sensor {
            Sensor::Dvl => &[Sensor::Lbl, Sensor::Gnss],
            Sensor::Gnss => &[Sensor::Lbl],
            Sensor::Ps => &[Sensor::Dvl, Sensor::Gnss],
            Sensor::Mcp if self.t_under_way > Time::MIN && t - self.t_under_way <= VOUCHES_FOR => {
                &[Sensor::Lbl, Sensor::Gnss]
            }
            _ => &[],
        };
        let (_, since) = self.refusals[sensor.index()].run();
        let is_too_long = since.is_some_and(|since| t - since > VOUCHED_AGAINST);
        let agrees = |witness: &Sensor| {
            let t_agreed = self.t_agreed[witness.index()];
            t_agreed > Time::MIN && (t - t_agreed).abs() <= VOUCHES_FOR
        };
        let sees_it_elsewhere = |witness: &Sensor| {
            let t_heard = self.t_heard[witness.index()];
            let is_heard = t_heard > Time::MIN && (t - t_heard).abs() <= VOUCHES_FOR;
            is_heard && !self.pulls[witness.index()].agrees()
        };
        let is_state_wrong = matches!(sensor, Sensor::Dvl | Sensor::Mcp) && witnesses.iter().any(sees_it_elsewhere);
        witnesses.iter().any(agrees) && !is_state_wrong && !is_too_long && !self.is_inertial_to_blame()
    }

    /// Judges what one sensor measured at `t`: gates, sets weights, tells of each. What was admitted comes first in the group, in its
    /// order; returned is how many they are.
    ///
    /// A sensor that its gate has refused five times in a row is admitted by its kernel: the state may be what is wrong. Unless
    /// others agree with the state and the kernel leaves nothing of the reading, or never lets go of it: then it stays refused.
    /// The latter also where there is no gate. What they contradict, a velocity or a heading for some seconds, returns when it is
    /// right on average; a depth or a heading that late stamps would explain is not held off.
    ///
    /// With `shares_offset` the group is an epoch of ranges with a common unknown offset, judged without its median.
    pub fn judge<C: Candidate>(
        &mut self,
        sensor: Sensor,
        config: &SensorConfig,
        shares_offset: bool,
        t: Time,
        group: &mut [C],
        mut tell: impl FnMut(&mut C, Verdict),
    ) -> usize {
        if group.is_empty() {
            return 0;
        }
        self.t_heard[sensor.index()] = t;
        let mut is_gated = config.gate;
        if shares_offset {
            is_gated &= take_out_median(group);
        }
        let admits = self.refusals[sensor.index()].admits_next();
        // Nobody is asked about a sensor that nothing is the matter with.
        let fails = |one: &mut C| {
            let components = one.components();
            !one.innovation().passes(sensor, components)
        };
        let is_questioned = admits || group.iter_mut().any(fails);
        let is_contradicted = is_questioned && self.is_contradicted(sensor, t);
        let (_, since) = self.refusals[sensor.index()].run();
        let is_long = since.is_some_and(|since| t - since > CONTRADICTED_FOR);
        // The state has held out without it, as far as those can tell who know where it is.
        let has_held_out = since.is_some_and(|since| t - since > VOUCHES_FOR);
        let is_returning = admits
            && is_contradicted
            && (is_gated && (sensor == Sensor::Ps || sensor == Sensor::Dvl && has_held_out)
                || sensor == Sensor::Mcp && has_held_out
                || self.is_fix_far && sensor == Sensor::Gnss);
        let is_fix_far = &mut self.is_fix_far;
        let persistence = &mut self.persistence[sensor.index()];
        // By what the gate refuses and lets through.
        let mut seen = [Pull::default(); 2];
        let (share, doubt) = (&mut self.shares[sensor.index()], &mut self.doubts[sensor.index()]);
        let (mut passed, mut improbable, all) = (0, 0, group.len());
        let mut is_forced = false;
        let mut admitted = 0;
        for index in 0..group.len() {
            let candidate = &mut group[index];
            let components = candidate.components();
            let kernel = candidate.kernel();
            let innovation = candidate.innovation();
            let is_improbable = share.observe(innovation.nis, components);
            doubt.observe(t, is_improbable);
            improbable += usize::from(is_improbable);
            // A receiver that settles comes through the gate before it is right.
            let is_off = persistence.observe(sensor, innovation) || sensor == Sensor::Gnss && is_improbable;
            let is_late = matches!(sensor, Sensor::Ps | Sensor::Mcp) && could_be_late(innovation);
            let is_returning = is_returning && !is_late;
            let passes = innovation.passes(sensor, components) && !(is_returning && is_off);
            passed += usize::from(passes);
            let weight = innovation.first_weight(kernel);
            let is_redescending = matches!(kernel, Kernel::Cauchy(_) | Kernel::AdaptiveCauchy(_));
            let is_void = is_contradicted && !is_late && (weight < NEGLIGIBLE || !is_redescending);
            let refused =
                !passes && (is_returning || if is_gated { !admits || is_void } else { is_void && is_redescending });
            *is_fix_far |= sensor == Sensor::Gnss && refused;
            is_forced |= sensor == Sensor::Dvl && !passes && !refused;
            let counted = weight * credit(kernel, components);
            if matches!(sensor, Sensor::Lbl | Sensor::Gnss) {
                let innovation = *candidate.innovation();
                seen[usize::from(passes)].observe(candidate.rows(), &innovation);
            }
            candidate.rows().iter_mut().for_each(|row| row.weight = counted);
            let gate = if is_gated { Innovation::gate(sensor, components) } else { [0.0; 2] };
            tell(candidate, Verdict { refused, contradicted: is_void && is_long, weight, gate });
            if !refused {
                if admitted < index {
                    group.swap(admitted, index);
                }
                admitted += 1;
            }
        }
        // Of a single range nothing is known of its kind: it may be an echo.
        if 2 * improbable > all && (sensor == Sensor::Gnss || sensor == Sensor::Lbl && all > 1) {
            if t - self.t_improbable <= DISSENT_WITHIN {
                self.t_dissent = self.t_dissent.max(t);
            }
            self.t_improbable = self.t_improbable.max(t);
        }
        if matches!(sensor, Sensor::Lbl | Sensor::Gnss) {
            // One wild range among good ones is nobody's place.
            let first_heard = usize::from(2 * passed > all);
            self.pulls[sensor.index()].take_in(seen[first_heard..].iter().copied());
            let passing = 2 - usize::from(2 * passed > all);
            self.shifts[sensor.index()].take_in(seen[passing..].iter().copied());
        }
        if 2 * passed > all {
            self.t_agreed[sensor.index()] = t.max(self.t_agreed[sensor.index()]);
        }
        if is_forced {
            self.t_velocity_forced = self.t_velocity_forced.max(t);
        }
        if is_gated || matches!(sensor, Sensor::Gnss | Sensor::Mcp) {
            self.refusals[sensor.index()].observe(t, passed > 0);
            self.is_fix_far &= sensor != Sensor::Gnss || passed == 0;
        }
        admitted
    }
}

/// Whether stamps that are late by no more than [`LATE_AT_MOST`] explain it.
fn could_be_late(innovation: &Innovation) -> bool {
    innovation.whitened[0].abs() <= innovation.slopes[0][0].abs() * LATE_AT_MOST
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
    use crate::kernels::BlockVector;
    use shared_types::Config;

    struct Read(Innovation, Kernel, Option<Row>);

    impl Candidate for Read {
        fn rows(&mut self) -> &mut [Row] {
            self.2.as_mut_slice()
        }
        fn innovation(&mut self) -> &mut Innovation {
            &mut self.0
        }
        fn components(&self) -> usize {
            1
        }
        fn kernel(&self) -> Kernel {
            self.1
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
                let mut group = vec![Read(
                    Innovation { whitened, nis, state_share: 0.0, slopes: Default::default() },
                    Kernel::None,
                    None,
                )];
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

    /// Whether a reading of a sensor at `t`, so many sigmas off, is refused, with the kernel and gate of its defaults.
    fn is_refused(judges: &mut Judges, sensor: Sensor, t: f64, off: f64) -> bool {
        let navigator = Config::default().navigator;
        let config = navigator.sensor(sensor).expect("aiding");
        let kernel = judges.kernel(sensor, config);
        let innovation =
            Innovation { whitened: [off, 0.0, 0.0], nis: off * off, state_share: 0.0, slopes: Default::default() };
        let mut refused = false;
        let mut group = vec![Read(innovation, kernel, None)];
        judges.judge(sensor, config, false, Time::from_seconds(t), &mut group, |_, verdict| refused = verdict.refused);
        refused
    }

    #[test]
    fn a_velocity_that_is_far_off_stays_refused_while_ranges_agree() {
        for (hears_ranges, expected) in [(true, 100), (false, 5)] {
            let mut judges = Judges::default();
            let refused = (0..100).filter(|&reading| {
                let t = 0.2 * f64::from(reading);
                if hears_ranges && reading % 5 == 0 {
                    assert!(!is_refused(&mut judges, Sensor::Lbl, t, 0.5));
                }
                is_refused(&mut judges, Sensor::Dvl, t, 80.0)
            });
            assert_eq!(refused.count(), expected, "ranges heard: {hears_ranges}");
            let mut still = |reading: i32, off: f64| {
                let t = 20.0 + 0.2 * f64::from(reading);
                if hears_ranges && reading % 5 == 0 {
                    assert!(!is_refused(&mut judges, Sensor::Lbl, t, 0.5));
                }
                is_refused(&mut judges, Sensor::Dvl, t, off)
            };
            assert!((0..50).all(|reading| still(reading, 3.0) == hears_ranges), "each would pass, their mean does not");
            let refused = (50..100).filter(|&reading| still(reading, 0.5)).count();
            assert!(refused < 10, "what is right again returns soon: {refused}");
        }
    }

    /// An epoch of ranges all round the vehicle at `t`, each within its gate, which is so many metres east of the state.
    fn hear_ranges(judges: &mut Judges, t: f64, east: f64) {
        const SIGMA: f64 = 0.3;
        let config = Config::default();
        let config = config.navigator.sensor(Sensor::Lbl).expect("aiding");
        let range = |bearing: f64| {
            let mut jacobian = BlockVector::zeros();
            (jacobian[0], jacobian[1]) = (bearing.sin() / SIGMA, bearing.cos() / SIGMA);
            let residual = -jacobian[0] * east;
            let innovation = Innovation {
                whitened: [residual, 0.0, 0.0],
                nis: residual * residual,
                state_share: 0.0,
                slopes: Default::default(),
            };
            let slopes = Default::default();
            let row = Row { jacobian, residual, inverse_sigma: 1.0 / SIGMA, weight: 1.0, slopes, mooring: None };
            Read(innovation, config.kernel, Some(row))
        };
        let mut epoch = [0.3, 1.9, 3.6, 5.1].map(range);
        judges.judge(Sensor::Lbl, config, false, Time::from_seconds(t), &mut epoch, |_, verdict| {
            assert!(!verdict.refused, "each is within its gate");
        });
    }

    #[test]
    fn a_velocity_is_admitted_where_ranges_that_each_pass_see_the_vehicle_elsewhere() {
        for (east, expected) in [(0.0, 51..=51), (0.6, 5..=20)] {
            let mut judges = Judges::default();
            let refused = (0..=50).filter(|&reading| {
                let t = 0.2 * f64::from(reading);
                if reading % 5 == 0 {
                    hear_ranges(&mut judges, t, east);
                }
                is_refused(&mut judges, Sensor::Dvl, t, 80.0)
            });
            let refused = refused.count();
            assert!(expected.contains(&refused), "{east} m: {refused}");
        }
    }

    #[test]
    fn ranges_tell_once_where_they_see_the_vehicle_and_again_when_they_have_seen_it_anew() {
        let mut judges = Judges::default();
        let told: Vec<i32> = (0..30)
            .filter(|&second| {
                hear_ranges(&mut judges, f64::from(second), 0.6);
                let shift = judges.take_shift(Time::from_seconds(f64::from(second)));
                assert!(shift.is_none_or(|shift| (shift - 0.6).abs() < 1e-9), "{shift:?}");
                shift.is_some()
            })
            .collect();
        assert!((2..=10).contains(&told.len()) && told.windows(2).all(|pair| pair[1] - pair[0] > 1), "{told:?}");
        hear_ranges(&mut judges, 30.0, 0.6);
        (31..35).for_each(|second| hear_ranges(&mut judges, f64::from(second), 0.6));
        assert_eq!(judges.take_shift(Time::from_seconds(60.0)), None, "nothing has been heard for long");
    }

    #[test]
    fn a_heading_that_is_far_off_is_refused_under_way_while_ranges_agree_and_returns_when_it_is_right_on_average() {
        for (speed, east, expected) in [(1.0, 0.0, 150), (0.1, 0.0, 0), (1.0, 0.6, 0)] {
            let mut judges = Judges::default();
            let mut refused = |from: i32, off: f64| {
                let readings = (from..from + 200).filter(|&reading| {
                    let t = 0.1 * f64::from(reading);
                    if reading % 10 == 0 {
                        hear_ranges(&mut judges, t, east);
                    }
                    judges.observe_speed(Time::from_seconds(t), speed);
                    is_refused(&mut judges, Sensor::Mcp, t, off)
                });
                readings.count()
            };
            let (wrong, right) = (refused(0, 17.0), refused(200, 0.3));
            assert!(wrong.abs_diff(expected) < 10, "{speed} m/s, {east} m: {wrong}");
            assert!(right < 20, "what is right again returns soon: {right}");
        }
    }

    #[test]
    fn a_fix_that_is_far_off_is_refused_without_a_gate_where_ranges_agree() {
        let mut judges = Judges::default();
        assert!(!is_refused(&mut judges, Sensor::Gnss, 0.0, 500.0), "nobody else says where it is");
        assert!(!is_refused(&mut judges, Sensor::Lbl, 1.0, 0.5));
        assert!(is_refused(&mut judges, Sensor::Gnss, 1.0, 500.0));
        assert!(!is_refused(&mut judges, Sensor::Gnss, 2.0, 6.0), "its kernel says how much of it counts");
        assert!(!is_refused(&mut judges, Sensor::Gnss, 7.0, 500.0), "no range for six seconds");
    }

    #[test]
    fn a_depth_that_leapt_stays_refused_while_velocities_agree_and_returns_when_it_is_right_on_average() {
        let mut judges = Judges::default();
        let mut depth = |t: f64, off: f64| {
            assert!(!is_refused(&mut judges, Sensor::Dvl, t, 0.5));
            is_refused(&mut judges, Sensor::Ps, t, off)
        };
        assert!((0..100).all(|reading| !depth(0.1 * f64::from(reading), 1.0)));
        assert!((100..200).all(|reading| depth(0.1 * f64::from(reading), 30.0)));
        assert!((200..300).all(|reading| depth(0.1 * f64::from(reading), 2.5)), "each would pass, their mean does not");
        let refused = (300..400).filter(|&reading| depth(0.1 * f64::from(reading), 0.2)).count();
        assert!((5..40).contains(&refused), "{refused}");
    }

    #[test]
    fn a_depth_that_late_stamps_would_explain_is_admitted_after_a_while() {
        let config = Config::default();
        let config = config.navigator.sensor(Sensor::Ps).expect("aiding");
        for (rate, expected) in [(0.0, 200), (80.0, 5)] {
            let mut judges = Judges::default();
            let mut refused = 0;
            for reading in 0..200 {
                let t = 0.1 * f64::from(reading);
                assert!(!is_refused(&mut judges, Sensor::Dvl, t, 0.5));
                let slopes = [[rate, 0.0, 0.0], [0.0; 3]];
                let innovation = Innovation { whitened: [20.0, 0.0, 0.0], nis: 400.0, state_share: 0.0, slopes };
                let mut group = vec![Read(innovation, judges.kernel(Sensor::Ps, config), None)];
                let tell = |_: &mut Read, verdict: Verdict| refused += u32::from(verdict.refused);
                judges.judge(Sensor::Ps, config, false, Time::from_seconds(t), &mut group, tell);
            }
            assert_eq!(refused, expected, "{rate} sigmas per second");
        }
    }

    #[test]
    fn nobody_is_contradicted_for_longer_than_five_minutes() {
        let mut judges = Judges::default();
        let refused = (0..400).filter(|&second| {
            let t = f64::from(second);
            assert!(!is_refused(&mut judges, Sensor::Dvl, t, 0.5));
            is_refused(&mut judges, Sensor::Ps, t, 30.0)
        });
        assert_eq!(refused.count(), 301);
    }
}
