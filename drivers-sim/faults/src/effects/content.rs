//! Wrong numbers of any sensor: holes, nonsense, freezing, offsets, scale, spikes, noise, rails.
//!
//! The numbers of a reading are what it measures, in its own order and unit; a satellite fix's and a buoy's are latitude,
//! longitude and height, whose metre-sized faults stand in `places.rs`.

use shared_types::{Header, Message, RawReading};

use crate::draws::Draws;
use crate::effect::{Effect, Fate, Moment, Passing};

pub(crate) fn header_mut(reading: &mut RawReading) -> &mut Header {
    match reading {
        RawReading::Imu(r) => r.header_mut(),
        RawReading::Buoy(r) => r.header_mut(),
        RawReading::Gnss(r) => r.header_mut(),
        RawReading::Dvl(r) => r.header_mut(),
        RawReading::Mcp(r) => r.header_mut(),
        RawReading::Ps(r) => r.header_mut(),
        RawReading::Lbl(r) => r.header_mut(),
    }
}

/// Shows every measured number to `change`.
pub(crate) fn each_number(reading: &mut RawReading, mut change: impl FnMut(usize, &mut f64)) {
    let mut all = |numbers: &mut dyn Iterator<Item = &mut f64>| {
        numbers.enumerate().for_each(|(index, number)| change(index, number));
    };
    match reading {
        RawReading::Imu(r) => all(&mut r.gyro_body.iter_mut().chain(&mut r.accel_body)),
        RawReading::Buoy(r) => all(&mut [&mut r.lat_deg, &mut r.lon_deg, &mut r.height].into_iter()),
        RawReading::Gnss(r) => all(&mut [&mut r.lat_deg, &mut r.lon_deg, &mut r.height].into_iter()),
        RawReading::Dvl(r) => all(&mut r.velocity_dvl.iter_mut()),
        RawReading::Mcp(r) => all(&mut std::iter::once(&mut r.heading_deg)),
        RawReading::Ps(r) => all(&mut std::iter::once(&mut r.depth)),
        RawReading::Lbl(r) => all(&mut std::iter::once(&mut r.range)),
    }
}

/// A compass reports a heading of its circle whatever happens to it.
pub(crate) fn wrap_heading(reading: &mut RawReading) {
    if let RawReading::Mcp(heading) = reading {
        heading.heading_deg = heading.heading_deg.rem_euclid(360.0);
    }
}

/// A share of the readings has one number replaced by `value`: NaN, infinity, or what no instrument says.
#[derive(Debug)]
pub(crate) struct Nonsense {
    pub(crate) share: f64,
    pub(crate) value: f64,
}

impl Effect for Nonsense {
    fn apply(&mut self, _at: &Moment, passing: &mut Passing, draws: &mut Draws) -> Fate {
        let (is_hit, place) = (draws.happens(self.share), draws.uniform());
        if is_hit {
            let mut count = 0;
            each_number(&mut passing.reading, |_, _| count += 1);
            let victim = (place * f64::from(count)) as usize;
            each_number(&mut passing.reading, |index, number| {
                if index == victim {
                    *number = self.value;
                }
            });
        }
        Fate::touched_if(is_hit)
    }
}

/// The instrument repeats its last numbers under running stamps; an acoustic receiver, those of each beacon.
#[derive(Debug, Default)]
pub(crate) struct Stuck {
    /// By number of the beacon or buoy, 0 for sensors that have none.
    last: Vec<(u32, RawReading)>,
}

impl Stuck {
    fn key(reading: &RawReading) -> u32 {
        match reading {
            RawReading::Lbl(range) => range.buoy,
            RawReading::Buoy(fix) => fix.buoy,
            _ => 0,
        }
    }
}

impl Effect for Stuck {
    fn apply(&mut self, _at: &Moment, passing: &mut Passing, _draws: &mut Draws) -> Fate {
        let key = Stuck::key(&passing.reading);
        match self.last.iter().find(|(known, _)| *known == key) {
            Some((_, frozen)) => {
                let header = *header_mut(&mut passing.reading);
                passing.reading = *frozen;
                *header_mut(&mut passing.reading) = header;
                Fate::Touched
            }
            None => {
                self.last.push((key, passing.reading));
                Fate::Untouched
            }
        }
    }

    fn outside(&mut self, reading: &RawReading) {
        let key = Stuck::key(reading);
        self.last.retain(|(known, _)| *known != key);
        self.last.push((key, *reading));
    }
}

/// Something added to every number: `offsets[index] + rates[index] · t`.
#[derive(Debug)]
pub(crate) struct Added {
    pub(crate) offsets: Vec<f64>,
    pub(crate) rates: Vec<f64>,
}

impl Added {
    pub(crate) fn offset(offsets: &[f64]) -> Added {
        Added { offsets: offsets.to_vec(), rates: Vec::new() }
    }

    pub(crate) fn ramp(rates: &[f64]) -> Added {
        Added { offsets: Vec::new(), rates: rates.to_vec() }
    }
}

impl Effect for Added {
    fn apply(&mut self, at: &Moment, passing: &mut Passing, _draws: &mut Draws) -> Fate {
        let of = |values: &[f64], index: usize| values.get(index).copied().unwrap_or(0.0);
        each_number(&mut passing.reading, |index, number| {
            *number += of(&self.offsets, index) + of(&self.rates, index) * at.since;
        });
        wrap_heading(&mut passing.reading);
        Fate::Touched
    }
}

/// Every number too large by a factor: a wrong speed of sound.
#[derive(Debug)]
pub(crate) struct Scale {
    pub(crate) factor: f64,
}

impl Effect for Scale {
    fn apply(&mut self, _at: &Moment, passing: &mut Passing, _draws: &mut Draws) -> Fate {
        each_number(&mut passing.reading, |_, number| *number *= self.factor);
        Fate::Touched
    }
}

/// A share of the readings with every number off by half to one and a half `size`, of either sign.
#[derive(Debug)]
pub(crate) struct Spikes {
    pub(crate) share: f64,
    pub(crate) size: f64,
}

impl Effect for Spikes {
    fn apply(&mut self, _at: &Moment, passing: &mut Passing, draws: &mut Draws) -> Fate {
        let is_hit = draws.happens(self.share);
        if is_hit {
            each_number(&mut passing.reading, |_, number| *number += draws.spike(self.size));
            wrap_heading(&mut passing.reading);
        }
        Fate::touched_if(is_hit)
    }
}

/// More noise than the sensor is said to have.
#[derive(Debug)]
pub(crate) struct Noise {
    pub(crate) sigma: f64,
}

impl Effect for Noise {
    fn apply(&mut self, _at: &Moment, passing: &mut Passing, draws: &mut Draws) -> Fate {
        each_number(&mut passing.reading, |_, number| *number += draws.normal(self.sigma));
        wrap_heading(&mut passing.reading);
        Fate::Touched
    }
}

/// No number beyond its limit: an instrument at its rails.
#[derive(Debug)]
pub(crate) struct Saturate {
    /// By index; the last one holds for the rest.
    pub(crate) limits: Vec<f64>,
}

impl Effect for Saturate {
    fn apply(&mut self, _at: &Moment, passing: &mut Passing, _draws: &mut Draws) -> Fate {
        let mut is_clipped = false;
        each_number(&mut passing.reading, |index, number| {
            let limit = self.limits[index.min(self.limits.len() - 1)];
            is_clipped |= number.abs() > limit;
            *number = number.clamp(-limit, limit);
        });
        Fate::touched_if(is_clipped)
    }
}
