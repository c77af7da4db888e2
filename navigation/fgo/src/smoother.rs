//! The trajectory given the whole log: the estimate of the past with what came after (§4 of the method, window = log).
//!
//! The readings pass through the estimator as ever, which ties and gates them; its window just never forgets. At the end the
//! window is solved as one batch. Between keyframes the trajectory runs along the IMU samples:
//!
//! ```text
//! x(t) = transport(x_k, t_k→t) ⊞ s·d,   d = x_{k+1} ⊟ transport(x_k, t_k→t_{k+1}),   s = (t − t_k)/(t_{k+1} − t_k)
//! C(t) = (1 − s) C_k + s C_{k+1}        attitude in the axes of the vehicle at t
//! ```
//!
//! d is what the IMU factor leaves over, millimetres at most, so its share along the way matters less still; what the
//! samples of one interval add to C between its ends is below a millimetre. After the last keyframe there is no d, and C grows.

use nalgebra::Matrix3;
use nav_models::preintegration::Preintegration;
use nav_models::state::{ATTITUDE, NavState, POSITION, VELOCITY};
use nav_models::transport::{transport, transport_jacobians};
use nav_models::world::WorldModel;
use shared_types::{AIDING, Config, Duration, Header, Mode, NavEstimate, Sensor, Time};

use crate::batch::BatchReport;
use crate::interval::{ImuHistory, ImuModel, TimedPoint};
use crate::kernels::{Block, BlockVector};
use crate::rows::DIM;
use crate::window::Window;

/// A keyframe given the whole log.
#[derive(Clone, Debug)]
pub struct SmoothedKeyframe {
    /// Data time.
    pub t: Time,
    /// Its state.
    pub state: NavState,
    /// Of the 15 error coordinates.
    pub covariance: Block<DIM>,
}

/// The trajectory given the whole log.
#[derive(Clone, Debug)]
pub struct Smoothed {
    /// Oldest first.
    pub keyframes: Vec<SmoothedKeyframe>,
    /// How it was found: the sum over the pieces.
    pub report: BatchReport,
    /// How many keyframes there are up to the end of each piece: nothing is known of how one goes over into the next.
    pub ends: Vec<usize>,
    /// Data times of the measurements used, by [`AIDING`] sensor, in order.
    used: [Vec<Time>; AIDING.len()],
}

impl Smoothed {
    /// Solves each window, in order of time, as one batch. `None` where there is no keyframe, or the information does not
    /// determine the states.
    pub(crate) fn of<'a>(
        windows: impl Iterator<Item = &'a mut Window>,
        history: &ImuHistory,
        imu: &ImuModel,
        max_passes: u32,
    ) -> Option<Smoothed> {
        let report = BatchReport { converged: true, ..BatchReport::default() };
        let mut smoothed = Smoothed { keyframes: Vec::new(), report, ends: Vec::new(), used: Default::default() };
        for window in windows.filter(|window| !window.nodes().is_empty()) {
            smoothed.add(window, history, imu, max_passes)?;
        }
        smoothed.used.iter_mut().for_each(|times| times.sort_unstable());
        (!smoothed.keyframes.is_empty()).then_some(smoothed)
    }

    fn add(&mut self, window: &mut Window, history: &ImuHistory, imu: &ImuModel, max_passes: u32) -> Option<()> {
        let BatchReport { passes, converged, cost } = window.solve_batch(max_passes, history, imu);
        self.report.passes += passes;
        self.report.converged &= converged;
        (0..2).for_each(|side| self.report.cost[side] += cost[side]);
        let covariances = window.covariances()?;
        for factor in window.nodes().iter().flat_map(|node| node.factors.iter().chain(node.between.factors())) {
            if let Some(at) = AIDING.iter().position(|&aiding| aiding == factor.sensor()) {
                self.used[at].push(factor.t);
            }
        }
        let nodes = window.nodes().iter().zip(covariances);
        self.keyframes.extend(nodes.map(|(node, covariance)| SmoothedKeyframe {
            t: node.t,
            state: node.state,
            covariance,
        }));
        self.ends.push(self.keyframes.len());
        Some(())
    }

    /// Shows the estimate at every IMU sample from the first keyframe on.
    pub(crate) fn along(
        &self,
        world: &WorldModel,
        config: &Config,
        history: &ImuHistory,
        imu: &ImuModel,
        mut show: impl FnMut(&NavEstimate),
    ) {
        let mut teller = Teller { world, config, sequence: 0 };
        let mut ages = Ages { used: &self.used, passed: [0; AIDING.len()] };
        for (index, keyframe) in self.keyframes.iter().enumerate() {
            let Some(point) = history.at(keyframe.t) else { continue };
            let next = self.keyframes.get(index + 1);
            let t_end = next.map_or(Time::MAX, |next| next.t);
            let next = next.filter(|_| !self.ends.contains(&(index + 1)));
            let start = TimedPoint { t: keyframe.t, point };
            let mut stretch = Stretch::new(keyframe, next, start, history, imu, world);
            // A sample at a keyframe belongs to it; `between` leaves both ends out.
            if history.is_sample(keyframe.t) {
                let place = stretch.at(keyframe.t, world);
                show(&teller.tell(index as u64 + 1, keyframe.t, keyframe.t, &place, ages.at(keyframe.t)));
            }
            for sample in history.between(keyframe.t, t_end) {
                stretch.advance(sample, imu);
                let place = stretch.at(sample.t, world);
                show(&teller.tell(index as u64 + 1, keyframe.t, sample.t, &place, ages.at(sample.t)));
            }
        }
    }
}

/// The oldest keyframe of `window` given everything in it: what was known of it a window ago, and what came since. `None` where
/// the last solve found no solution.
pub(crate) fn oldest(window: &Window, config: &Config, solution: u64) -> Option<NavEstimate> {
    let (state, covariance) = window.oldest_given_all()?;
    let t = window.nodes().front()?.t;
    let mut ages = [f64::INFINITY; AIDING.len()];
    for factor in window.nodes().iter().flat_map(|node| node.factors.iter().chain(node.between.factors())) {
        let age = &mut ages[factor.place()];
        *age = age.min((factor.t - t).as_seconds().abs());
    }
    let block = |at: usize| covariance.fixed_view::<3, 3>(at, at).into_owned();
    let place = Place { state, position: block(POSITION), velocity: block(VELOCITY), attitude: block(ATTITUDE) };
    let newest = window.nodes().back()?.t;
    Some(Teller { world: window.world(), config, sequence: solution }.tell(solution, newest, t, &place, ages))
}

/// Where the vehicle is, and how sure that is.
struct Place {
    state: NavState,
    position: Matrix3<f64>,
    velocity: Matrix3<f64>,
    /// Body axes.
    attitude: Matrix3<f64>,
}

/// From one keyframe towards the next.
struct Stretch<'a> {
    from: &'a SmoothedKeyframe,
    next: Option<(&'a SmoothedKeyframe, BlockVector<DIM>)>,
    last: TimedPoint,
    increment: Preintegration,
}

impl<'a> Stretch<'a> {
    fn new(
        from: &'a SmoothedKeyframe,
        next: Option<&'a SmoothedKeyframe>,
        start: TimedPoint,
        history: &ImuHistory,
        imu: &ImuModel,
        world: &WorldModel,
    ) -> Stretch<'a> {
        let (accel_bias, gyro_bias) = (from.state.accel_bias, from.state.gyro_bias);
        let next = next.and_then(|next| {
            let whole = history.integrate(from.t, next.t, &accel_bias, &gyro_bias, imu)?;
            Some((next, next.state.local(&transport(&from.state, &whole, world))))
        });
        Stretch { from, next, last: start, increment: Preintegration::new(accel_bias, gyro_bias) }
    }

    fn advance(&mut self, sample: &TimedPoint, imu: &ImuModel) {
        let dt = (sample.t - self.last.t).as_seconds();
        if self.next.is_some() {
            self.increment.step_mean(dt, &self.last.point, &sample.point);
        } else {
            let inflation = imu.inflation(sample.t - self.last.t);
            self.increment.step(&imu.noise, dt, &self.last.point, &sample.point, inflation);
        }
        self.last = *sample;
    }

    fn at(&self, t: Time, world: &WorldModel) -> Place {
        let carried = transport(&self.from.state, &self.increment, world);
        let Some((next, left_over)) = &self.next else { return self.beyond_the_last(carried, world) };
        let share = (t - self.from.t).as_seconds() / (next.t - self.from.t).as_seconds();
        let state = carried.retract(&(left_over * share));
        let blend = |near: Matrix3<f64>, far: Matrix3<f64>| near * (1.0 - share) + far * share;
        let block =
            |keyframe: &SmoothedKeyframe, at: usize| keyframe.covariance.fixed_view::<3, 3>(at, at).into_owned();
        let attitude = |keyframe: &SmoothedKeyframe| {
            let turn = state.r_enu_body().transpose() * keyframe.state.r_enu_body();
            turn * block(keyframe, ATTITUDE) * turn.transpose()
        };
        Place {
            position: blend(block(self.from, POSITION), block(next, POSITION)),
            velocity: blend(block(self.from, VELOCITY), block(next, VELOCITY)),
            attitude: blend(attitude(self.from), attitude(next)),
            state,
        }
    }

    fn beyond_the_last(&self, state: NavState, world: &WorldModel) -> Place {
        let jacobians = transport_jacobians(&self.from.state, &self.increment, world);
        let covariance = jacobians.state * self.from.covariance * jacobians.state.transpose()
            + jacobians.increment * self.increment.increment_covariance() * jacobians.increment.transpose();
        let block = |at: usize| covariance.fixed_view::<3, 3>(at, at).into_owned();
        Place { state, position: block(POSITION), velocity: block(VELOCITY), attitude: block(ATTITUDE) }
    }
}

/// Puts places into messages.
struct Teller<'a> {
    world: &'a WorldModel,
    config: &'a Config,
    sequence: u64,
}

/// How near the measurements are, by [`AIDING`] sensor.
struct Ages<'a> {
    used: &'a [Vec<Time>; AIDING.len()],
    /// Measurements not later than the last place.
    passed: [usize; AIDING.len()],
}

impl Teller<'_> {
    fn tell(
        &mut self,
        solution: u64,
        t_keyframe: Time,
        t: Time,
        place: &Place,
        aiding_age: [f64; AIDING.len()],
    ) -> NavEstimate {
        self.sequence += 1;
        let up_body = place.state.r_enu_body().row(2).transpose();
        let about_up = up_body.dot(&(place.attitude * up_body));
        NavEstimate {
            header: Header { sequence: self.sequence, ..Header::at(t) },
            solution,
            t_keyframe: t_keyframe.0,
            position_enu: place.state.position_enu.into(),
            velocity_enu: place.state.velocity_enu.into(),
            q_enu_body: place.state.quaternion_wxyz(),
            accel_bias: place.state.accel_bias.into(),
            gyro_bias: place.state.gyro_bias.into(),
            position_cov: upper_triangle(&place.position),
            velocity_cov: upper_triangle(&place.velocity),
            attitude_cov: upper_triangle(&place.attitude),
            sigma_rpy: [place.attitude[(0, 0)], place.attitude[(1, 1)], about_up].map(|v| v.max(0.0).sqrt()),
            lat_lon_h: self.world.frame.to_geodetic(&place.state.position_enu).to_degrees(),
            aiding_age,
            mode: self.mode(&place.position, &aiding_age) as u32,
            reserved: 0,
        }
    }

    /// As the propagator judges, by the nearest measurement in place of the last.
    fn mode(&self, position: &Matrix3<f64>, aiding_age: &[f64; AIDING.len()]) -> Mode {
        let limits = &self.config.navigator.propagator;
        let age = |sensor: Sensor| {
            AIDING.iter().position(|&aiding| aiding == sensor).map_or(f64::INFINITY, |at| aiding_age[at])
        };
        let is_near = |sensor: Sensor, limit: Duration| age(sensor) <= limit.as_seconds();
        let variance = position[(0, 0)].max(position[(1, 1)]);
        // A variance that is no number is not within the limit either.
        let is_within = variance <= limits.max_position_sigma * limits.max_position_sigma;
        if !is_within {
            return Mode::Invalid;
        }
        if ![Sensor::Lbl, Sensor::Gnss].into_iter().any(|sensor| is_near(sensor, limits.position_timeout)) {
            return Mode::DeadReckoning;
        }
        let is_missing = |sensor: Sensor| age(sensor).is_finite() && !is_near(sensor, limits.aiding_timeout);
        if [Sensor::Dvl, Sensor::Mcp, Sensor::Ps].into_iter().any(is_missing) { Mode::Degraded } else { Mode::Ok }
    }
}

impl Ages<'_> {
    /// To the nearest measurement used, before or after, s: a smoother is aided from both sides.
    fn at(&mut self, t: Time) -> [f64; AIDING.len()] {
        core::array::from_fn(|sensor| {
            let (times, passed) = (&self.used[sensor], &mut self.passed[sensor]);
            while times.get(*passed).is_some_and(|&used| used <= t) {
                *passed += 1;
            }
            let before = passed.checked_sub(1).map(|last| (t - times[last]).as_seconds());
            let after = times.get(*passed).map(|&next| (next - t).as_seconds());
            before.unwrap_or(f64::INFINITY).min(after.unwrap_or(f64::INFINITY))
        })
    }
}

/// ee, en, eu, nn, nu, uu.
fn upper_triangle(m: &Matrix3<f64>) -> [f64; 6] {
    [m[(0, 0)], m[(0, 1)], m[(0, 2)], m[(1, 1)], m[(1, 2)], m[(2, 2)]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_age_is_that_of_the_nearest_measurement_on_either_side() {
        let mut used: [Vec<Time>; AIDING.len()] = Default::default();
        used[0] = vec![Time::from_seconds(10.0), Time::from_seconds(20.0)];
        let mut ages = Ages { used: &used, passed: [0; AIDING.len()] };
        for (t, expected) in [(4.0, 6.0), (10.0, 0.0), (13.0, 3.0), (18.0, 2.0), (25.0, 5.0)] {
            let ages = ages.at(Time::from_seconds(t));
            assert!((ages[0] - expected).abs() < 1e-9, "{t}: {ages:?}");
            assert!(ages[1].is_infinite());
        }
    }
}
