//! When ranges that come one by one agree with each other against the state.
//!
//! [`recovery`](crate::recovery) asks a whole epoch where the vehicle is. Transponders that are asked one after the other never make
//! one: each range has its own instant, and a state that is wrong refuses them one by one. So the newest range of every buoy is
//! kept for some seconds, with how far the vehicle has gone since, and all of them are asked together:
//!
//! ```text
//! ρᵢ = ‖p(t) + d + R l − (Bᵢ + o(t) − o(tᵢ))‖      o the way as predicted from keyframe to keyframe, corrections left out
//! ```
//!
//! Echoes do not agree on a place d; but of three ranges two echoes may. So most of them have to be refused, and where few are
//! redundant the next round, of other ranges altogether, has to agree on a place again.

use nalgebra::Vector3;
use shared_types::{Duration, Time, Vehicle};

use crate::innovation::is_range_probable;
use crate::recovery::{Loosening, Place, agreed};
use crate::sensors::LblModel;
use crate::state::NavState;

/// A range stands for so long.
const ROUND: Duration = Duration(15_000_000_000);
/// Of the way since a range so much may be wrong, for a heading that is not known any better.
const OF_THE_WAY: f64 = 0.05;
/// Buoys that are kept: what is heard of more says nothing new.
const BUOYS_MAX: usize = 32;
/// Redundant ranges that agree by no chance.
const REDUNDANCY_SURE: usize = 3;
/// A second round has to follow a first one within so long.
const NEXT_ROUND: Duration = Duration(60_000_000_000);

#[derive(Clone, Copy, Debug)]
struct Heard {
    t: Time,
    buoy: u32,
    model: LblModel,
    way: Vector3<f64>,
    was_refused: bool,
}

/// The newest range of every buoy.
#[derive(Clone, Debug)]
pub struct Rounds {
    heard: Vec<Heard>,
    t: Time,
    /// o(t).
    way: Vector3<f64>,
    velocity: Vector3<f64>,
    /// When they first agreed on another place than the state's.
    t_agreed: Option<Time>,
    /// Since when ranges are refused.
    since: Option<Time>,
}

impl Default for Rounds {
    fn default() -> Self {
        Rounds {
            heard: Vec::with_capacity(BUOYS_MAX),
            t: Time::MIN,
            way: Vector3::zeros(),
            velocity: Vector3::zeros(),
            t_agreed: None,
            since: None,
        }
    }
}

impl Rounds {
    /// Forgets what was heard of a state that is no more.
    pub fn forget(&mut self) {
        self.heard.clear();
        (self.since, self.t_agreed) = (None, None);
    }

    /// The keyframe at `t` is predicted `moved` from the one before it, m.
    pub fn advance(&mut self, t: Time, moved: &Vector3<f64>, predicted: &NavState) {
        self.way += moved;
        (self.t, self.velocity) = (t, predicted.velocity_enu);
        self.heard.retain(|heard| t - heard.t <= ROUND);
    }

    /// Takes in a range at `t`, near the newest keyframe, and by how many of its sigmas and the state's it is off.
    pub fn hear(&mut self, t: Time, buoy: u32, model: &LblModel, off: f64) {
        // The negation refuses what is no number.
        let was_refused = !is_range_probable(off);
        let way = self.way + self.velocity * (t - self.t).as_seconds();
        let heard = Heard { t, buoy, model: *model, way, was_refused };
        match self.heard.iter().position(|known| known.buoy == buoy) {
            Some(at) if self.heard[at].t <= t => self.heard[at] = heard,
            None if self.heard.len() < BUOYS_MAX => self.heard.push(heard),
            _ => {}
        }
        if was_refused {
            self.since = self.since.or(Some(t));
        } else if !self.is_against_the_state() {
            (self.since, self.t_agreed) = (None, None);
        }
    }

    fn is_against_the_state(&self) -> bool {
        let refused = self.heard.iter().filter(|heard| heard.was_refused).count();
        2 * refused > self.heard.len()
    }

    /// By how much to loosen the state `predicted` for the newest keyframe, if they agree on another place, and how far that is, m: one
    /// after the other they would lead the state there only if it were near.
    pub fn loosening(
        &mut self,
        predicted: &NavState,
        height_sigma: f64,
        vehicle: &Vehicle,
    ) -> Option<(Loosening, Vector3<f64>)> {
        let since = self.since.filter(|_| self.is_against_the_state())?;
        let ranges = self.heard.iter().map(|heard| {
            let gone = self.way - heard.way;
            let sigma = vehicle.lbl.sigma.hypot(heard.model.buoy_sigma).hypot(OF_THE_WAY * gone.norm());
            (LblModel { buoy_enu: heard.model.buoy_enu + gone, ..heard.model }, sigma)
        });
        let Place { shift, redundancy } = agreed(ranges, predicted, height_sigma, 0.0)?;
        self.heard.clear();
        let is_second = self.t_agreed.is_some_and(|first| self.t - first <= NEXT_ROUND);
        if redundancy < REDUNDANCY_SURE && !is_second {
            self.t_agreed = Some(self.t);
            return None;
        }
        self.forget();
        Some((Loosening::by(shift.xy().norm(), self.t - since), shift))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::Config;

    const BUOYS: [[f64; 3]; 6] = [
        [0.0, -500.0, 0.0],
        [-400.0, 0.0, 0.0],
        [-200.0, 1000.0, 0.0],
        [200.0, 500.0, 0.0],
        [600.0, -100.0, 0.0],
        [300.0, -600.0, 0.0],
    ];
    const VELOCITY: Vector3<f64> = Vector3::new(1.0, 0.5, 0.0);

    fn on_course(t: f64) -> Vector3<f64> {
        Vector3::new(20.0, 10.0, -30.0) + VELOCITY * t
    }

    /// A second a buoy from a vehicle that is `off` beside where its state has it, each range off by `error` of its second; every
    /// place that was told, and when.
    fn run(
        buoys: usize,
        seconds: usize,
        off: Vector3<f64>,
        error: impl Fn(usize) -> f64,
    ) -> Vec<(usize, Vector3<f64>)> {
        let vehicle = &Config::default().vehicle;
        let mut rounds = Rounds::default();
        let mut told = Vec::new();
        for second in 1..=seconds {
            let (t, mut state) = (second as f64, NavState::identity());
            (state.position_enu, state.velocity_enu) = (on_course(t), VELOCITY);
            rounds.advance(Time::from_seconds(t), &VELOCITY, &state);
            if let Some((loosening, shift)) = rounds.loosening(&state, 0.01, vehicle) {
                assert!((loosening.position - shift.xy().norm()).abs() < 1e-9);
                told.push((second, shift));
            }
            let number = second % buoys;
            let truth = state.position_enu + off;
            let range = (truth - Vector3::from(BUOYS[number])).norm() + error(second);
            let model = LblModel::new(range, BUOYS[number], 0.0, &vehicle.lbl);
            let innovation = (state.position_enu - model.buoy_enu).norm() - range;
            rounds.hear(Time::from_seconds(t), number as u32, &model, innovation / vehicle.lbl.sigma);
        }
        told
    }

    #[test]
    fn four_buoys_tell_another_place_in_their_second_round() {
        for off in [Vector3::new(40.0, -30.0, 0.0), Vector3::new(-900.0, 400.0, 0.0)] {
            let (second, shift) = run(4, 12, off, |_| 0.0)[0];
            assert!((shift - off).norm() < 1.0, "{shift} for {off}");
            assert!((6..=9).contains(&second), "after {second} s");
        }
    }

    #[test]
    fn six_buoys_need_no_second_round() {
        let off = Vector3::new(40.0, -30.0, 0.0);
        let (second, shift) = run(6, 12, off, |_| 0.0)[0];
        assert!((shift - off).norm() < 1.0 && second <= 7, "{shift} after {second} s");
    }

    #[test]
    fn a_state_that_is_right_and_echoes_tell_nothing() {
        assert_eq!(run(6, 60, Vector3::zeros(), |_| 0.0), []);
        let echoes = |second: usize| if second.is_multiple_of(3) { 20.0 + 7.0 * (second as f64).sin() } else { 0.0 };
        assert_eq!(run(4, 60, Vector3::zeros(), echoes), []);
    }

    #[test]
    fn two_buoys_tell_no_place() {
        assert_eq!(run(2, 60, Vector3::new(40.0, -30.0, 0.0), |_| 0.0), []);
    }
}
