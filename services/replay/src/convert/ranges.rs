//! Four buoys around a track, and the ranges that they would give.
//!
//! As the paper simulated them: from the positions of a receiver, in a quality that follows that of its fix. The buoys stand 150 m
//! outside the corners of the track, at different heights, so that ranges tell of up, too.

use nalgebra::Vector3;
use nav_geometry::{Geodetic, LocalFrame};
use rand::RngExt;
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use shared_types::{BuoyFix, Header, LblRange, Time};

/// Outside the corners of the track, m.
const MARGIN: f64 = 150.0;
/// Above its lowest point, m.
const HEIGHTS: [f64; 4] = [30.0, 60.0, 20.0, 80.0];

/// 1-sigma of a range where the position is good, m; the paper's.
pub(super) const RANGE_SIGMA: f64 = 0.3;

/// Where the transducer was, and how well that is known.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ping {
    pub(super) t: Time,
    pub(super) transducer: Geodetic,
    /// 1-sigma of its ranges, m.
    pub(super) sigma: f64,
    /// Share of its ranges that are lost.
    pub(super) lost: f64,
}

/// Normal and uniform numbers of one seed.
pub(super) struct Noise(Pcg64);

impl Noise {
    /// `stream` keeps those of one purpose apart from those of another.
    pub(super) fn new(seed: u64, stream: u64) -> Noise {
        Noise(Pcg64::new(u128::from(seed), u128::from(stream)))
    }

    pub(super) fn normal(&mut self, sigma: f64) -> f64 {
        let unit: f64 = self.0.sample(StandardNormal);
        sigma * unit
    }

    fn uniform(&mut self) -> f64 {
        self.0.random()
    }
}

/// Buoys around the pings, and their ranges. `pings` is in order of time and not empty.
pub(super) fn simulate(pings: &[Ping], frame: &LocalFrame, seed: u64) -> (Vec<BuoyFix>, Vec<LblRange>) {
    let mut noise = Noise::new(seed, 1);
    let points: Vec<Vector3<f64>> = pings.iter().map(|ping| frame.to_enu(&ping.transducer)).collect();
    let low = points.iter().fold(Vector3::repeat(f64::INFINITY), |low, point| low.inf(point));
    let high = points.iter().fold(Vector3::repeat(f64::NEG_INFINITY), |high, point| high.sup(point));
    let (west, south) = (low.x - MARGIN, low.y - MARGIN);
    let (east, north) = (high.x + MARGIN, high.y + MARGIN);
    let corners = [[west, south], [east, south], [east, north], [west, north]];
    let buoys: Vec<Vector3<f64>> =
        corners.iter().zip(HEIGHTS).map(|([x, y], height)| Vector3::new(*x, *y, low.z + height)).collect();
    let begin = pings.first().map_or(Time(0), |ping| ping.t);
    let fixes = (1..).zip(&buoys).map(|(buoy, position_enu)| {
        let [lat_deg, lon_deg, height] = frame.to_geodetic(position_enu).to_degrees();
        BuoyFix { header: Header::at(begin), buoy, moored: 1, lat_deg, lon_deg, height }
    });
    let mut ranges = Vec::new();
    for (ping, transducer) in pings.iter().zip(&points) {
        for (buoy, position_enu) in (1..).zip(&buoys) {
            // Drawn whether or not the range is lost: one lost range changes no other.
            let (error, chance) = (noise.normal(ping.sigma), noise.uniform());
            if chance >= ping.lost {
                let range = (position_enu - transducer).norm() + error;
                ranges.push(LblRange { header: Header::at(ping.t), buoy, in_epoch: 0, range });
            }
        }
    }
    (fixes.collect(), ranges)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_scatter_as_their_fix_says_and_are_lost_in_their_share() {
        let origin = Geodetic::from_degrees(36.38, 127.36, 20.0);
        let frame = LocalFrame::new(origin);
        let ping = |second: i64, sigma: f64, lost: f64| Ping {
            t: Time(second * 1_000_000_000),
            transducer: frame.to_geodetic(&Vector3::new(second as f64, 0.0, 0.0)),
            sigma,
            lost,
        };
        let pings: Vec<Ping> =
            (0..4000).map(|s| if s < 2000 { ping(s, 0.3, 0.0) } else { ping(s, 3.0, 0.5) }).collect();
        let (buoys, ranges) = simulate(&pings, &frame, 7);
        let error = |range: &LblRange| {
            let fix = &buoys[range.buoy as usize - 1];
            let buoy = frame.to_enu(&Geodetic::from_degrees(fix.lat_deg, fix.lon_deg, fix.height));
            let at = Vector3::new(Time(range.header.t_valid).as_seconds(), 0.0, 0.0);
            range.range - (buoy - at).norm()
        };
        let scatter = |ranges: &[&LblRange]| {
            (ranges.iter().map(|range| error(range).powi(2)).sum::<f64>() / ranges.len() as f64).sqrt()
        };
        let (good, poor): (Vec<&LblRange>, Vec<&LblRange>) =
            ranges.iter().partition(|range| range.header.t_valid < 2_000_000_000_000);
        assert_eq!(good.len(), 8000);
        // Standard error of a scatter is 1/√(2·8000) = 0.8 % of it, of a share of half √(0.25/8000) = 0.6 %.
        assert!((scatter(&good) / 0.3 - 1.0).abs() < 0.03, "{}", scatter(&good));
        assert!((scatter(&poor) / 3.0 - 1.0).abs() < 0.04, "{}", scatter(&poor));
        assert!((poor.len() as f64 / 8000.0 - 0.5).abs() < 0.02, "{}", poor.len());
        assert_eq!(simulate(&pings, &frame, 7).1, ranges, "of one seed");
    }
}
