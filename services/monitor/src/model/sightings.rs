//! Ranges and fixes as the instruments said them, and what the keyframes made of them.

use std::collections::{BTreeMap, VecDeque};

use nalgebra::Vector3;
use nav_geometry::{Geodetic, LocalFrame};
use shared_types::{BuoyFix, Duration, GnssFix, KeyframeReport, LblRange, Message, Sensor, Time};

use super::keyframes::refusal;
use crate::detail::{Fate, Fix, Ring};

/// Fixes that wait for their fate, at most.
const WAITING: usize = 64;

/// A fix that no keyframe has named after this was not used; keyframes come once a second without ranges.
const PATIENCE: Duration = Duration(5_000_000_000);

/// A factor may bear its reading's time less the stamp's offset.
const SAME_READING: Duration = Duration(300_000_000);

/// Ranges of one epoch, at most.
const EPOCH: usize = 64;

/// Follows ranges and fixes.
#[derive(Clone, Debug, Default)]
pub(super) struct Sightings {
    fixes: VecDeque<(GnssFix, Fate)>,
    /// The newest epoch.
    ranges: Vec<(LblRange, Fate)>,
}

impl Sightings {
    /// Takes in a fix.
    pub(super) fn gnss(&mut self, fix: &GnssFix) {
        if self.fixes.len() == WAITING {
            self.fixes.pop_front();
        }
        self.fixes.push_back((*fix, Fate::Unknown));
    }

    /// Takes in a range; the first of an epoch ends the one before.
    pub(super) fn lbl(&mut self, range: &LblRange) {
        if self.ranges.first().is_some_and(|(first, _)| first.header.t_valid != range.header.t_valid) {
            self.ranges.clear();
        }
        if self.ranges.len() < EPOCH {
            self.ranges.push((*range, Fate::Unknown));
        }
    }

    /// Takes in what a keyframe made of them.
    pub(super) fn report(&mut self, report: &KeyframeReport) {
        for factor in &report.factors[..report.factors.len().min(report.factor_count as usize)] {
            let is_near = |t: i64| (Time(t) - Time(factor.t_valid)).0.abs() < SAME_READING.0;
            let fate = refusal(factor.refused).map_or(Fate::Used, Fate::Refused);
            match Sensor::from_index(factor.sensor) {
                Some(Sensor::Lbl) => {
                    let mut ranges = self.ranges.iter_mut();
                    let named = |range: &LblRange| range.buoy == factor.buoy && is_near(range.header.t_valid);
                    if let Some((_, of_range)) = ranges.find(|(range, _)| named(range)) {
                        *of_range = fate;
                    }
                }
                Some(Sensor::Gnss) => {
                    let distance = |fix: &GnssFix| (fix.header.t_valid - factor.t_valid).abs();
                    let waiting = self.fixes.iter_mut().filter(|(fix, _)| is_near(fix.header.t_valid));
                    if let Some((_, of_fix)) = waiting.min_by_key(|(fix, _)| distance(fix)) {
                        *of_fix = fate;
                    }
                }
                _ => {}
            }
        }
    }

    /// The fixes whose fate is known, and those that waited too long for it.
    pub(super) fn settle(&mut self, now: Option<Time>, frame: &LocalFrame, settled: &mut Vec<Fix>) {
        while let Some((fix, fate)) = self.fixes.front() {
            let is_old = now.is_some_and(|now| now - fix.t_valid() > PATIENCE);
            if *fate == Fate::Unknown && !is_old {
                return;
            }
            let height = if fix.height.is_finite() { fix.height } else { frame.origin().to_degrees()[2] };
            let position_enu = frame.to_enu(&Geodetic::from_degrees(fix.lat_deg, fix.lon_deg, height));
            if position_enu.iter().all(|x| x.is_finite()) {
                settled.push(Fix { t: fix.t_valid().as_seconds(), position_enu: position_enu.into(), fate: *fate });
            }
            self.fixes.pop_front();
        }
    }

    /// The newest epoch as circles at the height `up` (m).
    pub(super) fn rings(&self, frame: &LocalFrame, buoys: &BTreeMap<u32, BuoyFix>, up: f64) -> Vec<Ring> {
        let ring = |(range, fate): &(LblRange, Fate)| {
            let buoy_enu = buoy_enu(frame, buoys.get(&range.buoy)?)?;
            let below = buoy_enu.z - up;
            let radius = (range.range * range.range - below * below).max(0.0).sqrt();
            radius.is_finite().then(|| Ring {
                buoy: range.buoy,
                t: range.t_valid().as_seconds(),
                range: range.range,
                buoy_enu: buoy_enu.into(),
                radius,
                fate: *fate,
            })
        };
        self.ranges.iter().filter_map(ring).collect()
    }
}

/// Where a buoy is, m; `None` when that is no place.
pub(super) fn buoy_enu(frame: &LocalFrame, fix: &BuoyFix) -> Option<Vector3<f64>> {
    let position_enu = frame.to_enu(&Geodetic::from_degrees(fix.lat_deg, fix.lon_deg, fix.height));
    position_enu.iter().all(|x| x.is_finite()).then_some(position_enu)
}

#[cfg(test)]
mod tests {
    use shared_types::{FactorReport, Header, RejectReason};

    use super::*;
    use crate::testing::{frame, report_at};

    fn fix_at(t: f64, east: f64) -> GnssFix {
        let [lat_deg, lon_deg, height] = frame().to_geodetic(&Vector3::new(east, 0.0, 0.0)).to_degrees();
        GnssFix { header: Header::at(Time::from_seconds(t)), lat_deg, lon_deg, height, sigma_enu: [2.0; 3] }
    }

    fn range(t: f64, buoy: u32, range: f64) -> LblRange {
        LblRange { header: Header::at(Time::from_seconds(t)), buoy, in_epoch: 2, range }
    }

    fn report(t: f64, sensor: Sensor, buoy: u32, refused: u32) -> KeyframeReport {
        let mut report = report_at(t);
        report.factors[0] = FactorReport {
            t_valid: Time::from_seconds(t).0,
            sensor: sensor as u32,
            rows: 1,
            buoy,
            refused,
            ..FactorReport::default()
        };
        report.factor_count = 1;
        report
    }

    #[test]
    fn a_fix_waits_for_its_keyframe_and_not_for_ever() {
        let mut sightings = Sightings::default();
        let mut settled = Vec::new();
        sightings.gnss(&fix_at(10.0, 3.0));
        sightings.gnss(&fix_at(11.0, 4.0));
        sightings.settle(Some(Time::from_seconds(11.5)), &frame(), &mut settled);
        assert!(settled.is_empty());
        sightings.report(&report(9.9, Sensor::Gnss, 0, 1 + RejectReason::Gated as u32));
        sightings.settle(Some(Time::from_seconds(12.0)), &frame(), &mut settled);
        assert_eq!((settled.len(), settled[0].fate), (1, Fate::Refused("gated")), "its stamp is 0.1 s late");
        assert!((settled[0].position_enu[0] - 3.0).abs() < 1e-6);
        sightings.settle(Some(Time::from_seconds(16.5)), &frame(), &mut settled);
        assert_eq!(settled[1].fate, Fate::Unknown, "nobody took it");
    }

    #[test]
    fn the_newest_epoch_stands_as_circles_around_its_buoys() {
        let mut buoys = BTreeMap::new();
        let [lat_deg, lon_deg, height] = frame().origin().to_degrees();
        for buoy in [1, 2] {
            buoys.insert(buoy, BuoyFix { header: Header::default(), buoy, moored: 1, lat_deg, lon_deg, height });
        }
        let mut sightings = Sightings::default();
        for (t, buoy, slant) in [(1.0, 1, 99.0), (2.0, 1, 50.0), (2.0, 2, 20.0), (2.0, 9, 20.0)] {
            sightings.lbl(&range(t, buoy, slant));
        }
        sightings.report(&report(2.0, Sensor::Lbl, 1, 0));
        let rings = sightings.rings(&frame(), &buoys, -30.0);
        assert_eq!(rings.len(), 2, "buoy 9 was never heard of");
        assert!((rings[0].radius - 40.0).abs() < 1e-6, "{:?}", rings[0]);
        assert_eq!((rings[0].fate, rings[1].fate), (Fate::Used, Fate::Unknown));
        assert!(rings[1].radius.abs() < 1e-6, "a range shorter than the depth meets no circle");
    }
}
