//! Does this IMU sample count?
//!
//! A pure function of the sample and of those before it: the preprocessor (slow path) and the propagator (fast path)
//! each hold one, see the same samples and therefore decide alike.

use shared_types::{Duration, ImuGateConfig, ImuSample, RejectReason, Time};

use crate::axes::Axes;
use crate::leaps::Leaps;
use crate::repetition::Repetition;

/// Weight of one step in the pace of arrivals.
const PACE_MEMORY: f64 = 1e-3;
/// A stamp further ahead of its predecessor is believed only when the next sample confirms it. Without this, one wild
/// stamp would turn every later sample into one that runs backwards. Longer than a restarted driver is silent.
const LEAP: Duration = Duration(5_000_000_000);

/// Stamps beyond (±285 years) are no data time, and differences of two must fit 64 bits.
pub(crate) const T_MAX: Time = Time(4_500_000_000_000_000_000);

/// Whether an instant can be data time at all.
pub(crate) fn is_possible(t: Time) -> bool {
    t <= T_MAX && t >= Time(-T_MAX.0)
}

/// So many samples of the same six numbers are none (F5), if the instrument did not repeat itself from the beginning.
const FROZEN: u32 = 10;
/// A beginning, in samples: 10 s at 200 Hz.
const BEGINNING: u32 = 2000;

/// The gate, with the last sample that it let through.
#[derive(Clone, Debug)]
pub struct ImuGate {
    config: ImuGateConfig,
    repetition: Repetition<6>,
    leaps: Leaps,
    axes: Axes,
    /// The last sample had its place in time and said nothing.
    is_blind: bool,
    t_accepted: Option<Time>,
    /// When that arrived, ns of the clock of arrivals.
    arrived: i64,
    /// What the clock of arrivals and that of the stamps have lately gone between samples without a gap, s: a set that runs faster than
    /// real time gives its arrivals less.
    lately: [f64; 2],
    /// A sample that leapt ahead, until the next one confirms it.
    t_leapt: Option<Time>,
}

/// What the gate says of one sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImuVerdict {
    /// It counts.
    Accept {
        /// The step from the sample before, where it is longer than `imu.gap`.
        gap: Option<Duration>,
        /// The step is longer than `imu.long_gap`: a straight line over it says nothing.
        long: bool,
    },
    /// It does not.
    Reject(RejectReason),
}

impl ImuGate {
    /// A gate that has seen nothing.
    pub fn new(config: &ImuGateConfig) -> ImuGate {
        ImuGate {
            config: *config,
            repetition: Repetition::new(FROZEN, BEGINNING),
            leaps: Leaps::new(config.gap),
            axes: Axes::new(config.gap),
            is_blind: false,
            t_accepted: None,
            arrived: 0,
            lately: [0.0; 2],
            t_leapt: None,
        }
    }

    /// Judges the next sample: finite, within what the instrument can measure, later than its predecessor. Of several
    /// samples with one `t_valid` the first counts, of the same numbers over and over those that may be real.
    pub fn check(&mut self, sample: &ImuSample) -> ImuVerdict {
        self.is_blind = false;
        match self.judge(sample) {
            Ok(step) => {
                self.learn_pace(step, sample);
                self.t_accepted = Some(Time(sample.header.t_valid));
                self.arrived = sample.header.t_arrival;
                self.t_leapt = None;
                let gap = step.filter(|&step| step > self.config.gap);
                ImuVerdict::Accept { gap, long: gap.is_some_and(|gap| gap > self.config.long_gap) }
            }
            Err(reason) => ImuVerdict::Reject(reason),
        }
    }

    /// Data time of the newest sample that counted.
    pub fn t_newest(&self) -> Option<Time> {
        self.t_accepted
    }

    /// Whether the last sample was refused as one of an instrument that has frozen or cannot be right, and has been for
    /// longer than `imu.gap`: its stamp tells the time, and nobody sees where the vehicle goes.
    pub fn is_blind(&self) -> bool {
        self.is_blind
    }

    /// The step from the predecessor, or why the sample does not count.
    fn judge(&mut self, sample: &ImuSample) -> Result<Option<Duration>, RejectReason> {
        let t = Time(sample.header.t_valid);
        if !sample.gyro_body.iter().chain(&sample.accel_body).all(|value| value.is_finite()) {
            return Err(RejectReason::NotFinite);
        }
        // At full scale an instrument says its rail, whatever the truth beyond it is: a gap is bridged with its uncertainty,
        // a clipped sample would be believed (F3).
        let within = |values: &[f64; 3], limit: f64| values.iter().all(|value| value.abs() < limit);
        if !within(&sample.gyro_body, self.config.max_rate)
            || !within(&sample.accel_body, self.config.max_accel)
            || !is_possible(t)
        {
            return Err(RejectReason::OutOfRange);
        }
        let Some(t_before) = self.t_accepted else {
            self.leaps.is_leap(t, sample);
            self.axes.have_changed(t, sample);
            return Ok(None);
        };
        let step = t - t_before;
        if step == Duration::ZERO {
            return Err(RejectReason::Duplicate);
        }
        if step < Duration::ZERO {
            return Err(RejectReason::BackwardsTime);
        }
        if step > LEAP {
            let confirmed = self.t_leapt.is_some_and(|t_leapt| t > t_leapt && t - t_leapt <= LEAP);
            if !confirmed {
                self.t_leapt = Some(t);
                return Err(RejectReason::OutOfRange);
            }
        }
        if self.runs_ahead(step, sample) {
            return Err(RejectReason::OutOfRange);
        }
        let ([gx, gy, gz], [ax, ay, az]) = (sample.gyro_body, sample.accel_body);
        let is_frozen = self.repetition.is_frozen(&[gx, gy, gz, ax, ay, az]);
        if is_frozen || self.leaps.is_leap(t, sample) || self.axes.have_changed(t, sample) {
            self.is_blind = is_frozen || step > self.config.gap;
            return Err(if is_frozen { RejectReason::Stuck } else { RejectReason::OutOfRange });
        }
        Ok(Some(step))
    }

    fn learn_pace(&mut self, step: Option<Duration>, sample: &ImuSample) {
        let Some(step) = step.filter(|&step| step <= self.config.gap) else { return };
        let waited = Duration(sample.header.t_arrival.saturating_sub(self.arrived));
        for (lately, gone) in self.lately.iter_mut().zip([waited, step]) {
            *lately += gone.as_seconds() - PACE_MEMORY * *lately;
        }
    }

    /// Whether the stamp, `step` after the last, has left the clock of arrivals behind: no silence, but a clock that was set, for a
    /// while or for good (F21). For good when it has gone on for longer than it leapt.
    fn runs_ahead(&self, step: Duration, sample: &ImuSample) -> bool {
        let [arrivals, stamps] = self.lately;
        let waited = Duration(sample.header.t_arrival.saturating_sub(self.arrived));
        // A log may know of no arrivals, and a batch arrives at one instant.
        if waited <= Duration::ZERO || arrivals <= 0.0 {
            return false;
        }
        let waited = Duration::from_seconds(waited.as_seconds() * stamps / arrivals);
        let lead = Duration(step.0.saturating_sub(waited.0));
        lead > self.config.long_gap && waited <= lead.min(LEAP)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::imu;
    use shared_types::Navigator;

    const PASSES: ImuVerdict = ImuVerdict::Accept { gap: None, long: false };

    fn gate() -> ImuGate {
        ImuGate::new(&Navigator::default().imu)
    }

    #[test]
    fn samples_in_step_pass() {
        let mut gate = gate();
        for step in 0..100 {
            assert_eq!(gate.check(&imu(f64::from(step) * 0.005)), PASSES);
        }
        assert_eq!(gate.t_newest(), Some(Time::from_seconds(0.495)));
    }

    #[test]
    fn of_equal_times_the_first_counts() {
        let mut gate = gate();
        let mut other = imu(1.0);
        other.gyro_body = [0.2; 3];
        assert_eq!(gate.check(&imu(1.0)), PASSES);
        assert_eq!(gate.check(&imu(1.0)), ImuVerdict::Reject(RejectReason::Duplicate));
        assert_eq!(gate.check(&other), ImuVerdict::Reject(RejectReason::Duplicate));
    }

    #[test]
    fn an_instrument_that_freezes_is_not_believed_after_ten_samples() {
        let mut gate = gate();
        let live = |step: i32| {
            let mut sample = imu(f64::from(step) * 0.005);
            sample.gyro_body[0] = 0.5 + 1e-4 * f64::from(step % 7);
            sample
        };
        assert!((0..2500).all(|step| gate.check(&live(step)) == PASSES));
        let refused = (2500..2600).filter(|&step| gate.check(&imu(f64::from(step) * 0.005)) != PASSES);
        assert_eq!(refused.collect::<Vec<i32>>(), (2509..2600).collect::<Vec<i32>>());
        let gap = Some(Duration::from_seconds(92.0 * 0.005));
        assert!(matches!(gate.check(&live(2600)), ImuVerdict::Accept { gap: found, .. } if found == gap));
    }

    #[test]
    fn an_instrument_that_repeats_itself_from_the_beginning_is_slow_and_not_frozen() {
        let mut gate = gate();
        for step in 0..4000 {
            let mut sample = imu(f64::from(step) * 0.005);
            sample.gyro_body[0] = 1e-4 * f64::from((step / 20) % 7);
            assert_eq!(gate.check(&sample), PASSES, "{step}");
        }
    }

    #[test]
    fn time_that_runs_backwards_is_refused_and_forgotten() {
        let mut gate = gate();
        assert_eq!(gate.check(&imu(1.0)), PASSES);
        assert_eq!(gate.check(&imu(0.9)), ImuVerdict::Reject(RejectReason::BackwardsTime));
        assert_eq!(gate.check(&imu(1.005)), PASSES);
    }

    #[test]
    fn a_sample_that_is_no_number_or_beyond_full_scale_is_refused() {
        let mut gate = gate();
        let mut nan = imu(1.0);
        nan.accel_body[2] = f64::NAN;
        assert_eq!(gate.check(&nan), ImuVerdict::Reject(RejectReason::NotFinite));
        let mut wild = imu(1.0);
        wild.gyro_body[0] = -36.0;
        assert_eq!(gate.check(&wild), ImuVerdict::Reject(RejectReason::OutOfRange));
        let mut never = imu(1.0);
        never.header.t_valid = i64::MAX;
        assert_eq!(gate.check(&never), ImuVerdict::Reject(RejectReason::OutOfRange));
        assert_eq!(gate.check(&imu(1.0)), PASSES, "the refused ones left no trace");
    }

    #[test]
    fn a_sample_at_its_rail_is_refused() {
        let limits = Navigator::default().imu;
        let mut gate = gate();
        let mut clipped = imu(1.0);
        clipped.gyro_body[2] = -limits.max_rate;
        assert_eq!(gate.check(&clipped), ImuVerdict::Reject(RejectReason::OutOfRange));
        let mut clipped = imu(1.0);
        clipped.accel_body[0] = limits.max_accel;
        assert_eq!(gate.check(&clipped), ImuVerdict::Reject(RejectReason::OutOfRange));
        clipped.accel_body[0] = 0.99 * limits.max_accel;
        assert_eq!(gate.check(&clipped), PASSES);
    }

    #[test]
    fn gaps_are_measured_and_long_ones_flagged() {
        let mut gate = gate();
        gate.check(&imu(0.0));
        assert_eq!(gate.check(&imu(0.02)), PASSES, "two periods of a 100 Hz instrument are no gap");
        let gap = Some(Duration::from_seconds(0.1));
        assert_eq!(gate.check(&imu(0.12)), ImuVerdict::Accept { gap, long: false });
        let gap = Some(Duration::from_seconds(1.0));
        assert_eq!(gate.check(&imu(1.12)), ImuVerdict::Accept { gap, long: true });
    }

    #[test]
    fn stamps_that_leave_the_clock_of_arrivals_behind_are_refused_for_as_long_as_they_leapt() {
        let at = |t: f64, t_arrival: f64| {
            let mut sample = imu(t);
            sample.header.t_arrival = Time::from_seconds(t_arrival).0;
            sample
        };
        let mut gate = gate();
        for step in -400..0 {
            let t = 0.005 * f64::from(step);
            assert_eq!(gate.check(&at(10.0 + t, 110.0 + t)), PASSES);
        }
        let leapt = |step: i32| at(11.0 + 0.005 * f64::from(step), 110.0 + 0.005 * f64::from(step));
        assert!((0..100).all(|step| gate.check(&leapt(step)) == ImuVerdict::Reject(RejectReason::OutOfRange)));
        let gap = Some(Duration::from_seconds(0.505));
        assert!(matches!(gate.check(&at(10.5, 110.5)), ImuVerdict::Accept { gap: found, .. } if found == gap));
        // For good: believed when the last good sample is a second old, as long ago as it leapt. Arrivals from 110.505 s on.
        let refused = (101..400).filter(|&step| matches!(gate.check(&leapt(step)), ImuVerdict::Reject(_))).count();
        assert!((199..=201).contains(&refused), "{refused}");
    }

    #[test]
    fn a_silence_that_is_heard_as_one_is_no_leap_of_the_clock_however_fast_the_set_runs() {
        for rate in [0.5, 1.0, 10.0] {
            let at = |t: f64| {
                let mut sample = imu(t);
                sample.header.t_arrival = Time::from_seconds(100.0 + t / rate).0;
                sample
            };
            let mut gate = gate();
            assert!((0..400).all(|step| gate.check(&at(0.005 * f64::from(step))) == PASSES));
            assert!(matches!(gate.check(&at(4.0)), ImuVerdict::Accept { long: true, .. }), "rate {rate}");
            assert!((801..1000).all(|step| gate.check(&at(0.005 * f64::from(step))) == PASSES), "rate {rate}");
        }
    }

    #[test]
    fn one_wild_stamp_costs_one_sample_only() {
        let mut gate = gate();
        gate.check(&imu(1.0));
        assert_eq!(gate.check(&imu(1.0e6)), ImuVerdict::Reject(RejectReason::OutOfRange));
        assert_eq!(gate.check(&imu(1.005)), PASSES);
    }

    #[test]
    fn a_long_silence_is_believed_at_its_second_sample() {
        let mut gate = gate();
        gate.check(&imu(1.0));
        assert_eq!(gate.check(&imu(100.0)), ImuVerdict::Reject(RejectReason::OutOfRange));
        let gap = Some(Duration::from_seconds(99.005));
        assert_eq!(gate.check(&imu(100.005)), ImuVerdict::Accept { gap, long: true });
    }
}
