//! What an estimate's consumer saw while something was done to the set.

use std::collections::VecDeque;

use shared_types::{Message, Mode, NavEstimate, Solution, Truth};

/// Estimates and truths that wait for each other: five seconds of them at 10 Hz and 200 Hz.
const WAITING: usize = 1_000;

/// Figures of one trial, or of many.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Figures {
    /// Estimates received.
    pub(super) estimates: u64,
    /// Of those, with a number that is none.
    pub(super) not_finite: u64,
    /// Estimates by the number of their mode.
    pub(super) modes: [u64; Mode::ALL.len()],
    /// Solutions received.
    pub(super) solutions: u64,
    /// Longest way between the keyframes of two solutions, ns of data time.
    pub(super) solution_gap: i64,
    /// Longest way between the data times of two estimates that stand on samples, ns.
    pub(super) gap: i64,
    /// Longest monotonic time between the publications of two estimates of whatever mode, ns.
    pub(super) silence: i64,
    /// Largest step beyond what the velocity explains, sigmas of its axis.
    pub(super) step: f64,
    /// Largest error, sigmas of its axis.
    pub(super) worst: f64,
    /// Components of errors beyond three sigmas.
    pub(super) outside: u64,
    /// Components of errors.
    pub(super) compared: u64,
}

impl Figures {
    /// Both together.
    pub(super) fn and(self, other: Figures) -> Figures {
        Figures {
            estimates: self.estimates + other.estimates,
            not_finite: self.not_finite + other.not_finite,
            modes: std::array::from_fn(|mode| self.modes[mode] + other.modes[mode]),
            solutions: self.solutions + other.solutions,
            solution_gap: self.solution_gap.max(other.solution_gap),
            gap: self.gap.max(other.gap),
            silence: self.silence.max(other.silence),
            step: self.step.max(other.step),
            worst: self.worst.max(other.worst),
            outside: self.outside + other.outside,
            compared: self.compared + other.compared,
        }
    }
}

/// Makes figures of estimates and truths.
#[derive(Debug, Default)]
pub(super) struct Observer {
    figures: Figures,
    /// The last that stands on a sample.
    last: Option<NavEstimate>,
    last_published: Option<i64>,
    last_keyframe: Option<i64>,
    /// Largest step since it was last asked for.
    recent_step: f64,
    estimates: VecDeque<NavEstimate>,
    truths: VecDeque<Truth>,
}

/// Whether it says where the vehicle is at an inertial sample.
pub(super) fn is_valid(estimate: &NavEstimate) -> bool {
    !matches!(estimate.mode(), Mode::Initialising | Mode::Invalid)
}

impl Observer {
    /// Figures since the last call.
    pub(super) fn take(&mut self) -> Figures {
        std::mem::take(&mut self.figures)
    }

    /// Largest step since the last call, sigmas.
    pub(super) fn recent_step(&mut self) -> f64 {
        std::mem::take(&mut self.recent_step)
    }

    /// Another set, another mission: nothing is compared across.
    pub(super) fn forget(&mut self) {
        *self = Observer { figures: self.figures, ..Observer::default() };
    }

    pub(super) fn estimate(&mut self, estimate: &NavEstimate) {
        let figures = &mut self.figures;
        figures.estimates += 1;
        figures.not_finite += u64::from(!is_finite(estimate));
        figures.modes[estimate.mode() as usize] += 1;
        let published = estimate.header.t_published;
        if let Some(last) = self.last_published.replace(published) {
            figures.silence = figures.silence.max(published - last);
        }
        // What is held without a sample is declared INVALID and is no place to step from.
        if !is_valid(estimate) {
            return;
        }
        if let Some(last) = self.last {
            figures.gap = figures.gap.max(estimate.header.t_valid - last.header.t_valid);
            let step = step(&last, estimate);
            figures.step = figures.step.max(step);
            self.recent_step = self.recent_step.max(step);
        }
        self.last = Some(*estimate);
        if self.estimates.len() == WAITING {
            self.estimates.pop_front();
        }
        self.estimates.push_back(*estimate);
        self.compare();
    }

    pub(super) fn solution(&mut self, solution: &Solution) {
        self.figures.solutions += 1;
        if let Some(last) = self.last_keyframe.replace(solution.t_keyframe) {
            self.figures.solution_gap = self.figures.solution_gap.max(solution.t_keyframe - last);
        }
    }

    pub(super) fn truth(&mut self, truth: &Truth) {
        if self.truths.len() == WAITING {
            self.truths.pop_front();
        }
        self.truths.push_back(*truth);
        self.compare();
    }

    /// Truths come at instants of samples: each meets the estimate of its own time, or none.
    fn compare(&mut self) {
        let Some(newest) = self.estimates.back().map(Message::t_valid) else { return };
        while let Some(truth) = self.truths.pop_front_if(|truth| truth.t_valid() <= newest) {
            while self.estimates.pop_front_if(|estimate| estimate.t_valid() < truth.t_valid()).is_some() {}
            if let Some(estimate) = self.estimates.front().filter(|estimate| estimate.t_valid() == truth.t_valid()) {
                for (error, variance) in error_enu(estimate, &truth).into_iter().zip(variances(estimate)) {
                    let deviation = error.abs() / variance.sqrt();
                    // Not a number is worse than any.
                    let deviation = if deviation.is_nan() { f64::INFINITY } else { deviation };
                    self.figures.worst = self.figures.worst.max(deviation);
                    self.figures.outside += u64::from(deviation > 3.0);
                    self.figures.compared += 1;
                }
            }
        }
    }
}

fn is_finite(estimate: &NavEstimate) -> bool {
    let e = estimate;
    let vectors = [&e.position_enu[..], &e.velocity_enu, &e.q_enu_body, &e.accel_bias, &e.gyro_bias, &e.lat_lon_h];
    let covariances = [&e.position_cov[..], &e.velocity_cov, &e.attitude_cov, &e.sigma_rpy];
    vectors.iter().chain(&covariances).all(|numbers| numbers.iter().all(|number| number.is_finite()))
}

/// Of east, north, up.
fn variances(estimate: &NavEstimate) -> [f64; 3] {
    [0, 3, 5].map(|at| estimate.position_cov[at])
}

/// How far the second lies from where the velocities lead from the first, in sigmas of the axis where that is most. After a long gap
/// the sigmas of the velocities count: they lead there only so well.
fn step(first: &NavEstimate, second: &NavEstimate) -> f64 {
    let dt = (second.t_valid() - first.t_valid()).as_seconds();
    let (before, after) = (variances(first), variances(second));
    let of_way = |axis: usize| {
        let at = [0, 3, 5][axis];
        0.25 * dt * dt * (first.velocity_cov[at] + second.velocity_cov[at])
    };
    let of_axis = |axis: usize| {
        let way = 0.5 * (first.velocity_enu[axis] + second.velocity_enu[axis]) * dt;
        let step = second.position_enu[axis] - first.position_enu[axis] - way;
        // Where the sigma grows with the step (a gap is over), the estimate has said so.
        step.abs() / (before[axis].max(after[axis]) + of_way(axis)).sqrt()
    };
    (0..3).map(of_axis).fold(0.0, f64::max)
}

/// Estimate minus truth along east, north, up, m, on the radii of curvature of WGS-84 at the truth: to a millionth for errors
/// of some metres.
fn error_enu(estimate: &NavEstimate, truth: &Truth) -> [f64; 3] {
    const EQUATOR: f64 = 6_378_137.0;
    const ECCENTRICITY_SQUARED: f64 = 6.694_379_990_141_317e-3;
    let latitude = truth.lat_deg.to_radians();
    let w_squared = 1.0 - ECCENTRICITY_SQUARED * latitude.sin().powi(2);
    let east_radius = EQUATOR / w_squared.sqrt();
    let north_radius = east_radius * (1.0 - ECCENTRICITY_SQUARED) / w_squared;
    let [lat_deg, lon_deg, height] = estimate.lat_lon_h;
    [
        (lon_deg - truth.lon_deg).to_radians() * (east_radius + truth.height) * latitude.cos(),
        (lat_deg - truth.lat_deg).to_radians() * (north_radius + truth.height),
        height - truth.height,
    ]
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use shared_types::{Header, Time};

    /// At 5 ms a number, moving east at 1 m/s with sigmas of 0.1 m.
    pub(crate) fn estimate(number: i64) -> NavEstimate {
        let t = number * 5_000_000;
        NavEstimate {
            header: Header { t_published: t, ..Header::at(Time(t)) },
            solution: 1,
            t_keyframe: 0,
            position_enu: [t as f64 * 1e-9, 0.0, 0.0],
            velocity_enu: [1.0, 0.0, 0.0],
            q_enu_body: [1.0, 0.0, 0.0, 0.0],
            accel_bias: [0.0; 3],
            gyro_bias: [0.0; 3],
            position_cov: [0.01, 0.0, 0.0, 0.01, 0.0, 0.01],
            velocity_cov: [0.0; 6],
            attitude_cov: [0.0; 6],
            sigma_rpy: [0.0; 3],
            lat_lon_h: [36.0, 127.0, 0.0],
            aiding_age: [0.0; 5],
            mode: Mode::Ok as u32,
            reserved: 0,
        }
    }

    #[test]
    fn a_gap_is_told_from_a_silence_and_a_step_from_a_way() {
        let mut observer = Observer::default();
        for number in [0, 1, 2] {
            observer.estimate(&estimate(number));
        }
        let smooth = observer.take();
        assert_eq!((smooth.estimates, smooth.gap, smooth.silence), (3, 5_000_000, 5_000_000));
        assert!(smooth.step < 1e-9, "{smooth:?}");
        // The IMU is silent: what is held is no gap in silence, but one in samples.
        let mut held = estimate(6);
        held.mode = Mode::Invalid as u32;
        held.position_enu = estimate(2).position_enu;
        observer.estimate(&held);
        let mut jumped = estimate(12);
        jumped.position_enu[1] = -0.25;
        observer.estimate(&jumped);
        let found = observer.take();
        assert_eq!((found.gap, found.silence), (50_000_000, 30_000_000));
        assert!((found.step - 2.5).abs() < 1e-9, "{found:?}");
    }

    #[test]
    fn a_truth_meets_the_estimate_of_its_time_whichever_comes_first() {
        let mut observer = Observer::default();
        let truth = |number: i64, height: f64| Truth {
            header: estimate(number).header,
            lat_deg: 36.0,
            lon_deg: 127.0,
            height,
            q_enu_body: [1.0, 0.0, 0.0, 0.0],
            velocity_enu: [0.0; 3],
        };
        observer.truth(&truth(2, 0.2));
        (0..5).for_each(|number| observer.estimate(&estimate(number)));
        observer.truth(&truth(4, -0.4));
        let found = observer.take();
        assert_eq!((found.compared, found.outside), (6, 1));
        assert!((found.worst - 4.0).abs() < 1e-9, "{found:?}");
        let north = Truth { lat_deg: 36.0 - 1e-5, ..truth(0, 0.0) };
        // A hundred-thousandth of a degree of the meridian at 36 deg, 110 959 m/deg.
        assert!((error_enu(&estimate(0), &north)[1] - 1.1096).abs() < 1e-3);
    }

    #[test]
    fn a_number_that_is_none_is_counted() {
        let mut observer = Observer::default();
        let mut spoilt = estimate(0);
        spoilt.velocity_cov[4] = f64::NAN;
        observer.estimate(&spoilt);
        assert_eq!(observer.take().not_finite, 1);
    }
}
