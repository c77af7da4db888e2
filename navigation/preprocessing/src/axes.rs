//! Have an IMU's axes changed places?
//!
//! An instrument whose axes are exchanged or turned round by its driver, or by a connector, goes on within its range and shakes
//! as before (F5). Where gravity moves to another axis that is a leap (`leaps.rs`); where it does not, the numbers step by less
//! than a vehicle can. What betrays it is the step itself: much longer than this instrument's steps usually are, and undone, in
//! specific force and rate at once, by putting the axes back. No motion does that by chance: three numbers of each must agree.
//!
//! Such samples are refused until a step fits that turns the axes back, or, as with leaps, until they have insisted for as long
//! as the others had been believed.

use core::array;

use shared_types::{Duration, ImuSample, Time};

use crate::leaps::LONGEST;

/// Steps after which it is known how long they usually are.
const BEGINNING: u32 = 1000;
/// Weight of one step in the mean of their lengths.
const MEMORY: f64 = 2e-3;
/// So many usual lengths are learnt of a step at the most: a knock is none of them, a vehicle that begins to shake is.
const LEARNT: f64 = 5.0;
/// Squared length of a step, in usual ones, specific force and rate together, that no usual motion makes; what each of them makes of
/// it at the least, in usual lengths; and what squared length may be left when the axes are put back. Of normal noise alone that is
/// 12 once in ten thousand samples. The logs of three ROVs, a rover and a car hold no such step, nor one of which four times as
/// much is left; an exchange of axes makes one at nine of ten instants of a swaying vehicle's way.
const UNUSUAL: f64 = 100.0;
const EACH: f64 = 2.5;
const USUAL: f64 = 12.0;
/// The same squared length for the way back, which is expected.
const BACK: f64 = 40.0;

/// The axis that each axis was, and its sign.
type Turn = [(usize, f64); 3];

/// Two axes exchanged, one or two or all turned round: each undoes itself.
const TURNS: [Turn; 10] = [
    [(1, 1.0), (0, 1.0), (2, 1.0)],
    [(0, 1.0), (2, 1.0), (1, 1.0)],
    [(2, 1.0), (1, 1.0), (0, 1.0)],
    [(0, -1.0), (1, 1.0), (2, 1.0)],
    [(0, 1.0), (1, -1.0), (2, 1.0)],
    [(0, 1.0), (1, 1.0), (2, -1.0)],
    [(0, -1.0), (1, -1.0), (2, 1.0)],
    [(0, -1.0), (1, 1.0), (2, -1.0)],
    [(0, 1.0), (1, -1.0), (2, -1.0)],
    [(0, -1.0), (1, -1.0), (2, -1.0)],
];

/// Specific force and rate of a sample.
type Numbers = [[f64; 3]; 2];

/// The sample before, how long steps usually are, and which turn is in force.
#[derive(Clone, Debug)]
pub(crate) struct Axes {
    /// Samples further apart than this are not compared.
    gap: Duration,
    last: Option<(Time, Numbers)>,
    /// Mean length of a step that was one, m/s² and rad/s.
    usual: [f64; 2],
    seen: u32,
    turn: Option<&'static Turn>,
    believed: u32,
    refused: u32,
}

impl Axes {
    /// Nothing heard yet.
    pub(crate) fn new(gap: Duration) -> Axes {
        Axes { gap, last: None, usual: [0.0; 2], seen: 0, turn: None, believed: 0, refused: 0 }
    }

    /// Takes the sample at `t` in, later than its predecessors: whether its axes have changed places.
    pub(crate) fn have_changed(&mut self, t: Time, sample: &ImuSample) -> bool {
        let now = [sample.accel_body, sample.gyro_body];
        if let Some((t_last, last)) = self.last.replace((t, now))
            && t - t_last <= self.gap
        {
            let step = [0, 1].map(|triad| distance(&now[triad], &last[triad]));
            if self.seen >= BEGINNING {
                self.look_for_a_turn(step, &now, &last);
            }
            self.learn(step);
        }
        if self.turn.is_none() {
            self.believed = self.believed.saturating_add(1);
            return false;
        }
        self.refused += 1;
        if self.refused <= self.believed.min(LONGEST) {
            return true;
        }
        (self.turn, self.believed, self.refused) = (None, self.refused, 0);
        false
    }

    fn look_for_a_turn(&mut self, step: [f64; 2], now: &Numbers, last: &Numbers) {
        let squared = self.squared(step);
        if squared <= if self.turn.is_some() { BACK } else { UNUSUAL } {
            return;
        }
        let undoes =
            |turn: &Turn| self.squared([0, 1].map(|triad| distance(&turned(&now[triad], turn), &last[triad]))) < USUAL;
        match self.turn {
            None if step.iter().zip(&self.usual).all(|(length, usual)| *length >= EACH * usual) => {
                self.turn = TURNS.iter().find(|turn| undoes(turn));
            }
            Some(turn) if undoes(turn) => (self.turn, self.refused) = (None, 0),
            _ => {}
        }
    }

    /// Squared lengths in usual ones.
    fn squared(&self, step: [f64; 2]) -> f64 {
        step.iter().zip(&self.usual).map(|(length, usual)| (length / usual).powi(2)).sum()
    }

    fn learn(&mut self, step: [f64; 2]) {
        // A slow instrument behind a fast driver repeats its samples: those are no steps.
        if step[0] <= 0.0 || step[1] <= 0.0 {
            return;
        }
        self.seen = self.seen.saturating_add(1);
        let weight = MEMORY.max(1.0 / f64::from(self.seen));
        let most = if self.seen < BEGINNING { f64::INFINITY } else { LEARNT };
        for (usual, length) in self.usual.iter_mut().zip(step) {
            *usual += weight * (length.min(most * *usual) - *usual);
        }
    }
}

fn turned(triad: &[f64; 3], turn: &Turn) -> [f64; 3] {
    array::from_fn(|axis| turn[axis].1 * triad[turn[axis].0])
}

fn distance(one: &[f64; 3], other: &[f64; 3]) -> f64 {
    one.iter().zip(other).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::imu;

    const GAP: Duration = Duration(20_000_000);

    /// A vehicle that sways, with noise, at 200 Hz.
    fn swaying(step: i32) -> ImuSample {
        let t = 0.005 * f64::from(step);
        let noise = |of: i32| 1e-3 * f64::from((step * 7919 + of * 104_729).rem_euclid(101) - 50);
        let accel_body = [0.3 * t.sin() + noise(0), 1.0 + 0.2 * (1.7 * t).cos() + noise(1), 9.8 + noise(2)];
        let gyro_body = [
            0.05 * (2.0 * t).cos() + 0.02 * noise(3),
            0.03 * (1.3 * t).sin() + 0.02 * noise(4),
            0.06 + 0.02 * noise(5),
        ];
        ImuSample { gyro_body, accel_body, ..imu(t) }
    }

    fn with(sample: &ImuSample, turn: &Turn) -> ImuSample {
        ImuSample {
            accel_body: turned(&sample.accel_body, turn),
            gyro_body: turned(&sample.gyro_body, turn),
            ..*sample
        }
    }

    fn ask(axes: &mut Axes, sample: &ImuSample) -> bool {
        axes.have_changed(Time(sample.header.t_valid), sample)
    }

    #[test]
    fn axes_that_change_places_are_known_at_the_first_sample_and_until_they_change_back() {
        for turn in &TURNS {
            let mut axes = Axes::new(GAP);
            assert!((0..4000).all(|step| !ask(&mut axes, &swaying(step))));
            let believed = (4000..5000).find(|&step| !ask(&mut axes, &with(&swaying(step), turn)));
            assert_eq!(believed, None, "{turn:?}");
            let refused = (5000..6000).find(|&step| ask(&mut axes, &swaying(step)));
            assert_eq!(refused, None, "{turn:?}");
        }
    }

    #[test]
    fn a_knock_is_no_change_of_axes() {
        let mut axes = Axes::new(GAP);
        for step in 0..4000 {
            let mut sample = swaying(step);
            if step % 50 == 49 {
                sample.accel_body[step as usize % 3] += 2.0;
                sample.gyro_body[1] -= 0.3;
            }
            if step % 50 == 24 {
                sample.gyro_body[0] = -sample.gyro_body[0];
            }
            assert!(!ask(&mut axes, &sample), "{step}");
        }
    }

    #[test]
    fn axes_that_stay_where_they_went_are_believed_when_they_have_been_there_for_longer() {
        let mut axes = Axes::new(GAP);
        assert!((0..2000).all(|step| !ask(&mut axes, &swaying(step))));
        assert!((2000..4000).all(|step| ask(&mut axes, &with(&swaying(step), &TURNS[0]))));
        assert!((4000..5000).all(|step| !ask(&mut axes, &with(&swaying(step), &TURNS[0]))));
    }

    #[test]
    fn before_it_is_known_what_is_usual_nothing_is_said() {
        let mut axes = Axes::new(GAP);
        assert!((0..500).all(|step| !ask(&mut axes, &swaying(step))));
        assert!((500..900).all(|step| !ask(&mut axes, &with(&swaying(step), &TURNS[0]))));
    }
}
