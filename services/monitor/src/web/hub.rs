//! What the page's thread knows: looks come in, events go out to whoever listens, the past is kept for those who come late.
//!
//! Everything is bounded: the queue of looks, the ring of events that slow listeners fall behind in, and the history.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use axum::body::Bytes;
use tokio::sync::broadcast;

use crate::compact::compact_json;
use crate::detail::News;
use crate::history::{History, Kind, Limits, Sample};
use crate::snapshot::Snapshot;

/// Events that a listener may be behind: some ten seconds.
const BEHIND: usize = 160;

/// Between two states, in looks: twice a second.
const STATE_EVERY: u64 = 5;

/// Between two states that the history keeps, in looks.
const KEEP_EVERY: u64 = 20;

/// A history that was written out is given out again for so long.
const FRESH: Duration = Duration::from_secs(1);

/// Without a look for so long, the monitor hangs.
const ALIVE: Duration = Duration::from_secs(3);

/// One look of the monitor.
#[derive(Clone, Debug)]
pub(crate) struct Look {
    pub(crate) snapshot: Snapshot,
    pub(crate) news: News,
}

/// What the page's thread knows.
#[derive(Debug)]
pub(super) struct Hub {
    kind: Kind,
    title: String,
    events: broadcast::Sender<Bytes>,
    known: Mutex<Known>,
}

#[derive(Debug)]
struct Known {
    history: History,
    newest: Arc<Snapshot>,
    looks: u64,
    looked: Instant,
    /// The history as it was written out, and when.
    written: Option<(Instant, Bytes)>,
}

impl Hub {
    /// Of a run that goes on.
    pub(super) fn live(snapshot: Snapshot) -> Hub {
        let title = snapshot.prefix.clone();
        Hub::new(Kind::Live, title, History::new(Limits::LIVE), snapshot, None)
    }

    /// Of a run that has ended; `json` is its history, written out.
    pub(super) fn finished(json: String, snapshot: Snapshot) -> Hub {
        let written = Some((Instant::now(), Bytes::from(json)));
        Hub::new(Kind::Finished, String::new(), History::new(Limits::FINISHED), snapshot, written)
    }

    fn new(kind: Kind, title: String, history: History, snapshot: Snapshot, written: Option<(Instant, Bytes)>) -> Hub {
        let newest = Arc::new(snapshot);
        let known = Known { history, newest, looks: 0, looked: Instant::now(), written };
        Hub { kind, title, events: broadcast::Sender::new(BEHIND), known: Mutex::new(known) }
    }

    /// Takes in a look and tells everybody who listens.
    pub(super) fn fold(&self, look: Look) {
        let mut known = self.known();
        let sample = Sample::of(&look.snapshot);
        if let Some(sample) = sample {
            known.history.sample(sample);
        }
        for keyframe in &look.news.keyframes {
            let json = compact_json(keyframe);
            known.history.keyframe(keyframe, &json);
            self.tell("keyframe", &json);
        }
        for fix in &look.news.fixes {
            let json = compact_json(fix);
            known.history.fix(&json);
            self.tell("fix", &json);
        }
        if known.looks.is_multiple_of(KEEP_EVERY) {
            known.history.state(&look.snapshot.brief_json());
        }
        let is_news =
            look.snapshot.events.len() != known.newest.events.len() || look.snapshot.mode != known.newest.mode;
        if self.events.receiver_count() > 0 {
            self.tell("look", &sample.map_or_else(|| "{\"t\":null}".to_owned(), |sample| sample.json()));
            if is_news || known.looks.is_multiple_of(STATE_EVERY) {
                self.tell("state", &compact_json(&look.snapshot));
            }
        }
        known.looks += 1;
        known.looked = Instant::now();
        known.newest = Arc::new(look.snapshot);
    }

    /// Events from now on, and the first words of a stream.
    pub(super) fn listen(&self) -> (broadcast::Receiver<Bytes>, Bytes) {
        let state = event("state", &compact_json(&*self.newest()));
        (self.events.subscribe(), Bytes::from([b"retry: 1000\n\n".as_slice(), &state].concat()))
    }

    /// Whether there is something to listen to.
    pub(super) fn is_live(&self) -> bool {
        self.kind == Kind::Live
    }

    /// The newest snapshot.
    pub(super) fn newest(&self) -> Arc<Snapshot> {
        Arc::clone(&self.known().newest)
    }

    /// Whether looks still come.
    pub(super) fn is_alive(&self) -> bool {
        !self.is_live() || self.known().looked.elapsed() < ALIVE
    }

    /// The history as JSON, at most a second old: a hundred clients who come at once cost one writing.
    pub(super) fn history(&self) -> Bytes {
        let mut known = self.known();
        if let Some((at, written)) = &known.written
            && (!self.is_live() || at.elapsed() < FRESH)
        {
            return written.clone();
        }
        let written = Bytes::from(known.history.json(self.kind, &self.title, &known.newest));
        known.written = Some((Instant::now(), written.clone()));
        written
    }

    fn tell(&self, name: &str, json: &str) {
        // Nobody listens: that is no error.
        let _ = self.events.send(event(name, json));
    }

    fn known(&self) -> std::sync::MutexGuard<'_, Known> {
        // A panic in one answer leaves nothing half done that another could not use.
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// As server-sent events are written.
fn event(name: &str, json: &str) -> Bytes {
    Bytes::from(format!("event: {name}\ndata: {json}\n\n"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Model;
    use crate::testing::{keyframe_at, mission_under_way};

    fn look(model: &Model) -> Look {
        Look { snapshot: model.snapshot(), news: News { keyframes: vec![keyframe_at(5.0)], fixes: Vec::new() } }
    }

    #[test]
    fn every_look_is_told_even_before_anything_is_known() {
        let model = Model::new("main");
        let hub = Hub::live(model.snapshot());
        let (mut events, first) = hub.listen();
        assert!(first.starts_with(b"retry: 1000\n\nevent: state\ndata: {"), "{first:?}");
        for _ in 0..10 {
            hub.fold(Look { snapshot: model.snapshot(), news: News::default() });
        }
        let told: Vec<Bytes> = std::iter::from_fn(|| events.try_recv().ok()).collect();
        assert_eq!(told.iter().filter(|event| event.starts_with(b"event: look\n")).count(), 10);
        assert_eq!(told.iter().filter(|event| event.starts_with(b"event: state\n")).count(), 2);
    }

    #[test]
    fn a_listener_that_falls_behind_is_told_so_and_memory_stays_bounded() {
        let hub = Hub::live(mission_under_way().snapshot());
        let (mut events, _) = hub.listen();
        for _ in 0..(3 * BEHIND) {
            hub.fold(look(&mission_under_way()));
        }
        assert!(matches!(events.try_recv(), Err(broadcast::error::TryRecvError::Lagged(_))));
        let rest = std::iter::from_fn(|| events.try_recv().ok()).count();
        assert!(rest <= BEHIND.next_power_of_two(), "{rest}");
    }

    #[test]
    fn the_history_is_written_once_for_all_who_ask_within_a_second() {
        let hub = Hub::live(mission_under_way().snapshot());
        hub.fold(look(&mission_under_way()));
        let (first, second) = (hub.history(), hub.history());
        assert_eq!(first.as_ptr(), second.as_ptr());
        let json: serde_json::Value = serde_json::from_slice(&first).expect("valid JSON");
        assert_eq!((json["kind"].as_str(), json["keyframes"][0]["t"].as_f64()), (Some("live"), Some(5.0)));
        assert_eq!(json["states"][0]["sensors"][1]["sensor"], "lbl");
    }
}
