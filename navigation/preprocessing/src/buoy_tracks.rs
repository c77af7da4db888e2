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
//! `lbl.buoy_sigma`, and beside it the way that the buoy may have gone since it was carried on, at the speed v at which it has drifted:
//!
//! ```text
//! σ² = buoy_sigma² + (v · age)²    v over the newest ten seconds or more
//! ```
//!
//! A drifting buoy that says the same numbers again, to the bit, has not told where it is: its age goes on (F9).

use nalgebra::Vector3;
use nav_geometry::{Geodetic, LocalFrame};
use shared_types::{BuoyFix, Duration, RejectReason, Time};

/// A speed of drift is taken over so long: of fixes with noise, seconds apart, it says something.
const SPEED_OVER: Duration = Duration(10_000_000_000);
/// The same numbers so often in a row are those of a receiver that has frozen.
const FROZEN: u32 = 3;

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
    drift: Drift,
}

/// How a buoy drifts, and since when it has not.
#[derive(Clone, Copy, Debug, Default)]
struct Drift {
    /// Where the speed is taken from next.
    from: Option<Position>,
    /// m/s.
    speed: f64,
    /// Since when it says the same, and how often it has.
    same: Option<(Time, u32)>,
}

impl Drift {
    /// Takes in the next position after `last`; whether it is that of a receiver that has frozen.
    fn observe(&mut self, last: Option<&Position>, next: &Position) -> bool {
        if let Some(last) = last.filter(|last| last.geodetic == next.geodetic && self.speed > 0.0) {
            let (since, count) = self.same.unwrap_or((last.t, 1));
            self.same = Some((since, count.saturating_add(1)));
            return count + 1 >= FROZEN;
        }
        self.same = None;
        let from = *self.from.get_or_insert(*next);
        if next.t - from.t >= SPEED_OVER {
            // Within what a buoy drifts in seconds the Earth is flat.
            self.speed =
                LocalFrame::new(from.geodetic).to_enu(&next.geodetic).xy().norm() / (next.t - from.t).as_seconds();
            self.from = Some(*next);
        }
        false
    }

    /// How far it may have gone from where it is said to be at `t`, 1-sigma in m, if that was right until `t_told`.
    fn gone(&self, t_told: Time, t: Time) -> f64 {
        let t_told = self.same.map_or(t_told, |(since, _)| since.min(t_told));
        self.speed * (t - t_told).as_seconds().max(0.0)
    }
}

/// Where a buoy is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BuoyPlace {
    /// ENU, m.
    pub(crate) enu: Vector3<f64>,
    /// How far it may have drifted from there, 1-sigma in m.
    pub(crate) drifted: f64,
    /// It does not drift.
    pub(crate) is_moored: bool,
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
                if track.drift.observe(track.positions.last(), &position) {
                    // Between the first of the same and the next other one the buoy has gone the straight way.
                    let first = track.drift.same.map_or(position.t, |(since, _)| since);
                    track.positions.retain(|known| known.t <= first);
                    continue;
                }
                track.positions.push(position);
            }
        }
        for track in &mut tracks.tracks {
            track.moored = track.positions.len() == 1;
        }
        tracks
    }

    /// From now on drifting buoys are used up to this age.
    pub(crate) fn hold_for(&mut self, max_age: Duration) {
        self.max_age = max_age;
    }

    /// Takes a fix in.
    ///
    /// # Errors
    /// Why the fix does not count, or says nothing new: [`RejectReason::Stuck`] where a drifting buoy says the same again and again.
    pub(crate) fn insert(&mut self, fix: &BuoyFix) -> Result<(), RejectReason> {
        let position = judge(fix)?;
        let is_known = self.known;
        let track = self.track(fix.buoy).ok_or(RejectReason::TooMany)?;
        if is_known {
            // All that is missing from a track was passed over.
            let found = track.positions.binary_search_by_key(&position.t, |known| known.t);
            return found.map(|_| ()).map_err(|_| RejectReason::Stuck);
        }
        let slot = match track.positions.as_slice() {
            [.., last] if position.t == last.t => return Err(RejectReason::Duplicate),
            [.., last] if position.t > last.t => track.positions.len(),
            [first, _] if position.t <= first.t => return Err(RejectReason::BackwardsTime),
            [_, _] => 1,
            _ => 0,
        };
        // A drifting buoy keeps its newest two positions; a moored one its newest.
        track.moored = fix.moored != 0;
        let is_newest = slot == track.positions.len();
        let is_frozen = is_newest && !track.moored && track.drift.observe(track.positions.last(), &position);
        track.positions.insert(slot, position);
        let keep = if track.moored { 1 } else { 2 };
        while track.positions.len() > keep {
            track.positions.remove(0);
        }
        // It is not forgotten after `buoys.max_age`, as a silent one is: it may have run aground.
        if is_frozen { Err(RejectReason::Stuck) } else { Ok(()) }
    }

    /// Where a buoy is at `t`.
    ///
    /// # Errors
    /// [`RejectReason::UnknownBuoy`] without any fix, [`RejectReason::StaleBuoy`] where the nearest one is too old.
    pub(crate) fn at(&self, buoy: u32, t: Time, frame: &LocalFrame) -> Result<BuoyPlace, RejectReason> {
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
                Ok(BuoyPlace { enu: frame.to_enu(&first.geodetic), drifted: 0.0, is_moored: track.moored })
            } else {
                Err(RejectReason::StaleBuoy)
            };
        }
        if t >= last.t {
            if !is_fresh(t - last.t) {
                return Err(RejectReason::StaleBuoy);
            }
            let (enu, t_told) = match track.positions.as_slice() {
                [.., before, last] if !self.known => {
                    let t_held = last.t + (last.t - before.t);
                    (on_line(before, last, t.min(t_held), frame), t_held)
                }
                _ => (frame.to_enu(&last.geodetic), last.t),
            };
            let drifted = if track.moored { 0.0 } else { track.drift.gone(t_told, t) };
            return Ok(BuoyPlace { enu, drifted, is_moored: track.moored });
        }
        let after = track.positions.partition_point(|position| position.t <= t);
        let enu = on_line(&track.positions[after - 1], &track.positions[after], t, frame);
        Ok(BuoyPlace { enu, drifted: 0.0, is_moored: track.moored })
    }

    /// The track of that buoy, made if it is new; `None` when the table is full.
    fn track(&mut self, buoy: u32) -> Option<&mut Track> {
        let index = match self.tracks.binary_search_by_key(&buoy, |track| track.buoy) {
            Ok(index) => index,
            Err(_) if self.tracks.len() == BUOYS_MAX => return None,
            Err(index) => {
                self.tracks.insert(
                    index,
                    Track { buoy, moored: false, positions: Vec::with_capacity(3), drift: Drift::default() },
                );
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
        tracks.at(1, Time::from_seconds(t), &frame()).map(|place| (place.enu.y * 1e3).round() / 1e3)
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

    /// Northward at 0.2 m/s, a fix every 2 s until 20 s; and what comes after.
    fn adrift(then: &[BuoyFix]) -> Vec<BuoyFix> {
        let on_its_way = (0..=10).map(|index| drifting(2.0 * f64::from(index), 0.4 * f64::from(index)));
        on_its_way.chain(then.iter().copied()).collect()
    }

    /// To the millimetre.
    fn drifted_at(tracks: &BuoyTracks, t: f64) -> f64 {
        let place = tracks.at(1, Time::from_seconds(t), &frame()).unwrap();
        (place.drifted * 1e3).round() / 1e3
    }

    #[test]
    fn a_drifting_buoy_that_falls_silent_may_have_gone_on() {
        let tracks = live(&adrift(&[]));
        assert_eq!([drifted_at(&tracks, 21.0), drifted_at(&tracks, 22.0)], [0.0, 0.0], "carried on");
        assert_eq!([drifted_at(&tracks, 23.0), drifted_at(&tracks, 32.0)], [0.2, 2.0]);
        let known = BuoyTracks::with_known(MAX_AGE, adrift(&[]));
        assert_eq!([drifted_at(&known, 19.0), drifted_at(&known, 30.0)], [0.0, 2.0]);
    }

    #[test]
    fn a_drifting_buoy_that_says_the_same_again_has_not_told_where_it_is() {
        let mut tracks = live(&adrift(&[]));
        let again: Vec<_> = (11..60).map(|index| tracks.insert(&drifting(2.0 * f64::from(index), 4.0))).collect();
        assert_eq!(again[0], Ok(()));
        assert!(again[1..].iter().all(|told| *told == Err(RejectReason::Stuck)), "{again:?}");
        assert_eq!([drifted_at(&tracks, 119.0), drifted_at(&tracks, 120.0)], [19.8, 20.0]);
        tracks.insert(&drifting(122.0, 24.4)).unwrap();
        assert_eq!(drifted_at(&tracks, 123.0), 0.0);
    }

    #[test]
    fn a_buoy_that_never_moved_may_say_the_same_for_ever() {
        let mut tracks = live(&[drifting(0.0, 4.0)]);
        assert!((1..200).all(|t| tracks.insert(&drifting(f64::from(t), 4.0)).is_ok()));
        assert_eq!(drifted_at(&tracks, 220.0), 0.0);
    }

    #[test]
    fn in_a_known_track_a_frozen_receiver_is_passed_over() {
        let frozen: Vec<_> = (11..20).map(|index| drifting(2.0 * f64::from(index), 4.0)).collect();
        let mut rows = adrift(&frozen);
        rows.push(drifting(40.0, 8.0));
        let mut tracks = BuoyTracks::with_known(MAX_AGE, rows.clone());
        let counted: Vec<_> = rows.iter().filter(|row| tracks.insert(row) == Err(RejectReason::Stuck)).collect();
        assert_eq!(counted.len(), frozen.len());
        assert_eq!(
            [north_at(&tracks, 20.0), north_at(&tracks, 30.0), north_at(&tracks, 39.0)],
            [Ok(4.0), Ok(6.0), Ok(7.8)]
        );
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
