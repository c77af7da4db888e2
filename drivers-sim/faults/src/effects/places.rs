//! Wrong places: satellite fixes and buoys that are metres off, and fixes that lie about how good they are.

use nalgebra::Vector3;
use nav_geometry::{Geodetic, LocalFrame};
use shared_types::{GnssFix, RawReading, Time};

use crate::draws::Draws;
use crate::effect::{Effect, Fate, Moment, Passing};

/// Moves a place by east, north, up, m; what is not finite stays.
fn shift(lat_deg: &mut f64, lon_deg: &mut f64, height: &mut f64, by_enu: Vector3<f64>) {
    let known = if height.is_finite() { *height } else { 0.0 };
    if !(lat_deg.is_finite() && lon_deg.is_finite()) {
        return;
    }
    let frame = LocalFrame::new(Geodetic::from_degrees(*lat_deg, *lon_deg, known));
    let [lat, lon, up] = frame.to_geodetic(&by_enu).to_degrees();
    (*lat_deg, *lon_deg) = (lat, lon);
    if height.is_finite() {
        *height = up;
    }
}

fn shift_fix(fix: &mut GnssFix, by_enu: Vector3<f64>) {
    shift(&mut fix.lat_deg, &mut fix.lon_deg, &mut fix.height, by_enu);
}

/// Along a course clockwise from north, deg.
fn along(course_deg: f64, metres: f64) -> Vector3<f64> {
    let (sin, cos) = course_deg.to_radians().sin_cos();
    Vector3::new(metres * sin, metres * cos, 0.0)
}

/// All fixes elsewhere, by metres that grow with time: a jump (multipath at the surface, a spoofer) or a drag.
#[derive(Debug)]
pub(crate) struct Displaced {
    pub(crate) metres: f64,
    pub(crate) speed: f64,
    pub(crate) course_deg: f64,
}

impl Effect for Displaced {
    fn apply(&mut self, at: &Moment, passing: &mut Passing, _draws: &mut Draws) -> Fate {
        let RawReading::Gnss(fix) = &mut passing.reading else { return Fate::Untouched };
        shift_fix(fix, along(self.course_deg, self.metres + self.speed * at.since));
        Fate::Touched
    }
}

/// A share of the fixes off by half to one and a half `size` east, north and up.
#[derive(Debug)]
pub(crate) struct FixSpikes {
    pub(crate) share: f64,
    pub(crate) size: f64,
}

impl Effect for FixSpikes {
    fn apply(&mut self, _at: &Moment, passing: &mut Passing, draws: &mut Draws) -> Fate {
        let is_hit = draws.happens(self.share);
        if let (RawReading::Gnss(fix), true) = (&mut passing.reading, is_hit) {
            let size = self.size;
            shift_fix(fix, Vector3::from_fn(|_, _| draws.spike(size)));
        }
        Fate::touched_if(is_hit)
    }
}

/// A receiver that has just seen the sky again: its first fixes are off by `size`, and settle with `decay`, s.
#[derive(Debug)]
pub(crate) struct PoorFirst {
    pub(crate) size: f64,
    pub(crate) decay: f64,
    pub(crate) last: Option<Time>,
    /// When the sky came back, and the error then.
    pub(crate) began: Option<(Time, Vector3<f64>)>,
}

impl PoorFirst {
    /// s: a longer silence was a dive.
    const SILENCE: f64 = 5.0;
}

impl Effect for PoorFirst {
    fn apply(&mut self, at: &Moment, passing: &mut Passing, draws: &mut Draws) -> Fate {
        let RawReading::Gnss(fix) = &mut passing.reading else { return Fate::Untouched };
        let is_back = self.last.is_none_or(|last| (at.t - last).as_seconds() > PoorFirst::SILENCE);
        self.last = Some(at.t);
        if is_back {
            let size = self.size;
            self.began = Some((at.t, Vector3::from_fn(|_, _| draws.spike(size))));
        }
        let Some((began, error_enu)) = self.began else { return Fate::Untouched };
        shift_fix(fix, error_enu * (-(at.t - began).as_seconds() / self.decay).exp());
        Fate::Touched
    }

    fn outside(&mut self, reading: &RawReading) {
        self.last = Some(reading.t_valid());
        self.began = None;
    }
}

/// Every fix claims this sigma: zero, negative, NaN, absurd.
#[derive(Debug)]
pub(crate) struct Sigma {
    pub(crate) sigma: f64,
}

impl Effect for Sigma {
    fn apply(&mut self, _at: &Moment, passing: &mut Passing, _draws: &mut Draws) -> Fate {
        let RawReading::Gnss(fix) = &mut passing.reading else { return Fate::Untouched };
        fix.sigma_enu = [self.sigma; 3];
        Fate::Touched
    }
}

/// A buoy (0: every one) that is not where it says: mis-surveyed, or with a wrong fix.
#[derive(Debug)]
pub(crate) struct MovedBuoy {
    pub(crate) metres: f64,
    pub(crate) course_deg: f64,
    pub(crate) buoy: u32,
}

impl Effect for MovedBuoy {
    fn apply(&mut self, _at: &Moment, passing: &mut Passing, _draws: &mut Draws) -> Fate {
        match &mut passing.reading {
            RawReading::Buoy(fix) if self.buoy == 0 || fix.buoy == self.buoy => {
                let by_enu = along(self.course_deg, self.metres);
                shift(&mut fix.lat_deg, &mut fix.lon_deg, &mut fix.height, by_enu);
                Fate::Touched
            }
            _ => Fate::Untouched,
        }
    }
}
