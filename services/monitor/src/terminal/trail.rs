//! The past that the terminal draws: track, errors and the newest keyframes.

use std::collections::VecDeque;

use crate::detail::{Fate, Fix, KeyframeDetail, News};
use crate::history::{Sample, Series};
use crate::snapshot::Snapshot;

/// Points of the track: more than a terminal has.
const TRACK: usize = 1500;

/// Points of the strips: two minutes at ten a second.
const NEWEST: usize = 1200;

/// Keyframes: more than a window's strip has room for.
const KEYFRAMES: usize = 200;

/// Fixes on the map.
const FIXES: usize = 200;

/// What has been.
#[derive(Clone, Debug)]
pub(crate) struct Trail {
    track: Series<Sample>,
    newest: VecDeque<Sample>,
    keyframes: VecDeque<KeyframeDetail>,
    fixes: VecDeque<Fix>,
}

impl Trail {
    pub(crate) fn new() -> Trail {
        Trail {
            track: Series::new(TRACK, Sample::outweigh),
            newest: VecDeque::new(),
            keyframes: VecDeque::new(),
            fixes: VecDeque::new(),
        }
    }

    /// Takes in a look.
    pub(crate) fn fold(&mut self, snapshot: &Snapshot, news: &News) {
        if let Some(sample) = Sample::of(snapshot)
            && self.newest.back().is_none_or(|last| last.t < sample.t)
        {
            self.track.push(sample);
            push_bounded(&mut self.newest, sample, NEWEST);
        }
        news.keyframes.iter().for_each(|keyframe| push_bounded(&mut self.keyframes, keyframe.clone(), KEYFRAMES));
        news.fixes.iter().for_each(|fix| push_bounded(&mut self.fixes, fix.clone(), FIXES));
    }

    /// The track, thin.
    pub(super) fn track(&self) -> &[Sample] {
        self.track.items()
    }

    /// The newest samples, as they came.
    pub(super) fn newest(&self) -> &VecDeque<Sample> {
        &self.newest
    }

    /// The newest keyframes.
    pub(super) fn keyframes(&self) -> &VecDeque<KeyframeDetail> {
        &self.keyframes
    }

    /// East and north of the fixes that were used, or of those that were refused, m.
    pub(super) fn fixes(&self, refused: bool) -> Vec<(f64, f64)> {
        let wanted = |fix: &&Fix| matches!(fix.fate, Fate::Refused(_)) == refused;
        self.fixes.iter().filter(wanted).map(|fix| (fix.position_enu[0], fix.position_enu[1])).collect()
    }
}

fn push_bounded<T>(list: &mut VecDeque<T>, item: T, limit: usize) {
    if list.len() == limit {
        list.pop_front();
    }
    list.push_back(item);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{keyframe_at, mission_under_way};

    #[test]
    fn the_past_is_bounded_and_time_runs_forward() {
        let mut trail = Trail::new();
        let mut snapshot = mission_under_way().snapshot();
        for index in 0..10_000 {
            snapshot.t = Some(f64::from(index) * 0.1);
            trail.fold(&snapshot, &News { keyframes: vec![keyframe_at(f64::from(index))], fixes: Vec::new() });
            trail.fold(&snapshot, &News::default());
        }
        assert!(trail.track().len() <= TRACK && trail.keyframes().len() == KEYFRAMES);
        assert_eq!(trail.newest().len(), NEWEST);
        assert!(trail.track().windows(2).all(|pair| pair[0].t < pair[1].t));
    }
}
