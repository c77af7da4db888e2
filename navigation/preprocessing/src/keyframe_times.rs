//! When is the next keyframe, and which were the last?
//!
//! ```text
//! start     at initial.t, or at the first IMU sample
//! lbl       at an LBL epoch, unless the last keyframe is closer than keyframes.min_spacing: then it is tied to that one
//! age       keyframes.max_age after the last one
//! imu_gap   at the sample that ends an IMU gap beyond imu.long_gap; none inside the gap
//! ```
//!
//! §4.1. The caller asks for what is due, takes up every reading up to that time, and then closes it; so a ping that comes
//! before the due time, or exactly at it, still changes what is due.

use std::collections::VecDeque;

use shared_types::{AnchorMethod, KeyframeCause, KeyframeConfig, Time};

/// The schedule of keyframes, and those that an estimator still has in its window.
#[derive(Clone, Debug)]
pub(crate) struct KeyframeTimes {
    config: KeyframeConfig,
    start: Option<Time>,
    ping: Option<Time>,
    gaps: VecDeque<Gap>,
    recent: VecDeque<Time>,
    /// Keyframes in a full window.
    window: usize,
}

/// A long silence of the IMU: last sample before it, first sample after.
#[derive(Clone, Copy, Debug)]
struct Gap {
    t_before: Time,
    t_end: Time,
}

impl KeyframeTimes {
    /// `intervals`: IMU intervals in the estimator's window, which then has one keyframe more.
    pub(crate) fn new(config: &KeyframeConfig, intervals: usize) -> KeyframeTimes {
        KeyframeTimes {
            config: *config,
            start: None,
            ping: None,
            gaps: VecDeque::with_capacity(8),
            recent: VecDeque::with_capacity(intervals + 2),
            window: intervals + 1,
        }
    }

    /// The estimation starts at `t`.
    pub(crate) fn on_start(&mut self, t: Time) {
        self.start = Some(t);
    }

    /// The IMU was silent for long.
    pub(crate) fn on_gap(&mut self, t_before: Time, t_end: Time) {
        self.gaps.push_back(Gap { t_before, t_end });
    }

    /// An LBL epoch at `t`: a keyframe, where the rules allow it.
    pub(crate) fn on_ping(&mut self, t: Time) {
        let Some(t_last) = self.t_last() else { return };
        let is_inside_a_gap = self.gaps.iter().any(|gap| gap.t_before < t && t < gap.t_end);
        if t - t_last >= self.config.min_spacing && !is_inside_a_gap {
            self.ping = Some(t);
        }
    }

    /// The next keyframe as far as is known now.
    pub(crate) fn due(&self) -> Option<(Time, KeyframeCause)> {
        let Some(t_last) = self.t_last() else {
            return self.start.map(|t| (t, KeyframeCause::Start));
        };
        let t_age = t_last + self.config.max_age;
        let gap = self.gaps.iter().find(|gap| gap.t_end - t_last >= self.config.min_spacing);
        let (t_due, cause) = match gap {
            Some(gap) if t_age > gap.t_before => (gap.t_end, KeyframeCause::ImuGap),
            _ => (t_age, KeyframeCause::Age),
        };
        match self.ping {
            Some(t_ping) if t_ping < t_due || (t_ping == t_due && cause == KeyframeCause::Age) => {
                Some((t_ping, KeyframeCause::Lbl))
            }
            _ => Some((t_due, cause)),
        }
    }

    /// Whether a keyframe at `t` keeps the spacing.
    pub(crate) fn may_close(&self, t: Time) -> bool {
        self.t_last().is_some_and(|t_last| t - t_last >= self.config.min_spacing)
    }

    /// There is a keyframe at `t` now, the newest.
    pub(crate) fn close(&mut self, t: Time) {
        self.ping = None;
        self.gaps.retain(|gap| gap.t_end > t);
        if self.recent.len() == self.window {
            self.recent.pop_front();
        }
        self.recent.push_back(t);
    }

    /// The newest keyframe.
    pub(crate) fn t_last(&self) -> Option<Time> {
        self.recent.back().copied()
    }

    /// The keyframe to which a reading at `t` is tied: the nearer neighbour, of two equally near ones the earlier; with
    /// [`AnchorMethod::Fpf`] and [`AnchorMethod::Joint`] always the earlier neighbour. `None` where every keyframe of a window is later, or where
    /// there is no keyframe yet.
    ///
    /// A reading before the very first keyframe (of the initialisation) is tied to that.
    pub(crate) fn anchor(&self, t: Time) -> Option<Time> {
        let after = self.recent.partition_point(|&t_keyframe| t_keyframe <= t);
        let before = after.checked_sub(1).map(|index| self.recent[index]);
        match (before, self.recent.get(after)) {
            (Some(before), Some(&after)) => {
                let is_nearer_to_after = after - t < t - before;
                let is_always_forward = matches!(self.config.anchor, AnchorMethod::Fpf | AnchorMethod::Joint);
                Some(if is_nearer_to_after && !is_always_forward { after } else { before })
            }
            (None, Some(&first)) => (self.recent.len() == 1 && Some(first) == self.start).then_some(first),
            (before, None) => before,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::Navigator;

    fn at(t: f64) -> Time {
        Time::from_seconds(t)
    }

    /// Keyframe at 10 s, `max_age` 1.25 s, `min_spacing` 0.2 s.
    fn started() -> KeyframeTimes {
        let mut times = KeyframeTimes::new(&Navigator::default().keyframes, 20);
        times.on_start(at(10.0));
        assert_eq!(times.due(), Some((at(10.0), KeyframeCause::Start)));
        times.close(at(10.0));
        times
    }

    #[test]
    fn nothing_is_due_before_the_start_is_known() {
        assert_eq!(KeyframeTimes::new(&Navigator::default().keyframes, 20).due(), None);
    }

    #[test]
    fn without_pings_keyframes_come_by_age() {
        let mut times = started();
        assert_eq!(times.due(), Some((at(11.25), KeyframeCause::Age)));
        times.close(at(11.25));
        assert_eq!(times.due(), Some((at(12.5), KeyframeCause::Age)));
    }

    #[test]
    fn a_ping_makes_a_keyframe_unless_one_is_close_before_it() {
        let mut times = started();
        times.on_ping(at(10.19));
        assert_eq!(times.due(), Some((at(11.25), KeyframeCause::Age)));
        times.on_ping(at(10.2));
        assert_eq!(times.due(), Some((at(10.2), KeyframeCause::Lbl)));
        times.close(at(10.2));
        assert_eq!(times.due(), Some((at(11.45), KeyframeCause::Age)));
    }

    #[test]
    fn a_ping_at_the_due_time_gives_the_keyframe_its_name() {
        let mut times = started();
        times.on_ping(at(11.25));
        assert_eq!(times.due(), Some((at(11.25), KeyframeCause::Lbl)));
    }

    #[test]
    fn a_late_ping_makes_no_keyframe() {
        let mut times = started();
        times.on_ping(at(9.0));
        assert_eq!(times.due(), Some((at(11.25), KeyframeCause::Age)));
    }

    #[test]
    fn a_long_gap_ends_with_a_keyframe_and_has_none_inside() {
        let mut times = started();
        times.on_gap(at(10.5), at(14.0));
        times.on_ping(at(12.0));
        assert_eq!(times.due(), Some((at(14.0), KeyframeCause::ImuGap)));
        times.close(at(14.0));
        assert_eq!(times.due(), Some((at(15.25), KeyframeCause::Age)));
    }

    #[test]
    fn a_keyframe_that_was_due_before_the_gap_comes_first() {
        let mut times = started();
        times.on_gap(at(11.3), at(14.0));
        assert_eq!(times.due(), Some((at(11.25), KeyframeCause::Age)));
        times.close(at(11.25));
        assert_eq!(times.due(), Some((at(14.0), KeyframeCause::ImuGap)));
    }

    #[test]
    fn a_ping_close_after_an_age_keyframe_is_tied_to_it() {
        let mut times = started();
        times.close(at(11.25));
        times.on_ping(at(11.3));
        assert_eq!(times.due(), Some((at(12.5), KeyframeCause::Age)));
        times.close(at(12.5));
        assert_eq!(times.anchor(at(11.3)), Some(at(11.25)));
    }

    #[test]
    fn the_nearer_keyframe_anchors_and_of_equals_the_earlier() {
        let mut times = started();
        times.close(at(11.0));
        for (t, anchor) in [(10.1, 10.0), (10.5, 10.0), (10.51, 11.0), (11.0, 11.0), (11.9, 11.0)] {
            assert_eq!(times.anchor(at(t)), Some(at(anchor)), "reading at {t}");
        }
    }

    #[test]
    fn forward_only_anchors_to_the_keyframe_before() {
        let mut times = started();
        times.config.anchor = AnchorMethod::Fpf;
        times.close(at(11.0));
        for (t, anchor) in [(10.1, 10.0), (10.99, 10.0), (11.0, 11.0)] {
            assert_eq!(times.anchor(at(t)), Some(at(anchor)), "reading at {t}");
        }
    }

    #[test]
    fn readings_older_than_the_window_have_no_anchor() {
        let mut times = KeyframeTimes::new(&Navigator::default().keyframes, 2);
        times.on_start(at(10.0));
        times.close(at(10.0));
        assert_eq!(times.anchor(at(9.0)), Some(at(10.0)), "the initialisation's readings hold to the first keyframe");
        for t in [11.0, 12.0, 13.0] {
            times.close(at(t));
        }
        assert_eq!(times.anchor(at(10.9)), None);
        assert_eq!(times.anchor(at(11.2)), Some(at(11.0)));
    }
}
