//! An IMU at its rails, shaken, or wired wrongly.

use shared_types::RawReading;

use crate::draws::Draws;
use crate::effect::{Effect, Fate, Moment, Passing};

/// Every axis at full scale, with the sign that it has: rad/s and m/s².
#[derive(Debug)]
pub(crate) struct Rail {
    pub(crate) rate: f64,
    pub(crate) accel: f64,
}

impl Effect for Rail {
    fn apply(&mut self, _at: &Moment, passing: &mut Passing, _draws: &mut Draws) -> Fate {
        let RawReading::Imu(sample) = &mut passing.reading else { return Fate::Untouched };
        sample.gyro_body = sample.gyro_body.map(|axis| self.rate.copysign(axis));
        sample.accel_body = sample.accel_body.map(|axis| self.accel.copysign(axis));
        Fate::Touched
    }
}

/// Knocks: a share of the samples with the specific force off by half to one and a half `accel`, m/s², on every axis.
#[derive(Debug)]
pub(crate) struct Shock {
    pub(crate) share: f64,
    pub(crate) accel: f64,
}

impl Effect for Shock {
    fn apply(&mut self, _at: &Moment, passing: &mut Passing, draws: &mut Draws) -> Fate {
        let is_hit = draws.happens(self.share);
        if let (RawReading::Imu(sample), true) = (&mut passing.reading, is_hit) {
            sample.accel_body.iter_mut().for_each(|axis| *axis += draws.spike(self.accel));
        }
        Fate::touched_if(is_hit)
    }
}

/// Wired wrongly: axes x and y swapped, or z turned round.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Wiring {
    Swapped,
    Negated,
}

impl Effect for Wiring {
    fn apply(&mut self, _at: &Moment, passing: &mut Passing, _draws: &mut Draws) -> Fate {
        let RawReading::Imu(sample) = &mut passing.reading else { return Fate::Untouched };
        for triad in [&mut sample.gyro_body, &mut sample.accel_body] {
            match self {
                Wiring::Swapped => triad.swap(0, 1),
                Wiring::Negated => triad[2] = -triad[2],
            }
        }
        Fate::Touched
    }
}
