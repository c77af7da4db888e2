//! The readings of the recent past in order of time, those taken in and those still to come.
//!
//! ```text
//! (t, sensor in the order gnss dvl mcp ps lbl, buoy)       t: valid time less the configured offset of the sensor's stamps
//! ```
//!
//! The order is that in which the preprocessor hands readings out when none is late, so that a late one, taken in by rolling
//! back, finds the place that it would have had.

use std::collections::VecDeque;

use shared_types::{AIDING, Measurement, Reading, RejectReason, Sensor, SensorCounts, Time};

/// Readings kept: some hundred a second over the longest horizon.
const READINGS_MAX: usize = 65_536;
/// Room made beforehand.
const READINGS_USUAL: usize = 2048;

/// A reading in its place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Entry {
    /// When it was valid.
    pub(crate) t: Time,
    /// As it came, but with its times put to `t`.
    pub(crate) measurement: Measurement,
    pub(crate) reading: Reading,
    pub(crate) sensor: Sensor,
    /// Place of the sensor in [`AIDING`].
    pub(crate) place: usize,
    /// What was decided; taken back when it is judged again.
    pub(crate) outcome: Option<Outcome>,
}

/// What became of a reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    Used,
    Refused(RejectReason),
}

impl Entry {
    /// `None` for what is no aiding sensor's reading.
    pub(crate) fn new(t: Time, measurement: &Measurement, reading: Reading) -> Option<Entry> {
        let sensor = measurement.sensor()?;
        let place = AIDING.iter().position(|&aiding| aiding == sensor)?;
        let mut measurement = *measurement;
        (measurement.header.t_valid, measurement.t_keyframe) = (t.0, t.0);
        Some(Entry { t, measurement, reading, sensor, place, outcome: None })
    }

    fn key(&self) -> (Time, usize, u32) {
        // `AIDING` begins with the ranges, which stand behind the others of their instant.
        let rank = if self.place == 0 { AIDING.len() } else { self.place };
        (self.t, rank, self.buoy())
    }

    /// Number of the buoy; 0 for other sensors.
    pub(crate) fn buoy(&self) -> u32 {
        if let Reading::Lbl { buoy, .. } = self.reading { buoy } else { 0 }
    }

    /// Whether both are ranges of one epoch, to be taken in together.
    fn is_of_epoch(&self, other: &Entry) -> bool {
        self.sensor == Sensor::Lbl
            && other.sensor == Sensor::Lbl
            && self.t == other.t
            && self.measurement.epoch == other.measurement.epoch
    }

    /// Notes what became of it, and puts the counts right if it was judged before.
    pub(crate) fn settle(&mut self, outcome: Outcome, counts: &mut SensorCounts) {
        match self.outcome {
            Some(Outcome::Used) => counts.used -= 1,
            Some(Outcome::Refused(reason)) => counts.rejected[reason.index()] -= 1,
            None => {}
        }
        match outcome {
            Outcome::Used => counts.used += 1,
            Outcome::Refused(reason) => counts.rejected[reason.index()] += 1,
        }
        self.outcome = Some(outcome);
    }
}

/// Readings in order. See the module.
#[derive(Clone, Debug)]
pub(crate) struct Timeline {
    entries: VecDeque<Entry>,
    /// So many have been taken in.
    done: usize,
}

impl Timeline {
    pub(crate) fn new() -> Timeline {
        Timeline { entries: VecDeque::with_capacity(READINGS_USUAL), done: 0 }
    }

    /// Puts a reading in its place. Whether that is behind everything that was taken in; `None` if there is no room.
    pub(crate) fn insert(&mut self, entry: Entry) -> Option<bool> {
        if self.entries.len() == READINGS_MAX {
            return None;
        }
        let key = entry.key();
        let at = self.entries.partition_point(|earlier| earlier.key() <= key);
        self.entries.insert(at, entry);
        let is_behind = at >= self.done;
        self.done += usize::from(!is_behind);
        Some(is_behind)
    }

    /// The next group to take in, if it is not later than `t_end`: one reading, or the ranges of an epoch.
    pub(crate) fn next_group(&self, t_end: Time) -> Option<core::ops::Range<usize>> {
        let first = self.entries.get(self.done).filter(|entry| entry.t <= t_end)?;
        let count = self.entries.range(self.done..).take_while(|other| first.is_of_epoch(other)).count().max(1);
        Some(self.done..self.done + count)
    }

    /// A group has been taken in.
    pub(crate) fn take(&mut self, group: &core::ops::Range<usize>) {
        self.done = group.end;
    }

    pub(crate) fn get_mut(&mut self, index: usize) -> &mut Entry {
        &mut self.entries[index]
    }

    /// Everything after `t` is to be taken in again.
    pub(crate) fn rewind_to(&mut self, t: Time) {
        self.done = self.entries.partition_point(|entry| entry.t <= t);
    }

    /// Forgets readings up to `t`, which have been taken in.
    pub(crate) fn forget_up_to(&mut self, t: Time) {
        while self.done > 0 && self.entries.front().is_some_and(|entry| entry.t <= t) {
            self.entries.pop_front();
            self.done -= 1;
        }
    }

    /// Removes every reading up to `t` and shows it; for what came before the start.
    pub(crate) fn drain_up_to(&mut self, t: Time, mut show: impl FnMut(&Entry)) {
        while let Some(entry) = self.entries.front().filter(|entry| entry.t <= t) {
            show(entry);
            self.entries.pop_front();
        }
        self.done = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(t: i64, reading: Reading) -> Entry {
        let mut measurement = Measurement::new(Time(t), Time(t), &reading);
        measurement.epoch = u32::from(matches!(reading, Reading::Lbl { .. }));
        Entry::new(Time(t), &measurement, reading).expect("an aiding sensor")
    }

    fn range(t: i64, buoy: u32) -> Entry {
        entry(t, Reading::Lbl { buoy, epoch: 1, range: 5.0, buoy_enu: [0.0; 3], buoy_sigma: 0.0, is_moored: true })
    }

    fn depth(t: i64) -> Entry {
        entry(t, Reading::Ps { depth: 1.0 })
    }

    #[test]
    fn ranges_stand_behind_their_instant_and_go_together() {
        let mut timeline = Timeline::new();
        for entry in [range(5, 2), range(5, 0), depth(5), depth(7)] {
            assert_eq!(timeline.insert(entry), Some(true));
        }
        let mut groups = Vec::new();
        while let Some(group) = timeline.next_group(Time(6)) {
            groups.push(group.clone());
            timeline.take(&group);
        }
        assert_eq!(groups, [0..1, 1..3]);
        assert_eq!((timeline.get_mut(1).buoy(), timeline.get_mut(2).buoy()), (0, 2));
    }

    #[test]
    fn a_late_reading_finds_its_place_and_rewinding_comes_back_to_it() {
        let mut timeline = Timeline::new();
        for t in [1, 3, 5] {
            timeline.insert(depth(t));
        }
        while let Some(group) = timeline.next_group(Time(4)) {
            timeline.take(&group);
        }
        assert_eq!(timeline.insert(depth(2)), Some(false));
        assert_eq!(timeline.next_group(Time(9)).map(|group| group.start), Some(3), "the one at 5 is still next");
        timeline.rewind_to(Time(1));
        assert_eq!(timeline.next_group(Time(9)), Some(1..2));
        timeline.forget_up_to(Time(4));
        assert_eq!(timeline.next_group(Time(9)), Some(0..1), "only what was taken in is forgotten");
    }

    #[test]
    fn a_reading_that_is_judged_again_is_counted_once() {
        let mut counts = SensorCounts::default();
        let mut depth = depth(1);
        depth.settle(Outcome::Used, &mut counts);
        depth.settle(Outcome::Refused(RejectReason::Gated), &mut counts);
        assert_eq!((counts.used, counts.rejected_total()), (0, 1));
    }
}
