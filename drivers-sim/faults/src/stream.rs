//! Readings in, failing readings out, in the order of their arrival.
//!
//! A reading arrives when it did before any fault, or later by what the faults say. Those that are late wait in a heap until
//! the stream has come to their time; equal times keep the order of the stream.

use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

use shared_types::{Duration, RawReading, SENSORS, Time};

use crate::draws::Draws;
use crate::effect::{Effect, Fate, Moment, Passing};
use crate::effects::content::header_mut;
use crate::spec::FaultSpec;

/// What says when a reading of the source arrives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArrivalClock {
    /// Its `t_valid`: sensor models and plain logs, whose readings arrive as they are valid.
    Valid,
    /// Its `t_arrival`: recordings.
    Arrival,
}

/// What a fault has done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Readings that it saw within its span.
    pub seen: u64,
    /// Of these: changed or delayed.
    pub touched: u64,
    /// Of these: lost.
    pub lost: u64,
    /// Of these: sent twice.
    pub repeated: u64,
}

/// A fault ready to act.
#[derive(Debug)]
struct Armed {
    spec: FaultSpec,
    effect: Box<dyn Effect>,
    draws: Draws,
    began: Option<Time>,
    tally: Tally,
}

impl Armed {
    fn apply(&mut self, t: Time, passing: &mut Passing) -> Fate {
        let first = *self.began.get_or_insert(self.spec.span.from.unwrap_or(t));
        if !self.spec.span.holds(t) {
            self.effect.outside(&passing.reading);
            return Fate::Untouched;
        }
        let at = Moment { t, since: (t - first).as_seconds() };
        let fate = self.effect.apply(&at, passing, &mut self.draws);
        self.tally.seen += 1;
        match fate {
            Fate::Untouched => {}
            Fate::Touched => self.tally.touched += 1,
            Fate::Lost => self.tally.lost += 1,
            Fate::Repeated(_) => self.tally.repeated += 1,
        }
        fate
    }
}

/// A reading on its way; ordered by arrival, then as the source had it.
#[derive(Debug)]
struct Waiting {
    t_arrival: i64,
    order: u64,
    reading: RawReading,
}

impl PartialEq for Waiting {
    fn eq(&self, other: &Waiting) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Waiting {}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Waiting) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Waiting {
    fn cmp(&self, other: &Waiting) -> Ordering {
        (self.t_arrival, self.order).cmp(&(other.t_arrival, other.order))
    }
}

/// Faults between a source of readings and whoever takes them.
///
/// `push` a reading, then `pop` until there is none; at the end `finish` and `pop` the rest. Each reading comes out with
/// `header.t_arrival` on the clock of the source. Without faults it hands on what it is given.
#[derive(Debug)]
pub struct FaultStream {
    /// By sensor, in the order in which they were asked for.
    armed: [Vec<Armed>; SENSORS.len()],
    clock: ArrivalClock,
    waiting: BinaryHeap<Reverse<Waiting>>,
    order: u64,
    /// The source has come so far.
    horizon: i64,
}

impl FaultStream {
    /// Faults that draw from `seed`.
    pub fn new(specs: &[FaultSpec], seed: u64, clock: ArrivalClock) -> FaultStream {
        let mut armed: [Vec<Armed>; SENSORS.len()] = Default::default();
        for spec in specs {
            let name = format!("{}.{}", spec.sensor.name(), spec.class.name);
            let of_sensor = &mut armed[spec.sensor.index()];
            let ordinal = of_sensor.iter().filter(|other| other.spec.class.name == spec.class.name).count();
            of_sensor.push(Armed {
                spec: spec.clone(),
                effect: (spec.class.make)(&spec.values),
                draws: Draws::new(seed, &name, ordinal),
                began: None,
                tally: Tally::default(),
            });
        }
        FaultStream { armed, clock, waiting: BinaryHeap::new(), order: 0, horizon: i64::MIN }
    }

    /// Whether there is no fault at all.
    pub fn is_empty(&self) -> bool {
        self.armed.iter().all(Vec::is_empty)
    }

    /// Takes the next reading of the source.
    pub fn push(&mut self, reading: RawReading) {
        let t = reading.t_valid();
        let arrives = match self.clock {
            ArrivalClock::Valid => t.0,
            ArrivalClock::Arrival => reading.header().t_arrival,
        };
        self.horizon = self.horizon.max(arrives);
        let mut passing = Passing { reading, delay: Duration::ZERO };
        let mut repeats: Vec<Duration> = Vec::new();
        for armed in &mut self.armed[reading.sensor().index()] {
            match armed.apply(t, &mut passing) {
                Fate::Untouched | Fate::Touched => {}
                Fate::Lost => return,
                Fate::Repeated(after) => repeats.push(after),
            }
        }
        let t_arrival = Time(arrives) + passing.delay;
        self.send(t_arrival, passing.reading);
        for after in repeats {
            self.send(t_arrival + after, passing.reading);
        }
    }

    fn send(&mut self, t_arrival: Time, mut reading: RawReading) {
        header_mut(&mut reading).t_arrival = t_arrival.0;
        self.waiting.push(Reverse(Waiting { t_arrival: t_arrival.0, order: self.order, reading }));
        self.order += 1;
    }

    /// The next reading that has arrived by now.
    pub fn pop(&mut self) -> Option<RawReading> {
        let Reverse(next) = self.waiting.peek()?;
        if next.t_arrival > self.horizon {
            return None;
        }
        self.waiting.pop().map(|Reverse(waiting)| waiting.reading)
    }

    /// The source is at its end: all that is late arrives.
    pub fn finish(&mut self) {
        self.horizon = i64::MAX;
    }

    /// What each fault has done, by sensor and then as they were asked for.
    pub fn tallies(&self) -> impl Iterator<Item = (&FaultSpec, Tally)> {
        self.armed.iter().flatten().map(|armed| (&armed.spec, armed.tally))
    }

    /// Draws readings from `source` as they are asked for.
    pub fn over<I, E>(self, source: I) -> Faulted<I>
    where
        I: Iterator<Item = Result<RawReading, E>>,
    {
        Faulted { stream: self, source, at_end: false }
    }
}

/// A source with its faults. An error of the source comes out at once and ends it.
#[derive(Debug)]
pub struct Faulted<I> {
    stream: FaultStream,
    source: I,
    at_end: bool,
}

impl<I, E> Iterator for Faulted<I>
where
    I: Iterator<Item = Result<RawReading, E>>,
{
    type Item = Result<RawReading, E>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(reading) = self.stream.pop() {
                return Some(Ok(reading));
            }
            if self.at_end {
                return None;
            }
            match self.source.next() {
                Some(Ok(reading)) => self.stream.push(reading),
                Some(Err(error)) => {
                    self.at_end = true;
                    return Some(Err(error));
                }
                None => {
                    self.at_end = true;
                    self.stream.finish();
                }
            }
        }
    }
}
