//! The readings of one sensor, one after another: instants by its schedule, values by the instrument, losses by chance
//! and outage.

use std::collections::VecDeque;

use shared_types::{Duration, Message, Time};

use crate::noise::Draws;
use crate::scenario::Schedule;

/// A sensor: what it says at an instant.
pub(crate) trait Instrument {
    /// What it yields.
    type Reading: Message;

    /// Appends what it reads at `t` (true time) to `readings`. It takes the same number of draws at every call.
    fn read(&mut self, t: Time, draws: &mut Draws, readings: &mut Vec<Self::Reading>);

    /// Sees the readings of one instant that were not lost.
    fn complete(_readings: &mut [Self::Reading]) {}
}

/// Instants `phase + k/rate` from 0 to the end.
#[derive(Clone, Debug)]
struct Instants {
    phase: Time,
    rate: f64,
    next: u64,
    end: Time,
}

impl Iterator for Instants {
    type Item = Time;

    fn next(&mut self) -> Option<Time> {
        // Counted from the start: a period that is no whole number of nanoseconds does not add up its rounding.
        let t = self.phase + Duration((self.next as f64 * 1e9 / self.rate).round() as i64);
        self.next += 1;
        (t <= self.end).then_some(t)
    }
}

/// Readings of one sensor in order of time, numbered from 0. It owns all that it needs.
#[derive(Clone, Debug)]
pub(crate) struct Readings<I: Instrument> {
    instrument: I,
    instants: Instants,
    schedule: Schedule,
    draws: Draws,
    of_instant: Vec<I::Reading>,
    waiting: VecDeque<I::Reading>,
    sequence: u64,
}

impl<I: Instrument> Readings<I> {
    pub(crate) fn new(instrument: I, schedule: &Schedule, draws: Draws, duration: Duration) -> Readings<I> {
        let instants = Instants {
            phase: Time::from_seconds(schedule.phase),
            rate: schedule.rate,
            next: 0,
            end: Time(0) + duration,
        };
        Readings {
            instrument,
            instants,
            schedule: schedule.clone(),
            draws,
            of_instant: Vec::new(),
            waiting: VecDeque::new(),
            sequence: 0,
        }
    }
}

impl<I: Instrument> Iterator for Readings<I> {
    type Item = I::Reading;

    fn next(&mut self) -> Option<I::Reading> {
        while self.waiting.is_empty() {
            let t = self.instants.next()?;
            self.of_instant.clear();
            self.instrument.read(t, &mut self.draws, &mut self.of_instant);
            if self.schedule.dropout > 0.0 {
                let (draws, dropout) = (&mut self.draws, self.schedule.dropout);
                self.of_instant.retain(|_| draws.uniform() >= dropout);
            }
            if self.schedule.outages.iter().any(|[from, to]| (*from..=*to).contains(&t)) {
                continue;
            }
            I::complete(&mut self.of_instant);
            self.waiting.extend(self.of_instant.iter().copied());
        }
        let mut reading = self.waiting.pop_front()?;
        let header = reading.header_mut();
        header.t_valid = (Time(header.t_valid) + self.schedule.clock_offset).0;
        header.sequence = self.sequence;
        self.sequence += 1;
        Some(reading)
    }
}
