//! From an IMU sample to what may be published of it: gate, propagator, and a last look at every number.

use nav_models::propagator::{Propagator, PropagatorError};
use nav_preprocessing::{ImuGate, ImuVerdict};
use shared_types::{Config, ImuSample, Mode, NavEstimate, RejectReason, SensorHealth, Solution, Time};

/// Carries the newest solution to every IMU sample that counts. Knows no bus and no clock.
#[derive(Clone, Debug)]
pub struct FastPath {
    imu_gate: ImuGate,
    propagator: Propagator,
    imu: SensorHealth,
    last_sound: Option<NavEstimate>,
    unsound: u64,
}

impl FastPath {
    /// Without samples and solutions yet.
    pub fn new(config: &Config) -> FastPath {
        FastPath {
            imu_gate: ImuGate::new(&config.navigator.imu),
            propagator: Propagator::new(config),
            imu: SensorHealth::NONE,
            last_sound: None,
            unsound: 0,
        }
    }

    /// Stands on a solution from the next sample on.
    ///
    /// # Errors
    /// Those of [`Propagator::rebase`]; the last solution then stays in use.
    pub fn rebase(&mut self, solution: &Solution) -> Result<(), PropagatorError> {
        self.propagator.rebase(solution)
    }

    /// The estimate at a sample; `None` where the sample does not count. While an instrument has frozen or cannot be right, the
    /// last estimate is held, INVALID.
    ///
    /// Never one with a number that is none: the last sound one is then held, INVALID, and the case is counted.
    pub fn advance(&mut self, sample: &ImuSample) -> Option<NavEstimate> {
        self.imu.received += 1;
        if let ImuVerdict::Reject(reason) = self.imu_gate.check(sample) {
            self.imu.rejected[reason.index()] += 1;
            return if self.imu_gate.is_blind() { self.without_imu(Time(sample.header.t_valid)) } else { None };
        }
        self.imu.t_newest = sample.header.t_valid;
        match self.propagator.advance(sample) {
            Ok(estimate) => self.sound(estimate?),
            // The gate has sifted these out; should the two ever disagree, the sample is refused and counted all the same.
            Err(PropagatorError::NotFinite { .. }) => self.refuse(RejectReason::NotFinite),
            Err(_) => self.refuse(RejectReason::BackwardsTime),
        }
    }

    /// Goes through the motions of the next sample, `dt_s` of data time after the last, and changes nothing.
    pub fn rehearse(&self, dt_s: f64) {
        let rehearsed = self.propagator.rehearse(dt_s);
        // Nobody looks at it, and the compiler must not know.
        std::hint::black_box(rehearsed.is_some_and(|estimate| is_sound(&estimate)));
    }

    /// What can be said at `now` without a sample; `None` before the first estimate.
    pub fn without_imu(&mut self, now: Time) -> Option<NavEstimate> {
        self.last_sound?;
        let held = self.propagator.without_imu(now);
        self.sound(held)
    }

    /// The IMU as this process sees it.
    pub fn imu(&self) -> &SensorHealth {
        &self.imu
    }

    /// Estimates that held a number that is none, and were not published.
    pub fn unsound(&self) -> u64 {
        self.unsound
    }

    fn refuse(&mut self, reason: RejectReason) -> Option<NavEstimate> {
        self.imu.rejected[reason.index()] += 1;
        None
    }

    fn sound(&mut self, estimate: NavEstimate) -> Option<NavEstimate> {
        if is_sound(&estimate) {
            self.last_sound = Some(estimate);
            return Some(estimate);
        }
        self.unsound += 1;
        let last = self.last_sound?;
        Some(NavEstimate { header: estimate.header, mode: Mode::Invalid as u32, ..last })
    }
}

/// Whether every number is one, every variance is one, and the attitude is a rotation.
fn is_sound(estimate: &NavEstimate) -> bool {
    const UNIT_TOLERANCE: f64 = 1e-6;
    let e = estimate;
    let mut numbers = e
        .position_enu
        .iter()
        .chain(&e.velocity_enu)
        .chain(&e.accel_bias)
        .chain(&e.gyro_bias)
        .chain(&e.position_cov)
        .chain(&e.velocity_cov)
        .chain(&e.attitude_cov)
        .chain(&e.sigma_rpy)
        .chain(&e.lat_lon_h);
    let norm_squared: f64 = e.q_enu_body.iter().map(|q| q * q).sum();
    // Diagonal of ee, en, eu, nn, nu, uu.
    let mut variances =
        [e.position_cov, e.velocity_cov, e.attitude_cov].into_iter().flat_map(|cov| [cov[0], cov[3], cov[5]]);
    numbers.all(|number| number.is_finite())
        && variances.all(|variance| variance >= 0.0)
        && (norm_squared - 1.0).abs() <= UNIT_TOLERANCE
        && e.aiding_age.iter().all(|age| !age.is_nan())
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test may fail where it stands")]
    use super::*;
    use shared_types::Header;

    fn sample(t: f64) -> ImuSample {
        let header = Header { sequence: 7, t_arrival: 99, ..Header::at(Time::from_seconds(t)) };
        ImuSample { header, gyro_body: [0.0; 3], accel_body: [0.0, 0.0, 9.8] }
    }

    fn started() -> (FastPath, NavEstimate) {
        let mut fast_path = FastPath::new(&Config::default());
        let estimate = fast_path.advance(&sample(1.0)).unwrap();
        (fast_path, estimate)
    }

    #[test]
    fn before_the_first_solution_the_mode_says_so() {
        let (_, estimate) = started();
        assert_eq!(estimate.mode(), Mode::Initialising);
        assert_eq!((estimate.header.origin_sequence, estimate.header.origin_t_arrival), (7, 99));
    }

    #[test]
    fn samples_that_do_not_count_give_no_estimate_and_are_counted() {
        let (mut fast_path, _) = started();
        let mut nan = sample(1.005);
        nan.gyro_body[1] = f64::NAN;
        assert_eq!(fast_path.advance(&nan), None);
        assert_eq!(fast_path.advance(&sample(0.9)), None);
        assert_eq!(fast_path.advance(&sample(1.0)), None);
        assert!(fast_path.advance(&sample(1.005)).is_some());
        let health = fast_path.imu();
        assert_eq!((health.received, health.rejected.iter().sum::<u64>()), (5, 3));
        assert_eq!(health.rejected[RejectReason::NotFinite.index()], 1);
        assert_eq!(health.t_newest, 1_005_000_000);
    }

    #[test]
    fn an_imu_that_freezes_or_leaps_is_answered_for_by_the_last_estimate() {
        let mut fast_path = FastPath::new(&Config::default());
        let live = |index: i32| {
            let mut sample = sample(f64::from(index) * 0.005);
            sample.gyro_body[0] = 1e-4 * f64::from(1 + index % 7);
            sample
        };
        assert!((0..2500).all(|index| fast_path.advance(&live(index)).is_some()));
        for index in 2500..2600 {
            let held = fast_path.advance(&sample(f64::from(index) * 0.005)).unwrap();
            assert_eq!(held.header.t_valid, Time::from_seconds(f64::from(index) * 0.005).0);
        }
        assert_eq!(fast_path.imu().rejected[RejectReason::Stuck.index()], 91);
        assert!(fast_path.advance(&live(2600)).is_some());
        let turned = |index: i32| ImuSample { accel_body: [0.0, 0.0, -9.8], ..live(index) };
        let answered: Vec<bool> = (2601..2610).map(|index| fast_path.advance(&turned(index)).is_some()).collect();
        assert_eq!(answered.iter().position(|&answered| answered), Some(4), "once a gap would be a gap");
        assert_eq!(fast_path.imu().rejected[RejectReason::OutOfRange.index()], 9);
    }

    #[test]
    fn an_unsound_estimate_is_replaced_by_the_last_sound_one_declared_invalid() {
        let spoils: [fn(&mut NavEstimate); 6] = [
            |e| e.position_enu[1] = f64::NAN,
            |e| e.velocity_cov[2] = f64::INFINITY,
            |e| e.attitude_cov[3] = -1e-9,
            |e| e.q_enu_body = [0.9, 0.0, 0.0, 0.0],
            |e| e.aiding_age[4] = f64::NAN,
            |e| e.lat_lon_h[2] = f64::NEG_INFINITY,
        ];
        for (index, spoil) in spoils.into_iter().enumerate() {
            let (mut fast_path, last) = started();
            let mut estimate = NavEstimate { header: Header::at(Time(5)), ..last };
            spoil(&mut estimate);
            let published = fast_path.sound(estimate).unwrap();
            let held = NavEstimate { header: Header::at(Time(5)), mode: Mode::Invalid as u32, ..last };
            assert_eq!(published, held, "spoil {index}");
            assert_eq!(fast_path.unsound(), 1, "spoil {index}");
        }
    }

    #[test]
    fn nothing_is_said_without_imu_before_the_first_sample() {
        let mut fast_path = FastPath::new(&Config::default());
        assert_eq!(fast_path.without_imu(Time(5)), None);
        fast_path.advance(&sample(1.0));
        assert_eq!(fast_path.without_imu(Time::from_seconds(1.5)).unwrap().header.t_valid, 1_500_000_000);
    }
}
