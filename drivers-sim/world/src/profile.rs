//! One quantity over time (a speed, a heading, a pitch): a constant, smooth ramps of its value or of its rate, and waves.
//!
//! ```text
//! S(u) = 35u⁴ − 84u⁵ + 70u⁶ − 20u⁷,  u = (t − start)/length in [0, 1]      S = 0 before, 1 after
//! step:  amount · S                        rate:  amount · length · ∫S du
//! ```
//!
//! S has three vanishing derivatives at both ends, so a profile is three times continuously differentiable.

use crate::jet::Jet;

/// What a ramp changes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum RampOf {
    /// The value, by `amount`.
    Value,
    /// The rate, by `amount` per second; the value goes on changing after the ramp.
    Rate,
}

/// A smooth change between `start` and `start + length`, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Ramp {
    pub(crate) start: f64,
    pub(crate) length: f64,
    pub(crate) amount: f64,
    pub(crate) of: RampOf,
}

impl Ramp {
    /// The change that it has brought at `t`.
    fn at(&self, t: f64) -> Jet {
        let since = t - self.start;
        if since <= 0.0 {
            return Jet::default();
        }
        let (amount, length) = (self.amount, self.length);
        if since >= length {
            return match self.of {
                RampOf::Value => Jet::constant(amount),
                RampOf::Rate => Jet([amount * (since - 0.5 * length), amount, 0.0, 0.0]),
            };
        }
        let u = since / length;
        let v = 1.0 - u;
        let cubed = u * u * u;
        let s = cubed * u * (35.0 + u * (-84.0 + u * (70.0 - 20.0 * u)));
        let s1 = 140.0 * cubed * v * v * v / length;
        let s2 = 420.0 * u * u * v * v * (v - u) / (length * length);
        match self.of {
            RampOf::Value => {
                let s3 = 840.0 * u * v * (1.0 - 5.0 * u * v) / (length * length * length);
                Jet([amount * s, amount * s1, amount * s2, amount * s3])
            }
            RampOf::Rate => {
                let integral = length * cubed * u * u * (7.0 + u * (-14.0 + u * (10.0 - 2.5 * u)));
                Jet([amount * integral, amount * s, amount * s1, amount * s2])
            }
        }
    }
}

/// Sum of ramps.
pub(crate) fn ramps_at(ramps: &[Ramp], t: f64) -> Jet {
    ramps.iter().fold(Jet::default(), |sum, ramp| sum + ramp.at(t))
}

/// `amplitude · sin(2π t/period + phase)` under an envelope of ramps.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Wave {
    pub(crate) amplitude: f64,
    pub(crate) period: f64,
    pub(crate) phase: f64,
    pub(crate) envelope: Vec<Ramp>,
}

impl Wave {
    fn at(&self, t: f64) -> Jet {
        let envelope = ramps_at(&self.envelope, t);
        if envelope == Jet::default() {
            return envelope;
        }
        let omega = std::f64::consts::TAU / self.period;
        let (sine, _) = Jet([omega * t + self.phase, omega, 0.0, 0.0]).sin_cos();
        envelope * sine.scaled(self.amplitude)
    }
}

/// One quantity over time.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Profile {
    pub(crate) base: f64,
    pub(crate) ramps: Vec<Ramp>,
    pub(crate) waves: Vec<Wave>,
}

impl Profile {
    /// A constant.
    pub(crate) fn constant(base: f64) -> Profile {
        Profile { base, ..Profile::default() }
    }

    /// Its value and derivatives at `t`, s.
    pub(crate) fn at(&self, t: f64) -> Jet {
        let smooth = Jet::constant(self.base) + ramps_at(&self.ramps, t);
        self.waves.iter().fold(smooth, |sum, wave| sum + wave.at(t))
    }

    /// The value goes by `amount` from `start` to `end`.
    pub(crate) fn step(&mut self, start: f64, end: f64, amount: f64) {
        self.ramps.push(Ramp { start, length: end - start, amount, of: RampOf::Value });
    }

    /// The value rises to `amount` above what it was, holds, and is back at `end`; each flank takes `flank` seconds.
    pub(crate) fn plateau(&mut self, start: f64, end: f64, flank: f64, amount: f64) {
        self.ramps.extend(plateau(start, end, flank, amount));
    }

    /// The rate rises to `rate`, holds, and is back at `end`; each flank takes `flank` seconds.
    pub(crate) fn turn(&mut self, start: f64, end: f64, flank: f64, rate: f64) {
        self.ramps.extend(plateau(start, end, flank, rate).map(|ramp| Ramp { of: RampOf::Rate, ..ramp }));
    }
}

/// Up by `amount` at `start`, down at `end`.
pub(crate) fn plateau(start: f64, end: f64, flank: f64, amount: f64) -> [Ramp; 2] {
    let up = Ramp { start, length: flank, amount, of: RampOf::Value };
    [up, Ramp { start: end - flank, amount: -amount, ..up }]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn busy_profile() -> Profile {
        let mut profile = Profile::constant(0.4);
        profile.step(1.0, 3.0, 2.0);
        profile.turn(2.0, 9.0, 1.5, -0.3);
        profile.plateau(4.0, 8.0, 1.0, 0.7);
        profile.waves.push(Wave {
            amplitude: 0.2,
            period: 3.0,
            phase: 0.5,
            envelope: plateau(2.5, 8.5, 2.0, 1.0).into(),
        });
        profile
    }

    #[test]
    fn derivatives_agree_with_central_differences_everywhere() {
        let profile = busy_profile();
        // step²/6 times a fifth derivative of some 1e4.
        let step = 1e-5;
        for tick in 0..1000 {
            let t = f64::from(tick) * 0.01 + 0.003;
            let (before, here, after) = (profile.at(t - step), profile.at(t), profile.at(t + step));
            for order in 1..4 {
                let difference = (after.0[order - 1] - before.0[order - 1]) / (2.0 * step);
                assert!(
                    (difference - here.0[order]).abs() < 1e-6,
                    "order {order} at {t}: {difference} {}",
                    here.0[order]
                );
            }
        }
    }

    #[test]
    fn the_third_derivative_has_no_jump_where_a_ramp_begins_or_ends() {
        let profile = busy_profile();
        for knot in [1.0, 2.0, 3.0, 3.5, 4.0, 5.0, 7.0, 7.5, 8.0, 9.0] {
            let (before, after) = (profile.at(knot - 1e-9), profile.at(knot + 1e-9));
            for order in 0..4 {
                assert!((before.0[order] - after.0[order]).abs() < 1e-5, "order {order} at {knot}");
            }
        }
    }

    #[test]
    fn a_turn_comes_to_rate_times_the_time_between_the_middles_of_its_flanks() {
        let mut heading = Profile::constant(1.0);
        heading.turn(10.0, 30.0, 4.0, 0.1);
        let [value, rate, ..] = heading.at(100.0).0;
        assert!((value - (1.0 + 0.1 * 16.0)).abs() < 1e-13, "{value}");
        assert_eq!(rate, 0.0);
    }
}
