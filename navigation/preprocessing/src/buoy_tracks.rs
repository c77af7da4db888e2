//! Where was the buoy at that instant?
//!
//! Two rules of §3.2, by what is known:
//!
//! ```text
//! live          the newest two fixes: between them B₁ + (B₂ − B₁)(t − t₁)/(t₂ − t₁); after the second carried on along the
//!               same line for one more step t₂ − t₁, then held; none used at an age beyond `buoys.max_age`
//! known tracks  all rows of a log beforehand: between two rows the line, before the first and after the last held, for
//!               ever where there is one row, for `buoys.max_age` where there are several
//! ```
//!
//! A moored buoy's position holds for ever in both. The line is carried on for one step only because two fixes 0.1 s
//! apart with 1 m of noise would otherwise throw the buoy 300 m off in 30 s. `buoys.csv` has no sigma: it is
//! `lbl.buoy_sigma` throughout. Left out: the growth of that sigma with the age of the fix.

use nalgebra::Vector3;
use nav_geometry::{Geodetic, LocalFrame};
use shared_types::{BuoyFix, Duration, RejectReason, Time};

/// Buoys that are followed: far beyond any array, so that corrupt numbers cannot grow the table without bound.
const BUOYS_MAX: usize = 256;

/// Heights that no buoy has, m: below the deepest trench, above any lake.
const HEIGHTS: std::ops::RangeInclusive<f64> = -12_000.0..=9_000.0;

/// One position of one buoy.
#[derive(Clone, Copy, Debug)]
struct Position {
    t: Time,
    geodetic: Geodetic,
}

/// What is known of one buoy, positions in order of time: the newest two, or all rows of a log.
#[derive(Clone, Debug)]
struct Track {
    buoy: u32,
    moored: bool,
    positions: Vec<Position>,
}

/// The positions of all buoys.
#[derive(Clone, Debug)]
pub(crate) struct BuoyTracks {
    max_age: Duration,
    known: bool,
    /// In order of the buoy's number.
    tracks: Vec<Track>,
}

impl BuoyTracks {
    /// No buoy is known yet; fixes will come one by one.
    pub(crate) fn new(max_age: Duration) -> BuoyTracks {
        BuoyTracks { max_age, known: false, tracks: Vec::with_capacity(BUOYS_MAX) }
    }

    /// Every row of a log beforehand. Impossible rows are left out; they are counted when they come as readings.
    pub(crate) fn with_known(max_age: Duration, mut fixes: Vec<BuoyFix>) -> BuoyTracks {
        let mut tracks = BuoyTracks { max_age, known: true, tracks: Vec::new() };
        fixes.sort_by_key(|fix| fix.header.t_valid);
        for fix in &fixes {
            let Ok(position) = judge(fix) else { continue };
            let Some(track) = tracks.track(fix.buoy) else { continue };
            // Of several rows with one time the first counts.
            if track.positions.last().is_none_or(|last| last.t < position.t) {
                track.positions.push(position);
            }
        }
        for track in &mut tracks.tracks {
            track.moored = track.positions.len() == 1;
        }
        tracks
    }

    /// Takes a fix in.
    ///
    /// # Errors
    /// Why the fix does not count.
    pub(crate) fn insert(&mut self, fix: &BuoyFix) -> Result<(), RejectReason> {
        let position = judge(fix)?;
        if self.known {
            return Ok(());
        }
        let track = self.track(fix.buoy).ok_or(RejectReason::TooMany)?;
        let slot = match track.positions.as_slice() {
            [.., last] if position.t == last.t => return Err(RejectReason::Duplicate),
            [.., last] if position.t > last.t => track.positions.len(),
            [first, _] if position.t <= first.t => return Err(RejectReason::BackwardsTime),
            [_, _] => 1,
            _ => 0,
        };
        // A drifting buoy keeps its newest two positions; a moored one its newest.
        track.moored = fix.moored != 0;
        track.positions.insert(slot, position);
        let keep = if track.moored { 1 } else { 2 };
        while track.positions.len() > keep {
            track.positions.remove(0);
        }
        Ok(())
    }

    /// Position of a buoy at `t`, ENU, m.
    ///
    /// # Errors
    /// [`RejectReason::UnknownBuoy`] without any fix, [`RejectReason::StaleBuoy`] where the nearest one is too old.
    pub(crate) fn at(&self, buoy: u32, t: Time, frame: &LocalFrame) -> Result<Vector3<f64>, RejectReason> {
        let found = self.tracks.binary_search_by_key(&buoy, |track| track.buoy);
        let track = &self.tracks[found.map_err(|_| RejectReason::UnknownBuoy)?];
        let (first, last) = match track.positions.as_slice() {
            [] => return Err(RejectReason::UnknownBuoy),
            [first, .., last] => (first, last),
            [only] => (only, only),
        };
        let is_fresh = |age: Duration| track.moored || age <= self.max_age;
        if t <= first.t {
            return if is_fresh(first.t - t) {
                Ok(frame.to_enu(&first.geodetic))
            } else {
                Err(RejectReason::StaleBuoy)
            };
        }
        if t >= last.t {
            if !is_fresh(t - last.t) {
                return Err(RejectReason::StaleBuoy);
            }
            return Ok(match track.positions.as_slice() {
                [.., before, last] if !self.known => {
                    let t_held = last.t + (last.t - before.t);
                    on_line(before, last, t.min(t_held), frame)
                }
                _ => frame.to_enu(&last.geodetic),
            });
        }
        let after = track.positions.partition_point(|position| position.t <= t);
        Ok(on_line(&track.positions[after - 1], &track.positions[after], t, frame))
    }

    /// The track of that buoy, made if it is new; `None` when the table is full.
    fn track(&mut self, buoy: u32) -> Option<&mut Track> {
        let index = match self.tracks.binary_search_by_key(&buoy, |track| track.buoy) {
            Ok(index) => index,
            Err(_) if self.tracks.len() == BUOYS_MAX => return None,
            Err(index) => {
                self.tracks.insert(index, Track { buoy, moored: false, positions: Vec::with_capacity(3) });
                index
            }
        };
        self.tracks.get_mut(index)
    }
}

fn judge(fix: &BuoyFix) -> Result<Position, RejectReason> {
    if ![fix.lat_deg, fix.lon_deg, fix.height].iter().all(|value| value.is_finite()) {
        return Err(RejectReason::NotFinite);
    }
    if fix.lat_deg.abs() > 90.0 || fix.lon_deg.abs() > 360.0 || !HEIGHTS.contains(&fix.height) {
        return Err(RejectReason::OutOfRange);
    }
    let geodetic = Geodetic::from_degrees(fix.lat_deg, fix.lon_deg, fix.height);
    Ok(Position { t: Time(fix.header.t_valid), geodetic })
}

/// The line through two positions, at `t`.
fn on_line(before: &Position, after: &Position, t: Time, frame: &LocalFrame) -> Vector3<f64> {
    let (before_enu, after_enu) = (frame.to_enu(&before.geodetic), frame.to_enu(&after.geodetic));
    let share = (t - before.t).as_seconds() / (after.t - before.t).as_seconds();
    before_enu + (after_enu - before_enu) * share
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test may fail where it stands")]
    use super::*;
    use crate::testing::buoy_fix;

    const MAX_AGE: Duration = Duration(30_000_000_000);

    fn frame() -> LocalFrame {
        LocalFrame::new(Geodetic::from_degrees(36.0, 127.0, 0.0))
    }

    /// A drifting fix of buoy 1 at `north` m from the origin.
    fn drifting(t: f64, north: f64) -> BuoyFix {
        let [lat_deg, lon_deg, height] = frame().to_geodetic(&Vector3::new(0.0, north, 0.0)).to_degrees();
        BuoyFix { lat_deg, lon_deg, height, moored: 0, ..buoy_fix(t, 1) }
    }

    /// To the millimetre.
    fn north_at(tracks: &BuoyTracks, t: f64) -> Result<f64, RejectReason> {
        tracks.at(1, Time::from_seconds(t), &frame()).map(|enu| (enu.y * 1e3).round() / 1e3)
    }

    fn live(fixes: &[BuoyFix]) -> BuoyTracks {
        let mut tracks = BuoyTracks::new(MAX_AGE);
        for fix in fixes {
            tracks.insert(fix).unwrap();
        }
        tracks
    }

    #[test]
    fn a_buoy_that_never_reported_is_unknown() {
        assert_eq!(north_at(&live(&[]), 0.0), Err(RejectReason::UnknownBuoy));
    }

    #[test]
    fn a_moored_buoy_holds_for_ever_before_and_after_its_fix() {
        let mut fix = drifting(1000.0, 5.0);
        fix.moored = 1;
        let tracks = live(&[fix]);
        assert_eq!([north_at(&tracks, 0.0), north_at(&tracks, 1.0e6)], [Ok(5.0), Ok(5.0)]);
    }

    #[test]
    fn a_drifting_buoy_is_carried_on_for_one_step_then_held_then_stale() {
        let tracks = live(&[drifting(10.0, 0.0), drifting(12.0, 3.0)]);
        assert_eq!(north_at(&tracks, 11.0), Ok(1.5));
        assert_eq!(north_at(&tracks, 13.0), Ok(4.5));
        assert_eq!(north_at(&tracks, 14.0), Ok(6.0));
        assert_eq!(north_at(&tracks, 40.0), Ok(6.0));
        assert_eq!(north_at(&tracks, 42.1), Err(RejectReason::StaleBuoy));
    }

    #[test]
    fn a_single_drifting_fix_ages() {
        let tracks = live(&[drifting(10.0, 2.0)]);
        assert_eq!(north_at(&tracks, 40.0), Ok(2.0));
        assert_eq!(north_at(&tracks, 40.1), Err(RejectReason::StaleBuoy));
        assert_eq!(north_at(&tracks, -20.1), Err(RejectReason::StaleBuoy));
    }

    #[test]
    fn the_newest_two_fixes_count_in_whatever_order_they_come() {
        let expected = live(&[drifting(12.0, 2.0), drifting(14.0, 6.0)]);
        let mut tracks = BuoyTracks::new(MAX_AGE);
        for fix in [drifting(10.0, 0.0), drifting(14.0, 6.0), drifting(12.0, 2.0)] {
            tracks.insert(&fix).unwrap();
        }
        for t in [12.0, 13.0, 15.0, 30.0] {
            assert_eq!(north_at(&tracks, t), north_at(&expected, t), "at {t}");
        }
        assert_eq!(tracks.insert(&drifting(11.0, 9.0)), Err(RejectReason::BackwardsTime));
        assert_eq!(tracks.insert(&drifting(14.0, 9.0)), Err(RejectReason::Duplicate));
    }

    #[test]
    fn known_tracks_are_interpolated_between_all_rows_and_held_at_their_ends() {
        let rows = vec![drifting(10.0, 0.0), drifting(20.0, 10.0), drifting(30.0, 0.0)];
        let tracks = BuoyTracks::with_known(MAX_AGE, rows);
        assert_eq!(north_at(&tracks, 12.5), Ok(2.5));
        assert_eq!(north_at(&tracks, 29.0), Ok(1.0));
        assert_eq!(north_at(&tracks, -20.0), Ok(0.0));
        assert_eq!(north_at(&tracks, 60.0), Ok(0.0));
        assert_eq!(north_at(&tracks, -20.1), Err(RejectReason::StaleBuoy));
        assert_eq!(north_at(&tracks, 60.1), Err(RejectReason::StaleBuoy));
    }

    #[test]
    fn a_known_track_of_one_row_is_a_moored_buoy() {
        let tracks = BuoyTracks::with_known(MAX_AGE, vec![drifting(10.0, 7.0)]);
        assert_eq!([north_at(&tracks, -1.0e5), north_at(&tracks, 1.0e5)], [Ok(7.0), Ok(7.0)]);
    }

    #[test]
    fn impossible_fixes_are_refused() {
        let mut tracks = BuoyTracks::new(MAX_AGE);
        let bad = |change: fn(&mut BuoyFix)| {
            let mut fix = drifting(1.0, 0.0);
            change(&mut fix);
            fix
        };
        assert_eq!(tracks.insert(&bad(|fix| fix.height = f64::NAN)), Err(RejectReason::NotFinite));
        assert_eq!(tracks.insert(&bad(|fix| fix.lat_deg = 90.5)), Err(RejectReason::OutOfRange));
        assert_eq!(tracks.insert(&bad(|fix| fix.height = 1.0e6)), Err(RejectReason::OutOfRange));
        for buoy in 0..BUOYS_MAX as u32 {
            tracks.insert(&BuoyFix { buoy: 10 + buoy, ..drifting(1.0, 0.0) }).unwrap();
        }
        assert_eq!(tracks.insert(&drifting(1.0, 0.0)), Err(RejectReason::TooMany));
    }
}
