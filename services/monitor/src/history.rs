//! What a page that opens late needs of the past: bounded memory whatever the length of the run, dense near the end, thin
//! far back.

mod consistency;
mod sample;
mod series;

use core::fmt::Write;
use std::collections::VecDeque;

use shared_types::AIDING;

use crate::compact::compact_json;
use crate::detail::KeyframeDetail;
use crate::snapshot::Snapshot;
use consistency::Consistency;
pub use sample::Sample;
use sample::{columns, push_numbers};
pub(crate) use series::Series;

/// How much is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Points of the track over the whole run.
    pub track: usize,
    /// Points of the newest stretch of it, which is kept as it came.
    pub newest: usize,
    /// Keyframes with all their factors, the newest.
    pub keyframes: usize,
    /// States of the tables over the whole run.
    pub states: usize,
    /// Points of each series that belongs to keyframes, over the whole run.
    pub solutions: usize,
    /// Fixes, the newest.
    pub fixes: usize,
}

impl Limits {
    /// For a live run: some 10 MB at most.
    pub const LIVE: Limits =
        Limits { track: 4000, newest: 3000, keyframes: 400, states: 240, solutions: 1500, fixes: 1000 };

    /// For a finished run, which is looked at as a whole.
    pub const FINISHED: Limits =
        Limits { track: 12_000, newest: 0, keyframes: 20_000, states: 1200, solutions: 3000, fixes: 5000 };
}

/// What a solve left, merged over stretches.
#[derive(Clone, Debug)]
struct Solved {
    t: f64,
    /// Longest solve, s.
    solve: f64,
    /// Most iterations.
    iterations: u32,
    /// Offset and sigma per aiding sensor, s.
    time_offsets: [[f64; 2]; AIDING.len()],
}

impl Solved {
    fn of(keyframe: &KeyframeDetail) -> Solved {
        Solved {
            t: keyframe.t,
            solve: keyframe.solve.unwrap_or(f64::NAN),
            iterations: keyframe.iterations,
            time_offsets: core::array::from_fn(|place| match keyframe.time_offsets.get(place) {
                Some(&[offset, sigma]) if sigma > 0.0 => [offset, sigma],
                _ => [f64::NAN; 2],
            }),
        }
    }

    fn merge(&mut self, later: Solved) {
        // `max` passes over a NaN on either side.
        self.solve = self.solve.max(later.solve);
        self.iterations = self.iterations.max(later.iterations);
        self.time_offsets = later.time_offsets;
    }
}

/// The past of a run.
#[derive(Clone, Debug)]
pub struct History {
    limits: Limits,
    track: Series<Sample>,
    newest: VecDeque<Sample>,
    solutions: Series<Solved>,
    consistency: Consistency,
    /// JSON of each with its time.
    keyframes: VecDeque<String>,
    fixes: VecDeque<String>,
    states: Series<String>,
    t_last: f64,
}

impl History {
    /// Nothing has happened yet.
    pub fn new(limits: Limits) -> History {
        History {
            limits,
            track: Series::new(limits.track, Sample::outweigh),
            newest: VecDeque::new(),
            solutions: Series::new(limits.solutions, Solved::merge),
            consistency: Consistency::new(limits.solutions),
            keyframes: VecDeque::new(),
            fixes: VecDeque::new(),
            states: Series::new(limits.states, |_, _| {}),
            t_last: f64::NEG_INFINITY,
        }
    }

    /// Takes in a point of the track. One that is no later than the last is left out, unless time begins anew: then
    /// everything before is forgotten.
    pub fn sample(&mut self, sample: Sample) {
        /// A restarted propagator repeats a little; a step back beyond this is another run, s.
        const ANOTHER_RUN: f64 = 10.0;
        if sample.t < self.t_last - ANOTHER_RUN {
            *self = History::new(self.limits);
        }
        if sample.t <= self.t_last {
            return;
        }
        self.t_last = sample.t;
        self.track.push(sample);
        if self.limits.newest > 0 {
            push_bounded(&mut self.newest, sample, self.limits.newest);
        }
    }

    /// Takes in a state of the tables, as JSON.
    pub fn state(&mut self, json: &str) {
        self.states.push(json.to_owned());
    }

    /// Takes in a keyframe, with the JSON that it has become.
    pub fn keyframe(&mut self, keyframe: &KeyframeDetail, json: &str) {
        self.solutions.push(Solved::of(keyframe));
        self.consistency.push(keyframe);
        push_bounded(&mut self.keyframes, json.to_owned(), self.limits.keyframes);
    }

    /// Takes in the JSON of a [`crate::Fix`].
    pub fn fix(&mut self, json: &str) {
        push_bounded(&mut self.fixes, json.to_owned(), self.limits.fixes);
    }

    /// The whole as JSON; `now` is the newest state.
    pub fn json(&self, kind: Kind, title: &str, now: &Snapshot) -> String {
        let mut out = String::with_capacity(1 << 20);
        let title = serde_json::to_string(title).expect("a string is JSON");
        let _ = write!(out, "{{\"schema\":1,\"kind\":\"{}\",\"title\":{title},\"track\":", kind.name());
        let dense_from = self.newest.front().map_or(f64::INFINITY, |sample| sample.t);
        let thin = self.track.items().iter().filter(move |sample| sample.t < dense_from);
        columns(&mut out, thin.chain(&self.newest));
        out.push_str(",\"solutions\":");
        self.solutions_json(&mut out);
        out.push_str(",\"nis\":");
        self.consistency.json(&mut out);
        push_list(&mut out, "keyframes", self.keyframes.iter());
        push_list(&mut out, "fixes", self.fixes.iter());
        push_list(&mut out, "states", self.states.items().iter());
        let now = compact_json(now);
        let _ = write!(out, ",\"now\":{now}}}");
        out
    }

    fn solutions_json(&self, out: &mut String) {
        let items = self.solutions.items();
        out.push_str("{\"t\":");
        push_numbers(out, items.iter().map(|solved| solved.t), 3);
        out.push_str(",\"solve\":");
        push_numbers(out, items.iter().map(|solved| solved.solve), 7);
        out.push_str(",\"iterations\":");
        push_numbers(out, items.iter().map(|solved| f64::from(solved.iterations)), 0);
        for (place, sensor) in AIDING.into_iter().enumerate() {
            for (part, name) in ["offset", "offset_sigma"].into_iter().enumerate() {
                let _ = write!(out, ",\"{name}_{sensor}\":");
                push_numbers(out, items.iter().map(|solved| solved.time_offsets[place][part]), 5);
            }
        }
        out.push('}');
    }
}

/// What a page shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A run that goes on.
    Live,
    /// A run that has ended.
    Finished,
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Kind::Live => "live",
            Kind::Finished => "finished",
        }
    }
}

fn push_bounded<T>(list: &mut VecDeque<T>, item: T, limit: usize) {
    if list.len() >= limit {
        list.pop_front();
    }
    list.push_back(item);
}

fn push_list<'a>(out: &mut String, name: &str, items: impl Iterator<Item = &'a String>) {
    let _ = write!(out, ",\"{name}\":[");
    for (index, item) in items.enumerate() {
        if index > 0 {
            out.push(',');
        }
        out.push_str(item);
    }
    out.push(']');
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{keyframe_at, mission_under_way};

    fn sample_at(t: f64) -> Sample {
        Sample { t, ..Sample::of(&mission_under_way().snapshot()).expect("time is known") }
    }

    fn parsed(history: &History) -> serde_json::Value {
        let now = mission_under_way().snapshot();
        serde_json::from_str(&history.json(Kind::Live, "main", &now)).expect("valid JSON")
    }

    fn times(json: &serde_json::Value) -> Vec<f64> {
        json["track"]["t"].as_array().expect("a column").iter().filter_map(serde_json::Value::as_f64).collect()
    }

    #[test]
    fn hours_are_kept_thin_and_the_newest_minutes_dense() {
        let template = sample_at(0.0);
        let mut history = History::new(Limits::LIVE);
        (0..400_000).for_each(|index| history.sample(Sample { t: f64::from(index) * 0.1, ..template }));
        let times = times(&parsed(&history));
        assert!(times.len() <= Limits::LIVE.track + Limits::LIVE.newest, "{}", times.len());
        assert!(times.windows(2).all(|pair| pair[0] < pair[1]), "in order, and nothing twice");
        assert_eq!((times[0], times[times.len() - 1]), (0.0, 39_999.9));
        let newest = &times[times.len() - 3000..];
        assert!((newest[2999] - newest[0] - 299.9).abs() < 1e-6, "five minutes at ten a second");
    }

    #[test]
    fn keyframes_are_bounded_but_their_sums_go_back_to_the_beginning() {
        let mut history = History::new(Limits::LIVE);
        for index in 0..1000 {
            let keyframe = keyframe_at(f64::from(index));
            history.keyframe(&keyframe, &compact_json(&keyframe));
        }
        let json = parsed(&history);
        assert_eq!(json["keyframes"].as_array().expect("a list").len(), Limits::LIVE.keyframes);
        assert_eq!(json["keyframes"][0]["t"], 600.0);
        assert_eq!((json["solutions"]["t"][0].as_f64(), json["nis"]["lbl"]["t"][0].as_f64()), (Some(0.0), Some(0.0)));
        assert_eq!(json["solutions"]["offset_lbl"][0], 0.05);
        assert!(json["solutions"]["offset_dvl"][0].is_null(), "nothing spoke against its stamps");
    }

    #[test]
    fn a_run_that_begins_anew_is_another_one_and_a_repetition_is_left_out() {
        let mut history = History::new(Limits::LIVE);
        for t in [100.0, 101.0, 100.5, 101.5] {
            history.sample(sample_at(t));
        }
        assert_eq!(times(&parsed(&history)), [100.0, 101.0, 101.5]);
        history.sample(sample_at(3.0));
        assert_eq!(times(&parsed(&history)), [3.0]);
    }

    #[test]
    fn before_anything_happened_it_is_valid_json_all_the_same() {
        let json = parsed(&History::new(Limits::FINISHED));
        assert_eq!((json["kind"].as_str(), json["keyframes"].as_array().map(Vec::len)), (Some("live"), Some(0)));
        assert_eq!(json["now"]["mode"], "OK");
    }
}
